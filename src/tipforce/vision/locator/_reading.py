"""Reads the strip of image along a rough line: the axis, its visibility, the base and the tip, with their errors.

The axis is a cubic spline along the strip. Its coefficients are the mean of a posterior: the offsets that the network
states, each with its variance, and a weak prior that the curvature changes slowly. So where the catheter is hidden the
line goes on with the curvature that it has, and the covariance says how far it may be off.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.interpolate import BSpline

from ...geometry import arc_length, resampled
from ...types import FloatArray, Image
from ._networks import Offsets, refine
from ._strip import ALONG, Strip, straightened

INTERVALS = 9
"""Number of intervals of the spline along the strip."""
MIN_OFFSET_STD = 0.003
EXACT_SPREAD, EXCESS_EXPONENT, LARGEST_EXCESS, SPREAD_FACTOR = 0.005, 0.8, 3.0, 0.9
"""The standard deviation of an offset, in diameters, from the spread that the network states: with a spread of 0.005
or less it is 0.9 of it; larger ones state too little, by a power of the spread and at most this factor. Measured on 39
sessions of three presets, docs/results/locator.md."""
CORRELATED_STATIONS = 6.0
"""Errors of neighbouring stations go together over this number of stations, which count as one."""
LASTING_SHARE = 0.8
"""Errors have a part that is common to all stations: this share of the median standard deviation of the seen ones."""
CURVATURE_CHANGE_STD = 0.02
"""Standard deviation of the third difference of the spline's coefficients, in lengths of the strip."""
BEYOND_WEIGHT = 0.02
"""Weight of the stations beyond the ends."""
MIN_END_PROBABILITY = 1e-5
"""The network cannot exclude a station as an end."""
MAX_STATED_PENALTY = 9.0
"""Logarithm by which a stated length makes any other one less likely: a clear tip elsewhere weighs more."""
MIN_END_STD_STATIONS = 0.15
VISIBLE_SHARE = 0.97
"""Share of the stated length that is visible of a catheter that enters at the border."""
MIN_SEEN = 0.1
"""A hidden station weighs this share of a visible one of the same spread."""
MIN_SURE_SEEN = 0.5
"""A station is seen with more than this probability."""
HINT_FLOOR = 0.02
"""Prior of an end far from where the first network finds it, relative to one that is there."""
MIN_STRIP_SHARE = 0.3
"""A line covers this share of the strip."""
END_SHARE = 0.25
"""A line is extended with the mean curvature of its last stretch of this share."""
SAMPLES = 400
"""Number of points of a line between two readings."""
_STATIONS = np.arange(ALONG, dtype=np.float64)
_KNOTS = np.concatenate([[0.0] * 3, np.linspace(0.0, ALONG - 1.0, INTERVALS + 1), [ALONG - 1.0] * 3])
_BASIS = BSpline.design_matrix(_STATIONS, _KNOTS, 3).toarray()
_THIRD = np.diff(np.eye(INTERVALS + 3), n=3, axis=0)


class Known(NamedTuple):
    """Constants of the session that a line is read with.

    Attributes:
        length_px: length of the catheter, px.
        length_std_px: its standard error.
        base_px: (2,) u, v of the base; None where it is not known.
        base_std_px: its standard error.
        base_in_view: whether the base is inside the image; None where it is not known.
    """

    length_px: float
    length_std_px: float
    base_px: FloatArray | None = None
    base_std_px: float = 1.0
    base_in_view: bool | None = None


class Hint(NamedTuple):
    """Ends of the line as the first network finds them.

    Attributes:
        base_px: (2,) u, v of the base.
        tip_px: (2,) u, v of the tip.
        std_px: standard deviation of both.
        outside: probability that the base is outside the image.
    """

    base_px: FloatArray
    tip_px: FloatArray
    std_px: float
    outside: float

    def prior(self, points: FloatArray, end_px: FloatArray) -> FloatArray:
        """Returns the logarithm of the prior of each of ``points`` (n, 2) to be the end at ``end_px``."""
        off = np.linalg.norm(points - end_px, axis=1) / self.std_px
        return np.log(HINT_FLOOR + np.exp(-0.5 * off**2))


