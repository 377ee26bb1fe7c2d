"""The spatial rod on a moving wall: the wall, the solver that integrates from instant to instant, and its results."""

import math
from dataclasses import dataclass

import numpy as np

from ...types import BoolArray, FloatArray, IntArray, frozen
from ._face import face_normals
from ._rod import SpatialRod, frames_of
from ._state import Load, elastic_of, line_of, make_work
from ._time_stepping import WallLaw, integrate, make_history, make_instants


def damping_of_loss_factor(stiffness_n_per_m: float, loss_factor: float, frequency_hz: float) -> float:
    """Returns the damping in N s/m whose force leads the indentation by atan(``loss_factor``) at ``frequency_hz``.

    A spring and a dashpot in parallel have the loss factor 2 pi f c / k.

    Args:
        stiffness_n_per_m: stiffness k of the spring.
        loss_factor: ratio of the viscous force to the elastic one.
        frequency_hz: frequency f at which it has this value.

    Raises:
        ValueError: a value has no physical meaning.

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
    """A plane that yields at the contact, in the base frame.

    Normal force = spring + damping x rate of depth, never pulling. After a release the indentation recovers by itself;
    a new contact begins at its present depth. The spring is linear; or with ``hertz_depth_m`` h, Hertz's law for a
    ball: stiffness x depth x sqrt(depth / h), so that the stiffness is the secant's at depth h; or with
    ``exponential_depth_m`` h, a law that stiffens like living tissue (Fung): stiffness x h x
    (exp(depth / h) - 1) / (e - 1).

    Along the wall the tissue yields until Coulomb's friction is reached, then the tip slips, in any direction of the
    plane.

    Attributes:
        normal: (3,) direction INTO the wall, d, made a unit vector.
        stiffness_n_per_m: stiffness of the spring.
        damping_ns_per_m: damping of the normal force.
        friction: Coulomb's coefficient.
        shear_n_per_m: stiffness along the wall; None: 2/3 of ``stiffness_n_per_m``, Mindlin's ratio for an
            incompressible half-space.
        hertz_depth_m: see above.
        side_stiffness_n_per_m2: spring, per metre of length, against the shaft's side, without friction or damping; 0:
            the shaft passes through the wall.
        exponential_depth_m: see above.
        face_radius_m: the wall's point is the apex of a sphere, convex if positive, concave if negative; None: a plane.
            At each instant the dome touches the tangent plane of the sphere at its expected position.

    Raises:
        ValueError: a value has no physical meaning.
    """

    normal: FloatArray
    stiffness_n_per_m: float
    damping_ns_per_m: float = 0.0
    friction: float = 0.0
    shear_n_per_m: float | None = None
    hertz_depth_m: float | None = None
    side_stiffness_n_per_m2: float = 0.0
    exponential_depth_m: float | None = None
    face_radius_m: float | None = None

    def __post_init__(self) -> None:
        """Checks the values; the normal becomes a unit vector."""
        normal = np.array(frozen("normal", self.normal, (3,)))
        size = float(np.linalg.norm(normal))
        if not (size > 0 and math.isfinite(size)):
            raise ValueError(f"a wall needs a direction, got normal {normal}")
        object.__setattr__(self, "normal", frozen("normal", normal / size, (3,)))
        positive = [self.stiffness_n_per_m, self.tangential_n_per_m]
        positive += [depth for depth in (self.hertz_depth_m, self.exponential_depth_m) if depth is not None]
        others = [self.damping_ns_per_m, self.friction, self.side_stiffness_n_per_m2]
        if not (all(value > 0 for value in positive) and all(value >= 0 for value in others)):
            raise ValueError(
                "a wall needs positive stiffness, shear and Hertz depth, and no negative damping, friction or side "
                f"stiffness, got {self}"
            )
        if len(positive) > 3 or self.face_radius_m == 0.0:
            raise ValueError(f"a wall has one law, of Hertz or exponential, and no face of radius 0, got {self}")
        if self.face_radius_m is not None and self.side_stiffness_n_per_m2 > 0.0:
            raise ValueError("the shaft's side touches flat walls only: face_radius_m or side_stiffness_n_per_m2")

    @property
    def tangential_n_per_m(self) -> float:
        """Stiffness along the wall during stick."""
        return self.stiffness_n_per_m * 2 / 3 if self.shear_n_per_m is None else self.shear_n_per_m

    @property
    def axes(self) -> FloatArray:
        """Rows (3, 3): d, and two directions of the plane; the first of them is z x d if that exists."""
        d = np.asarray(self.normal)
        across = np.array([-d[1], d[0], 0.0])
        size = float(np.linalg.norm(across))
        first = across / size if size > 1e-6 else np.array([1.0, 0.0, 0.0]) - d[0] * d
        first /= np.linalg.norm(first)
        return np.stack([d, first, np.cross(d, first)])

    def normals_at(self, places_m: FloatArray) -> FloatArray:
        """Returns the directions (m, 3) into the wall, at its points nearest to ``places_m`` (m, 3) from the apex."""
        return face_normals(self.axes, self.face_radius_m, places_m)


@dataclass(frozen=True, slots=True, eq=False)
class SpatialContact:
    """The rod at m instants, base frame.

    Attributes:
        rod: the rod.
        wall: the wall.
        quaternions: (m, segments + 1, 4), see `SpatialRod.unloaded_quaternions`.
        advance_m: (m,) advance of the clamp along x.
        force_n: (m, 3) force of the wall on the electrode's dome.
        touch_m: (m, 3) point at which it acts.
        side_force_n: (m, 3) force of the wall on the shaft's side.
        reaction_force_n: (m, 3) force of the clamp on the rod.
        reaction_moment_nm: (m, 3) moment of the clamp on the rod, about the clamp, from the shaft's strain.
        indentation_m: (m,) indentation of the wall, which remains after the contact if there is damping.
        touching: (m,) whether the dome touches.
        slipping: (m,) whether the dome slips.
        converged: (m,) whether an equilibrium was found.
        stable: (m,) whether it is a minimum, with a sticking tip tied to the wall.
    """

    rod: SpatialRod
    wall: SpatialWall
    quaternions: FloatArray
    advance_m: FloatArray
    force_n: FloatArray
    touch_m: FloatArray
    side_force_n: FloatArray
    reaction_force_n: FloatArray
    reaction_moment_nm: FloatArray
    indentation_m: FloatArray
    touching: BoolArray
    slipping: BoolArray
    converged: BoolArray
    stable: BoolArray

    def nodes_m(self) -> FloatArray:
        """Returns the nodes (m, segments + 2, 3): clamp, segment ends, tip of the electrode."""
        return self.rod.nodes_m(self.quaternions, self.advance_m)

    def frames(self) -> FloatArray:
        """Returns the material frames (m, segments + 1, 3, 3) of the segments and of the electrode, in columns."""
        return frames_of(self.quaternions)

    def tip_axes(self, rows: BoolArray | IntArray) -> FloatArray:
        """Returns the electrode's direction (k, 3) at ``rows``."""
        return frames_of(self.quaternions[rows, -1])[..., 0]


