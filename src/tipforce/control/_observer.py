"""Where the wall will be: an extended Kalman filter over a model of its motion, the heart's rate, and the plant's gain.

State, of each of ``B`` rates that are tried: the wall's constant, the breath as an oscillator, ``H`` harmonics of the
heart as oscillators (two numbers each), the heart's rate in rad/s, and the logarithm of the gain. The force is the
gain times how deep the tip stands in the wall, ``position + wall``, and never below zero. A force of zero where the
model has none tells nothing, one where it has some tells that the wall is farther away.
"""

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from ..types import FloatArray, IntArray
from ._settings import ObserverSettings

_BREATH, _HEART = 1, 3
_TWO_PI = 2.0 * math.pi
_MEMORY_S = 10.0
"""So long counts what a rate explained, and what it did not."""
_PLAUSIBLE = 20.0
"""A rate counts as long as its log-likelihood is at most so much smaller than that of the most likely one."""
_TEMPERED = 0.25
"""Share of a difference in log-likelihood that counts: errors of neighbouring estimates are alike."""
_SURPRISE_S = 1.0
"""Time in contact after which an error of the prediction no longer counts. Time without contact proves nothing."""
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
        self._surprises: deque[tuple[float, float]] = deque()
        self._in_contact_s = 0.0
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
            if self._felt(sample):
                self._in_contact_s += sample.time_s - self.time_s
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

    @property
    def rate_range_hz(self) -> float:
        """How far the rates that are plausible lie apart."""
        return float(np.ptp(self._x[self._plausible, self._rate])) / _TWO_PI

    @property
    def surprise_n(self) -> float:
        """Largest difference between the force and what the most likely model expected, in the last second of contact.

        Infinite before the first estimate.
        """
        return max((size for _, size in self._surprises), default=math.inf)

    def spread_mm(self) -> float:
        """Standard deviation of `wall_mm` where it is largest within the next period of the heart.

        The rates that are plausible count as likely as they are: where they predict different walls, it is large.
        """
        rows = self._plausible
        weights = np.exp(_TEMPERED * (self._likelihood[rows] - self._likelihood.max()))
        weights /= weights.sum()
        ahead = np.linspace(0.0, _TWO_PI / float(self._x[self.best, self._rate]), _PHASES)
        wall, h = self._predictions(rows, ahead)
        variance = np.einsum("bki,bij,bkj->bk", h, self._p[rows], h)
        return float(np.sqrt((weights @ (variance + (wall - weights @ wall) ** 2)).max()))

    def excess_mm(self, times_s: FloatArray, places_mm: FloatArray, force_n: float, sigmas: float) -> float:
        """Returns by how many mm the tip goes too far for the worst of all plausible rates; at least 0.

        Args:
            times_s: (k,) not before the last estimate.
            places_mm: (k,) where the tip is on the path then.
            force_n: largest force that is allowed, in newtons.
            sigmas: standard deviations of the predicted force that are added to it.
        """
        if self.time_s is None:
            return 0.0
        rows = self._plausible
        wall, h = self._predictions(rows, times_s - self.time_s)
        gain = np.exp(self._x[rows, self._gain])[:, None]
        depth = places_mm + wall
        h[:, :, self._gain] = np.maximum(depth, 0.0)
        spread = np.sqrt(np.maximum(np.einsum("bki,bij,bkj->bk", h, self._p[rows], h), 0.0))
        return max(0.0, float((depth + sigmas * spread - force_n / gain).max()))

    @property
    def _plausible(self) -> IntArray:
        """(b,) rows of the rates that are not ruled out yet."""
        return np.flatnonzero(self._likelihood >= self._likelihood.max() - _PLAUSIBLE)

    def _predictions(self, rows: IntArray, ahead_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Returns the wall (b, k) in mm, of ``rows`` (b,) at ``ahead_s`` (k,), and its gradient by the state."""
        x = self._x[rows]
        rate = x[:, self._rate, None, None]
        h = np.zeros((len(x), ahead_s.size, x.shape[1]))
        h[:, :, 0] = 1.0
        breath = _TWO_PI * self.settings.respiration_hz * ahead_s
        h[:, :, _BREATH], h[:, :, _BREATH + 1] = np.cos(breath), np.sin(breath)
        turns = np.multiply.outer(ahead_s, self._numbers)
        cos, sin = np.cos(rate * turns), np.sin(rate * turns)
        h[:, :, _HEART : self._rate : 2], h[:, :, _HEART + 1 : self._rate : 2] = cos, sin
        wall = np.einsum("bki,bi->bk", h, x)
        pairs = x[:, None, _HEART : self._rate].reshape(len(x), 1, -1, 2)
        h[:, :, self._rate] = ((-sin * pairs[..., 0] + cos * pairs[..., 1]) * turns).sum(axis=2)
        return wall, h

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

    def _felt(self, sample: Sample) -> bool:
        """Returns whether the force is more than noise."""
        return sample.force_n > 3.0 * self.settings.noise_n

    def _update(self, sample: Sample) -> None:
        x = self._x
        wall = x[:, 0] + x[:, _BREATH] + x[:, _HEART : self._rate : 2].sum(axis=1)
        depth, gain = sample.position_mm + wall, np.exp(x[:, self._gain])
        h = np.zeros_like(x)
        h[:, 0] = h[:, _BREATH] = gain
        h[:, _HEART : self._rate : 2] = gain[:, None]
        h[:, self._gain] = np.maximum(gain * depth, 0.0)
        expected = np.maximum(gain * depth, 0.0)
        informative = (depth > 0.0) | self._felt(sample)
        ph = np.einsum("bij,bj->bi", self._p, h)
        noise = max(sample.sigma_n, self.settings.noise_n) ** 2
        variance = np.einsum("bi,bi->b", h, ph) + noise
        wrong = sample.force_n - np.where(informative, gain * depth, expected)
        self._surprises.append((self._in_contact_s, abs(sample.force_n - float(expected[self.best]))))
        while self._surprises[0][0] < self._in_contact_s - _SURPRISE_S:
            self._surprises.popleft()
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
