"""Locates the catheter of stated size in one image: rough points by the first network, the line by the second."""

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre
from scipy.interpolate import make_lsq_spline

from ...geometry import arc_length
from ...types import BaseSide, FloatArray, Image
from ._networks import Offsets, coarse, refine
from ._strip import ACROSS, ALONG, HALF_WIDTH, Strip, evenly, straightened
from ._upright import STRIDE, normalised, upright

_DEGREE = 5
"""Degree of the rough line through the points."""
_RIDGE = 1e-3
_INTERVALS = 9
"""Number of intervals of the spline along the strip."""
_LEAST_SPREAD = 0.02
"""No offset is trusted to more than this share of the diameter."""
_CLEAR = 1.0 / 7.0
"""An offset whose error is smaller than this share of the diameter is clear."""
_LEAST_MASS = 0.02
_LEAST_MEDIAN_MASS = 0.05
"""With less for the median point the network sees no catheter."""
_SHORTEST, _FEWEST = 0.3, 8
"""A line covers this share of the strip, and has this number of samples in the image."""
_BEYOND = 0.02
"""Weight of the samples beyond the ends."""
_SAMPLES = 400
_SHORTEST_PX, _WIDEST = 42.0, 12.0
"""A shorter catheter would be magnified more than twice; and the longer side of an image in lengths of the catheter."""


@dataclass(frozen=True, slots=True, eq=False)
class Located:
    """``points`` (n, 2): u, v in px from base to tip; the other fields say how sure the networks are."""

    points: FloatArray
    length_px: float
    mass: FloatArray
    """(k,): probability of each rough point near its peak."""
    spread: float
    """Median error of the offsets, in diameters."""
    end_spread: float
    """The largest one of the last fifth."""
    base_peak: float
    """Probability of the base within a station of its peak; 1 where it is outside the image."""
    tip_peak: float
    right: float
    """Logit that the strip is the catheter's; the least of both rounds."""
    clear: float
    """Share of the stations whose offset is known to a seventh of the diameter."""
    darker: bool
    """Whether the shaft is darker than the ground beside it."""


