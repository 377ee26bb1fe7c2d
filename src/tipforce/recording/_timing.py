"""The offset between the force log's clock and the camera's, from the catheter's own deflection.

An elastic shaft takes its shape at once: shape and force belong to the same instant, friction and contact or not. So
the shape numbers are regressed on the force (cubic), shifted by a trial offset, and the most likely offset is the one
that leaves the smallest generalised variance of residuals. The other way round, force on shape, the noise of the
pictures is in the regressors, weakens the finer coordinates and pulls the offset by milliseconds. The motion of the
wall would not do at all: it leads the force by the tissue's loss angle. A drift of 20 ppm between the clocks is 1.2 ms
in 60 s and is left alone; in a recording of many minutes the offset found is the one of its middle.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter1d

from ..types import FloatArray, IntArray
from ..vision import NoFeatures, ShapeFeatureSettings, Sighting, shape_features
from ._facts import ClockOffset

__all__ = ["estimate_offset", "shape_coordinates"]

_COORDINATES = ShapeFeatureSettings(kind="legendre", degree=3, constant=False)
_STEP_S = 4e-3
_SMOOTH_S = 4e-3
"""Standard deviation of the force's low-pass: symmetric, so it moves nothing in time; about an exposure's."""
_BLOCK_S = 1.0
_MAX_BLOCKS = 150
_REPLICATES = 100
_MIN_EXPLAINED = 0.3
_MAX_STDERR_MS = 5.0
_RIVAL_S = 0.025


def shape_coordinates(sightings: Sequence[Sighting]) -> FloatArray:
    """(n, 3): Legendre coefficients 1..3 of the tangent angle over arc length, rad; NaN where nothing was found."""
    rows = np.full((len(sightings), 3), math.nan)
    for place, sighting in enumerate(sightings):
        values = shape_features(sighting, _COORDINATES)
        if not isinstance(values, NoFeatures):
            rows[place] = values
    return rows


def estimate_offset(
    frame_ns: IntArray, coordinates: FloatArray, force_ns: IntArray, force_n: FloatArray, *, window_s: float = 0.3
) -> ClockOffset:
    """The offset within +-``window_s`` at which force and deflection belong together best.

    ``frame_ns`` (n,), ``coordinates`` (n, k): shape numbers, rows with NaN are left out; ``force_ns`` (m,),
    ``force_n`` (m, 3) in any frame, NaN for unknown axes. The standard error comes from a bootstrap over blocks of a
    second. ``how="refused"`` with the reason where the offset cannot be told.
    """
    known = ~np.isnan(force_n).all(axis=0)
    steps = round(window_s / _STEP_S)
    shifts = np.arange(-steps, steps + 1, dtype=np.float64) * _STEP_S
    origin = int(force_ns[0])
    time = (frame_ns - origin).astype(np.float64) * 1e-9
    end = (int(force_ns[-1]) - origin) * 1e-9
    usable = np.isfinite(coordinates).all(axis=1) & (time > window_s) & (time < end - window_s)
    if known.sum() == 0 or usable.sum() < 50 or time[usable][-1] - time[usable][0] < 3.0:
        return _refused(f"only {int(usable.sum())} frames show the catheter while the force log runs; 3 s are needed")
    terms = _ForceTerms(force_ns, force_n[:, known], origin)
    blocks = _blocks(time, usable)
    time, coordinates = time[usable], coordinates[usable]
    first = _Fit(time, coordinates, blocks, terms, shifts)
    distance, _ = first.residuals(first.best())
    keep = distance <= 5.0 * float(np.median(distance))  # pictures in which something else was seen
    time, coordinates, blocks = time[keep], coordinates[keep], blocks[keep]
    fit = _Fit(time, coordinates, blocks, terms, shifts)
    best = fit.best()
    _, explained = fit.residuals(best)
    verdict = _judge(fit, shifts, best, explained, window_s)
    if verdict.how == "refused":
        return verdict
    fine = (
        np.arange(-8, 9, dtype=np.float64) * 1e-3 + best
    )  # the parabola over coarse steps is off by tenths of a millisecond
    return replace(verdict, offset_ns=round(_Fit(time, coordinates, blocks, terms, fine).best() * 1e9))


class _ForceTerms:
    """Regressors: cubic in the two directions in which the force varies most, linear in the third."""

    def __init__(self, stamps_ns: IntArray, force: FloatArray, origin_ns: int) -> None:
        seconds = (stamps_ns - origin_ns) * 1e-9
        step = max(float(np.median(np.diff(seconds))), 1e-4)
        self._grid = np.arange(0.0, seconds[-1] + step, step)
        even = np.stack([np.interp(self._grid, seconds, column) for column in force.T], axis=1)
        smooth = gaussian_filter1d(even, max(_SMOOTH_S / step, 1e-3), axis=0)
        centred = smooth - smooth.mean(axis=0)
        _, axes = np.linalg.eigh(centred.T @ centred)
        principal = centred @ axes[:, ::-1]
        self._values = principal / max(float(np.std(principal[:, 0])), 1e-12)

    def at(self, seconds: FloatArray) -> FloatArray:
        """(n,) -> (n, terms)."""
        force = np.stack([np.interp(seconds, self._grid, column) for column in self._values.T])
        first = force[0]
        columns = [np.ones_like(first), first, first**2, first**3]
        if len(force) > 1:
            second = force[1]
            columns += [second, second**2, second**3, first * second, first**2 * second, first * second**2]
        return np.stack([*columns, *force[2:]], axis=1)


class _Fit:
    """Sums of the regression, block by block, for every trial shift: all that profile and bootstrap need."""

    def __init__(
        self, time: FloatArray, coordinates: FloatArray, blocks: IntArray, terms: _ForceTerms, shifts: FloatArray
    ) -> None:
        self._time, self._terms, self._shifts = time, terms, shifts
        self._coordinates = (coordinates - coordinates.mean(axis=0)) / np.maximum(coordinates.std(axis=0), 1e-12)
        _, block = np.unique(blocks, return_inverse=True)
        self.count = int(block.max()) + 1
        xx: list[FloatArray] = []
        xc: list[FloatArray] = []
        cc: list[FloatArray] = []
        for number in range(self.count):
            here = block == number
            c = self._coordinates[here]
            # a force stamp is the frame's time minus the offset
            x = terms.at((time[here] - shifts[:, None]).ravel()).reshape(len(shifts), len(c), -1)
            xx.append(np.swapaxes(x, 1, 2) @ x)
            xc.append(np.swapaxes(x, 1, 2) @ c)
            cc.append(c.T @ c)
        self._xx, self._xc, self._cc = np.array(xx), np.array(xc), np.array(cc)

    def profile(self, weights: FloatArray) -> FloatArray:
        """(r, blocks) weights -> (r, shifts): log likelihood per degree of freedom, up to a constant."""
        rows: list[FloatArray] = []
        for weight in weights:
            xx, xc = np.tensordot(weight, self._xx, 1), np.tensordot(weight, self._xc, 1)
            places = np.arange(xx.shape[1])
            xx[:, places, places] *= 1.0 + 1e-9
            xx[:, places, places] += 1e-9
            rest = np.tensordot(weight, self._cc, 1) - np.swapaxes(xc, 1, 2) @ np.linalg.solve(xx, xc)
            rows.append(-0.5 * np.linalg.slogdet(rest)[1])
        return np.array(rows)

    def best(self) -> float:
        """The most likely shift."""
        return float(_peak(self._shifts, self.profile(np.ones((1, self.count))))[0])

    def residuals(self, shift: float) -> tuple[FloatArray, float]:
        """Distance (n,) of each frame from the fit in units of its scatter, and the share of variance explained."""
        x = self._terms.at(self._time - shift)
        rest = self._coordinates - x @ np.linalg.lstsq(x, self._coordinates, rcond=None)[0]
        covariance = rest.T @ rest / len(rest) + 1e-12 * np.eye(rest.shape[1])
        distance = np.sqrt(np.einsum("ni,ij,nj->n", rest, np.linalg.inv(covariance), rest))
        # of the coordinate that the force explains best: the others may hold noise alone
        return distance, float(np.max(1.0 - rest.var(axis=0) / np.maximum(self._coordinates.var(axis=0), 1e-12)))


def _blocks(time: FloatArray, usable: npt.NDArray[np.bool_]) -> IntArray:
    """The second that each usable frame belongs to; of long recordings evenly spread seconds only (in place)."""
    seconds = np.floor(time / _BLOCK_S).astype(np.int64)
    stride = -(-len(np.unique(seconds[usable])) // _MAX_BLOCKS)
    usable &= seconds % stride == 0
    return seconds[usable]


def _peak(shifts: FloatArray, profiles: FloatArray) -> FloatArray:
    """Place of each profile's (r, shifts) maximum, by the parabola through its three highest points."""
    top = np.clip(np.argmax(profiles, axis=1), 1, len(shifts) - 2)
    rows = np.arange(len(profiles))
    left, middle, right = profiles[rows, top - 1], profiles[rows, top], profiles[rows, top + 1]
    bend = left - 2 * middle + right
    move = np.where(bend < 0, 0.5 * (left - right) / np.where(bend < 0, bend, -1.0), 0.0)
    return shifts[top] + np.clip(move, -1.0, 1.0) * (shifts[1] - shifts[0])


