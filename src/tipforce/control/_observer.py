"""Where the wall will be: an extended Kalman filter over a model of its motion, the heart's rate, and the plant's gain.

State, of each of ``B`` rates that are tried: the wall's constant, the breath as an oscillator, ``H`` harmonics of the
heart as oscillators (two numbers each), the heart's rate in rad/s, and the logarithm of the gain. The force is the
gain times how deep the tip stands in the wall, ``position + wall``, and never below zero. A force of zero where the
model has none tells nothing, one where it has some tells that the wall is farther away.
"""

import math
from dataclasses import dataclass

import numpy as np

from ._settings import ObserverSettings

__all__ = ["Sample", "WallObserver"]

_BREATH, _HEART = 1, 3
_TWO_PI = 2.0 * math.pi
_MEMORY_S = 10.0
"""So long counts what a rate explained, and what it did not."""
_PHASES = 8
"""Of a beat, at which the prediction's spread is looked at."""


@dataclass(frozen=True, slots=True)
class Sample:
    """An estimate as a controller takes it: mid-exposure in s, force and its standard deviation, place on the path."""

    time_s: float
    force_n: float
    sigma_n: float
    position_mm: float


class WallObserver:
    """Follows the wall from estimates of the force, and predicts it.

    Until `lock` all rates of the settings are followed side by side; the most likely one is then kept, and tracked.
    """

    def __init__(self, settings: ObserverSettings, wall_mm: float, wall_sigma_mm: float) -> None:
        self.settings = settings
        self.time_s: float | None = None
        count, harmonics = settings.rates, settings.harmonics
        size = _HEART + 2 * harmonics + 2
        self._rate, self._gain = size - 2, size - 1
        self._x = np.zeros((count, size))
        self._x[:, 0] = wall_mm
        low, high = settings.heart_hz
        self._x[:, self._rate] = _TWO_PI * np.linspace(low, high, count)
        self._x[:, self._gain] = math.log(settings.gain_n_per_mm)
        numbers = np.arange(1, harmonics + 1)
        amplitude = np.repeat(settings.wall_mm / numbers**2, 2) / math.sqrt(2.0)
        breath = np.full(2, settings.breath_mm / math.sqrt(2.0))
        spacing = _TWO_PI * (high - low) / (count - 1) / 3.0
        sigma = np.concatenate([[wall_sigma_mm], breath, amplitude, [spacing, math.log(settings.gain_factor)]])
        self._p = np.tile(np.diag(sigma**2), (count, 1, 1))
        swing = np.repeat(settings.swing_mm / numbers, 2)
        wander = np.concatenate(
            [
                [settings.wander_mm],
                np.full(2, settings.swing_mm),
                swing,
                [_TWO_PI * settings.rate_wander_hz, settings.gain_wander],
            ]
        )
        self._q = np.diag(wander**2)
        self._numbers = numbers
        self._likelihood = np.zeros(count)
        self.locked = False

    @property
    def best(self) -> int:
        """The row of the most likely rate."""
        return int(np.argmax(self._likelihood))

    @property
    def heart_hz(self) -> float:
        """The heart's rate, of the most likely model."""
        return float(self._x[self.best, self._rate]) / _TWO_PI

    @property
    def gain_n_per_mm(self) -> float:
        """Force for each mm of the path."""
        return math.exp(float(self._x[self.best, self._gain]))

    def lock(self) -> None:
        """Keep the most likely rate alone."""
        row = self.best
        self._x, self._p = self._x[row : row + 1], self._p[row : row + 1]
        self._likelihood = self._likelihood[row : row + 1]
        self.locked = True

    def add(self, sample: Sample) -> None:
        """Take one estimate; one that is not later than the last is passed over."""
        if self.time_s is not None:
            if sample.time_s <= self.time_s:
                return
            self._predict(sample.time_s - self.time_s)
        self.time_s = sample.time_s
        self._update(sample)

    def wall_mm(self, time_s: float) -> float:
        """Where the wall is, or will be, at ``time_s``: minus the place on the path at which the tip just meets it."""
        if self.time_s is None:
            return float(self._x[0, 0])
        ahead = time_s - self.time_s
        x = self._x[self.best]
        turned = _TWO_PI * self.settings.respiration_hz * ahead
        wall = x[0] + math.cos(turned) * x[_BREATH] + math.sin(turned) * x[_BREATH + 1]
        angles = self._numbers * x[self._rate] * ahead
        pairs = x[_HEART : self._rate].reshape(-1, 2)
        return float(wall + np.cos(angles) @ pairs[:, 0] + np.sin(angles) @ pairs[:, 1])

    @property
    def mean_mm(self) -> float:
        """The wall's constant: where it is without heart and breath."""
        return float(self._x[self.best, 0])

    def spread_mm(self) -> float:
        """Standard deviation of `wall_mm` where it is largest within the next period of the heart."""
        row = self.best
        x, rate = self._x[row], float(self._x[row, self._rate])
        ahead = np.linspace(0.0, _TWO_PI / rate, _PHASES)
        h = np.zeros((_PHASES, x.size))
        h[:, 0] = 1.0
        breath = _TWO_PI * self.settings.respiration_hz * ahead
        h[:, _BREATH], h[:, _BREATH + 1] = np.cos(breath), np.sin(breath)
        angles = np.outer(ahead, self._numbers * rate)
        cos, sin = np.cos(angles), np.sin(angles)
        h[:, _HEART : self._rate : 2], h[:, _HEART + 1 : self._rate : 2] = cos, sin
        pairs = x[_HEART : self._rate].reshape(-1, 2)
        h[:, self._rate] = ahead * ((-sin * pairs[:, 0] + cos * pairs[:, 1]) @ self._numbers)
        return float(np.sqrt(np.einsum("ki,ij,kj->k", h, self._p[row], h).max()))

    def _predict(self, dt_s: float) -> None:
        x, count, size = self._x, *self._x.shape
        jacobian = np.tile(np.eye(size), (count, 1, 1))
        moved = x.copy()
        turned = _TWO_PI * self.settings.respiration_hz * dt_s
        rotation = np.array([[math.cos(turned), math.sin(turned)], [-math.sin(turned), math.cos(turned)]])
        breath = slice(_BREATH, _BREATH + 2)
        moved[:, breath] = x[:, breath] @ rotation.T
        jacobian[:, breath, breath] = rotation
        for number in self._numbers.tolist():
            at = slice(_HEART + 2 * number - 2, _HEART + 2 * number)
            angle = number * x[:, self._rate] * dt_s
            cos, sin = np.cos(angle), np.sin(angle)
            a, b = x[:, at.start], x[:, at.start + 1]
            moved[:, at.start], moved[:, at.start + 1] = cos * a + sin * b, -sin * a + cos * b
            jacobian[:, at, at] = np.stack([np.stack([cos, sin], 1), np.stack([-sin, cos], 1)], 1)
            jacobian[:, at.start, self._rate] = number * dt_s * moved[:, at.start + 1]
            jacobian[:, at.start + 1, self._rate] = -number * dt_s * moved[:, at.start]
        self._likelihood = self._likelihood * math.exp(-dt_s / _MEMORY_S)
        self._x = moved
        self._p = jacobian @ self._p @ jacobian.transpose(0, 2, 1) + self._q * dt_s

    def _update(self, sample: Sample) -> None:
        x = self._x
        wall = x[:, 0] + x[:, _BREATH] + x[:, _HEART : self._rate : 2].sum(axis=1)
        depth, gain = sample.position_mm + wall, np.exp(x[:, self._gain])
        h = np.zeros_like(x)
        h[:, 0] = h[:, _BREATH] = gain
        h[:, _HEART : self._rate : 2] = gain[:, None]
        h[:, self._gain] = np.maximum(gain * depth, 0.0)
        expected = np.maximum(gain * depth, 0.0)
        informative = (depth > 0.0) | (sample.force_n > 3.0 * self.settings.noise_n)
        ph = np.einsum("bij,bj->bi", self._p, h)
        noise = max(sample.sigma_n, self.settings.noise_n) ** 2
        variance = np.einsum("bi,bi->b", h, ph) + noise
        wrong = sample.force_n - np.where(informative, gain * depth, expected)
        step = np.where(informative, wrong / variance, 0.0)
        # Beyond three standard deviations an estimate counts as if it were there: the model, not the wall, jumped.
        bound = 3.0 / np.sqrt(variance)
        step = np.clip(step, -bound, bound)
        self._x = x + ph * step[:, None]
        self._p = self._p - np.where(informative, 1.0 / variance, 0.0)[:, None, None] * ph[:, :, None] * ph[:, None, :]
        self._p = 0.5 * (self._p + self._p.transpose(0, 2, 1))
        low, high = self.settings.gain_range
        np.clip(self._x[:, self._gain], math.log(low), math.log(high), out=self._x[:, self._gain])
        slowest, fastest = (_TWO_PI * rate for rate in self.settings.heart_hz)
        np.clip(self._x[:, self._rate], slowest, fastest, out=self._x[:, self._rate])
        self._likelihood = self._likelihood - 0.5 * np.where(
            informative, wrong * wrong / variance + np.log(variance), math.log(noise)
        )