def _peaks(logits: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Returns the points (k, 2) in px of the network's image and their masses (k,) from ``logits`` (k, h, w)."""
    count, height, width = logits.shape
    top = np.maximum(logits.max(axis=(1, 2), keepdims=True), 0.0)
    weights = np.exp(logits - top)
    total = weights.sum(axis=(1, 2)) + np.exp(-top[:, 0, 0])
    points, mass = np.empty((count, 2)), np.empty(count)
    for k, flat in enumerate(logits.reshape(count, -1).argmax(axis=1).tolist()):
        row, column = divmod(flat, width)
        rows = np.arange(max(row - 1, 0), min(row + 2, height))
        columns = np.arange(max(column - 1, 0), min(column + 2, width))
        near = weights[k][np.ix_(rows, columns)]
        inside = near.sum()
        mass[k] = inside / total[k]
        points[k] = (near.sum(axis=0) @ columns / inside, near.sum(axis=1) @ rows / inside)
    return (points + 0.5) * STRIDE - 0.5, mass


def _rough_line(points: FloatArray, mass: FloatArray) -> FloatArray:
    """A smooth line through ``points`` (k, 2), each weighed by its mass."""
    basis = legendre.legvander(np.linspace(-1.0, 1.0, len(points)), _DEGREE)
    heavy = np.maximum(mass, _LEAST_MASS)
    ridge = _RIDGE * np.diag(np.arange(_DEGREE + 1.0) ** 4) * heavy.mean()
    weight, found = heavy, np.zeros((_DEGREE + 1, 2))
    for _ in range(3):  # a point far off the others' line is another object's
        found = np.linalg.solve(basis.T @ (weight[:, None] * basis) + ridge, basis.T @ (weight[:, None] * points))
        weight = heavy / (1.0 + (np.linalg.norm(points - basis @ found, axis=1) / STRIDE) ** 2)
    return np.asarray(legendre.legvander(np.linspace(-1.0, 1.0, _SAMPLES), _DEGREE) @ found, np.float64)


def _expected(probability: FloatArray) -> tuple[float, float]:
    """The station, as a fraction, and the probability of it and its neighbours."""
    peak = int(probability.argmax())
    near = np.arange(max(peak - 2, 0), min(peak + 3, len(probability)))
    mass = probability[near].sum()
    return float(probability[near] @ near / mass), float(probability[max(peak - 1, 0) : peak + 2].sum())


@dataclass(frozen=True, slots=True, eq=False)
class _Followed:
    """A better ``line`` (n, 2), the strip that it was read in, and the peaks' probabilities of base and tip."""

    line: FloatArray
    strip: Strip
    read: Offsets
    base_peak: float
    tip_peak: float


def _follow(image: Image, line: FloatArray, diameter_px: float) -> _Followed:
    """Reads the strip of ``image`` along ``line`` (n, 2); the better line begins where it enters the image."""
    strip = straightened(image, line, diameter_px)
    read = refine(strip)
    points = strip.points + (diameter_px * read.offset)[:, None] * strip.normals
    base, base_peak = _expected(read.base)
    first = int(strip.seen.argmax())
    if base < first + 0.5:  # the base is outside the image: the line begins at the border
        base, base_peak = max(first - 1.0, 0.0), 1.0
    tip, tip_peak = _expected(read.tip)
    tip = min(max(tip, base + _SHORTEST * ALONG), ALONG - 1.0)
    station = np.arange(ALONG, dtype=np.float64)
    weight = 1.0 / np.hypot(np.maximum(read.spread, _LEAST_SPREAD), _LEAST_SPREAD)
    weight[(station < base - 2.0) | (station > tip + 2.0)] *= _BEYOND
    knots = np.concatenate([[0.0] * 3, np.linspace(0.0, ALONG - 1.0, _INTERVALS + 1), [ALONG - 1.0] * 3])
    fine = np.asarray(make_lsq_spline(station, points, knots, k=3, w=weight)(np.linspace(base, tip, _SAMPLES)))
    inside = ((fine >= 0.0) & (fine <= np.array(image.shape[1::-1]) - 1.0)).all(axis=1)
    return _Followed(fine[int(inside.argmax()) :], strip, read, base_peak, tip_peak)


def locate(image: Image, base_side: BaseSide, length_px: float, diameter_px: float, points: int) -> Located | None:
    """Locates the catheter in ``image``, (h, w) or (h, w, 3) uint8, whose size is stated; None where it sees none.

    So too where the catheter is shorter than 42 px or the image is more than twelve times as long as it: the networks
    have learnt nothing of these.

    ``base_side``: side of the base. ``points``: number of points of the centreline.
    """
    if length_px < _SHORTEST_PX or max(image.shape[:2]) > _WIDEST * length_px:
        return None
    small = upright(image, base_side, length_px)
    rough, mass = _peaks(coarse(normalised(small.image)))
    if float(np.median(mass)) < _LEAST_MEDIAN_MASS:
        return None
    once = _follow(image, small.to_original(_rough_line(rough, mass)), diameter_px)
    if len(once.line) < _FEWEST:
        return None
    twice = _follow(image, once.line, diameter_px)
    if len(twice.line) < _FEWEST:
        return None
    inner = slice(round(0.15 * ALONG), round(0.88 * ALONG))
    spread, grey = twice.read.spread[inner], twice.strip.values[:, inner].mean(axis=-1)
    across = np.abs(np.linspace(-HALF_WIDTH, HALF_WIDTH, ACROSS))
    return Located(
        points=evenly(twice.line, points),
        length_px=float(arc_length(twice.line)[-1]),
        mass=mass,
        spread=float(np.median(spread)),
        end_spread=float(np.max(spread[-15:])),
        base_peak=twice.base_peak,
        tip_peak=twice.tip_peak,
        right=min(once.read.right, twice.read.right),
        clear=float(np.mean(spread < _CLEAR)),
        darker=bool(np.median(grey[across < 0.4]) < np.median(grey[across > 0.8])),
    )
