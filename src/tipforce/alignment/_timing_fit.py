"""Force and deflection fitted to one another, for many trial shifts of time at once: what `estimate_offset` asks.

Least squares take regressors for exact, and the force is not: where a force along a nearly straight shaft hardly bends
it, the noise of its small sideways part moves the answer by milliseconds. So what noise adds to the normal equations is
told from the log itself and taken out again. And the shaft drifts and creeps, which the force does not explain: what
changes more slowly than the heart beats is left out on both sides.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter1d

from ..types import FloatArray, IntArray

__all__ = ["SMOOTH_S", "Data", "Fit", "Force", "peak"]

SMOOTH_S = 10e-3
"""Standard deviation of the force's low-pass: symmetric, so it moves nothing in time. The force's noise pulls the
answer late (3 mN and steps of 5 mN at 1 kHz: by 0.7 ms with 2 ms, 0.3 with 4); 24 ms round off touch and release.
"""
DEGREE = 3
"""Of the elastic law."""
_ANGLE_PRIOR = math.tan(math.radians(2.0))
_SLOW_HZ = 0.2
_MOST_NOISE = 0.7
"""No more than this share of any regressor is taken for noise: what is left must be able to carry the fit."""


class Force:
    """The force on an even grid, low-passed; x and y, NaN taken as none.

    ``noise`` (2, 2): covariance of what the low-pass leaves of the sensor's noise, N^2.
    """

    def __init__(self, stamps_ns: IntArray, force: FloatArray, origin_ns: int, smooth_s: float = SMOOTH_S) -> None:
        seconds = (stamps_ns - origin_ns) * 1e-9
        step = max(float(np.median(np.diff(seconds))), 1e-4)
        self._grid = np.arange(0.0, seconds[-1] + step, step)
        even = np.stack([np.interp(self._grid, seconds, column) for column in np.nan_to_num(force).T])
        sigma = max(smooth_s / step, 1e-3)
        self._values = gaussian_filter1d(even, sigma, axis=1)
        # Third differences of neighbouring readings hold no force, only noise, 20 times its variance; the low-pass
        # leaves 1 / (2 sqrt(pi) sigma) of it.
        rough = np.diff(even, 3, axis=1)
        left = 1.0 / max(2.0 * math.sqrt(math.pi) * sigma, 1.0)
        self.noise: FloatArray = left / 20.0 * (rough @ rough.T) / max(rough.shape[1], 1)

    @property
    def direction(self) -> FloatArray:
        """(2,): of the mean force, each instant weighing as its size; zero where there is none."""
        total = self._values @ np.linalg.norm(self._values, axis=0)
        return total / max(float(np.linalg.norm(total)), 1e-12)

    def at(self, seconds: FloatArray) -> FloatArray:
        """(...) -> (2, ...)."""
        return np.stack([np.interp(seconds, self._grid, row) for row in self._values])


@dataclass(frozen=True, slots=True, eq=False)
class Data:
    """Frames: ``time`` (n,) s, ``coordinates`` (n, 4), ``blocks`` (n,); and the force."""

    time: FloatArray
    coordinates: FloatArray
    blocks: IntArray
    force: Force

    def touching(self, way: float = 1.0) -> "Data":
        """The levers' end moved by the dome's radius against the mean force, to where the wall is met; -1: and back."""
        x, y = way * self.force.direction
        moved = self.coordinates.copy()
        moved[:, 1] += y * moved[:, 3]
        moved[:, 2] -= x * moved[:, 3]
        return replace(self, coordinates=moved)

    def subset(self, keep: npt.NDArray[np.bool_]) -> "Data":
        """Some of the frames."""
        return Data(self.time[keep], self.coordinates[keep], self.blocks[keep], self.force)

    def loaded(self) -> npt.NDArray[np.bool_]:
        """(n,): the half of the frames at which the force is larger."""
        size = np.linalg.norm(self.force.at(self.time), axis=0)
        return size >= np.median(size)

    def slow(self) -> FloatArray:
        """(n, k): an orthonormal basis of what changes slowly."""
        span = max(float(np.ptp(self.time)), 1e-9)
        place = ((self.time - self.time[0]) / span)[:, None]
        waves = np.cos(np.pi * np.arange(1 + int(2.0 * _SLOW_HZ * span)) * place)
        # cosines are level at both ends, a drift is not
        return np.linalg.qr(np.hstack([waves, place, place**2]))[0]

    def unit(self) -> float:
        """A moment that makes powers of it comparable."""
        force = np.std(self.force.at(self.time), axis=1).max()
        return max(float(force * np.abs(self.coordinates[:, 1:3]).max()), 1e-12)

    def terms(self, shifts: FloatArray, unit: float, *, bound: bool, degree: int) -> tuple[FloatArray, FloatArray]:
        """(shifts, n, terms): G, G^2 ... and, unless ``bound``, what G gains when the sensor turns.

        And (shifts, n, terms, 2): their slopes with the force's x and y.
        """
        # a force stamp is the frame's time minus the offset
        x, y = self.force.at(self.time - shifts[:, None])
        across, along = self.coordinates[:, 1] / unit, self.coordinates[:, 2] / unit
        lever = across * x + along * y
        columns = [lever**power for power in range(1, degree + 1)]
        levers = np.stack([across, along], axis=-1)
        slopes = [(power * lever ** (power - 1))[..., None] * levers for power in range(1, degree + 1)]
        if not bound:
            columns.append(along * x - across * y)
            slopes.append(np.broadcast_to(np.stack([along, -across], axis=-1), slopes[0].shape))
        return np.stack(columns, axis=-1), np.stack(slopes, axis=-2)


class Fit:
    """Sums of the regression, block by block, for every trial shift: all that profile and bootstrap need.

    ``corrected``: the share of the force's noise that could be taken out.
    """

    def __init__(self, data: Data, shifts: FloatArray, penalty: float, *, bound: bool, degree: int = DEGREE) -> None:
        self._data, self._shifts, self._penalty, self._bound, self._degree = data, shifts, penalty, bound, degree
        self._slow, self._unit = data.slow(), data.unit()
        self._c = self._quick(data.coordinates[:, 0])
        numbers, block = np.unique(data.blocks, return_inverse=True)
        self.count = len(numbers)
        x, noise = self._terms(shifts)
        prior = np.zeros(x.shape[2])
        prior[-1] = 0.0 if bound else penalty
        self.corrected = min(1.0, _MOST_NOISE / _share(np.swapaxes(x, 1, 2) @ x + np.diag(prior), noise.sum(axis=1)))
        xx: list[FloatArray] = []
        xc: list[FloatArray] = []
        for number in range(self.count):
            here = block == number
            part = x[:, here]
            xx.append(np.swapaxes(part, 1, 2) @ part - self.corrected * noise[:, here].sum(axis=1))
            xc.append(np.swapaxes(part, 1, 2) @ self._c[here])
        self._xx, self._xc = np.array(xx), np.array(xc)
        self._cc = np.bincount(block, self._c**2)

    def _quick(self, values: FloatArray) -> FloatArray:
        """(n,) or (shifts, n, terms): without what changes slowly."""
        return values - self._slow @ (self._slow.T @ values)

    def _terms(self, shifts: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(shifts, n, terms), and (shifts, n, terms, terms): what the force's noise adds to their products."""
        x, slopes = self._data.terms(shifts, self._unit, bound=self._bound, degree=self._degree)
        kept = 1.0 - np.sum(self._slow**2, axis=1)
        noise = (slopes @ self._data.force.noise) @ np.swapaxes(slopes, -1, -2) * kept[:, None, None]
        return self._quick(x), noise

    def profile(self, weights: FloatArray) -> FloatArray:
        """(r, blocks) weights -> (r, shifts): minus the logarithm of what is left unexplained."""
        rows: list[FloatArray] = []
        for weight in weights:
            xx, xc = np.tensordot(weight, self._xx, 1), np.tensordot(weight, self._xc, 1)
            solved = self._solved(xx, xc)
            taken = np.sum(xc * solved, axis=1)
            rows.append(-np.log(np.maximum(weight @ self._cc - taken, 1e-30)))
        return np.array(rows)

    def _solved(self, xx: FloatArray, xc: FloatArray) -> FloatArray:
        """(shifts, terms): what fits best."""
        places = np.arange(xx.shape[1])
        xx[:, places, places] *= 1.0 + 1e-9
        xx[:, places, places] += 1e-9
        if not self._bound:
            xx[:, -1, -1] += self._penalty
        solved: FloatArray = np.linalg.solve(xx, xc[..., None])[..., 0].astype(np.float64)
        return solved

    def best(self) -> float:
        """The most likely shift."""
        return float(peak(self._shifts, self.profile(np.ones((1, self.count))))[0])

    def _solve(self, shift: float) -> tuple[FloatArray, FloatArray]:
        every, noise = self._terms(np.array([shift]))
        x = every[0]
        return x, self._solved((x.T @ x - self.corrected * noise[0].sum(axis=0))[None], (x.T @ self._c)[None])[0]

    def residuals(self, shift: float) -> FloatArray:
        """(n,): bend that is left unexplained, rad."""
        x, solved = self._solve(shift)
        return self._c - x @ solved

    def explained(self, shift: float) -> float:
        """Share of the bend's variance that the force explains."""
        return float(1.0 - self.residuals(shift).var() / max(float(self._c.var()), 1e-30))

    def unexplained(self) -> float:
        """Variance that is left at the most likely shift."""
        return float(self.residuals(self.best()).var())

    def slope(self, shift: float) -> float:
        """Sign and size of dB/dG, by the straight line through what is fitted: positive for a real shaft."""
        x, solved = self._solve(shift)
        lever, fitted = x[:, 0], x[:, : self._degree] @ solved[: self._degree]
        return float(lever @ fitted / max(float(lever @ lever), 1e-30))

    def angle(self, shift: float) -> float:
        """By how much the sensor seems turned, rad; of a fit that is not bound."""
        return math.atan2(float(self._solve(shift)[1][-1]), self.slope(shift))

    def penalty(self) -> float:
        """What the prior on the angle adds to the squares: residual variance over (slope times tan 2 deg)^2."""
        at = self.best()
        return float(self.residuals(at).var() / max((self.slope(at) * _ANGLE_PRIOR) ** 2, 1e-12))


def _share(square: FloatArray, noise: FloatArray) -> float:
    """The largest share that ``noise`` has in any direction of ``square``, both (shifts, terms, terms)."""
    places = np.arange(square.shape[1])
    square = square.copy()
    square[:, places, places] = square[:, places, places] * (1.0 + 1e-9) + 1e-12
    return max(float(np.linalg.eigvals(np.linalg.solve(square, noise)).real.max()), 1e-12)


def peak(shifts: FloatArray, profiles: FloatArray) -> FloatArray:
    """Place of each profile's (r, shifts) maximum, by the parabola through its three highest points."""
    top = np.clip(np.argmax(profiles, axis=1), 1, len(shifts) - 2)
    rows = np.arange(len(profiles))
    left, middle, right = profiles[rows, top - 1], profiles[rows, top], profiles[rows, top + 1]
    bend = left - 2 * middle + right
    move = np.where(bend < 0, 0.5 * (left - right) / np.where(bend < 0, bend, -1.0), 0.0)
    return shifts[top] + np.clip(move, -1.0, 1.0) * (shifts[1] - shifts[0])