def _judge(fit: _Fit, shifts: FloatArray, best: float, explained: float, window_s: float) -> ClockOffset:
    if explained < _MIN_EXPLAINED:
        return _refused(
            f"the force explains {100 * explained:.0f} % of the deflection ({100 * _MIN_EXPLAINED:.0f} % are needed): "
            "too little contact or motion",
            explained,
        )
    if abs(best) > window_s - 2 * _STEP_S:
        return _refused(f"the best offset lies at the edge of +-{1e3 * window_s:.0f} ms", explained)
    even = np.full(fit.count, 1.0 / fit.count)
    weights = np.random.default_rng(0).multinomial(fit.count, even, _REPLICATES).astype(np.float64)
    places = _peak(shifts, fit.profile(weights))
    apart = np.abs(places - best) > _RIVAL_S
    if apart.mean() > 0.05:
        rival = float(np.median(places[apart]))
        return _refused(
            f"{1e3 * best:.0f} ms and {1e3 * rival:.0f} ms fit alike: the motion repeats itself or is too little",
            explained,
        )
    stderr_ms = 1e3 * float(np.std(places[~apart]))
    if stderr_ms > _MAX_STDERR_MS:
        return _refused(
            f"{1e3 * best:.0f} ms fits best, but only to +-{stderr_ms:.0f} ms (standard error): too little motion",
            explained,
        )
    return ClockOffset(round(best * 1e9), "estimated", stderr_ms, explained)


def _refused(reason: str, explained: float = math.nan) -> ClockOffset:
    return ClockOffset(0, "refused", explained=explained, detail=reason)
