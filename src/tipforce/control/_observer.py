"""Predicts the wall: an extended Kalman filter over a model of its motion, the heart rate, and the gain of the plant.

Several heart rates are tried in parallel, each with a state of its own (a row of the arrays). A state consists of the
wall's constant in mm, the breath as an oscillator, ``H`` harmonics of the heart as oscillators (two numbers each, in
mm), the heart's rate in rad/s, and the logarithm of the gain in N/mm: ``s = 2 H + 5`` numbers. The force is the gain
times the depth of the tip in the wall, ``position + wall``, and never below zero. A measured force of zero where the
model has none has no information; where the model has a force, it shows that the wall is farther away.
"""

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from ..types import FloatArray, IntArray
from ._settings import ObserverSettings

_BREATH, _HEART = 1, 3
_TWO_PI = 2.0 * math.pi
_LIKELIHOOD_MEMORY_S = 10.0
"""Time constant with which the log-likelihood of a rate decays."""
_MAX_LOG_LIKELIHOOD_DEFICIT = 20.0
"""A rate counts while its log-likelihood is at most this much smaller than that of the most likely one."""
_LIKELIHOOD_SHARE = 0.25
"""Share of a difference in log-likelihood that counts: errors of neighbouring estimates are alike."""
_RESIDUAL_MEMORY_S = 1.0
"""Time in contact for which an error of the prediction counts. Time without contact has no information."""
_PHASE_COUNT = 8
"""Number of phases of a beat at which the standard deviation of the prediction is computed."""


@dataclass(frozen=True, slots=True)
class Sample:
    """An estimate as a controller takes it.

    Args:
        time_s: mid-exposure of the image.
        force_n: estimated force.
        sigma_n: standard deviation of the force.
        position_mm: position of the catheter on the path.
    """

    time_s: float
    force_n: float
    sigma_n: float
    position_mm: float


