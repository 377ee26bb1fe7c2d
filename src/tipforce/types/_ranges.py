"""Plausible ranges of all physical values that a person or a file states.

They are wide: they find wrong units and senseless numbers, not unusual laboratories.
"""

from dataclasses import dataclass

import numpy as np

from ._arrays import FloatArray


@dataclass(frozen=True, slots=True)
class Range:
    """Range of the plausible values of a quantity.

    Attributes:
        low: smallest value.
        high: largest value.
        unit: unit of both.
        other: unit with which it is often confused.
        factor: factor from ``other`` to ``unit``.
    """

    low: float
    high: float
    unit: str
    other: str = ""
    factor: float = 1.0

    def __str__(self) -> str:
        return f"{self.low:g} to {self.high:g} {self.unit}".strip()

    def hint(self, value: float) -> str:
        """Returns the advice for a ``value`` that is probably in the other unit, else an empty text.

        >>> RANGES["diameter_m"].hint(2.33)
        '; it is in metres: for 2.33 mm write 0.00233'
        """
        meant = value * self.factor
        if not (self.other and self.low <= meant <= self.high):
            return ""
        return f"; it is in {self.unit}: for {value:g} {self.other} write {meant:g}"

    def outside(self, values: FloatArray) -> int | None:
        """Returns the index of the first of ``values`` (n,) that is outside; None if none is. NaN counts as inside."""
        outside = np.flatnonzero((values < self.low) | (values > self.high))
        return int(outside[0]) if len(outside) else None


UNCERTAINTY_RANGE = Range(1e-6, 1.0, "shares", "%", 1e-2)
RANGES = {
    "diameter_m": Range(5e-5, 0.05, "metres", "mm", 1e-3),
    "flexible_length_m": Range(1e-4, 2.0, "metres", "mm", 1e-3),
    "rigid_length_m": Range(0.0, 0.2, "metres", "mm", 1e-3),
    "bending_stiffness_nm2": Range(1e-10, 10.0, "N m^2", "N mm^2", 1e-6),
    "metres_per_px": Range(1e-8, 0.01, "metres", "mm", 1e-3),
    "moving_mass_kg": Range(0.0, 50.0, "kg", "g", 1e-3),
    "knob_gain_per_m_deg": Range(-100.0, 100.0, "1/m for a degree"),
    "rest_curvature_per_m": Range(-200.0, 200.0, "1/m"),
    "knob_offset_per_m": Range(-200.0, 200.0, "1/m"),
    "knob_play_deg": Range(0.0, 90.0, "degrees"),
    "counts_per_n": Range(1e-6, 1e12, "counts for a newton"),
    "range_n": Range(1e-3, 1e4, "N"),
    "rate_hz": Range(1e-3, 1e6, "rows per second"),
    "stiffness_n_per_m": Range(1.0, 1e5, "N/m", "N/mm", 1e3),
    "angle_deg": Range(-360.0, 360.0, "degrees"),
    "flexible_length_uncertainty": UNCERTAINTY_RANGE,
    "bending_stiffness_uncertainty": UNCERTAINTY_RANGE,
    "metres_per_px_uncertainty": UNCERTAINTY_RANGE,
    "knob_gain_uncertainty": UNCERTAINTY_RANGE,
    "tilt_uncertainty_deg": Range(0.01, 90.0, "degrees"),
    "pose_uncertainty_deg": Range(0.0, 90.0, "degrees"),
    "pose_uncertainty_m": Range(0.0, 1.0, "metres", "mm", 1e-3),
}
"""Key of the session metadata -> range."""

FORCE_RANGE = Range(-1e4, 1e4, "N")
"""Range of the readings of a force sensor at a catheter."""

KNOB_RANGE = Range(-720.0, 720.0, "degrees")
RANGE_BY_UNIT = {
    "deg": Range(-36e3, 36e3, "degrees"),
    "rad": Range(-628.0, 628.0, "radians"),
    "m": Range(-100.0, 100.0, "metres", "mm", 1e-3),
    "mm": Range(-1e5, 1e5, "mm"),
    "um": Range(-1e8, 1e8, "um"),
    "kpa": Range(-1e6, 1e6, "kPa"),
    "pa": Range(-1e9, 1e9, "Pa"),
    "bar": Range(-1e4, 1e4, "bar"),
    "v": Range(-1e5, 1e5, "V"),
    "a": Range(-1e4, 1e4, "A"),
    "ma": Range(-1e7, 1e7, "mA"),
    "n": Range(-1e5, 1e5, "N"),
    "mn": Range(-1e8, 1e8, "mN"),
    "nmm": Range(-1e7, 1e7, "N mm"),
}
UNLIMITED_RANGE = Range(-1e12, 1e12, "")


def actuation_range(name: str) -> Range:
    """Returns the range of the readings of a drive with the name NAME_UNIT.

    >>> str(actuation_range("knob_deg")), str(actuation_range("stage_forward_mm"))
    ('-720 to 720 degrees', '-100000 to 100000 mm')
    """
    if name == "knob_deg":
        return KNOB_RANGE
    return RANGE_BY_UNIT.get(name.rpartition("_")[2].lower(), UNLIMITED_RANGE)
