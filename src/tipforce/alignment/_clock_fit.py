"""Force and deflection fitted to one another, for many trial time shifts and clock tilts together.

Least squares treat regressors as exact, but the force has noise: where a force along a nearly straight shaft bends it
very little, the noise of its small sideways part moves the estimate by milliseconds. So the contribution of the noise
to the normal equations is estimated from the log itself and subtracted. The shaft also drifts and creeps, which the
force does not explain: changes slower than the heartbeat are removed on both sides.
"""

import copy
import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import gaussian_filter1d

from ..plausibility import MAX_GAP_S
from ..types import BoolArray, FloatArray, IntArray

SMOOTH_S = 10e-3
"""Standard deviation of the force's low-pass: symmetric, so it moves nothing in time. The force's noise pulls the
estimate late (3 mN and steps of 5 mN at 1 kHz: by 0.7 ms with 2 ms, 0.3 with 4); 24 ms round off touch and release.
"""
DEGREE = 3
"""Degree of the elastic law."""
STATED_ANGLE, ANY_ANGLE = 1e12, 0.0
"""Penalties that hold the sensor at its stated angle, and that leave its angle open."""
_ANGLE_PRIOR = math.tan(math.radians(2.0))
_SLOW_HZ = 0.2
_MAX_NOISE_SHARE = 0.7
"""Largest share of a regressor that is treated as noise: the rest must be enough for the fit."""
_HARMONICS = 5
"""Harmonics of the beat in the inertia of a mass whose movement no log states."""
_BEAT_HZ = (0.5, 3.5)
_STEPS = 9
"""Points of the first grid of tilts."""

Tilted = tuple[float, float]
"""(shift_s, tilt_s): force time = trial force time - shift - tilt x, with x from -1 at the first image to 1 at the
last."""


class Force:
    """The force's x and y on an even grid, low-passed. A gap (NaN, or no rows) is interpolated; see `known`.

    Args:
        seconds: (m,) times of the readings.
        force_n: (m, 2) readings in N; NaN where a reading is not plausible.
        smooth_s: standard deviation of the low-pass.

    Attributes:
        noise: (2, 2) covariance of the sensor's noise behind the low-pass, N^2.
    """

    def __init__(self, seconds: FloatArray, force_n: FloatArray, smooth_s: float = SMOOTH_S) -> None:
        """Interpolates and smooths the readings, marks gaps, and determines the noise from neighbouring readings."""
        finite = np.isfinite(force_n).all(axis=1)
        step = max(float(np.median(np.diff(seconds))), 1e-4)
        self._grid: FloatArray = np.arange(seconds[0], seconds[-1] + step, step)
        even = np.stack([np.interp(self._grid, seconds[finite], column) for column in force_n[finite].T])
        sigma = max(smooth_s / step, 1e-3)  # in steps of the grid
        self._values = gaussian_filter1d(even, sigma, axis=1)
        known = seconds[finite]
        gaps = np.zeros(len(self._grid), np.bool_)
        for number in np.flatnonzero(np.diff(known) > MAX_GAP_S).tolist():
            first, last = np.searchsorted(self._grid, known[number : number + 2])
            gaps[max(0, first - round(3.0 * sigma)) : last + round(3.0 * sigma)] = True
        self._gaps: BoolArray = gaps
        self._ends = float(known[0]), float(known[-1])
        # Third differences of neighbouring readings hold no force, only noise, 20 times its variance; the low-pass
        # leaves 1 / (2 sqrt(pi) sigma) of it.
        rough = np.diff(even, 3, axis=1)
        passed = 1.0 / max(2.0 * math.sqrt(math.pi) * sigma, 1.0)
        self.noise: FloatArray = passed / 20.0 * (rough @ rough.T) / max(rough.shape[1], 1)

    @property
    def direction(self) -> FloatArray:
        """Direction (2,) of the mean force, weighted by its size; zero without a force."""
        total = self._values @ np.linalg.norm(self._values, axis=0)
        return total / max(float(np.linalg.norm(total)), 1e-12)

    @property
    def even(self) -> tuple[float, FloatArray]:
        """Its step in seconds and the values (2, k)."""
        return float(self._grid[1] - self._grid[0]), self._values

    def at(self, seconds: FloatArray) -> FloatArray:
        """Returns the force (2, ...) in N at ``seconds`` (...)."""
        return np.stack([np.interp(seconds, self._grid, row) for row in self._values])

    def known(self, seconds: FloatArray, margin_s: float) -> BoolArray:
        """Returns whether plausible readings exist around each time.

        Args:
            seconds: (n,) times on the force log's clock.
            margin_s: half the length of the stretch around each time that must have readings.

        Returns:
            (n,) whether they exist.
        """
        inside = (seconds > self._ends[0] + margin_s) & (seconds < self._ends[1] - margin_s)
        counts = np.concatenate([[0], np.cumsum(self._gaps)])
        first, last = (np.searchsorted(self._grid, seconds + side) for side in (-margin_s, margin_s))
        return inside & (counts[last] == counts[first])