class WallObserver:
    """Follows the wall from estimates of the force, and predicts it.

    Until `lock` all rates of the settings are followed in parallel; then the most likely one is kept and tracked.

    Args:
        settings: model of the wall.
        wall_mm: expected constant of the wall: minus the position on the path at which the tip meets it.
        wall_sigma_mm: standard deviation of that constant.
    """

    def __init__(self, settings: ObserverSettings, wall_mm: float, wall_sigma_mm: float) -> None:
        self.settings = settings
        self.time_s: float | None = None
        count, harmonics = settings.rates, settings.harmonics
        size = _HEART + 2 * harmonics + 2
        self._rate_column, self._gain_column = size - 2, size - 1
        """Columns of the state: the heart's rate, and the logarithm of the gain."""
        self._harmonics = np.arange(1, harmonics + 1)
        """(H,) numbers of the harmonics: 1, 2, ..."""
        # the state (rates, s) before the first estimate: each row has its own heart rate, and no motion
        self._state = np.zeros((count, size))
        """(rates, s) state of each rate that is tried."""
        self._state[:, 0] = wall_mm
        low, high = settings.heart_hz
        self._state[:, self._rate_column] = _TWO_PI * np.linspace(low, high, count)
        self._state[:, self._gain_column] = math.log(settings.gain_n_per_mm)
        # its covariance; an amplitude has two components, each with half of the variance
        heart_sigma = np.repeat(settings.wall_mm / self._harmonics**2, 2) / math.sqrt(2.0)
        breath_sigma = np.full(2, settings.breath_mm / math.sqrt(2.0))
        rate_sigma = _TWO_PI * (high - low) / (count - 1) / 3.0  # a third of the distance between neighbouring rates
        gain_sigma = math.log(settings.gain_factor)
        sigma = np.concatenate([[wall_sigma_mm], breath_sigma, heart_sigma, [rate_sigma, gain_sigma]])
        self._covariance = np.tile(np.diag(sigma**2), (count, 1, 1))
        """(rates, s, s) covariance of each state."""
        # standard deviation of the random walk of each number of the state over a second
        breath_walk, heart_walk = np.full(2, settings.swing_mm), np.repeat(settings.swing_mm / self._harmonics, 2)
        rate_walk, gain_walk = _TWO_PI * settings.rate_wander_hz, settings.gain_wander
        walk = np.concatenate([[settings.wander_mm], breath_walk, heart_walk, [rate_walk, gain_walk]])
        self._growth = np.diag(walk**2)
        """(s, s) growth of the covariance in a second."""
        self._log_likelihood = np.zeros(count)
        """(rates,) log-likelihood of each rate."""
        self._residuals: deque[tuple[float, float]] = deque()
        self._in_contact_s = 0.0
        self.locked = False

    @property
    def best(self) -> int:
        """Row of the most likely rate."""
        return int(np.argmax(self._log_likelihood))

    @property
    def heart_hz(self) -> float:
        """Heart rate of the most likely model, in Hz."""
        return float(self._state[self.best, self._rate_column]) / _TWO_PI

    @property
    def gain_n_per_mm(self) -> float:
        """Force for each mm of the path, in the most likely model."""
        return math.exp(float(self._state[self.best, self._gain_column]))

    def lock(self) -> None:
        """Keeps the most likely rate only."""
        row = self.best
        self._state, self._covariance = self._state[row : row + 1], self._covariance[row : row + 1]
        self._log_likelihood = self._log_likelihood[row : row + 1]
        self.locked = True

    def add(self, sample: Sample) -> None:
        """Moves the model of the wall to the time of an estimate, and corrects it by the estimated force.

        An estimate that is not later than the last one is ignored.
        """
        if self.time_s is not None:
            dt_s = sample.time_s - self.time_s
            if dt_s <= 0.0:
                return
            self._predict(dt_s)
            if self._has_force(sample):
                self._in_contact_s += dt_s
        self.time_s = sample.time_s
        self._update(sample)

    def wall_mm(self, time_s: float) -> float:
        """Returns the wall at ``time_s`` in mm: minus the position on the path at which the tip just meets it.

        It is the sum of the constant, the breath and the harmonics of the heart, in the most likely model. Before the
        first estimate it is the constant.
        """
        if self.time_s is None:
            return float(self._state[0, 0])
        ahead_s = time_s - self.time_s
        state = self._state[self.best]
        breath_angle = _TWO_PI * self.settings.respiration_hz * ahead_s
        wall_mm = state[0] + math.cos(breath_angle) * state[_BREATH] + math.sin(breath_angle) * state[_BREATH + 1]
        angles = self._harmonics * state[self._rate_column] * ahead_s
        components = state[_HEART : self._rate_column].reshape(-1, 2)  # (H, 2) of cosine and sine
        return float(wall_mm + np.cos(angles) @ components[:, 0] + np.sin(angles) @ components[:, 1])

    @property
    def mean_mm(self) -> float:
        """Constant of the wall: its position without heart and breath, in mm."""
        return float(self._state[self.best, 0])

    @property
    def rate_range_hz(self) -> float:
        """Difference between the largest and the smallest plausible rate, in Hz."""
        return float(np.ptp(self._state[self._plausible_rows, self._rate_column])) / _TWO_PI

    @property
    def max_residual_n(self) -> float:
        """Largest difference of measured force and most likely model in the last second of contact.

        Infinite before the first estimate.
        """
        return max((size for _, size in self._residuals), default=math.inf)

    def spread_mm(self) -> float:
        """Returns the largest standard deviation of `wall_mm` within the next period of the heart, in mm.

        Plausible rates are weighted by their likelihood: the value is large where they predict different walls.
        """
        rows = self._plausible_rows
        # errors of neighbouring estimates are alike, so that only a share of the log-likelihood counts
        weights = np.exp(_LIKELIHOOD_SHARE * (self._log_likelihood[rows] - self._log_likelihood.max()))
        weights /= weights.sum()
        period_s = _TWO_PI / float(self._state[self.best, self._rate_column])
        wall_mm, gradient = self._predictions(rows, np.linspace(0.0, period_s, _PHASE_COUNT))
        variance_mm2 = np.einsum("bki,bij,bkj->bk", gradient, self._covariance[rows], gradient)
        mean_mm = weights @ wall_mm
        # variance of the mixture at each phase: within each model, and between the models
        return float(np.sqrt((weights @ (variance_mm2 + (wall_mm - mean_mm) ** 2)).max()))

    def excess_mm(self, times_s: FloatArray, positions_mm: FloatArray, force_n: float, sigmas: float) -> float:
        """Returns by how many mm the tip would be deeper in the wall than a limit of the force allows.

        The wall is predicted for each time and each plausible heart rate; the worst case counts.

        Args:
            times_s: (k,) times in s, not before the last estimate.
            positions_mm: (k,) positions of the tip on the path at these times.
            force_n: largest force that is allowed, in newtons.
            sigmas: number of standard deviations by which the force may be larger than predicted.

        Returns:
            Depth in mm by which the tip is deeper than the depth at which the force is ``force_n``: the largest value.
            It is 0 where the tip is less deep, and before the first estimate.
        """
        if self.time_s is None:
            return 0.0
        rows = self._plausible_rows
        wall_mm, gradient = self._predictions(rows, times_s - self.time_s)
        gain_n_per_mm = np.exp(self._state[rows, self._gain_column])[:, None]
        depth_mm = positions_mm + wall_mm
        # Force / gain = depth, so an uncertain gain counts as an uncertain depth: d(force) / d(log gain) = force, and
        # divided by the gain that is the depth.
        gradient[:, :, self._gain_column] = np.maximum(depth_mm, 0.0)
        variance_mm2 = np.einsum("bki,bij,bkj->bk", gradient, self._covariance[rows], gradient)
        sigma_mm = np.sqrt(np.maximum(variance_mm2, 0.0))  # rounding can make a variance negative
        return max(0.0, float((depth_mm + sigmas * sigma_mm - force_n / gain_n_per_mm).max()))

    @property
    def _plausible_rows(self) -> IntArray:
        """(b,) rows of the rates whose log-likelihood is near that of the most likely one."""
        return np.flatnonzero(self._log_likelihood >= self._log_likelihood.max() - _MAX_LOG_LIKELIHOOD_DEFICIT)

    def _predictions(self, rows: IntArray, ahead_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Predicts the wall: constant, breath and harmonics of the heart, each turned on from the last estimate.

        Args:
            rows: (b,) rows of the rates.
            ahead_s: (k,) times after the last estimate, in s.

        Returns:
            (b, k) wall in mm, and its gradient by the state (b, k, s).
        """
        state = self._state[rows]
        gradient = np.zeros((len(state), ahead_s.size, state.shape[1]))
        gradient[:, :, 0] = 1.0
        breath_angle = _TWO_PI * self.settings.respiration_hz * ahead_s
        gradient[:, :, _BREATH], gradient[:, :, _BREATH + 1] = np.cos(breath_angle), np.sin(breath_angle)
        angle_by_rate = np.multiply.outer(ahead_s, self._harmonics)  # (k, H): angle = rate * time * number
        angle = state[:, self._rate_column, None, None] * angle_by_rate
        cos, sin = np.cos(angle), np.sin(angle)
        gradient[:, :, _HEART : self._rate_column : 2], gradient[:, :, _HEART + 1 : self._rate_column : 2] = cos, sin
        # the wall is linear in constant, breath and harmonics; the columns of rate and gain are still zero here
        wall_mm = np.einsum("bki,bi->bk", gradient, state)
        components = state[:, None, _HEART : self._rate_column].reshape(len(state), 1, -1, 2)
        wall_by_angle = -sin * components[..., 0] + cos * components[..., 1]
        gradient[:, :, self._rate_column] = (wall_by_angle * angle_by_rate).sum(axis=2)
        return wall_mm, gradient

    def _predict(self, dt_s: float) -> None:
        """Moves state and covariance of all rates by ``dt_s`` seconds: breath and harmonics of the heart turn.

        The constants, the rates and the gain keep their values; the covariance of the whole state grows.
        """
        count, size = self._state.shape
        jacobian = np.tile(np.eye(size), (count, 1, 1))
        state = self._state.copy()
        breath_angle = _TWO_PI * self.settings.respiration_hz * dt_s
        cosine, sine = math.cos(breath_angle), math.sin(breath_angle)
        rotation = np.array([[cosine, sine], [-sine, cosine]])
        breath = slice(_BREATH, _BREATH + 2)
        state[:, breath] = self._state[:, breath] @ rotation.T
        jacobian[:, breath, breath] = rotation
        for number in self._harmonics.tolist():
            first, second = _HEART + 2 * number - 2, _HEART + 2 * number - 1  # columns of the harmonic's two components
            angle = number * self._state[:, self._rate_column] * dt_s
            cos, sin = np.cos(angle), np.sin(angle)
            state[:, first] = cos * self._state[:, first] + sin * self._state[:, second]
            state[:, second] = -sin * self._state[:, first] + cos * self._state[:, second]
            harmonic = slice(first, second + 1)
            jacobian[:, harmonic, harmonic] = np.stack([np.stack([cos, sin], 1), np.stack([-sin, cos], 1)], 1)
            jacobian[:, first, self._rate_column] = number * dt_s * state[:, second]
            jacobian[:, second, self._rate_column] = -number * dt_s * state[:, first]
        # old estimates say little about the present rate: the heart rate changes
        self._log_likelihood = self._log_likelihood * math.exp(-dt_s / _LIKELIHOOD_MEMORY_S)
        self._state = state
        self._covariance = jacobian @ self._covariance @ jacobian.transpose(0, 2, 1) + self._growth * dt_s

    def _has_force(self, sample: Sample) -> bool:
        """Returns whether the force is more than noise."""
        return sample.force_n > 3.0 * self.settings.noise_n

    def _update(self, sample: Sample) -> None:
        """Corrects state, covariance and log-likelihood of all rates by a force: the Kalman filter's measurement step.

        The oscillators are at phase 0, since `_predict` moved them to the sample's time: only their first components
        are in the wall. A row without a force in model and sample is not corrected.
        """
        state = self._state
        wall = state[:, 0] + state[:, _BREATH] + state[:, _HEART : self._rate_column : 2].sum(axis=1)
        depth, gain = sample.position_mm + wall, np.exp(state[:, self._gain_column])
        expected = np.maximum(gain * depth, 0.0)
        gradient = np.zeros_like(state)  # (rates, s) of the force by the state
        gradient[:, 0] = gradient[:, _BREATH] = gain
        gradient[:, _HEART : self._rate_column : 2] = gain[:, None]
        gradient[:, self._gain_column] = expected
        informative = (depth > 0.0) | self._has_force(sample)
        force_covariance = np.einsum("bij,bj->bi", self._covariance, gradient)  # (rates, s) of state and force
        noise = max(sample.sigma_n, self.settings.noise_n) ** 2
        variance = np.einsum("bi,bi->b", gradient, force_covariance) + noise
        residual = sample.force_n - np.where(informative, gain * depth, expected)
        self._residuals.append((self._in_contact_s, abs(sample.force_n - float(expected[self.best]))))
        while self._residuals[0][0] < self._in_contact_s - _RESIDUAL_MEMORY_S:
            self._residuals.popleft()
        step = np.where(informative, residual / variance, 0.0)
        # An estimate further off counts as if it were at three standard deviations: it is an error of the estimator,
        # since the wall does not jump.
        bound = 3.0 / np.sqrt(variance)
        step = np.clip(step, -bound, bound)
        self._state = state + force_covariance * step[:, None]
        weight = np.where(informative, 1.0 / variance, 0.0)[:, None, None]
        self._covariance = self._covariance - weight * force_covariance[:, :, None] * force_covariance[:, None, :]
        self._covariance = 0.5 * (self._covariance + self._covariance.transpose(0, 2, 1))  # rounding made it asymmetric
        low, high = self.settings.gain_range
        np.clip(self._state[:, self._gain_column], math.log(low), math.log(high), out=self._state[:, self._gain_column])
        slowest, fastest = (_TWO_PI * rate for rate in self.settings.heart_hz)
        np.clip(self._state[:, self._rate_column], slowest, fastest, out=self._state[:, self._rate_column])
        # a row without information gets the log-likelihood of a residual of zero, so that it does not fall behind
        self._log_likelihood = self._log_likelihood - 0.5 * np.where(
            informative, residual * residual / variance + np.log(variance), math.log(noise)
        )
