"""Locates the catheter in one image: rough points by the first network, then the line by the second.

The first network reads the image, or the window around a known base, with its prompts. One course leads through its
points. The second network reads the strip of image along this line, twice: the second time along its own line, and in
the width that it finds. The end of the line is where the posterior of the tip is highest: the second network's
distribution times the session's length with its standard error. So a hidden tip is at that length, with a standard
deviation that says so.
"""

import math
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
from numpy.polynomial import legendre

from ...geometry import arc_length, resampled
from ...types import FloatArray, Image
from ._networks import OUTSIDE, POINTS, RoughPoints, rough_points
from ._prompts import NOMINAL_LENGTH_PX, Prompts
from ._reading import MIN_SURE_SEEN, SAMPLES, Hint, Known, Reading, of_length, read_strip
from ._strip import ACROSS, ALONG, HALF_WIDTH

PYRAMID_SIDES_PX = (192, 320, 512, 768)
"""Objects are looked for in the image with its longer side of these lengths in px."""
MAX_SIDE_PX = 960
"""The network's image is at most this large: a catheter that is shorter there is not found."""
MAX_MAGNIFICATION = 3.0
_DEGREE = 5
"""Degree of the rough line through the points."""
_RIDGE = 1e-3
_MIN_MASS = 0.02
"""A point of less mass weighs as much as one of this mass."""
_OUTLIER_PX = 10.0
"""A point this far in px of the network's image from the others' line weighs half."""
HINT_STD_SHARE = 0.04
"""Standard deviation of the ends that the first network finds, in lengths of the catheter."""
SEEN_STD_FACTOR, HIDDEN_STD_FACTOR = 0.65, 1.3
"""The error of a visible tip along the line is this much smaller than the posterior says, that of a hidden one this
much larger: measured on `varied` and `generalise`, docs/results/locator.md."""
MIN_SPREAD_DIAMETERS = 0.02
"""Smaller spreads do not make a line more likely the catheter."""
MIN_SAMPLES = 8
"""Number of a line's samples in the image."""
BEND_POINTS = 24
"""Number of points at which the curvature is measured."""
MIN_PRESENT, MIN_MASS = 0.3, 0.12
"""An image with less is without a catheter."""
GUESSED_ASPECT, MIN_DIAMETER_PX = 16.0, 2.0
"""Length of a catheter in diameters where its diameter is not known, and its least diameter."""
END_STATIONS = 8.0
"""Stations that are at most this far from an end judge that end."""
ROUNDS = 2
"""The strip is read this often, once more where the diameter is not stated: each time along the line found before."""


@dataclass(frozen=True, slots=True, eq=False)
class Located:
    """A line in one image, and the networks' statements about it.

    Attributes:
        points: (n, 2) u, v in px, evenly from base to tip.
        std_px: (n,) standard deviation of each point across the line, px.
        seen: (n,) whether the catheter is visible there.
        length_px: length of the line.
        length_std_px: standard deviation of the length, px: small where the tip is seen.
        tip_seen: probability that the tip is visible.
        tip_peak: probability of the tip near its peak, by the image alone.
        base_in_view: whether the line begins inside the image.
        mass: mean probability of the rough points near their peaks.
        present: probability that a catheter is in the image.
        right_base: logit that the strip is the catheter's, by the image near the base.
        right_body: the same by the image between the ends.
        right_tip: the same by the image near the tip.
        spread: median standard deviation across the seen part, diameters.
        bend: largest curvature of the line, in 1 / length.
        misfit: median distance of the rough points from the line, diameters.
        ends_apart: distance of the rough ends from those of the line, each weighed by its mass, lengths.
        diameter_px: diameter of the shaft as the second network sees it, also where another one is stated.
        darker: whether the shaft is darker than the ground beside it.
        xray: whether the image is an X-ray image.
    """

    points: FloatArray
    std_px: FloatArray
    seen: npt.NDArray[np.bool_]
    length_px: float
    length_std_px: float
    tip_seen: float
    tip_peak: float
    base_in_view: bool
    mass: float
    present: float
    right_base: float
    right_body: float
    right_tip: float
    spread: float
    bend: float
    misfit: float
    ends_apart: float
    diameter_px: float
    darker: bool
    xray: bool = False

    @property
    def is_there(self) -> bool:
        """Whether the networks see a catheter at all."""
        return self.present >= MIN_PRESENT and self.mass >= MIN_MASS

    @property
    def heading_rad(self) -> float:
        """Direction at the base, from u toward v."""
        along_u, along_v = -3.0 * self.points[0] + 4.0 * self.points[2] - self.points[4]
        return math.atan2(along_v, along_u)


