"""The trajectory of one session, instant by instant: knob, clamp, stage and wall move, the rod follows."""

from dataclasses import dataclass, fields, replace

import numpy as np

from ...mechanics import Play, SpatialContact, SpatialContactSolver
from ...types import FloatArray
from ._bench_model import BenchModel
from ._drives import AxisModel, Drive
from ._motion_profile import Motion, MotionProfile
from .settings import WorldSettings

_BLOCK_INSTANTS = 4096
"""Number of instants in a block; in longer blocks only the rod takes time."""


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """A session at each of m instants.

    Attributes:
        time_s: (m,) time on the camera's clock.
        knob_deg: (m,) angle of the knob.
        advance_m: (m,) advance of the clamp along x.
        curvature_per_m: (m,) curvature of the unloaded shaft in its plane of bending.
        command_m: (m, 2) commanded positions of the stage, forward (positive against the tip) and across.
        stage_m: (m, 2) reached positions of the stage.
        acceleration_m_per_s2: (m, 3) acceleration of the stage, base frame.
        wall_m: (m, 3) position of the point of the undeformed surface that was touched first, base frame.
        contact: result of the mechanics.
        radius_m: radius of dome and shaft.
    """

    time_s: FloatArray
    knob_deg: FloatArray
    advance_m: FloatArray
    curvature_per_m: FloatArray
    command_m: FloatArray
    stage_m: FloatArray
    acceleration_m_per_s2: FloatArray
    wall_m: FloatArray
    contact: SpatialContact
    radius_m: float

    def side_touch_m(self, rows: slice) -> FloatArray:
        """Returns the point (m, 3) of the force on the shaft's side; a point of the wall if the side does not touch."""
        contact, wall = self.contact, self.contact.wall
        nodes = contact.rod.nodes_m(contact.quaternions[rows], contact.advance_m[rows])[:, 1:-1]
        normal = np.asarray(wall.normal)
        # The mean of the touching nodes, weighted by their depth in the tissue (their force is proportional to it).
        depth = np.maximum((nodes - self.wall_m[rows, None]) @ normal + self.radius_m, 0.0)
        total = depth.sum(axis=1, keepdims=True)
        centre = (depth[..., None] * nodes).sum(axis=1) / np.maximum(total, 1e-30)
        return np.where(total > 0.0, centre + self.radius_m * normal, self.wall_m[rows])


def _drives(
    settings: WorldSettings, motion_profile: MotionProfile, programme_m: FloatArray
) -> tuple[Drive, Drive, Drive, Drive]:
    """Makes the drives of clamp, knob, and the stage's two axes; their programme is the session without commands."""
    dt = float(motion_profile.time_s[1] - motion_profile.time_s[0])
    clamp, knob, motion = settings.clamp, settings.knob_drive, settings.motion
    # Without commands nothing moves the clamp, and a hand moves the knob; motors drive the stage.
    clamp_axis, stage_axis = (
        AxisModel(ax.step_m, ax.max_speed_m_per_s, ax.max_acceleration_m_per_s2, ax.delay_s, ax.lag_s, *ax.travel_m)
        for ax in (clamp, motion)
    )
    knob_axis = AxisModel(
        knob.step_deg, knob.max_speed_deg_per_s, knob.max_acceleration_deg_per_s2, knob.delay_s, knob.lag_s,
        *knob.travel_deg,
    )  # fmt: skip
    return (
        Drive(clamp_axis, dt, np.zeros(motion_profile.time_s.size), by_hand=True),
        Drive(knob_axis, dt, motion_profile.knob_deg, by_hand=True),
        Drive(stage_axis, dt, programme_m[:, 0], by_hand=False),
        Drive(stage_axis, dt, programme_m[:, 1], by_hand=False),
    )


