"""The line from the marked start to the marked goal, along which the catheter is driven."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from ..errors import InputError
from ..types import ADVANCE, KNOB, Actuators, AxisLimits
from ._settings import SafetySettings

_UNITS_PER_PATH_MM = {ADVANCE: 1.0, KNOB: 3.0}
"""Change of each axis that counts as 1 mm of the path: 3 degrees of the knob move a tip that is 40 mm away by 2 mm."""


@dataclass(frozen=True, slots=True)
class Path:
    """The path from ``start`` (0) to ``goal`` (`length_mm`): the operator marked the position of each axis at both.

    All axes move at the same time, each in its share. A mm of the path is a mm of advance or 3 degrees of the knob: the
    axis that moves more counts.

    Args:
        start: position of each axis at the start, in mm or degrees.
        goal: position of each axis at the goal, in mm or degrees.

    Raises:
        InputError: start and goal do not name the same axes, or are the same position.
    """

    start: Mapping[str, float]
    goal: Mapping[str, float]
    length_mm: float = field(init=False)

    def __post_init__(self) -> None:
        if unknown := [axis for axis in self.start if axis not in _UNITS_PER_PATH_MM]:
            raise InputError(f"start and goal: expected axes among {', '.join(_UNITS_PER_PATH_MM)}, got {unknown[0]}")
        if self.start.keys() != self.goal.keys():
            raise InputError(
                f"start and goal: expected the same axes, got {sorted(self.start)} and {sorted(self.goal)}"
            )
        length = max(abs(self.goal[name] - self.start[name]) / _UNITS_PER_PATH_MM[name] for name in self.start)
        if length <= 0.0:
            raise InputError("start and goal: expected two positions, got one")
        object.__setattr__(self, "length_mm", length)

    def slope(self, axis: str) -> float:
        """Returns the change of ``axis`` for each mm of the path, in its own unit."""
        return (self.goal[axis] - self.start[axis]) / self.length_mm

    def targets(self, position_mm: float) -> dict[str, float]:
        """Returns the position of each axis at ``position_mm``."""
        return {axis: self.start[axis] + self.slope(axis) * position_mm for axis in self.start}

    def position_mm(self, readings: Mapping[str, float]) -> float:
        """Returns the position on the path that is nearest to the ``readings`` of the drives, in mm.

        It is the orthogonal projection on the line from start to goal, in a space in which each axis is scaled to mm
        of the path: 1 mm of advance, or 3 degrees of the knob.
        """
        along, norm = 0.0, 0.0
        for axis in self.start:
            unit = _UNITS_PER_PATH_MM[axis]
            slope = self.slope(axis) / unit
            along += slope * (readings[axis] - self.start[axis]) / unit
            norm += slope * slope
        return along / norm

    def max_speed_mm_per_s(self, limits: Mapping[str, AxisLimits], settings: SafetySettings) -> float:
        """Returns the largest speed on the path at which no axis exceeds the limits.

        Args:
            limits: limits of each drive.
            settings: the largest speeds of advance and knob.
        """
        allowed = {ADVANCE: settings.max_advance_mm_per_s, KNOB: settings.max_knob_deg_per_s}
        return min(
            min(limits[axis].max_speed, allowed[axis]) / abs(self.slope(axis))
            for axis in self.start
            if self.slope(axis)
        )

    def max_acceleration_mm_per_s2(self, limits: Mapping[str, AxisLimits]) -> float:
        """Returns the largest acceleration on the path that every axis can follow."""
        return min(limits[axis].max_acceleration / abs(self.slope(axis)) for axis in self.start if self.slope(axis))

    def check(self, actuators: Actuators) -> None:
        """Raises InputError where the drives cannot go along the whole path."""
        for axis in self.start:
            limits = actuators.limits.get(axis)
            if limits is None:
                raise InputError(f"start and goal: there is no axis {axis}; there are {', '.join(actuators.limits)}")
            for position in (self.start[axis], self.goal[axis]):
                if limits.clipped(position) != position:
                    raise InputError(f"{axis}: expected {limits.low:g} to {limits.high:g}, got {position:g}")