class End(NamedTuple):
    """One end of the line.

    Attributes:
        at: its station, as a fraction.
        std: standard deviation in stations.
        peak: probability of the station and its neighbours by the image alone.
    """

    at: float
    std: float
    peak: float


@dataclass(frozen=True, slots=True, eq=False)
class Reading:
    """Reading of one strip.

    Attributes:
        coefficients: (k, 2) of the spline, px.
        covariance: (k, k) of the coefficients, px^2; the same for u and v.
        strip: the strip.
        read: the network's result for it.
        offset_std_px: (ALONG,) standard deviation of its offsets.
        base: the base, or the position where the catheter enters the image.
        base_in_view: whether the base is inside the image.
        tip: the tip.
    """

    coefficients: FloatArray
    covariance: FloatArray
    strip: Strip
    read: Offsets
    offset_std_px: FloatArray
    base: End
    base_in_view: bool
    tip: End

    def line(self, count: int = SAMPLES) -> FloatArray:
        """Returns (count, 2) px from base to tip."""
        return np.asarray(BSpline(_KNOTS, self.coefficients, 3)(self._at(count)), np.float64)

    def std_px(self, count: int) -> FloatArray:
        """Returns the standard deviation (count,) px of the same points in each direction."""
        basis = BSpline.design_matrix(self._at(count), _KNOTS, 3).toarray()
        variance = np.einsum("ij,jk,ik->i", basis, self.covariance, basis)
        seen = (self.read.seen > MIN_SURE_SEEN) & (self.base.at < _STATIONS) & (self.tip.at > _STATIONS)
        if seen.any():
            variance += (LASTING_SHARE * np.median(self.offset_std_px[seen])) ** 2
        return np.sqrt(variance)

    def _at(self, count: int) -> FloatArray:
        return np.clip(np.linspace(self.base.at, self.tip.at, count), 0.0, ALONG - 1.0)


def offset_std(spread: FloatArray) -> FloatArray:
    """Returns the standard deviation of offsets from the ``spread`` that the network states, both in diameters."""
    excess = np.clip((spread / EXACT_SPREAD) ** EXCESS_EXPONENT, 1.0, LARGEST_EXCESS)
    return np.hypot(MIN_OFFSET_STD, SPREAD_FACTOR * excess * spread)


def _end(posterior: FloatArray, image: FloatArray) -> End:
    """Returns an end from its ``posterior`` (ALONG,) and its probability by the ``image`` alone (ALONG,)."""
    peak = int(posterior.argmax())
    near = np.arange(max(peak - 2, 0), min(peak + 3, ALONG))
    at = float(posterior[near] @ near / posterior[near].sum())
    below = np.cumsum(posterior)
    low, high = np.interp([0.16, 0.84], below / below[-1], _STATIONS + 0.5)
    peak = int(image.argmax())
    sure = float(image[max(peak - 1, 0) : peak + 2].sum())
    return End(at, max(0.5 * float(high - low), MIN_END_STD_STATIONS), sure)