def beat_hz(force: Force) -> float:
    """Returns the heart rate in Hz: the highest peak of the force's spectrum within `_BEAT_HZ`.

    It is 1 where the log is so short that the spectrum has no frequency in that range.
    """
    step_s, values = force.even
    stride = max(1, round(0.02 / step_s))  # every 20 ms is enough for a beat
    thin = values[:, ::stride] - values.mean(axis=1, keepdims=True)
    size = 8 * thin.shape[1]
    power = np.sum(np.abs(np.fft.rfft(thin * np.hanning(thin.shape[1]), size)) ** 2, axis=0)
    hertz = np.fft.rfftfreq(size, stride * step_s)
    inside = np.flatnonzero((hertz >= _BEAT_HZ[0]) & (hertz <= _BEAT_HZ[1]))
    if not inside.size:
        return 1.0
    top = inside[np.argmax(power[inside])]
    # vertex of the parabola through the logarithms of three neighbours
    left, here, right = np.log(power[top - 1 : top + 2])
    return float(hertz[top] + 0.5 * (left - right) / (left - 2.0 * here + right) * hertz[1])


@dataclass(frozen=True, slots=True, eq=False)
class Data:
    """Frames, and the force.

    Attributes:
        time: (n,) time of each image on the force log's clock by a trial map, s.
        coordinates: (n, 4) `shape_coordinates`.
        blocks: (n,) number of the stretch of each frame.
        force: the force.
        beat_hz: beat of a carried mass whose movement no log states, where the readings contain its inertia; else 0.
    """

    time: FloatArray
    coordinates: FloatArray
    blocks: IntArray
    force: Force
    beat_hz: float = 0.0

    def touching(self, way: float = 1.0) -> "Data":
        """Returns the data with the levers' end ``way`` dome radii against the mean force: at 1 the contact point."""
        x, y = way * self.force.direction
        moved = self.coordinates.copy()
        moved[:, 1] += y * moved[:, 3]
        moved[:, 2] -= x * moved[:, 3]
        return replace(self, coordinates=moved)

    def subset(self, keep: BoolArray) -> "Data":
        """Returns the data of some of the frames."""
        return replace(self, time=self.time[keep], coordinates=self.coordinates[keep], blocks=self.blocks[keep])

    def loaded(self) -> BoolArray:
        """Returns the half of the frames (n,) at which the force is larger."""
        size = np.linalg.norm(self.force.at(self.time), axis=0)
        return size >= np.median(size)

    def left_out(self) -> FloatArray:
        """Returns an orthonormal basis (n, k) of courses over time that the fit leaves out: no force explains them.

        These are slow changes of the bend, and, where a mass is carried, its bending moment at the beat and its
        harmonics: the lever along x and y times a wave.
        """
        span = max(float(np.ptp(self.time)), 1e-9)
        share = ((self.time - self.time[0]) / span)[:, None]  # of the time
        waves = np.cos(np.pi * np.arange(1 + int(2.0 * _SLOW_HZ * span)) * share)
        # cosines are level at both ends, a drift is not
        columns = [waves, share, share**2]
        if self.beat_hz:
            turns = 2.0 * math.pi * self.beat_hz * np.outer(self.time, np.arange(1, _HARMONICS + 1))
            beats = np.hstack([np.cos(turns), np.sin(turns)])
            columns += [beats * self.coordinates[:, [axis]] / self.unit() for axis in (1, 2)]
        return np.linalg.qr(np.hstack(columns))[0]

    def unit(self) -> float:
        """Returns a typical moment in N px; moments are divided by it so that their powers are of similar size."""
        force = np.std(self.force.at(self.time), axis=1).max()
        return max(float(force * np.abs(self.coordinates[:, 1:3]).max()), 1e-12)

    def terms(self, shifts: FloatArray, unit: float, degree: int) -> tuple[FloatArray, FloatArray]:
        """Returns the terms of the elastic law at trial shifts.

        Args:
            shifts: (shifts,) time shifts in s.
            unit: moment in N px by which moments are divided, see `unit`.
            degree: degree of the law in the moment G.

        Returns:
            (shifts, n, degree + 1) terms: G, G^2 ... and the change of G when the sensor turns; and their derivatives
            (shifts, n, degree + 1, 2) by the force's x and y.
        """
        x, y = self.force.at(self.time - shifts[:, None])
        across, along = self.coordinates[:, 1] / unit, self.coordinates[:, 2] / unit
        moment = across * x + along * y
        terms, slopes = np.empty((*moment.shape, degree + 1)), np.empty((*moment.shape, degree + 1, 2))
        power: FloatArray = np.ones_like(moment)
        for column in range(degree):  # d(G^k) / dx = k G^(k - 1) dG / dx
            slope = (column + 1.0) * power
            slopes[..., column, 0], slopes[..., column, 1] = slope * across, slope * along
            power = power * moment
            terms[..., column] = power
        terms[..., degree] = along * x - across * y
        slopes[..., degree, 0], slopes[..., degree, 1] = along, -across
        return terms, slopes


