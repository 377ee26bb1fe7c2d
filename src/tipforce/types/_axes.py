"""Driven axes: what they can do, and what became of a command."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

ADVANCE = "advance_mm"
"""The catheter's clamp, along the base tangent; the free length stays."""
KNOB = "knob_deg"
STAGE_FORWARD, STAGE_ACROSS = "stage_forward_mm", "stage_across_mm"
"""What moves the tissue: forward, against the tip, and to the left of that as the image shows it."""


@dataclass(frozen=True, slots=True)
class AxisLimits:
    """What an axis keeps to, in the unit that its name ends in: positions, speed per s, acceleration per s^2.

    Raises ValueError where they leave no room.

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
        """The nearest position that the axis may go to."""
        return min(max(target, self.low), self.high)


def refuse_unknown(names: Iterable[str], limits: Mapping[str, AxisLimits]) -> None:
    """Raise ValueError where one of ``names`` is not an axis of ``limits``."""
    for name in names:
        if name not in limits:
            raise ValueError(f"{name}: there is no such axis; there are {', '.join(limits)}")


@dataclass(frozen=True, slots=True)
class Commanded:
    """What became of a command: ``targets``, where the axes are going now, and since when.

    ``clipped``: what was asked for, of those axes that cannot go so far.
    """

    stamp_ns: int
    targets: Mapping[str, float]
    clipped: Mapping[str, float]

    @classmethod
    def of(cls, stamp_ns: int, wanted: Mapping[str, float], limits: Mapping[str, AxisLimits]) -> "Commanded":
        """``wanted`` by the name of the axis, held against ``limits``.

        Raises ValueError, for all of it, where an axis is unknown or a value is not finite.

        >>> Commanded.of(0, {"knob_deg": 99.0}, {"knob_deg": AxisLimits(0.0, 90.0, 60.0, 600.0)})
        Commanded(stamp_ns=0, targets={'knob_deg': 90.0}, clipped={'knob_deg': 99.0})
        """
        refuse_unknown(wanted, limits)
        for name, value in wanted.items():
            if not math.isfinite(value):
                raise ValueError(f"{name}: expected a finite number, got {value}")
        targets = {name: limits[name].clipped(float(value)) for name, value in wanted.items()}
        return cls(stamp_ns, targets, {n: float(v) for n, v in wanted.items() if targets[n] != v})
