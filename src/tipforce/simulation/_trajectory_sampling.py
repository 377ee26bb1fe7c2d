"""A session's trajectory at any time, and the readings of its instruments."""

from collections.abc import Callable

import numpy as np

from ..types import ADVANCE, JOINTS, KNOB, STAGE, STAGE_ACROSS, STAGE_FORWARD, Actuation, FloatArray, IntArray, Wrench
from .rendering.camera import TissueState
from .world import LEAD_S, STEP_S, BenchModel, ForceSensor, Resolution, SensorLoad, Trajectory, smooth_centrelines

_CENTRELINE_POINTS = 97
"""Number of points of the true centreline, about 0.5 mm apart."""


class TrajectoryInterpolator:
    """Interpolates the trajectory of a session; of a session in progress: up to the last simulated instant.

    It holds no reference to the bench: when a bench is no longer used, its memory with all painted layers is freed
    immediately.

    Args:
        trajectory: the trajectory.
        bench_model: the session's bench.
        resolution: step size of the trajectory.
    """

    def __init__(self, trajectory: Trajectory, bench_model: BenchModel, resolution: Resolution) -> None:
        self._trajectory, self._bench_model, self._resolution = trajectory, bench_model, resolution

    def place(self, time_s: FloatArray) -> tuple[IntArray, FloatArray]:
        """Returns the index of the instant before each time, and the share of the step from there to the next one."""
        steps = (time_s + LEAD_S) / (STEP_S * self._resolution.every)
        low = np.clip(np.floor(steps).astype(np.int64), 0, self._trajectory.time_s.size - 2)
        return low, steps - low

    def nearest(self, time_s: FloatArray) -> IntArray:
        """Returns the indices (k,) of the trajectory's instants nearest to ``time_s``."""
        low, share = self.place(time_s)
        return low + (share >= 0.5)

    def at(self, values: FloatArray, time_s: FloatArray) -> FloatArray:
        """Interpolates ``values`` of the trajectory linearly between instants.

        Args:
            values: (m, ...) values at the instants.
            time_s: (k,) times.

        Returns:
            (k, ...) values at these times.
        """
        low, share = self.place(time_s)
        weight = share.reshape(-1, *[1] * (values.ndim - 1))
        return values[low] * (1 - weight) + values[low + 1] * weight

    def lines_m(self, time_s: FloatArray) -> FloatArray:
        """Returns the centreline (k, points, 3) at ``time_s`` (k,): base frame, base to apex, uniform in arc length."""
        low, share = self.place(time_s)
        trajectory, rod = self._trajectory, self._bench_model.rod
        before, after = (
            smooth_centrelines(
                rod, trajectory.contact.quaternions[rows], _CENTRELINE_POINTS, trajectory.advance_m[rows]
            )
            for rows in (low, low + 1)
        )
        return before + share[:, None, None] * (after - before)

    def exposure(self, middle_s: float, length_s: float, count: int) -> tuple[FloatArray, TissueState]:
        """Returns shapes and tissue at evenly spaced instants of an exposure.

        Args:
            middle_s: middle of the exposure.
            length_s: its length.
            count: number of instants; 1: the middle.

        Returns:
            Shapes (count, points, 3) in the base frame, and the tissue.
        """
        times = middle_s + 0.5 * length_s * (np.linspace(-1.0, 1.0, count) if count > 1 else np.zeros(1))
        trajectory = self._trajectory
        now = np.array([middle_s])
        tissue = TissueState(
            shift_m=self.at(trajectory.wall_m, times) - self._bench_model.touch_m,
            indentation_m=float(self.at(trajectory.contact.indentation_m, now)[0]),
            touch_m=self.at(trajectory.contact.touch_m, now)[0],
        )
        return self.lines_m(times), tissue


Place = Callable[[FloatArray], tuple[IntArray, FloatArray]]
"""Times (k,) -> index of the instant before each, and share of the step from there to the next one."""
_STAGE_HZ = 100.0
_KNOB_HZ = 50.0
_SENSOR_DEPTH_M = 0.02
"""Distance from the tissue's surface to the sensor's origin."""