class SpatialContactSolver:
    """A rod and a wall that are moved instant by instant: for a closed loop with live commands.

    With ``creep`` the shaft is a standard linear solid on the strain relative to its pre-curvature: a spring, ``creep``
    times as stiff as EI and GJ, is parallel to the shaft and relaxes with the time constant ``creep_time_s``. Under a
    fixed strain the moment falls by creep / (1 + creep), under a fixed moment the strain grows by ``creep``, and the
    final state is the rod of `solve_static_spatial`.

    The first instant starts from the free rod after complete creep, so it should be without contact. Steps should be
    short compared with the ball.

    Args:
        rod: the rod.
        wall: the wall.
        dt_s: time between instants; it matters with damping and creep only.
        tip_radius_m: radius of the ball at the electrode's end, and of the shaft.
        distributed_n_per_m: dead load along the whole length, (3,) or (segments + 1, 3).
        creep: relative stiffness of the parallel spring.
        creep_time_s: its time constant.

    Raises:
        ValueError: a value has no physical meaning.

    >>> wall = SpatialWall(np.array([0.6, 0.8, 0.0]), 120.0)
    >>> solver = SpatialContactSolver(SpatialRod(0.04, 4.3e-4, 0.008), wall, 1e-3, 1e-3)
    >>> for depth in np.linspace(-1e-3, 4e-3, 50):
    ...     now = solver.step(np.array([0.048, 0.0, 0.0]) - depth * wall.normal)
    >>> now.force_n[0, :2].round(4), bool(now.touching[0])
    (array([-0.0399, -0.0532]), True)
    """

    def __init__(
        self,
        rod: SpatialRod,
        wall: SpatialWall,
        dt_s: float,
        tip_radius_m: float,
        *,
        distributed_n_per_m: FloatArray | None = None,
        creep: float = 0.0,
        creep_time_s: float = 1.0,
    ) -> None:
        """Checks the values, and converts rod, load and wall to arguments of the compiled kernels."""
        if not (dt_s > 0 and creep >= 0 and creep_time_s > 0):
            raise ValueError(
                f"expected positive dt_s and creep_time_s and no negative creep, got {dt_s}, {creep_time_s}, {creep}"
            )
        if wall.face_radius_m is not None and abs(wall.face_radius_m) <= tip_radius_m:
            raise ValueError(f"the face's radius must exceed tip_radius_m={tip_radius_m}, got {wall.face_radius_m}")
        if not 0.0 <= tip_radius_m <= rod.rigid_length_m:
            raise ValueError(
                f"tip_radius_m: expected 0 to the electrode's length {rod.rigid_length_m}, got {tip_radius_m}"
            )
        self.rod, self.wall = rod, wall
        self._load = Load(np.zeros(3), np.zeros(3), line_of(rod, distributed_n_per_m))
        weight = np.zeros(3) if distributed_n_per_m is None else np.asarray(distributed_n_per_m)
        self._weight_n = (np.broadcast_to(weight, (rod.segments + 1, 3)) * rod.element_lengths_m[:, None]).sum(axis=0)
        self._creep, self._creep_time_s = creep, creep_time_s
        self._elastic = elastic_of(rod, rod.rigid_length_m - tip_radius_m)
        self._law = WallLaw(
            axes=wall.axes,
            radius=tip_radius_m,
            stiffness=wall.stiffness_n_per_m,
            hertz=0.0 if wall.hertz_depth_m is None else wall.hertz_depth_m**-0.5,
            damping=wall.damping_ns_per_m,
            kt=wall.tangential_n_per_m,
            friction=wall.friction,
            side=wall.side_stiffness_n_per_m2 * rod.flexible_length_m / rod.segments,
            dt_s=dt_s,
            relaxing=0.0,
            base_rest=np.array(rod.precurvature_per_m),
            growth=0.0 if wall.exponential_depth_m is None else 1.0 / wall.exponential_depth_m,
            face_radius=wall.face_radius_m or 0.0,
        )
        self.change_step(dt_s)
        self._history = make_history(rod.unloaded_quaternions)
        self._work = make_work(rod.segments + 1, 3 + (rod.segments if wall.side_stiffness_n_per_m2 > 0 else 0))

    def change_step(self, dt_s: float) -> None:
        """Sets ``dt_s``, the time between instants, from now on.

        Raises:
            ValueError: the time is not positive.
        """
        if not dt_s > 0:
            raise ValueError(f"expected positive dt_s, got {dt_s}")
        relaxing = dt_s / self._creep_time_s
        self._elastic = self._elastic._replace(maxwell=self._creep / (1 + relaxing))
        self._law = self._law._replace(dt_s=dt_s, relaxing=relaxing)

    def run(
        self,
        wall_m: FloatArray,
        precurvature_change_per_m: FloatArray | None = None,
        advance_m: FloatArray | None = None,
    ) -> SpatialContact:
        """Solves the next m instants, each from the one before; the first continues from the last call.

        Args:
            wall_m: (m, 3) a point of the wall's undeformed surface, which moves with the tissue.
            precurvature_change_per_m: (m, 3) is added to the rod's own pre-curvature in every joint.
            advance_m: (m,) advance of the clamp along the base tangent.

        Returns:
            One equilibrium for each instant.

        Raises:
            ValueError: The arrays do not fit together.
        """
        wall = np.ascontiguousarray(wall_m, np.float64)
        m = wall.shape[0]
        change = np.zeros((m, 3)) if precurvature_change_per_m is None else precurvature_change_per_m
        change = np.ascontiguousarray(change, np.float64)
        advance = np.ascontiguousarray(np.zeros(m) if advance_m is None else advance_m, np.float64)
        if wall.shape != (m, 3) or change.shape != (m, 3) or advance.shape != (m,):
            raise ValueError(
                "expected wall_m (m, 3), precurvature_change_per_m (m, 3) and advance_m (m,), "
                f"got {wall.shape}, {change.shape}, {advance.shape}"
            )
        rod = self.rod
        rod.check_stiffening(np.abs(change).max(axis=0, initial=0.0) + np.abs(self._law.base_rest).max(axis=0))
        now = make_instants(m, rod.segments + 1)
        integrate(self._elastic, self._load, self._law, self._history, self._work, wall, change, advance, now)
        side = -now.side_force[:, None] * np.asarray(self.wall.normal)
        return SpatialContact(
            rod=rod,
            wall=self.wall,
            quaternions=now.shapes,
            advance_m=advance,
            force_n=now.dome_force,
            touch_m=now.touch,
            side_force_n=side,
            reaction_force_n=-now.dome_force - side - self._weight_n,
            reaction_moment_nm=-now.base_moment,
            indentation_m=now.indentation,
            touching=now.touching,
            slipping=now.slipping,
            converged=now.converged,
            stable=now.stable,
        )

    def step(
        self, wall_m: FloatArray, precurvature_change_per_m: FloatArray | None = None, advance_m: float = 0.0
    ) -> SpatialContact:
        """Solves the next instant; see `run`.

        Args:
            wall_m: (3,) a point of the wall's undeformed surface.
            precurvature_change_per_m: (3,) is added to the rod's own pre-curvature.
            advance_m: advance of the clamp along the base tangent.

        Returns:
            The equilibrium, as one row.
        """
        change = None if precurvature_change_per_m is None else np.asarray(precurvature_change_per_m)[None]
        return self.run(np.asarray(wall_m)[None], change, np.array([advance_m]))
