"""The tip on a compliant, moving wall with friction, in the plane: quasi-static, instant after instant.

The simulation solves contact in space (`solve_contact_spatial`). This solver, with another rod and another treatment of
stick and slip, is its oracle.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...types import BoolArray, FloatArray
from ._compile import compiled
from ._newton import NO_SPRINGS, Elastic, Load, Springs, elastic_of, relax
from ._rod import Rod


@dataclass(frozen=True, slots=True)
class Wall:
    """A plane that yields where it is touched, in the base frame.

    ``angle_rad``: the direction INTO the wall, d, counter-clockwise from x; t is d turned by a further 90 degrees.
    Normal force = ``stiffness_n_per_m`` x depth + ``damping_ns_per_m`` x rate of depth, never pulling: after a release
    the indentation goes back with the time constant damping / stiffness and is met again where it then is
    (Kelvin-Voigt).
    Along the wall the tissue yields by ``shear_n_per_m`` until Coulomb's ``friction`` is reached, then the tip slips.
    """

    angle_rad: float
    stiffness_n_per_m: float
    damping_ns_per_m: float = 0.0
    friction: float = 0.0
    shear_n_per_m: float | None = None
    """None: 2/3 of the normal stiffness, Mindlin's ratio for an incompressible half-space."""

    def __post_init__(self) -> None:
        if not (self.stiffness_n_per_m > 0 and self.damping_ns_per_m >= 0 and self.friction >= 0):
            raise ValueError(f"a wall needs positive stiffness, and no negative damping or friction, got {self}")


@dataclass(frozen=True, slots=True, eq=False)
class Contact:
    """The rod at m instants.

    ``angles_rad`` (m, segments + 1); ``force_n`` (m, 2): what the wall does to the tip, base frame; ``touch_m`` (m, 2):
    where it does so; ``indentation_m`` (m,): of the wall, which outlasts the contact where there is damping;
    ``touching``, ``slipping``, ``converged``, ``stable`` (m,).
    """

    rod: Rod
    wall: Wall
    angles_rad: FloatArray
    force_n: FloatArray
    touch_m: FloatArray
    indentation_m: FloatArray
    touching: BoolArray
    slipping: BoolArray
    converged: BoolArray
    stable: BoolArray


@compiled
def _slip(
    theta: FloatArray, rod: Elastic, springs: Springs, friction: float, way: float, normal: float, nothing: Load
) -> tuple[float, bool, bool]:
    """Sliding: friction ``way`` x mu x normal force as a load, by the secant method on the normal force.

    Starts from the guess ``normal``. Returns the normal force, and whether the last shape converged and is stable.
    """
    older = older_miss = 0.0
    converged = stable = False
    for attempt in range(30):
        drag = way * friction * normal
        load = Load(-drag * springs.dy, drag * springs.dx, drag * springs.radius, nothing.carried)
        out = relax(theta, rod, load, springs)
        stable = out.stable
        miss = normal - springs.kn * max(0.0, out.depth)
        if abs(miss) < 1e-10:
            converged = out.converged
            break
        change = -miss
        if attempt > 0 and miss != older_miss:
            change *= (normal - older) / (miss - older_miss)
        older, older_miss, normal = normal, miss, max(0.0, normal + change)
    return normal, converged, stable


class _Instants(NamedTuple):
    """What comes out at each of m instants, (m,) but ``angles`` (m, n); ``drag``: force on the tip along t."""

    angles: FloatArray
    normal: FloatArray
    drag: FloatArray
    indentation: FloatArray
    slipping: BoolArray
    converged: BoolArray
    stable: BoolArray


