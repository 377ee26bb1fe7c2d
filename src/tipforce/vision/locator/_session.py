"""Constants of a session, which its images agree on: the catheter's base, length and diameter.

Objects are looked for in some images, at several sizes, and each is read again in a window around its base, at its own
size. The object whose lines are the most probable is the catheter: its base and size become prompts, all images are
read with them, and the length is that of the lines whose tip is seen.
"""

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from ...errors import InputError, NoCatheterError
from ...geometry import arc_length
from ...types import Box, FloatArray, Image
from .._clamp import INWARD
from ._line_probability import probability
from ._locate import Located, locate, read_points, readings_by_size, rough_line
from ._networks import OUTSIDE, RoughPoints
from ._prompts import Prompts
from ._reading import Known

POINTS = 64
MAX_FIRST_FRAMES = 4
"""Number of images in which objects are looked for: each takes the networks up to ten readings."""
MAX_OUTSIDE = 0.3
"""Where the base is more probably outside the image the object is read again without a prompt for its base, too."""
SURE_PROBABILITY = 0.8
"""An image whose line at the stated size is more probable is not read at other sizes; nor without the stated border if
a line that was found with it is."""
MAX_OBJECTS = 2
MIN_LENGTH_PX = 4.0
MIN_SHARE = 0.3
"""The catheter must be found in this share of the images."""
MAX_BASE_DIAMETERS, MAX_BASE_PX = 2.5, 5.0
"""Lines that begin within this distance begin at the same base."""
RIVAL_SHARE = 0.25
"""Another object may be the catheter if its lines are this likely, as a share of those of the most likely one."""
MIN_INWARD_COSINE = 0.0
"""A catheter that comes from a stated border begins in a direction away from it."""
RIVAL_SCORE_SHARE = 0.8
"""If the lines from the other base are nearly as sure, a person must say which object is the catheter."""
MIN_TIP_SEEN, MIN_TIP_PEAK = 0.6, 0.4
"""A line with more counts for the length."""
STATED_LENGTH_STD_SHARE = 0.04
"""Standard error of a length that only the metadata state: the catheter, the scale, and the hidden root."""
MAX_LENGTH_SIGMAS = 3.0
"""A length that is further from the stated one is kept as it is."""
ONE_LENGTH_STD_SHARE, MIN_LENGTH_STD_SHARE = 0.03, 0.004
"""Standard error of a length from one line, and the least one."""
MIN_LENGTH_RATIO, MAX_LENGTH_RATIO = 0.8, 1.15
"""An object of another length than these shares of the stated one is not the catheter; its root may be hidden."""
MIN_DIAMETER_RATIO, MAX_DIAMETER_RATIO = 0.45, 2.2
"""Nor is an object whose diameter is another one than the stated one by more than these factors."""
MAX_LENGTH_CHANGE_SHARE = 0.25
"""A line of another length than this share of the median one is wrong."""
STILL_PX, STILL_PERCENT = 0.1, 80.0
"""A line of which half is nearer than this to one and the same curve, in this percentage of the images, does not bend
or move across itself: a post, an edge, or a cable that another object crosses."""
CELL_PX, CHANGED_GREY, CHANGED_SHARE = 8, 8.0, 0.004
"""The images differ where this share of cells of this size changes by this number of grey levels."""
MIN_FRAMES = 3
"""Fewest images of a session that are compared."""


@dataclass(frozen=True, slots=True, eq=False)
class SessionConstants:
    """Constants of the catheter in the images of one session.

    Attributes:
        base_px: (2,) u, v of the base, or of the point where the catheter enters the image.
        base_in_view: whether the base is inside the image.
        heading_rad: direction at the base, from u toward v.
        length_px: length of the line from ``base_px`` to the tip.
        length_std_px: its standard deviation in one image: in a projection it changes from image to image.
        diameter_px: diameter of the shaft.
        darker: whether the shaft is darker than the ground beside it.
        lines: the line in each image; None where no line was found.
    """

    base_px: FloatArray
    base_in_view: bool
    heading_rad: float
    length_px: float
    length_std_px: float
    diameter_px: float
    darker: bool
    lines: tuple[Located | None, ...]