def _ends(read: Offsets, points: FloatArray, first: int, hint: Hint, known: Known | None) -> tuple[End, End, bool]:
    """Returns base, tip, and whether the base is in view, from the joint posterior of both ends.

    Args:
        read: result of the second network.
        points: (ALONG, 2) px of the axis at the stations.
        first: first station inside the image.
        hint: the ends as the first network finds them.
        known: constants of the session.
    """
    border = max(first - 1, 0)
    outside = min(max(hint.outside, MIN_END_PROBABILITY), 1.0 - MIN_END_PROBABILITY)
    base = np.log(read.base + MIN_END_PROBABILITY) + hint.prior(points, hint.base_px) + math.log(1.0 - outside)
    in_view = None
    if known is not None:
        in_view = known.base_in_view
        if known.base_px is not None:
            base -= 0.5 * (np.linalg.norm(points - known.base_px, axis=1) / known.base_std_px) ** 2
    base[first + 0.5 > _STATIONS] = -np.inf
    if in_view is False:
        base[:] = -np.inf
    if not in_view:
        base[border] = math.log(outside)
    score = base[:, None] + (np.log(read.tip + MIN_END_PROBABILITY) + hint.prior(points, hint.tip_px))[None]
    if known is not None:
        arc = arc_length(points)
        length = np.full(ALONG, known.length_px)
        if in_view is None:
            length[border] *= VISIBLE_SHARE
        unlikely = 0.5 * ((arc[None] - arc[:, None] - length[:, None]) / known.length_std_px) ** 2
        # a length that the images of the session agree on is sure; one that is only stated may be wrong
        score -= np.minimum(unlikely, MAX_STATED_PENALTY) if in_view is None else unlikely
    score[_STATIONS[:, None] + MIN_STRIP_SHARE * ALONG > _STATIONS[None]] = -np.inf
    joint = np.exp(score - score.max())
    joint /= joint.sum()
    bases = joint.sum(axis=1)
    if bases.argmax() == border and base[border] > -np.inf and not in_view:
        return End(float(border), 0.0, 1.0), _end(joint[border] / joint[border].sum(), read.tip), False
    return _end(bases, read.base), _end(joint.sum(axis=0), read.tip), True


def read_strip(
    image: Image,
    line: FloatArray,
    diameter_px: float,
    hint: Hint,
    known: Known | None,
    network: Path | None = None,
) -> Reading | None:
    """Reads the strip of ``image`` along ``line``; None where too little of the strip is inside the image for a line.

    Args:
        image: (h, w) or (h, w, 3).
        line: (n, 2) px, base to tip.
        diameter_px: diameter of the shaft.
        hint: the ends as the first network finds them.
        known: constants of the session; None where nothing is known.
        network: folder of fine-tuned networks; None: those that come with tipforce.
    """
    strip = straightened(image, line, diameter_px)
    first = int(strip.inside_view.argmax())
    if not strip.inside_view.any() or first + MIN_STRIP_SHARE * ALONG > ALONG - 1:
        return None
    read = refine(strip, network)
    points = strip.points + (diameter_px * read.offset)[:, None] * strip.normals
    base, tip, in_view = _ends(read, points, first, hint, known)
    std_px = diameter_px * offset_std(read.spread)
    weight = np.maximum(read.seen, MIN_SEEN) / (CORRELATED_STATIONS * std_px**2)
    weight[(base.at - 2.0 > _STATIONS) | (tip.at + 2.0 < _STATIONS)] *= BEYOND_WEIGHT
    length = max(float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum()), 1.0)
    slow = _THIRD / (CURVATURE_CHANGE_STD * length)
    covariance = np.linalg.inv(_BASIS.T @ (weight[:, None] * _BASIS) + slow.T @ slow)
    coefficients = covariance @ (_BASIS.T @ (weight[:, None] * points))
    return Reading(coefficients, covariance, strip, read, std_px, base, in_view, tip)


def of_length(line: FloatArray, known: Known | None) -> FloatArray:
    """Returns ``line`` (n, 2) cut at the session's length, or extended to it as an arc."""
    if known is None:
        return line
    arc = arc_length(line)
    missing = known.length_px - float(arc[-1])
    if missing <= 0.0:
        return resampled(line[: max(int((arc <= known.length_px).sum()), 2)], SAMPLES)
    even = resampled(line, SAMPLES)
    first = round((1.0 - END_SHARE) * (SAMPLES - 1))
    steps = np.diff(even[first:], axis=0)
    angles = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    step = float(arc[-1]) / (SAMPLES - 1)
    slope, angle = np.polyfit(step * np.arange(len(angles)), angles, 1)
    count = max(round(missing / step), 1)
    heading = angle + slope * step * (len(angles) + np.arange(count))
    beyond = even[-1] + missing / count * np.cumsum(np.column_stack([np.cos(heading), np.sin(heading)]), axis=0)
    return np.vstack([even, beyond])
