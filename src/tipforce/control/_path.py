"""The line from the marked start to the marked goal, along which the catheter is driven."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from ..errors import InputError
from ..types import ADVANCE, KNOB, Actuators, AxisLimits
from ._settings import SafetySettings

_UNITS_PER_MM = {ADVANCE: 1.0, KNOB: 3.0}
"""Of each axis what counts as a mm of the path: 3 degrees of the knob move a tip that is 40 mm away by some 2 mm."""


@dataclass(frozen=True, slots=True)
class Path:
    """From ``start`` (0) to ``goal`` (`length_mm`), both marked by the operator: where each axis stands there.

    All axes move together, each in its share; a mm of the path is a mm of advance or 3 degrees of the knob, whichever
    of the two moves more. Raises InputError where start and goal do not name the same axes, or are the same.
    """

    start: Mapping[str, float]
    goal: Mapping[str, float]
    length_mm: float = field(init=False)

    def __post_init__(self) -> None:
        if unknown := [axis for axis in self.start if axis not in _UNITS_PER_MM]:
            raise InputError(f"start and goal: expected axes among {', '.join(_UNITS_PER_MM)}, got {unknown[0]}")
        if self.start.keys() != self.goal.keys():
            raise InputError(
                f"start and goal: expected the same axes, got {sorted(self.start)} and {sorted(self.goal)}"
            )
        length = max(abs(self.goal[name] - self.start[name]) / _UNITS_PER_MM[name] for name in self.start)
        if length <= 0.0:
            raise InputError("start and goal: expected two places, got one")
        object.__setattr__(self, "length_mm", length)

    def slope(self, axis: str) -> float:
        """How far ``axis`` goes for each mm of the path, in its own unit."""
        return (self.goal[axis] - self.start[axis]) / self.length_mm

    def targets(self, position_mm: float) -> dict[str, float]:
        """Where each axis stands at ``position_mm``."""
        return {axis: self.start[axis] + self.slope(axis) * position_mm for axis in self.start}

    def position_mm(self, readings: Mapping[str, float]) -> float:
        """The place on the path that is nearest to what the drives read."""
        along, norm = 0.0, 0.0
        for axis in self.start:
            unit = _UNITS_PER_MM[axis]
            slope = self.slope(axis) / unit
            along += slope * (readings[axis] - self.start[axis]) / unit
            norm += slope * slope
        return along / norm

    def max_speed_mm_per_s(self, limits: Mapping[str, AxisLimits], settings: SafetySettings) -> float:
        """The fastest at which no axis is asked for more than drives and ``settings`` allow."""
        own = {ADVANCE: settings.max_advance_mm_per_s, KNOB: settings.max_knob_deg_per_s}
        speeds = (
            min(limits[axis].max_speed, own[axis]) / abs(self.slope(axis)) for axis in self.start if self.slope(axis)
        )
        return min(speeds)

    def max_acceleration_mm_per_s2(self, limits: Mapping[str, AxisLimits]) -> float:
        """With which the axes keep together."""
        return min(limits[axis].max_acceleration / abs(self.slope(axis)) for axis in self.start if self.slope(axis))

    def check(self, actuators: Actuators) -> None:
        """Raises InputError where the drives cannot go along the whole path."""
        for axis in self.start:
            limits = actuators.limits.get(axis)
            if limits is None:
                raise InputError(f"start and goal: there is no axis {axis}; there are {', '.join(actuators.limits)}")
            for place in (self.start[axis], self.goal[axis]):
                if limits.clipped(place) != place:
                    raise InputError(f"{axis}: expected {limits.low:g} to {limits.high:g}, got {place:g}")