def session_constants(
    frames: Sequence[Image], prompts: Prompts, *, moves: bool, network: Path | None = None
) -> SessionConstants:
    """Finds the constants of one session.

    Args:
        frames: images of the session.
        prompts: everything that is stated, px.
        moves: whether the catheter must have moved in these images where they differ.
        network: folder of fine-tuned networks; None: those that come with tipforce.

    Raises:
        InputError: no catheter is found, two objects could be it, or the object that is found does not move.
    """
    stated = _known_length(prompts)
    first = _first_lines(frames, prompts, stated, network)
    found = [line for line in first if line is not None and line.is_there]
    if not found:
        raise InputError(_nothing(first, 0, len(frames)))
    objects = _likely_objects(found, prompts)
    tried = [[locate(frame, each, POINTS, stated, network) for frame in frames] for each in objects]
    best = _chosen(objects, tried, stated)
    lines, sized = tried[best], objects[best]
    assert sized.diameter_px is not None
    kept = [line for line in lines if line is not None and line.is_there]
    if len(kept) < max(1.0, MIN_SHARE * len(frames)):
        raise InputError(_nothing(lines, len(kept), len(frames)))
    begins = np.array([line.points[0] for line in kept])
    base = np.median(begins, axis=0)
    in_view = 2 * sum(line.base_in_view for line in kept) > len(kept)
    near = np.linalg.norm(begins - base, axis=1) < max(MAX_BASE_DIAMETERS * sized.diameter_px, MAX_BASE_PX)
    near_lines = [line for line, is_near in zip(kept, near, strict=True) if is_near] or kept
    length, error = _length(near_lines, base, stated if in_view else None)
    if prompts.region is not None and not _in_box(base, prompts.region, sized.diameter_px):
        raise InputError(f"the object found begins at ({base[0]:.0f}, {base[1]:.0f}), outside base_region")
    if prompts.border is not None:
        inward = _inward_rad(prompts.border)
        if 2 * sum(_points_inward(line, inward) for line in kept) <= len(kept):
            raise InputError(
                f"the object found at ({base[0]:.0f}, {base[1]:.0f}) does not come from the side that is stated, "
                f"{prompts.border}"
            )
    if prompts.length_px is not None and not MIN_LENGTH_RATIO < length / prompts.length_px < MAX_LENGTH_RATIO:
        raise InputError(
            f"the object found is {length:.0f} px long, the stated length is {prompts.length_px:.0f} px: correct the "
            "catheter's length or the scale"
        )
    seen_px = statistics.median(line.diameter_px for line in kept)
    if prompts.diameter_px is not None and not MIN_DIAMETER_RATIO < seen_px / prompts.diameter_px < MAX_DIAMETER_RATIO:
        raise InputError(
            f"the object found is {seen_px:.1f} px thick, the stated diameter is {prompts.diameter_px:.1f} px: correct "
            "the catheter's diameter or the scale"
        )
    if moves and stands_still(np.array([line.points for line in kept]), frames):
        end = kept[0].points[-1]
        raise InputError(
            f"the object found, as far as ({end[0]:.0f}, {end[1]:.0f}), neither moves nor bends while the images "
            "change: a post or an edge does so"
        )
    return SessionConstants(
        base, in_view, _median_angle([line.heading_rad for line in kept]),
        length, error, sized.diameter_px, 2 * sum(line.darker for line in kept) > len(kept), tuple(lines),
    )  # fmt: skip


def _in_box(point: FloatArray, box: Box, margin_px: float) -> bool:
    """Whether ``point`` (2,) is in ``box``, or at most ``margin_px`` outside it."""
    low, high = np.array(box[:2]) - margin_px, np.array(box[2:]) + margin_px
    return bool(((point >= low) & (point <= high)).all())


def _median_angle(angles_rad: Sequence[float]) -> float:
    return math.atan2(statistics.median(map(math.sin, angles_rad)), statistics.median(map(math.cos, angles_rad)))


def _nothing(lines: Sequence[Located | None], count: int, images: int) -> str:
    likely = max((line.present for line in lines if line is not None), default=0.0)
    return f"no catheter was found: one is visible in {count} of {images} images (probability {likely:.0%} at most)"


