"""The wall in space: a plane of compliant tissue with friction."""

import math
from dataclasses import dataclass

import numpy as np

from ..types import FloatArray, frozen

__all__ = ["SpatialWall", "damping_of_loss_factor"]


def damping_of_loss_factor(stiffness_n_per_m: float, loss_factor: float, frequency_hz: float) -> float:
    """Damping in N s/m whose force leads the dent by atan(``loss_factor``) at ``frequency_hz``.

    A spring and a dashpot side by side have the loss factor 2 pi f c / k.

    >>> round(damping_of_loss_factor(120.0, 0.175, 1.2), 3)
    2.785
    """
    if not (stiffness_n_per_m > 0 and loss_factor >= 0 and frequency_hz > 0):
        raise ValueError(
            "expected positive stiffness_n_per_m and frequency_hz and no negative loss_factor, "
            f"got {stiffness_n_per_m}, {frequency_hz}, {loss_factor}"
        )
    return stiffness_n_per_m * loss_factor / (2 * math.pi * frequency_hz)


@dataclass(frozen=True, slots=True, eq=False)
class SpatialWall:
    """A plane that yields where it is touched, in the base frame.

    ``normal`` (3,): the direction INTO the wall, d, made a unit vector. Normal force = spring + ``damping_ns_per_m`` x
    rate of depth, never pulling: after a release the dent goes back by itself and is met again where it then is. The
    spring is ``stiffness_n_per_m`` x depth, or with ``hertz_depth_m`` h, Hertz's law for a ball:
    ``stiffness_n_per_m`` x depth x sqrt(depth / h), so that the stiffness is the secant's at depth h.

    Along the wall the tissue yields by ``shear_n_per_m`` (None: 2/3 of ``stiffness_n_per_m``, Mindlin's ratio for an
    incompressible half-space) until Coulomb's ``friction`` is reached, then the tip slips, in any direction of the
    plane. ``side_stiffness_n_per_m2``: spring, per metre of length, against the shaft's side, without friction or
    damping; 0: the shaft passes through the wall.

    Raises ValueError where a value has no physical meaning.
    """

    normal: FloatArray
    stiffness_n_per_m: float
    damping_ns_per_m: float = 0.0
    friction: float = 0.0
    shear_n_per_m: float | None = None
    hertz_depth_m: float | None = None
    side_stiffness_n_per_m2: float = 0.0

    def __post_init__(self) -> None:
        normal = np.array(frozen("normal", self.normal, (3,)))
        size = float(np.linalg.norm(normal))
        if not (size > 0 and math.isfinite(size)):
            raise ValueError(f"a wall needs a direction, got normal {normal}")
        object.__setattr__(self, "normal", frozen("normal", normal / size, (3,)))
        positive = [self.stiffness_n_per_m, self.tangential_n_per_m]
        positive += [] if self.hertz_depth_m is None else [self.hertz_depth_m]
        others = [self.damping_ns_per_m, self.friction, self.side_stiffness_n_per_m2]
        if not (all(value > 0 for value in positive) and all(value >= 0 for value in others)):
            raise ValueError(
                "a wall needs positive stiffness, shear and Hertz depth, and no negative damping, friction or side "
                f"stiffness, got {self}"
            )

    @property
    def tangential_n_per_m(self) -> float:
        """Stiffness along the wall while the tip sticks."""
        return self.stiffness_n_per_m * 2 / 3 if self.shear_n_per_m is None else self.shear_n_per_m

    @property
    def axes(self) -> FloatArray:
        """(3, 3), rows: d, and two directions of the plane; the first of them is z x d where that exists."""
        d = np.asarray(self.normal)
        across = np.array([-d[1], d[0], 0.0])
        size = float(np.linalg.norm(across))
        first = across / size if size > 1e-6 else np.array([1.0, 0.0, 0.0]) - d[0] * d
        first /= np.linalg.norm(first)
        return np.stack([d, first, np.cross(d, first)])