class _ReadingLog:
    """A drive's readings at ``hertz``: ``values`` (k, n) of n axes by ``names``, rounded to ``digits`` decimals."""

    def __init__(self, hertz: float, seconds: float, names: tuple[str, ...], digits: int, place: Place) -> None:
        """Sets up the times of the readings; `take` fills the values."""
        times = np.arange(round(seconds * hertz)) / hertz
        self.stamp_ns: IntArray = np.round(times * 1e9).astype(np.int64)
        self.names, self.digits = names, digits
        self.values = np.zeros((times.size, len(names)))
        self._low, self._share = place(times)
        self.need = self._low + 2
        """Number of instants of the trajectory that must have been simulated before a row can be read."""

    def take(self, columns: tuple[tuple[FloatArray, float], ...], first: int, end: int) -> None:
        """Fills the readings from ``first`` to ``end`` (exclusive) by linear interpolation of the trajectory.

        ``columns``: for each axis its positions (m,) at the instants, and the factor to the unit of the reading.
        """
        low, share = self._low[first:end], self._share[first:end]
        for axis, (column, factor) in enumerate(columns[: len(self.names)]):
            value = factor * (column[low] * (1 - share) + column[low + 1] * share)
            self.values[first:end, axis] = np.round(value, self.digits)


class Readings:
    """Force sensor, stage and joints of a session. The readings do not depend on the number of calls of `take`.

    Args:
        bench_model: the session's bench.
        place: see `Place`.
        rng: random numbers of the force sensor.

    Attributes:
        log: readings of the force sensor.
        need_force: number of instants of the trajectory that must have been simulated before each reading of the force;
            ``stage.need`` and ``joints.need`` are the same for their readings.
    """

    def __init__(self, bench_model: BenchModel, place: Place, rng: np.random.Generator) -> None:
        """Sets up the logs, which have one row for each reading of the session; `take` fills them."""
        world = bench_model.settings
        angle = float(np.arctan2(bench_model.forward[1], bench_model.forward[0]))
        self.bench_model, self._home_m = bench_model, world.clamp.home_m
        self.sensor = ForceSensor(world.sensor, world.clock, angle, world.seconds + 0.2, rng)
        self.log = self.sensor.log
        self._low, _ = place(self.log.true_s)
        self.need_force = self._low + 3  # one more, because the trajectory's stamps are not exact
        names = (KNOB, ADVANCE) if world.clamp.logged else (KNOB,)
        self.stage = _ReadingLog(_STAGE_HZ, world.seconds, (STAGE_FORWARD, STAGE_ACROSS), 4, place)
        self.joints = _ReadingLog(_KNOB_HZ, world.seconds, names, 2, place)
        self._taken = [0, 0, 0]

    def take(self, trajectory: Trajectory, rows: int) -> None:
        """Takes all readings that the known part of a trajectory allows.

        Args:
            trajectory: trajectory of the session.
            rows: number of its instants that are simulated; only these are read.
        """
        # A complete trajectory allows also the last force reading, whose need is one instant more than there are.
        rows = len(trajectory.time_s) + 1 if rows == len(trajectory.time_s) else rows
        for log, need in enumerate((self.need_force, self.stage.need, self.joints.need)):
            first, end = self._taken[log], int(np.searchsorted(need, rows, side="right"))
            if end <= first:
                continue
            self._taken[log] = end
            if log == 0:
                window = slice(max(0, int(self._low[first]) - 1), int(self._low[end - 1]) + 3)
                self.sensor.take(self._load(trajectory, window), first, end)
            elif log == 1:
                self.stage.take(((trajectory.command_m[:, 0], 1e3), (trajectory.command_m[:, 1], 1e3)), first, end)
            else:
                self.joints.take(((trajectory.knob_deg, 1.0), (trajectory.advance_m + self._home_m, 1e3)), first, end)

    def _load(self, trajectory: Trajectory, rows: slice) -> SensorLoad:
        """Returns the load on the sensor at the instants ``rows``, with the tissue's force on the tip reversed."""
        origin = trajectory.wall_m[rows] + _SENSOR_DEPTH_M * self.bench_model.forward
        contact = trajectory.contact
        side = None
        if self.bench_model.wall.side_stiffness_n_per_m2 > 0.0:
            side = -contact.side_force_n[rows], trajectory.side_touch_m(rows) - origin
        lever_m = contact.touch_m[rows] - origin
        acceleration = trajectory.acceleration_m_per_s2[rows]
        return SensorLoad(trajectory.time_s[rows], -contact.force_n[rows], lever_m, acceleration, side)

    def wrench(self, row: int) -> Wrench:
        """Returns a reading of the force sensor, stamped by its own clock."""
        return Wrench(int(self.log.stamp_ns[row]), self.log.force_n[row], self.log.torque_nm[row], frame="sensor")

    def actuation(self, log: _ReadingLog, row: int) -> Actuation:
        """Returns a reading of a drive.

        Args:
            log: ``stage`` or ``joints``.
            row: number of the reading.

        Returns:
            Positions of the axes in mm or degrees, stamped by the camera's clock.
        """
        values = dict(zip(log.names, log.values[row].tolist(), strict=True))
        return Actuation(int(log.stamp_ns[row]), values, STAGE if log is self.stage else JOINTS)