def _first_lines(
    frames: Sequence[Image], prompts: Prompts, stated: Known | None, network: Path | None
) -> list[Located | None]:
    """Returns the lines in some of the images, from each object that the first network sees at one of several sizes.

    The points at one size alone are no answer: where a catheter is small its mouth is not visible, and the tube that it
    comes out of looks like a catheter. So each object is read again, in a window around its base, at its own size. The
    peak of a base that is called outside the image may be the mouth of the tube: both readings are made. A stated
    border draws the points toward it, past the mouth of a tube: where no line is sure, they are also read without it.
    """

    def again(frame: Image, read: RoughPoints) -> list[Located | None]:
        length = prompts.length_px or max(float(arc_length(rough_line(read))[-1]), MIN_LENGTH_PX)
        own = replace(prompts, length_px=length)
        begins = [own] if prompts.base_px is not None else [replace(own, base_px=read.points[0])]
        if prompts.base_px is None and read.states[0, OUTSIDE] > MAX_OUTSIDE:
            begins.append(replace(own, near_px=read.points[1]))
        return [locate(frame, each, POINTS, stated, network) for each in begins]

    lines: list[Located | None] = []
    for frame in frames[:: -(-len(frames) // MAX_FIRST_FRAMES)]:
        if prompts.length_px is not None:
            sized = again(frame, read_points(frame, prompts, network))
            lines += sized
            if _any_sure(sized):
                continue
        unsized = replace(prompts, length_px=None, diameter_px=None)
        for asked in (unsized,) if prompts.border is None else (unsized, replace(unsized, border=None)):
            found = [line for read in readings_by_size(frame, asked, network) for line in again(frame, read)]
            lines += found
            if _any_sure(found):
                break
    return lines


def _any_sure(lines: Sequence[Located | None]) -> bool:
    return any(line is not None and probability(line) > SURE_PROBABILITY for line in lines)


def object_prompts(
    frames: Sequence[Image], prompts: Prompts, count: int, rival_share: float, network: Path | None = None
) -> list[Prompts]:
    """Returns the prompts for the objects in ``frames`` that could be the catheter, the most probable first.

    Args:
        frames: images of a session.
        prompts: everything that is stated, px.
        count: largest number of objects.
        rival_share: least probability of an object's lines, as a share of those of the first one.
        network: folder of fine-tuned networks; None: those that come with tipforce.
    """
    found = [line for line in _first_lines(frames, prompts, _known_length(prompts), network) if line is not None]
    return _likely_objects(found, prompts, count, rival_share) if found else []


def _known_length(prompts: Prompts) -> Known | None:
    if prompts.length_px is None:
        return None
    return Known(prompts.length_px, STATED_LENGTH_STD_SHARE * prompts.length_px)


def _likely_objects(
    found: Sequence[Located], prompts: Prompts, count: int = MAX_OBJECTS, rival_share: float = RIVAL_SHARE
) -> list[Prompts]:
    """Returns the prompts for the object whose lines are the most probable, and for others that are likely, too.

    Lines that point toward the stated border do not count, unless all do.
    """
    if prompts.border is not None:
        inward = _inward_rad(prompts.border)
        found = [line for line in found if _points_inward(line, inward)] or found
    begins, votes = np.array([line.points[0] for line in found]), np.array([probability(line) for line in found])
    limits = np.maximum(MAX_BASE_DIAMETERS * np.array([line.diameter_px for line in found]), MAX_BASE_PX)
    near = np.linalg.norm(begins[:, None] - begins, axis=2) < np.minimum(limits[:, None], limits)
    objects, left, most = list[Prompts](), np.ones(len(found), bool), 0.0
    for _ in range(count):
        sums = np.where(left, (near & left) @ votes, -1.0)
        best = int(sums.argmax())
        if sums[best] <= rival_share * most:
            break
        most = max(most, float(sums[best]))
        own = near[best] & left
        good = [
            line
            for line, is_own, vote in zip(found, own, votes, strict=True)
            if is_own and 2.0 * vote >= votes[own].max()
        ]
        base = np.median([line.points[0] for line in good], axis=0)
        length = prompts.length_px or statistics.median(line.length_px for line in good)
        diameter = prompts.diameter_px or statistics.median(line.diameter_px for line in good)
        given = base if prompts.base_px is None else prompts.base_px
        objects.append(replace(prompts, base_px=given, length_px=length, diameter_px=diameter))
        left &= ~near[best]
        if prompts.base_px is not None or not left.any():
            break
    return objects


def _chosen(objects: Sequence[Prompts], tried: Sequence[Sequence[Located | None]], stated: Known | None) -> int:
    """Returns the index of the object whose lines are the surest; on one and the same shaft the length counts, too.

    Raises NoCatheterError where two objects are as likely.
    """
    inward = None if objects[0].border is None else _inward_rad(objects[0].border)
    kept = [
        [each for each in lines if each is not None and (inward is None or _points_inward(each, inward))]
        for lines in tried
    ]
    scores = [sum(map(probability, lines)) for lines in kept]
    best = int(np.argmax(scores))
    for rival, score in enumerate(scores):
        if rival == best or score <= RIVAL_SCORE_SHARE * scores[best]:
            continue
        diameter = objects[best].diameter_px
        assert diameter is not None
        if _same_shaft(kept[best][0].points, kept[rival][0].points, diameter):
            surer = 0.0 if stated is None else len(kept[best]) * math.log(scores[best] / score)
            best = rival if _length_off(kept[rival], stated) + surer < _length_off(kept[best], stated) else best
            continue
        one, other = (objects[k].base_px for k in (best, rival))
        assert one is not None
        assert other is not None
        raise NoCatheterError(
            f"two objects could be the catheter: one begins near ({one[0]:.0f}, {one[1]:.0f}), the "
            f"other near ({other[0]:.0f}, {other[1]:.0f})",
            several=True,
        )
    return best


def _inward_rad(border: str) -> float:
    """Returns the direction from a border into the image, from u toward v."""
    along_u, along_v = INWARD[border]
    return math.atan2(along_v, along_u)


def _points_inward(line: Located, inward_rad: float) -> bool:
    return math.cos(line.heading_rad - inward_rad) > MIN_INWARD_COSINE


def _same_shaft(one: FloatArray, other: FloatArray, diameter_px: float) -> bool:
    """Whether most of the shorter of two lines (n, 2) is on the longer one."""
    apart = np.linalg.norm(one[:, None] - other, axis=2)
    return float(min(np.median(apart.min(axis=1)), np.median(apart.min(axis=0)))) < diameter_px


def _length_off(lines: Sequence[Located], stated: Known | None) -> float:
    """Returns half the square of the lines' error of length in standard errors; none stated: the longest is best."""
    length = statistics.median(line.length_px for line in lines)
    return -length if stated is None else 0.5 * ((length - stated.length_px) / stated.length_std_px) ** 2


def _length(lines: Sequence[Located], base_px: FloatArray, stated: Known | None) -> tuple[float, float]:
    """Returns the length in px and its standard error, from the lines whose tip is seen and from the stated length.

    It is measured from ``base_px``, the base of the session.
    """
    seen = [line for line in lines if line.tip_seen >= MIN_TIP_SEEN and line.tip_peak >= MIN_TIP_PEAK]
    if not seen:
        if stated is not None:
            return stated.length_px, stated.length_std_px
        seen = sorted(lines, key=lambda line: -line.tip_peak)[: (len(lines) + 1) // 2]
    lengths = []
    for line in seen:
        arc = arc_length(line.points)
        nearest = int(np.linalg.norm(line.points - base_px, axis=1).argmin())
        lengths.append(float(arc[-1] - arc[nearest]))
    middle = statistics.median(lengths)
    off = [length - middle for length in lengths]
    near = [each for each in off if abs(each) < MAX_LENGTH_CHANGE_SHARE * middle]
    scatter = math.sqrt(statistics.fmean(each**2 for each in near or off))
    error = max(
        math.hypot(scatter, ONE_LENGTH_STD_SHARE * middle) / math.sqrt(len(seen)), MIN_LENGTH_STD_SHARE * middle
    )
    if stated is None:
        return middle, math.hypot(error, scatter)
    own, other = error**-2, stated.length_std_px**-2
    if abs(middle - stated.length_px) > MAX_LENGTH_SIGMAS * math.hypot(error, stated.length_std_px):
        return middle, math.hypot(error, scatter)
    length = (own * middle + other * stated.length_px) / (own + other)
    return length, math.hypot((own + other) ** -0.5, scatter)


def stands_still(lines: FloatArray, frames: Sequence[Image]) -> bool:
    """Whether an object with the ``lines`` (n, k, 2) neither moves nor bends while ``frames`` change."""
    return len(lines) >= MIN_FRAMES and _still(lines) and _images_differ(frames)


def _still(lines: FloatArray) -> bool:
    """Whether most ``lines`` (n, k, 2) are on one curve, however far each goes along it."""
    apart = np.empty((len(lines), len(lines)))
    for row, curve in zip(apart, lines, strict=True):
        ways = np.diff(curve, axis=0)
        from_start = lines[:, :, None] - curve[:-1]
        share = np.clip((from_start * ways).sum(axis=-1) / (ways**2).sum(axis=-1), 0.0, 1.0)
        off = np.linalg.norm(from_start - share[..., None] * ways, axis=-1).min(axis=-1)
        row[:] = np.median(off, axis=1)
    return float(np.percentile(apart, STILL_PERCENT, axis=1).min()) < STILL_PX


def _images_differ(frames: Sequence[Image]) -> bool:
    """Whether more changes between ``frames`` than light and noise."""
    greys = [cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY) if frame.ndim == 3 else frame for frame in frames]
    size = tuple(max(1, n // CELL_PX) for n in greys[0].shape[1::-1])
    small = np.array([cv2.resize(g, size, interpolation=cv2.INTER_AREA).astype(np.float64) for g in greys])
    small -= np.median(small, axis=(1, 2), keepdims=True)
    return float((np.ptp(small, axis=0) > CHANGED_GREY).mean()) > CHANGED_SHARE