class Fit:
    """Sums of the regression, block by block, for every trial shift: the data of profile and bootstrap.

    The bend y and the terms X of the elastic law, both without the bend that the force does not explain, give for each
    block the products X'X (less the noise in it), X'y and y'y. A weighted sum of them over blocks is a regression.

    Args:
        data: frames and force.
        shifts: (shifts,) trial shifts in s, even.
        penalty: penalty of the prior on the sensor's angle in the squares, see `penalty_at`.
        degree: degree of the elastic law.

    Attributes:
        corrected: share of the force's noise that could be subtracted.
        place: (blocks,) x of `Tilted`.
    """

    def __init__(self, data: Data, shifts: FloatArray, penalty: float = STATED_ANGLE, degree: int = DEGREE) -> None:
        """Sums the products of the regression over the frames of each block, for every trial shift."""
        self._data, self.shifts, self._degree = data, shifts, degree
        self._basis, self._unit = data.left_out(), data.unit()
        self._y = self._quick(data.coordinates[:, 0])
        numbers, block = np.unique(data.blocks, return_inverse=True)
        self.count = len(numbers)
        x, slopes = data.terms(shifts, self._unit, degree)
        x = self._quick(x)
        rows_of = [np.flatnonzero(block == number) for number in range(self.count)]
        self._noisy_xx = np.array([np.swapaxes(x[:, rows], 1, 2) @ x[:, rows] for rows in rows_of])
        self._noise = np.array([self._noise_of(slopes[:, rows], rows) for rows in rows_of])
        self._xy = np.stack([np.swapaxes(x[:, rows], 1, 2) @ self._y[rows] for rows in rows_of])
        self._yy = np.bincount(block, self._y**2)
        middle, half = self.span
        times = np.bincount(block, data.time) / np.bincount(block)
        self.place: FloatArray = (times - middle) / half  # -1 at the first image, 1 at the last
        self._hold(penalty)

    def _hold(self, penalty: float) -> None:
        """Sets the prior on the sensor's angle, and subtracts the noise, or as much of it as leaves a regression."""
        self.penalty = penalty
        prior = np.zeros(self._xy.shape[2])
        prior[-1] = penalty
        share = _share(self._noisy_xx.sum(axis=0) + np.diag(prior), self._noise.sum(axis=0))
        self.corrected = min(1.0, _MAX_NOISE_SHARE / share)
        self._xx = self._noisy_xx - self.corrected * self._noise
        self._sums: FloatArray = np.concatenate([self._xx, self._xy[..., None]], axis=3)
        self._steps: FloatArray = np.diff(self._sums, axis=1)

    def with_penalty(self, penalty: float) -> "Fit":
        """Returns the same fit with another prior on the sensor's angle."""
        fit = copy.copy(self)
        fit._hold(penalty)
        return fit

    @property
    def span(self) -> tuple[float, float]:
        """Middle of the images on the force log's clock, and half their length, s."""
        first, last = float(self._data.time[0]), float(self._data.time[-1])
        return 0.5 * (first + last), max(0.5 * (last - first), 1e-9)

    def _quick(self, values: FloatArray) -> FloatArray:
        """Returns (n,) or (shifts, n, terms) without the bend that the force does not explain."""
        return values - self._basis @ (self._basis.T @ values)

    def _noise_of(self, slopes: FloatArray, rows: IntArray) -> FloatArray:
        """Returns the force's noise in the products of the terms, summed over frames.

        Args:
            slopes: (shifts, k, terms, 2) derivatives of the terms by the force's x and y.
            rows: (k,) the frames.

        Returns:
            (shifts, terms, terms) its part of the normal equations.
        """
        remaining = 1.0 - np.sum(self._basis[rows] ** 2, axis=1)  # share of the noise that `_quick` does not remove
        by_term = np.swapaxes(slopes, 1, 2)
        shape = (*by_term.shape[:2], -1)
        noisy: FloatArray = (by_term @ self._data.force.noise) * remaining[:, None]
        return noisy.reshape(shape) @ np.swapaxes(by_term.reshape(shape), 1, 2)

    def profile(self, weights: FloatArray, tilted: list[Tilted]) -> FloatArray:
        """Returns the profile over shift and tilt.

        Args:
            weights: (r, blocks) weights of the blocks in each replicate.
            tilted: m shifts and tilts.

        Returns:
            (r, m) minus the logarithm of the unexplained bend.
        """
        shift = np.array(tilted)[:, :1] + np.array(tilted)[:, 1:] * self.place
        step = self.shifts[1] - self.shifts[0]
        # each block has a shift of its own (m, blocks): its sums are interpolated between two trial shifts
        position = np.clip((shift - self.shifts[0]) / step, 0.0, len(self.shifts) - 1.000001)
        low = position.astype(np.int64)
        fraction = position - low
        block, terms, count = np.arange(self.count), self._xy.shape[2], len(tilted)
        sums = self._sums[block, low] + fraction[..., None, None] * self._steps[block, low]
        weighted = weights @ np.swapaxes(sums, 0, 1).reshape(self.count, -1)
        totals = weighted.reshape(-1, terms, terms + 1)
        xy: FloatArray = totals[..., -1]
        explained = np.sum(xy * self._solved(totals[..., :-1], xy), axis=1).reshape(len(weights), count)
        return -np.log(np.maximum((weights @ self._yy)[:, None] - explained, 1e-30))

    def _solved(self, xx: FloatArray, xy: FloatArray) -> FloatArray:
        """Returns the coefficients (m, terms) of m regressions with the products X'X and X'y; changes ``xx``."""
        diagonal = np.arange(xx.shape[1])
        xx[:, diagonal, diagonal] *= 1.0 + 1e-9  # solvable without a force, too
        xx[:, diagonal, diagonal] += 1e-9
        xx[:, -1, -1] += self.penalty
        solved: FloatArray = np.linalg.solve(xx, xy[..., None])[..., 0].astype(np.float64)
        return solved

    def best(self, max_tilt_s: float) -> Tilted:
        """Returns the most likely shift and tilt of the clock in s.

        It searches on a grid, then on six finer grids about the best point. ``max_tilt_s`` is the largest tilt that is
        tried; at 0 the tilt is 0.
        """
        ones = np.ones((1, self.count))  # all blocks have the same weight
        tilts = np.linspace(-max_tilt_s, max_tilt_s, _STEPS) if max_tilt_s else np.zeros(1)
        grid = [(float(shift), float(tilt)) for tilt in tilts for shift in self.shifts]
        best, step = grid[int(np.argmax(self.profile(ones, grid)[0]))], float(self.shifts[1] - self.shifts[0])
        tilt_step = float(tilts[1] - tilts[0]) if max_tilt_s else 0.0
        for _ in range(6):
            best = self.peaks(ones, best, step, tilt_step)[0]
            step, tilt_step = max(0.5 * step, 1e-3), max(0.5 * tilt_step, 1e-3) if max_tilt_s else 0.0
        return float(best[0]), float(best[1])

    def peaks(self, weights: FloatArray, about: Tilted, step: float, tilt_step: float) -> FloatArray:
        """Returns shift and tilt of each profile's maximum, by a paraboloid through a grid of five by five points.

        Args:
            weights: (r, blocks) weights of the blocks in each replicate.
            about: middle of the grid.
            step: step of the grid in the shift, s.
            tilt_step: step of the grid in the tilt, s; 0: the tilt is held, and a parabola through five points is used.

        Returns:
            (r, 2) shifts and tilts in s.
        """
        ticks = np.arange(-2.0, 3.0)
        x, y = (part.ravel() for part in np.meshgrid(ticks, ticks if tilt_step else np.zeros(1)))
        points = [(about[0] + right * step, about[1] + up * tilt_step) for right, up in zip(x, y, strict=True)]
        heights = self.profile(weights, points)
        # paraboloid: c0 + c1 x + c2 x^2 + c3 y + c4 y^2 + c5 x y
        columns = np.stack([np.ones_like(x), x, x * x, *((y, y * y, x * y) if tilt_step else ())], axis=1)
        solved = np.linalg.solve(columns.T @ columns, columns.T @ heights.T)
        moves = np.zeros((len(weights), 2))
        highest = np.argmax(heights, axis=1)
        for row, c in enumerate(solved.T):
            hessian = np.array([[2 * c[2], c[5]], [c[5], 2 * c[4]]]) if tilt_step else np.array([[2 * c[2]]])
            slope = np.array([c[1], c[3]]) if tilt_step else c[1:2]
            if np.linalg.eigvalsh(hessian).max() < 0.0:
                move = np.clip(-np.linalg.solve(hessian, slope), -2.5, 2.5)  # not far beyond the grid
            else:  # no maximum nearby: towards the highest point
                move = np.array([x[highest[row]], y[highest[row]]])[: len(slope)]
            moves[row, : len(move)] = move
        return moves * [step, tilt_step or 1.0] + about

    def _solve(self, at: Tilted) -> tuple[FloatArray, FloatArray]:
        """Returns the terms (n, terms) at one shift and tilt, and the coefficients (terms,) of the best fit there."""
        middle, half = self.span
        shifted = replace(self._data, time=self._data.time - at[0] - at[1] * (self._data.time - middle) / half)
        terms, slopes = shifted.terms(np.zeros(1), self._unit, self._degree)
        noise = self._noise_of(slopes, np.arange(len(self._y)))[0]
        x = self._quick(terms[0])
        return x, self._solved((x.T @ x - self.corrected * noise)[None], (x.T @ self._y)[None])[0]

    def residuals(self, at: Tilted) -> FloatArray:
        """Returns the bend (n,) that is left unexplained, in rad."""
        x, solved = self._solve(at)
        return self._y - x @ solved

    @property
    def bend(self) -> FloatArray:
        """Bend (n,) in rad without the part that the force does not explain."""
        return self._y

    def explained(self, at: Tilted) -> float:
        """Returns the share of the bend's variance that the force explains."""
        return float(1.0 - self.residuals(at).var() / max(float(self._y.var()), 1e-30))

    def slope(self, at: Tilted) -> float:
        """Returns sign and size of dB/dG, by the straight line through the fitted bend: positive for a real shaft."""
        x, solved = self._solve(at)
        moment, fitted = x[:, 0], x[:, : self._degree] @ solved[: self._degree]
        return float(moment @ fitted / max(float(moment @ moment), 1e-30))

    def angle(self, at: Tilted) -> float:
        """Returns the angle by which the sensor seems turned, in rad."""
        return math.atan2(float(self._solve(at)[1][-1]), self.slope(at))

    def penalty_at(self, at: Tilted) -> float:
        """Returns the weight of the prior on the angle: residual variance over (slope times tan 2 deg)^2."""
        return float(self.residuals(at).var() / max((self.slope(at) * _ANGLE_PRIOR) ** 2, 1e-12))

    def local_shifts(self, at: Tilted, groups: IntArray) -> FloatArray:
        """Returns the shift of each group of blocks that fits best with the law of all.

        Args:
            at: shift and tilt of the law of all.
            groups: (blocks,) number of each block's group, 0 to k - 1.

        Returns:
            (k, 3) shift beyond ``at`` and its standard error in s, and energy of the fitted bend over that of the usual
            residual.
        """
        _, solved = self._solve(at)
        fitted = np.einsum("i,bsij,j->bs", solved, self._xx, solved)
        losses = self._yy[:, None] - 2.0 * self._xy @ solved + fitted  # (blocks, shifts) squared residuals
        frames = np.bincount(np.unique(self._data.blocks, return_inverse=True)[1])
        usual_loss = max(float(np.mean(self.residuals(at) ** 2)), 1e-30)
        step = self.shifts[1] - self.shifts[0]
        local: list[tuple[float, float, float]] = []
        for number in range(int(groups.max()) + 1):
            inside = groups == number
            loss, count = losses[inside].sum(axis=0), int(frames[inside].sum())
            # minimum of the parabola through the least loss and its neighbours
            least = int(np.clip(np.argmin(loss), 1, len(loss) - 2))
            left, here, right = loss[least - 1 : least + 2]
            curvature = max(float(left - 2 * here + right), 1e-30)
            shift = self.shifts[least] + step * float(np.clip(0.5 * (left - right) / curvature, -1.0, 1.0))
            expected = at[0] + at[1] * float(self.place[inside].mean())
            stderr = step * math.sqrt(2.0 * max(float(here) / count, usual_loss) / curvature)
            energy = float(fitted[inside, len(self.shifts) // 2].sum()) / (count * usual_loss)
            local.append((shift - expected, stderr, energy))
        return np.array(local)


def _share(square: FloatArray, noise: FloatArray) -> float:
    """Returns the largest share that ``noise`` has in any direction of ``square``, both (shifts, terms, terms)."""
    diagonal = np.arange(square.shape[1])
    square = square.copy()
    square[:, diagonal, diagonal] = square[:, diagonal, diagonal] * (1.0 + 1e-9) + 1e-12
    return max(float(np.linalg.eigvals(np.linalg.solve(square, noise)).real.max()), 1e-12)