class TrajectoryIntegrator:
    """A session that is simulated up to the instant that is needed, while its drives may be commanded.

    The result does not depend on the lengths of the parts.

    Args:
        bench_model: the session's bench.
        motion_profile: the motion before its amplitude is known.
        motion: amplitude of the beat, and standoff.
        every: interval between solutions of the rod, in instants. The rows of ``contact`` between them are empty; the
            drives move at all instants.

    Attributes:
        clamp: drive of the advance, m.
        knob: drive of the knob, degrees.
        forward: drive of the stage along the wall's normal, m.
        across: drive of the stage across, m.
        trajectory: the trajectory; its rows are valid up to ``done``, their accelerations up to ``final``.
    """

    def __init__(self, bench_model: BenchModel, motion_profile: MotionProfile, motion: Motion, every: int = 1) -> None:
        """Makes drives and contact solver, and allocates the rows of the trajectory, which `advance` fills."""
        settings = bench_model.settings
        self.bench_model, self._motion_profile, self._every = bench_model, motion_profile, every
        self.drives = self.clamp, self.knob, self.forward, self.across = _drives(
            settings, motion_profile, motion_profile.programme_m(bench_model, motion)
        )
        self._dt = float(motion_profile.time_s[1] - motion_profile.time_s[0])
        self._solver = SpatialContactSolver(
            bench_model.rod,
            bench_model.wall,
            every * self._dt,
            bench_model.radius_m,
            creep=settings.shaft.creep_share,
            creep_time_s=settings.shaft.creep_s,
        )
        self._play: Play | None = None
        count = motion_profile.time_s.size
        self._smooth = np.zeros((count, 2))
        self.done = self.final = 0
        self.trajectory = Trajectory(
            time_s=motion_profile.time_s,
            knob_deg=np.zeros(count),
            advance_m=np.zeros(count),
            curvature_per_m=np.zeros(count),
            command_m=np.zeros((count, 2)),
            stage_m=np.zeros((count, 2)),
            acceleration_m_per_s2=np.zeros((count, 3)),
            wall_m=np.zeros((count, 3)),
            contact=_allocate(self._solver.run(np.zeros((0, 3))), count),
            radius_m=bench_model.radius_m,
        )

    def advance(self, end: int) -> None:
        """Simulates up to the instant ``end``, exclusive, if that has not been done."""
        end = min(end, self.trajectory.time_s.size)
        while self.done < end:
            self._integrate(self.done, min(end, self.done + _BLOCK_INSTANTS))
            self._update_acceleration()

    def _integrate(self, first: int, end: int) -> None:
        """Moves the drives at the instants ``first`` to ``end`` (exclusive); solves the rod at every n-th of them."""
        rows, trajectory, bench_model = slice(first, end), self.trajectory, self.bench_model
        _, _, trajectory.advance_m[rows] = self.clamp.run(first, end)
        _, _, trajectory.knob_deg[rows] = self.knob.run(first, end)
        for k, drive in enumerate((self.forward, self.across)):
            trajectory.command_m[rows, k], self._smooth[rows, k], trajectory.stage_m[rows, k] = drive.run(first, end)
        trajectory.curvature_per_m[rows] = bench_model.curvature_per_m(
            self._transmitted(first, end), self._motion_profile.drift[rows]
        )
        trajectory.wall_m[rows] = bench_model.touch_m + bench_model.directed(trajectory.stage_m[rows])
        # `solved` begins at the first multiple of `_every`: its rows do not depend on how a session is cut into parts.
        solved = slice(first + -first % self._every, end, self._every)
        curvature = trajectory.curvature_per_m[solved]
        zero = np.zeros(curvature.size)
        contact = self._solver.run(
            trajectory.wall_m[solved], np.stack([zero, zero, curvature], axis=1), trajectory.advance_m[solved]
        )
        for name in _ROWS:
            getattr(trajectory.contact, name)[solved] = getattr(contact, name)
        self.done = end

    def _transmitted(self, first: int, end: int) -> FloatArray:
        """Returns the knob's angles (end - first,) in degrees behind its play.

        They are those of the profile until the knob's drive takes over; then the play continues from that angle.
        """
        transmitted, taken = self._motion_profile.transmitted_deg[first:end], self.knob.taken_over
        if taken is None or taken >= end:
            return transmitted
        if self._play is None:
            first = max(first, taken)
            last_planned = float(self._motion_profile.transmitted_deg[max(0, first - 1)])
            self._play = Play(self.bench_model.settings.actuation.play_deg, output=last_planned)
        driven = self._play.run(self.trajectory.knob_deg[first:end])
        return np.concatenate([transmitted[: transmitted.size - driven.size], driven])

    def _update_acceleration(self) -> None:
        """Computes the stage's acceleration by two central differences, each of which needs the next instant.

        So the acceleration is final two instants after the position; at the end of the session all of it is.
        """
        first, complete = self.final, self.done == self.trajectory.time_s.size
        end = self.done if complete else self.done - 2
        start = max(0, first - 2)
        if end <= first or self.done - start < 2:
            return
        smooth = self._smooth[start : self.done]
        second = np.gradient(np.gradient(smooth, self._dt, axis=0), self._dt, axis=0)[first - start : end - start]
        self.trajectory.acceleration_m_per_s2[first:end] = self.bench_model.directed(second)
        self.final = end


_ROWS = tuple(field.name for field in fields(SpatialContact) if field.name not in ("rod", "wall"))


def _allocate(none: SpatialContact, count: int) -> SpatialContact:
    """Returns arrays of ``count`` instants, with the shapes of a contact of no instants."""
    rows = {name: getattr(none, name) for name in _ROWS}
    return replace(none, **{name: np.zeros((count, *row.shape[1:]), row.dtype) for name, row in rows.items()})


def integrate_trajectory(
    bench_model: BenchModel, motion_profile: MotionProfile, motion: Motion, every: int = 1
) -> Trajectory:
    """Integrates a session from beginning to end without commands, at the instants of ``motion_profile``.

    Args:
        bench_model: the bench.
        motion_profile: the motion before its amplitude is known.
        motion: the solved motion.
        every: interval between solutions of the rod, which are returned, in instants.

    Returns:
        The trajectory at these instants.
    """
    run = TrajectoryIntegrator(bench_model, motion_profile, motion, every)
    run.advance(motion_profile.time_s.size)
    return run.trajectory if every == 1 else thinned(run.trajectory, every)


def thinned(trajectory: Trajectory, every: int) -> Trajectory:
    """Returns a trajectory with fewer instants.

    Args:
        trajectory: the trajectory.
        every: every ``every``-th instant is kept, from the first on.

    Returns:
        The thinned trajectory.
    """
    rows = {name: getattr(trajectory.contact, name)[::every] for name in _ROWS}
    others = [field.name for field in fields(Trajectory) if field.name not in ("contact", "radius_m")]
    plain = {name: getattr(trajectory, name)[::every] for name in others}
    return replace(trajectory, contact=replace(trajectory.contact, **rows), **plain)