def as_colour(image: Image) -> npt.NDArray[np.uint8]:
    """Returns ``image``, (h, w) or (h, w, 3) uint8, with three channels."""
    return np.repeat(image[:, :, None], 3, axis=2) if image.ndim == 2 else image


def read_points(image: Image, prompts: Prompts, network: Path | None = None) -> RoughPoints:
    """Returns the rough points in px of ``image``, (h, w) or (h, w, 3); at several sizes where no length is stated.

    The reading counts whose points are surest. Where the length is not stated, the image is read again at the size at
    which the line that was found has the length that the network knows best.
    """
    longer = max(image.shape[:2])
    if prompts.length_px is not None:
        scale = min(NOMINAL_LENGTH_PX / prompts.length_px, MAX_SIDE_PX / longer, MAX_MAGNIFICATION)
        return _read_at(image, prompts, scale, network)
    best = max(readings_by_size(image, prompts, network), key=sureness)
    length = float(arc_length(rough_line(best))[-1])
    scale = min(NOMINAL_LENGTH_PX / max(length, 1.0), MAX_SIDE_PX / longer, MAX_MAGNIFICATION)
    return max(best, _read_at(image, prompts, scale, network), key=sureness)


def readings_by_size(image: Image, prompts: Prompts, network: Path | None) -> list[RoughPoints]:
    """Returns the rough points in px of ``image``, read at each of several sizes: no length is stated."""
    longer = max(image.shape[:2])
    sides = [side for side in PYRAMID_SIDES_PX if side <= MAX_MAGNIFICATION * longer] or PYRAMID_SIDES_PX[:1]
    return [_read_at(image, prompts, side / longer, network) for side in sides]


def sureness(read: RoughPoints) -> float:
    """Returns how sure the points of a reading are, and that the base is where it is stated; 0 to 1."""
    return float(read.mass.mean()) * read.present * read.in_region


def _read_at(image: Image, prompts: Prompts, scale: float, network: Path | None) -> RoughPoints:
    rows, columns = image.shape[:2]
    window = prompts.window(rows, columns)
    u0, v0, u1, v1 = window
    way = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_LINEAR
    size = max(1, round(scale * (u1 - u0))), max(1, round(scale * (v1 - v0)))
    small = np.asarray(cv2.resize(image[v0:v1, u0:u1], size, interpolation=way), np.uint8)
    read = rough_points(as_colour(small), prompts.inside(window, rows, columns).at_scale(scale), network)
    return read._replace(points=(read.points + 0.5) / scale - 0.5 + (u0, v0))


def rough_line(read: RoughPoints) -> FloatArray:
    """Fits a smooth line (`SAMPLES`, 2), base to tip, px of the image, to the points of a reading.

    Each point counts by its mass, the network's certainty of it; points that are far from the others' line count less.
    """
    basis = legendre.legvander(np.linspace(-1.0, 1.0, POINTS), _DEGREE)
    heavy = np.maximum(read.mass, _MIN_MASS)
    ridge = _RIDGE * np.diag(np.arange(_DEGREE + 1.0) ** 4) * heavy.mean()
    size = float(np.ptp(read.points, axis=0).max()) / NOMINAL_LENGTH_PX
    weight, found = heavy, np.zeros((_DEGREE + 1, 2))
    for _ in range(3):
        found = np.linalg.solve(basis.T @ (weight[:, None] * basis) + ridge, basis.T @ (weight[:, None] * read.points))
        off = np.linalg.norm(read.points - basis @ found, axis=1)
        weight = heavy / (1.0 + (off / max(_OUTLIER_PX * size, 1e-6)) ** 2)
    return np.asarray(legendre.legvander(np.linspace(-1.0, 1.0, SAMPLES), _DEGREE) @ found, np.float64)


def locate(
    image: Image, prompts: Prompts, points: int, known: Known | None = None, network: Path | None = None
) -> Located | None:
    """Locates the catheter in ``image``; None where its line is too short or outside the image.

    Args:
        image: (h, w) or (h, w, 3) RGB, uint8.
        prompts: everything that is stated or known, px.
        points: number of points of the line.
        known: constants of the session; a hidden tip is placed by its length.
        network: folder of fine-tuned networks; None: those that come with tipforce.
    """
    read = read_points(image, prompts, network)
    line = rough_line(read)
    diameter_px = prompts.diameter_px or max(float(arc_length(line)[-1]) / GUESSED_ASPECT, MIN_DIAMETER_PX)
    if not _long_enough(line, image.shape):
        return None
    size_px = float(arc_length(line)[-1])
    hint = Hint(read.points[0], read.points[-1], HINT_STD_SHARE * size_px, float(read.states[0, OUTSIDE]))
    reading: Reading | None = None
    for _ in range(ROUNDS if prompts.diameter_px else ROUNDS + 1):
        reading = read_strip(image, of_length(line, known), diameter_px, hint, known, network)
        line = line[:0] if reading is None else _inside(reading.line(), image.shape)
        if reading is None or len(line) < MIN_SAMPLES:
            return None
        if prompts.diameter_px is None:
            diameter_px = max(diameter_px * reading.read.width, MIN_DIAMETER_PX)
    assert reading is not None
    seen_px = diameter_px * (reading.read.width if prompts.diameter_px else 1.0)
    return replace(_located(read, reading, line, diameter_px, points), diameter_px=seen_px, xray=prompts.xray)


