"""Driven axes: their limits, and the result of a command."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

ADVANCE = "advance_mm"
"""Axis of the catheter's clamp, along the base tangent; the free length stays."""
KNOB = "knob_deg"
STAGE_FORWARD, STAGE_ACROSS = "stage_forward_mm", "stage_across_mm"
"""Axes of the tissue: forward, against the tip, and to the left of that direction in the image."""


@dataclass(frozen=True, slots=True)
class AxisLimits:
    """Limits of an axis, in the unit at the end of its name.

    Attributes:
        low: smallest position.
        high: largest position.
        max_speed: largest speed, for each second.
        max_acceleration: largest acceleration, for each second squared.

    Raises:
        ValueError: the limits allow no motion.

    >>> AxisLimits(-10.0, 20.0, 50.0, 1000.0).clipped(25.0)
    20.0
    """

    low: float
    high: float
    max_speed: float
    max_acceleration: float

    def __post_init__(self) -> None:
        if not (self.low < self.high and self.max_speed > 0 and self.max_acceleration > 0):
            raise ValueError(f"an axis needs low < high and positive speed and acceleration, got {self}")

    def clipped(self, target: float) -> float:
        """Returns the nearest position that the axis may go to."""
        return min(max(target, self.low), self.high)


def refuse_unknown(names: Iterable[str], limits: Mapping[str, AxisLimits]) -> None:
    """Checks that all names are axes.

    Args:
        names: names of the axes.
        limits: limits of each axis, by name.

    Raises:
        ValueError: one of the names is not in ``limits``.
    """
    for name in names:
        if name not in limits:
            raise ValueError(f"{name}: there is no such axis; there are {', '.join(limits)}")


@dataclass(frozen=True, slots=True)
class Commanded:
    """Result of a command.

    Attributes:
        stamp_ns: time of the command.
        targets: present target of each commanded axis, by name.
        clipped: requested targets of the axes whose limits do not allow them.
    """

    stamp_ns: int
    targets: Mapping[str, float]
    clipped: Mapping[str, float]

    @classmethod
    def of(cls, stamp_ns: int, wanted: Mapping[str, float], limits: Mapping[str, AxisLimits]) -> "Commanded":
        """Clips the requested targets to the limits of their axes.

        Args:
            stamp_ns: time of the command.
            wanted: requested target of each axis, by name.
            limits: limits of each axis, by name.

        Raises:
            ValueError: an axis is unknown or a value is not finite; the whole command is refused.

        >>> Commanded.of(0, {"knob_deg": 99.0}, {"knob_deg": AxisLimits(0.0, 90.0, 60.0, 600.0)})
        Commanded(stamp_ns=0, targets={'knob_deg': 90.0}, clipped={'knob_deg': 99.0})
        """
        refuse_unknown(wanted, limits)
        for name, value in wanted.items():
            if not math.isfinite(value):
                raise ValueError(f"{name}: expected a finite number, got {value}")
        targets = {name: limits[name].clipped(float(value)) for name, value in wanted.items()}
        return cls(stamp_ns, targets, {name: float(value) for name, value in wanted.items() if targets[name] != value})
