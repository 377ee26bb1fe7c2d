"""Arguments of the kernels of the spatial rod: the rod, its loads, the wall, and buffers."""

from typing import NamedTuple

import numpy as np

from ...types import FloatArray
from ._rod import SpatialRod


class Elastic(NamedTuple):
    """The values of the rod; k = segments + 1 joints, each in front of one element (segments, then the electrode).

    Attributes:
        span: (k,) length of shaft of each joint.
        ei: (k,) bending stiffness.
        gj: (k,) torsional stiffness.
        rest: (k, 3) pre-curvature.
        soft: 1 / k_s^2.
        reach: (k,) length of each element; the last one's is the lever of the loaded point.
        memory: (k, 3) crept strain.
        maxwell: relative stiffness of the Maxwell spring.
        small: EI / length of the shaft.
    """

    span: FloatArray
    ei: FloatArray
    gj: FloatArray
    rest: FloatArray
    soft: float
    reach: FloatArray
    memory: FloatArray
    maxwell: float
    small: float


class Load(NamedTuple):
    """Dead loads, base frame.

    Attributes:
        force: (3,) force at the lever's end.
        moment: (3,) moment on the electrode.
        line: (k, 3) derivative of a distributed load's work by each element's direction, in N m.
    """

    force: FloatArray
    moment: FloatArray
    line: FloatArray


class Touch(NamedTuple):
    """A ball at the lever's end, and the shaft's side, against a plane that yields.

    Normal force = ``stiffness`` x depth (or x depth^1.5 ``hertz`` if that is positive, or the exponential law of
    `exponential_spring` if ``growth`` is) + ``rate`` x (depth - ``indentation``), on depths beyond ``rest`` only.

    Attributes:
        active: whether there is a wall.
        axes: (3, 3) rows d (into the wall), t1, t2.
        place: position of the undeformed plane along d, minus the part of the clamp's advance along d.
        radius: radius of the ball.
        stiffness: see above.
        hertz: see above; 0: linear.
        rate: damping over the time step.
        indentation: depth at the last instant.
        rest: depth beyond which the wall touches the ball.
        kt: stiffness of the tie between the touching point and ``zero``; 0: no tie.
        zero: (2,) end of the tie along t1 and t2.
        arm: (3,) touching point relative to the ball's centre, in the electrode's frame.
        drag: (2,) dead tangential force, without a tie.
        friction: Coulomb's coefficient, at whose limit the tie slips without energy; negative: it never slips.
        side: stiffness of the contact of each node of the shaft.
        side_radius: radius of the shaft.
        growth: see above; 0: no exponential law.
    """

    active: bool
    axes: FloatArray
    place: float
    radius: float
    stiffness: float
    hertz: float
    rate: float
    indentation: float
    rest: float
    kt: float
    zero: FloatArray
    arm: FloatArray
    drag: FloatArray
    friction: float
    side: float
    side_radius: float
    growth: float = 0.0


class Work(NamedTuple):
    """Buffers of Newton's method; ``rows`` are the contacts' directions, ``firm`` (m, m) their stiffness."""

    gradient: FloatArray
    hessian: FloatArray
    band: FloatArray
    tail: FloatArray
    skew: FloatArray
    step: FloatArray
    trial: FloatArray
    tangent: FloatArray
    rows: FloatArray
    solved: FloatArray
    firm: FloatArray
    compliance: FloatArray
    small: FloatArray
    forces: FloatArray


NO_TOUCH = Touch(
    False, np.eye(3), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, np.zeros(2), np.zeros(3), np.zeros(2), -1.0, 0.0, 0.0
)  # fmt: skip


def elastic_of(rod: SpatialRod, lever_m: float) -> Elastic:
    """Returns the values of a rod without creep.

    Args:
        rod: the rod.
        lever_m: distance of the loaded point beyond the end of its shaft.

    Returns:
        The values.
    """
    reach = rod.element_lengths_m
    reach[-1] = lever_m
    profile = np.asarray(rod.stiffness_profile, np.float64)
    return Elastic(
        span=rod.joint_spans_m,
        ei=rod.bending_stiffness_nm2 * profile,
        gj=rod.gj_nm2 * profile,
        rest=np.array(rod.precurvature_per_m),
        soft=rod.stiffening_curvature_per_m**-2,
        reach=reach,
        memory=np.zeros((rod.segments + 1, 3)),
        maxwell=0.0,
        small=rod.bending_stiffness_nm2 / rod.flexible_length_m,
    )


def line_of(rod: SpatialRod, distributed_n_per_m: FloatArray | None) -> FloatArray:
    """Returns `Load.line` (segments + 1, 3) of a distributed load.

    Args:
        rod: the rod.
        distributed_n_per_m: (3,) for the whole length, or (segments + 1, 3) for each element; None: no load.

    Raises:
        ValueError: it has another shape, or is not finite.
    """
    shape = (rod.segments + 1, 3)
    if distributed_n_per_m is None:
        return np.zeros(shape)
    if np.shape(distributed_n_per_m) not in ((3,), shape) or not np.isfinite(distributed_n_per_m).all():
        raise ValueError(f"distributed_n_per_m: expected finite numbers (3,) or {shape}, got {distributed_n_per_m}")
    lengths = rod.element_lengths_m[:, None]
    load_n = np.broadcast_to(distributed_n_per_m, shape) * lengths
    beyond = np.cumsum(load_n[::-1], axis=0)[::-1] - load_n  # load on all elements after this one
    return lengths * (beyond + 0.5 * load_n)  # an element's own load acts at its middle


def make_work(elements: int, contacts: int) -> Work:
    """Makes buffers of Newton's method.

    Args:
        elements: number of elements, segments + 1.
        contacts: largest number of contact springs.

    Returns:
        The buffers.
    """
    size = 3 * elements
    return Work(
        gradient=np.zeros(size),
        hessian=np.zeros((size, 6)),
        band=np.zeros((size, 6)),
        tail=np.zeros((3, 3)),
        skew=np.zeros(3),
        step=np.zeros(size),
        trial=np.zeros((elements, 4)),
        tangent=np.zeros((elements, 3)),
        rows=np.zeros((contacts, size)),
        solved=np.zeros((contacts, size)),
        firm=np.zeros((contacts, contacts)),
        compliance=np.zeros((contacts, contacts)),
        small=np.zeros((contacts, contacts)),
        forces=np.zeros((2, contacts)),
    )
