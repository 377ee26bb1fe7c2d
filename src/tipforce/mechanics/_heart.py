"""Motion of the heart's wall: waveforms over a cycle, from -1 to 1, and the commands of a stage for this motion."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np

from ..types import STAGE_ACROSS, STAGE_FORWARD, FloatArray

Wave = Callable[[FloatArray], FloatArray]

# Centre and width in degrees of the cycle, and height, of P, R and T: only the half-waves above the base line, made so
# wide that a stage on a spindle can follow.
_BUMPS = ((-110.0, 34.0, 0.20), (0.0, 40.0, 1.0), (125.0, 42.0, 0.35))


def sine(cycles: FloatArray) -> FloatArray:
    """Returns a sine (n,) for times (n,) in cycles."""
    return np.sin(2 * np.pi * cycles)


def _bumps(cycles: FloatArray) -> FloatArray:
    """Returns the sum of the Gaussian bumps of `_BUMPS` (n,) at times (n,) in cycles."""
    total = np.zeros(np.shape(cycles))
    for centre, width, height in _BUMPS:
        from_centre_deg = np.remainder(360.0 * cycles - centre + 180.0, 360.0) - 180.0
        total += height * np.exp(-0.5 * (from_centre_deg / width) ** 2)
    return total


@cache
def _span() -> tuple[float, float]:
    values = _bumps(np.linspace(0.0, 1.0, 4001))
    return float(values.min()), float(values.max())


def half_wave(cycles: FloatArray) -> FloatArray:
    """Returns the half-waves above the base line of a PQRST curve (thesis fig. 20b), (n,), for times (n,) in cycles.

    >>> bool(half_wave(np.zeros(1))[0] > 0.999)
    True
    """
    low, high = _span()
    return 2.0 * (_bumps(cycles) - low) / (high - low) - 1.0


HEART_WAVES: dict[str, Wave] = {"sine": sine, "half-wave PQRST": half_wave}


@dataclass(frozen=True, slots=True)
class HeartMotion:
    """Heart beat, forward and lateral, as in the thesis's heart simulator (fig. 20), and respiration; for `Actuators`.

    Attributes:
        amplitude_m: forward amplitude, half of peak to peak.
        beat_hz: frequency of the beat.
        wave: one of `HEART_WAVES`.
        lateral_share: ratio of the lateral amplitude to the forward one.
        lateral_phase_rad: phase by which the lateral motion is ahead.
        respiration_m: amplitude of the respiration, a sine in forward direction.
        respiration_hz: its frequency.
        respiration_phase_rad: its phase.
        standoff_m: distance by which the whole motion is set back from the stage's zero.

    Raises:
        ValueError: the wave is unknown.

    >>> HeartMotion(5e-3, beat_hz=1.2, lateral_share=0.5).command(1 / 4.8)
    {'stage_forward_mm': 5.0, 'stage_across_mm': 2.5}
    """

    amplitude_m: float
    beat_hz: float
    wave: str = "sine"
    lateral_share: float = 0.0
    lateral_phase_rad: float = 0.0
    respiration_m: float = 0.0
    respiration_hz: float = 0.25
    respiration_phase_rad: float = 0.0
    standoff_m: float = 0.0

    def __post_init__(self) -> None:
        if self.wave not in HEART_WAVES:
            raise ValueError(f"wave: expected one of {', '.join(HEART_WAVES)}, got {self.wave}")

    def forward(self, time_s: FloatArray) -> FloatArray:
        """Returns the forward beat (n,) at times (n,) in s, divided by the amplitude."""
        return HEART_WAVES[self.wave](self.beat_hz * time_s)

    def lateral(self, time_s: FloatArray) -> FloatArray:
        """Returns the lateral beat (n,) at times (n,) in s, divided by the forward amplitude."""
        turned = self.lateral_phase_rad / (2 * math.pi)
        return self.lateral_share * HEART_WAVES[self.wave](self.beat_hz * time_s + turned)

    def respiration(self, time_s: FloatArray) -> FloatArray:
        """Returns the forward motion (n,) by respiration at times (n,) in s, in m."""
        return self.respiration_m * np.sin(2 * math.pi * self.respiration_hz * time_s + self.respiration_phase_rad)

    def command(self, time_s: float) -> dict[str, float]:
        """Returns the command of a stage ``time_s`` after the start of the motion; it is sent repeatedly."""
        now = np.array([time_s])
        forward = self.amplitude_m * self.forward(now) + self.respiration(now) - self.standoff_m
        across = self.amplitude_m * self.lateral(now)
        return {STAGE_FORWARD: round(1e3 * float(forward[0]), 4), STAGE_ACROSS: round(1e3 * float(across[0]), 4)}
