"""All that a session's instruments read but the pictures: taken as far as the session has come."""

from collections.abc import Callable

import numpy as np

from ..types import ADVANCE, JOINTS, KNOB, STAGE, STAGE_ACROSS, STAGE_FORWARD, Actuation, FloatArray, IntArray, Wrench
from .world import Course, ForceSensor, Load, Rig

__all__ = ["Place", "Readings"]

Place = Callable[[FloatArray], tuple[IntArray, FloatArray]]
"""Times (k,) -> the course's instant before each, and how far it is from there to the next."""

_STAGE_HZ = 100.0
_KNOB_HZ = 50.0
_SENSOR_BELOW_M = 0.02
"""From the tissue's surface to the sensor's origin."""


class _Log:
    """A drive's readings: rows of ``values`` (k, n) by ``names``, rounded to ``digits``."""

    def __init__(self, hertz: float, seconds: float, names: tuple[str, ...], digits: int, place: Place) -> None:
        times = np.arange(round(seconds * hertz)) / hertz
        self.stamp_ns: IntArray = np.round(times * 1e9).astype(np.int64)
        self.names, self.digits = names, digits
        self.values = np.zeros((times.size, len(names)))
        self._low, self._share = place(times)
        self.need = self._low + 2
        """Instants of the course that must have happened for each row to be read."""

    def take(self, columns: tuple[tuple[FloatArray, float], ...], first: int, end: int) -> None:
        """The readings from ``first`` to ``end``, exclusive, of the course's ``columns``, each with its unit."""
        low, part = self._low[first:end], self._share[first:end]
        for k, (column, unit) in enumerate(columns[: len(self.names)]):
            value = unit * (column[low] * (1 - part) + column[low + 1] * part)
            self.values[first:end, k] = np.round(value, self.digits)


class Readings:
    """Force sensor, stage and joints of a session; the same however often `take` is called on the way.

    ``log``: the sensor's; ``need_force``, ``stage.need``, ``joints.need``: how many instants of the course must have
    happened for each reading.
    """

    def __init__(self, rig: Rig, place: Place, rng: np.random.Generator) -> None:
        world = rig.settings
        angle = float(np.arctan2(rig.forward[1], rig.forward[0]))
        self.rig = rig
        self.sensor = ForceSensor(world.sensor, world.clock, angle, world.seconds + 0.2, rng)
        self.log = self.sensor.log
        self._low, _ = place(self.log.true_s)
        self.need_force = self._low + 3  # one more, for the course's stamps are not exact
        names = (KNOB, ADVANCE) if world.clamp.logged else (KNOB,)
        self.stage = _Log(_STAGE_HZ, world.seconds, (STAGE_FORWARD, STAGE_ACROSS), 4, place)
        self.joints = _Log(_KNOB_HZ, world.seconds, names, 2, place)
        self._taken = [0, 0, 0]

    def take(self, course: Course, rows: int) -> None:
        """Read what the first ``rows`` instants of ``course`` allow for."""
        rows = len(course.time_s) + 1 if rows == len(course.time_s) else rows
        for k, need in enumerate((self.need_force, self.stage.need, self.joints.need)):
            first, end = self._taken[k], int(np.searchsorted(need, rows, side="right"))
            if end <= first:
                continue
            self._taken[k] = end
            if k == 0:
                window = slice(max(0, int(self._low[first]) - 1), int(self._low[end - 1]) + 3)
                self.sensor.take(self._load(course, window), first, end)
            elif k == 1:
                self.stage.take(((course.command_m[:, 0], 1e3), (course.command_m[:, 1], 1e3)), first, end)
            else:
                self.joints.take(((course.knob_deg, 1.0), (course.advance_m, 1e3)), first, end)

    def _load(self, course: Course, rows: slice) -> Load:
        origin = course.wall_m[rows] + _SENSOR_BELOW_M * self.rig.forward
        contact = course.contact
        side = None
        if self.rig.wall.side_stiffness_n_per_m2 > 0.0:
            side = -contact.side_force_n[rows], course.side_touch_m(rows) - origin
        return Load(
            course.time_s[rows],
            -contact.force_n[rows],
            contact.touch_m[rows] - origin,
            course.acceleration_m_per_s2[rows],
            side,
        )

    def wrench(self, row: int) -> Wrench:
        """A reading of the force sensor, stamped by its own clock."""
        return Wrench(int(self.log.stamp_ns[row]), self.log.force_n[row], self.log.torque_nm[row], frame="sensor")

    def actuation(self, log: _Log, row: int) -> Actuation:
        """A reading of ``stage`` or ``joints``."""
        values = dict(zip(log.names, log.values[row].tolist(), strict=True))
        return Actuation(int(log.stamp_ns[row]), values, STAGE if log is self.stage else JOINTS)