@compiled
def _integrate(
    theta: FloatArray,
    rod: Elastic,
    springs: Springs,
    damping: float,
    friction: float,
    dt_s: float,
    position: FloatArray,
    along: FloatArray,
    out_rows: _Instants,
) -> None:
    """Instant after instant, into ``out_rows``."""
    last = theta.size - 1
    indentation = 0.0
    touching = False
    anchor = 0.0  # of the tip's way along the wall, seen from the wall
    nothing = Load(0.0, 0.0, 0.0, np.zeros((theta.size, 2)))
    start = relax(theta, rod, nothing, NO_SPRINGS)
    way_before = start.slide
    for row in range(position.size):
        # Kelvin-Voigt by implicit Euler: a stiffer spring that begins where the indentation would be without contact.
        kn = springs.kn + damping / dt_s
        rest = indentation * (damping / dt_s) / kn
        place = Springs(springs.dx, springs.dy, position[row] + rest, kn, 0.0, 0.0, springs.radius)
        if not touching:
            anchor = way_before
        stuck = Springs(place.dx, place.dy, place.position, kn, springs.kt, anchor + along[row], springs.radius)
        out = relax(theta, rod, nothing, stuck if touching and friction > 0.0 else place)
        converged, stable, slipping = out.converged, out.stable, False
        normal = kn * max(0.0, out.depth)
        drag = 0.0
        if touching and normal == 0.0 and friction > 0.0:  # lifted off while still tied: let go
            out = relax(theta, rod, nothing, place)
            converged, stable, normal = out.converged, out.stable, kn * max(0.0, out.depth)
        elif touching and friction > 0.0:
            drag = -springs.kt * (out.slide - stuck.anchor)
            if abs(drag) > friction * normal:
                slipping = True
                way = math.copysign(1.0, drag)
                normal, converged, stable = _slip(theta, rod, place, friction, way, normal, nothing)
                drag = way * friction * normal
        touching = normal > 0.0
        x = y = 0.0
        for i in range(last + 1):
            reach = rod.h if i < last else rod.lever
            x += reach * math.cos(theta[i])
            y += reach * math.sin(theta[i])
        depth = x * springs.dx + y * springs.dy + springs.radius - position[row]
        way_before = y * springs.dx - x * springs.dy + springs.radius * theta[last] - along[row]
        indentation = depth if touching else rest
        if slipping:
            anchor = way_before + drag / springs.kt
        out_rows.angles[row] = theta
        out_rows.normal[row], out_rows.drag[row], out_rows.indentation[row] = normal, drag, indentation
        out_rows.slipping[row], out_rows.converged[row], out_rows.stable[row] = slipping, converged, stable


def solve_contact(
    rod: Rod, wall: Wall, position_m: FloatArray, along_m: FloatArray, dt_s: float, tip_radius_m: float
) -> Contact:
    """The rod while the wall moves: one equilibrium for each instant, each starting from the one before.

    ``position_m`` (m,): where the wall's undeformed surface cuts the axis d through the base frame's origin;
    ``along_m`` (m,): the wall's own way along t. ``dt_s`` is the time between instants and matters with damping only.
    The electrode ends in a ball of ``tip_radius_m``. The first instant is reached from the unloaded shape, so it
    should be without contact, and steps should be short beside the ball.
    """
    position, along = np.ascontiguousarray(position_m, np.float64), np.ascontiguousarray(along_m, np.float64)
    if position.ndim != 1 or position.shape != along.shape or dt_s <= 0:
        raise ValueError(f"expected two equally long rows and dt_s > 0, got {position.shape}, {along.shape}, {dt_s}")
    if not 0.0 <= tip_radius_m <= rod.rigid_length_m:
        raise ValueError(f"tip_radius_m: expected 0 to the electrode's length {rod.rigid_length_m}, got {tip_radius_m}")
    elastic = elastic_of(rod, rod.rigid_length_m - tip_radius_m)
    direction = np.array([math.cos(wall.angle_rad), math.sin(wall.angle_rad)])
    shear = wall.shear_n_per_m if wall.shear_n_per_m is not None else wall.stiffness_n_per_m * 2 / 3
    dx, dy = float(direction[0]), float(direction[1])
    springs = Springs(dx, dy, 0.0, wall.stiffness_n_per_m, shear, 0.0, tip_radius_m)
    rows, flags = np.empty((3, position.size)), np.empty((3, position.size), np.bool_)
    now = _Instants(
        np.empty((position.size, rod.segments + 1)), rows[0], rows[1], rows[2], flags[0], flags[1], flags[2]
    )
    start = np.array(rod.unloaded_angles_rad)
    _integrate(start, elastic, springs, wall.damping_ns_per_m, wall.friction, dt_s, position, along, now)
    tangent = np.array([-direction[1], direction[0]])
    tip = rod.nodes_m(now.angles)[:, -1]
    axis = np.stack([np.cos(now.angles[:, -1]), np.sin(now.angles[:, -1])], axis=1)
    return Contact(
        rod=rod,
        wall=wall,
        angles_rad=now.angles,
        force_n=now.drag[:, None] * tangent - now.normal[:, None] * direction,
        touch_m=tip + tip_radius_m * (direction - axis),
        indentation_m=now.indentation,
        touching=now.normal > 0,
        slipping=now.slipping,
        converged=now.converged,
        stable=now.stable,
    )