def _verdicts(reading: Reading) -> tuple[float, float, float]:
    """Returns the mean logit that the strip is the catheter's by the stations near the base, between, near the tip."""
    from_base, from_tip = np.arange(ALONG) - reading.base.at, np.arange(ALONG) - reading.tip.at
    near_base, near_tip = np.abs(from_base) <= END_STATIONS, np.abs(from_tip) <= END_STATIONS
    between = (from_base > END_STATIONS) & (from_tip < -END_STATIONS)
    base, body, tip = (float(reading.read.right[part].mean()) for part in (near_base, between, near_tip))
    return base, body, tip


def _long_enough(line: FloatArray, shape: tuple[int, ...]) -> bool:
    return len(_inside(line, shape)) >= MIN_SAMPLES and float(arc_length(line)[-1]) > 4.0


def _inside(line: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """Returns ``line`` (n, 2) from where it enters the image on."""
    inside = ((line >= 0.0) & (line <= np.array([shape[1], shape[0]]) - 1.0)).all(axis=1)
    return line[int(inside.argmax()) :] if inside.any() else line[:0]


def _located(read: RoughPoints, reading: Reading, line: FloatArray, diameter_px: float, points: int) -> Located:
    base, tip = reading.base, reading.tip
    right_base, right_body, right_tip = _verdicts(reading)
    station = np.linspace(base.at, tip.at, points)
    along = np.arange(ALONG)
    spread = np.maximum(reading.read.spread, MIN_SPREAD_DIAMETERS)
    seen = np.interp(station, along, reading.read.seen) > MIN_SURE_SEEN
    arc = arc_length(line)
    step = float(arc[-1]) / max(tip.at - base.at, 1.0)
    at_tip = along[(along > tip.at - 3.0) & (along < tip.at + 0.5)]
    tip_seen = float(reading.read.seen[at_tip].mean()) if len(at_tip) else 0.0
    shaft = (along > base.at) & (along < tip.at) & (reading.read.seen > MIN_SURE_SEEN)
    grey = reading.strip.values[:, shaft].mean(axis=-1) if shaft.any() else reading.strip.values.mean(axis=-1)
    even = resampled(line, BEND_POINTS)
    turns = np.diff(np.unwrap(np.arctan2(*np.diff(even, axis=0).T[::-1])))
    apart = np.linalg.norm(read.points[:, None] - line[None], axis=2).min(axis=1)
    ends = read.mass[[0, -1]] * np.linalg.norm(read.points[[0, -1]] - line[[0, -1]], axis=1)
    return Located(
        points=resampled(line, points),
        std_px=reading.std_px(points),
        seen=seen,
        length_px=float(arc[-1]),
        length_std_px=step * math.hypot(tip.std, base.std) * (SEEN_STD_FACTOR if tip_seen > 0.5 else HIDDEN_STD_FACTOR),
        tip_seen=tip_seen,
        tip_peak=tip.peak,
        base_in_view=reading.base_in_view,
        mass=float(read.mass.mean()),
        present=read.present,
        right_base=right_base,
        right_body=right_body,
        right_tip=right_tip,
        spread=float(np.median(spread[shaft])) if shaft.any() else float(np.median(spread)),
        bend=float(np.abs(turns).max()) * BEND_POINTS,
        misfit=float(np.median(apart)) / diameter_px,
        ends_apart=float(ends[0 if reading.base_in_view else 1 :].sum() / max(arc[-1], 1e-9)),
        diameter_px=diameter_px,
        darker=bool(np.median(grey[_AXIS]) < np.median(grey[_BESIDE])),
    )


_FROM_AXIS = np.abs(np.linspace(-HALF_WIDTH, HALF_WIDTH, ACROSS))
_AXIS, _BESIDE = _FROM_AXIS < 0.4, _FROM_AXIS > 0.8
