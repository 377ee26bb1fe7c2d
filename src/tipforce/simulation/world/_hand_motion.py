"""A stage that is moved by hand: slow presses, pauses and small irregular motions, with the tremor of a hand."""

import numpy as np
from scipy.ndimage import gaussian_filter1d

from ...types import FloatArray

_KINDS = ("press", "pause", "fiddle")
_KIND_SHARES = (0.45, 0.2, 0.35)
_PRESS_S, _HOLD_S, _PAUSE_S, _FIDDLE_S = (0.8, 5.0), (0.0, 2.5), (0.5, 3.0), (2.0, 7.0)
_FIDDLE_HZ = (0.3, 1.5)
"""Range of the upper edge of the filtered noise; one value is drawn for each section."""
_TREMOR_HZ, _TREMOR_SHARE = 9.0, 0.01
"""The physiological tremor of a hand is between 8 and 12 Hz; its standard deviation as a share of the amplitude."""
_SMOOTHING_S = 0.06
"""A hand needs this time to start and to stop."""


def hand_wave(time_s: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Makes the motion of a stage that a hand moves: random sections (press, pause, fiddle), smoothed, with tremor.

    Args:
        time_s: (m,) evenly spaced times.
        rng: random numbers.

    Returns:
        (m,) positions from -1 to 1.
    """
    step, count = float(time_s[1] - time_s[0]), time_s.size
    wave, filled, position = np.empty(count), 0, -1.0
    while filled < count:
        kind = str(rng.choice(_KINDS, p=_KIND_SHARES))
        if kind == "press":
            section = _press(position, step, rng)
        elif kind == "pause":
            section = np.full(_steps(_PAUSE_S, step, rng), position)
        else:
            section = _fiddle(position, step, rng)
        section = section[: count - filled]
        wave[filled : filled + section.size] = section
        filled, position = filled + section.size, float(section[-1])
    tremor = _noise(count, _TREMOR_HZ * step, rng)
    wave = gaussian_filter1d(wave, _SMOOTHING_S / step, mode="nearest") + _TREMOR_SHARE * tremor
    low, high = float(wave.min()), float(wave.max())
    return 2.0 * (wave - low) / (high - low) - 1.0


def _steps(seconds: tuple[float, float], step: float, rng: np.random.Generator) -> int:
    return max(2, round(float(rng.uniform(*seconds)) / step))


def _press(here: float, step: float, rng: np.random.Generator) -> FloatArray:
    """Returns a press from position ``here``: forward to some depth, a pause, back; each motion is half a cosine."""
    top, end = float(rng.uniform(min(max(here, -0.2), 0.9), 1.0)), float(rng.uniform(-1.0, -0.3))
    motions = [_ramp(here, top, _steps(_PRESS_S, step, rng)), np.full(_steps(_HOLD_S, step, rng), top)]
    return np.concatenate([*motions, _ramp(top, end, _steps(_PRESS_S, step, rng))])


def _ramp(start: float, end: float, count: int) -> FloatArray:
    return start + (end - start) * (0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, count)))


def _fiddle(here: float, step: float, rng: np.random.Generator) -> FloatArray:
    """Returns filtered noise that starts at the present position and drifts to another mean."""
    count = _steps(_FIDDLE_S, step, rng)
    noise = _noise(count, float(rng.uniform(*_FIDDLE_HZ)) * step, rng)
    drift = np.linspace(here, float(rng.uniform(-0.7, 0.3)), count)
    return np.clip(drift + float(rng.uniform(0.15, 0.5)) * (noise - noise[0]), -1.0, 1.0)


def _noise(count: int, cycles: float, rng: np.random.Generator) -> FloatArray:
    """Returns (count,) low-pass filtered noise of standard deviation 1 with its edge at ``cycles`` per step."""
    sigma = 0.5 / (np.pi * cycles)  # in steps; this Gaussian filter reduces the power at the edge to 1/e
    noise = gaussian_filter1d(rng.standard_normal(count + round(8 * sigma)), sigma)
    noise = noise[round(4 * sigma) : round(4 * sigma) + count]  # without the ends, which the filter spoils
    return noise * np.sqrt(2.0 * np.sqrt(np.pi) * sigma)
