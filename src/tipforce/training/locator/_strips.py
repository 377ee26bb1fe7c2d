"""Strips along a rough line, from which the line network learns: near the true line, or along another one."""

import math
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from ...geometry import arc_length, resampled, tangents_and_normals
from ...vision.locator import ALONG, straightened, strip_input
from ._labels import SEEN

Float = npt.NDArray[np.float64]

LINE_POINTS = 160
MAX_OFFSET_DIAMETERS = 1.4
"""The axis of a station further off is not learnt."""
WRONG_SHARE = 0.25
"""Share of the strips along other lines than the catheter's."""
GUESSED_SHARE, MAX_GUESS_RATIO, DIAMETER_ERROR = 0.2, 2.5, 0.05
"""Share of the strips whose diameter is only guessed, wrong by this factor at most, and the error of a known one."""
NEAR_END_DIAMETERS = 1.5
"""A found line of which a visible end is further off is wrong."""
FOLLOWED_SHARE = 0.9
"""Least share of the visible points of the true line, and of the found line beside them, that a right line has."""
MIN_VISIBLE_SHARE = 0.4
"""Least share of a right found line that is beside the visible part of the true line."""
FOUND_SHARE = 0.5
"""Share of the strips along lines that the locator found, of an image that has such lines."""
_GREY = np.array([[0.299], [0.587], [0.114]], np.float32)


class FoundLine(NamedTuple):
    """A line (n, 2) px that the locator found in an image, right or wrong, and its diameter in px."""

    points: Float
    diameter_px: float


@dataclass(frozen=True, slots=True, eq=False)
class StripSource:
    """``image`` (h, w, 3) uint8 with the true ``line`` (n, 2) px, base to tip, and the ``state`` (n,) of its points.

    Not ``present``: the catheter is missing, and ``line`` is where it would be. ``found``: lines of the locator.
    """

    image: npt.NDArray[np.uint8]
    line: Float
    state: npt.NDArray[np.uint8]
    diameter_px: float
    present: bool = True
    found: tuple[FoundLine, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class StripTarget:
    """``strip`` (3, ACROSS, ALONG), and the line, visibility and ends that the network learns.

    ``offset`` (ALONG,) of the true axis where ``asked``; ``seen`` (ALONG,) where ``judged``; ``ends`` (2,): stations of
    base and tip, -1 where they are not asked for; ``right``: 1 where the strip is the catheter's. ``log_width``:
    logarithm of the true diameter over the strip's.
    """

    strip: npt.NDArray[np.float32]
    offset: npt.NDArray[np.float32]
    asked: npt.NDArray[np.bool_]
    seen: npt.NDArray[np.float32]
    judged: npt.NDArray[np.bool_]
    ends: npt.NDArray[np.float32]
    right: np.float32
    log_width: np.float32


STRIP_FIELDS = tuple(field.name for field in fields(StripTarget))


def strip_target(source: StripSource, rng: np.random.Generator) -> StripTarget:
    """Returns a strip along a line near the true one, or along another one, with the values that the network learns.

    Args:
        source: the image with its catheter.
        rng: source of the line and of the light.
    """
    line = resampled(source.line, LINE_POINTS)
    state = source.state[np.linspace(0, len(source.state) - 1, LINE_POINTS).round().astype(int)]
    is_found = bool(source.found) and rng.random() < FOUND_SHARE
    wrong = not source.present or (not is_found and rng.random() < WRONG_SHARE)
    if is_found:
        guess, diameter_px = source.found[int(rng.integers(len(source.found)))]
    else:
        guess, diameter_px = _guess(source, line, state, wrong, rng)
    log_ratio = math.log(diameter_px / source.diameter_px)
    strip = straightened(source.image, guess, diameter_px)
    offset, near, at = _offsets(line, strip.points, strip.normals, diameter_px)
    first = _first_inside(line, source.image.shape) if is_found else 0
    (base, base_off), (tip, tip_off) = (_station(strip.points, end) for end in (line[first], line[-1]))
    right = not (wrong or is_found)
    if is_found and source.present:
        ends_near = base_off < NEAR_END_DIAMETERS * diameter_px, tip_off < NEAR_END_DIAMETERS * diameter_px
        right = 0.0 <= base < 0.3 * ALONG and ends_near[0] and _follows(strip.points, line, state, near, diameter_px)
        if state[-1] == SEEN:
            right = right and 0.7 * ALONG < tip <= ALONG - 1 and ends_near[1]
        elif not ends_near[1]:
            tip = -1.0
    station = np.arange(ALONG)
    seen = (state[at] == SEEN) & near & (station > base - 0.5) & (station < tip + 0.5)
    lit = lit_otherwise(strip.values, rng)
    if rng.random() < 0.3:  # an object across the strip
        start, wide = int(rng.integers(0, ALONG - 4)), int(rng.integers(2, 14))
        lit = lit.copy()
        lit[:, start : start + wide] = rng.uniform(0.0, 255.0, 3)
        seen[start : start + wide] = False
    values = strip_input(np.clip(lit, 0.0, 255.0), strip.inside)
    if rng.random() < 0.5:
        values, offset = np.ascontiguousarray(values[:, ::-1]), -offset
    in_view = first == 0 and bool(strip.inside_view[int(np.clip(round(base), 0, ALONG - 1))])
    ends = np.array([base if right and in_view else -1.0, tip if right else -1.0], np.float32)
    inside = strip.inside_view
    judged = inside if right else np.zeros(ALONG, bool)
    return StripTarget(
        values, offset.astype(np.float32), near & inside & right, seen.astype(np.float32), judged, ends,
        np.float32(right), np.float32(-log_ratio),
    )  # fmt: skip


def _guess(
    source: StripSource, line: Float, state: npt.NDArray[np.uint8], wrong: bool, rng: np.random.Generator
) -> FoundLine:
    """Returns a line near the true ``line`` (`LINE_POINTS`, 2), or along another one, and a guess of the diameter."""
    guessed = rng.random() < GUESSED_SHARE
    log_ratio = rng.uniform(-1.0, 1.0) * math.log(MAX_GUESS_RATIO) if guessed else rng.normal(0.0, DIAMETER_ERROR)
    diameter_px = source.diameter_px * math.exp(log_ratio)
    hidden_from = int(np.flatnonzero(state == SEEN).max(initial=0)) / (LINE_POINTS - 1.0)
    elsewhere = wrong and (source.present or rng.random() < 0.5)
    course = _elsewhere(line, diameter_px, source.image.shape, rng) if elsewhere else line
    # lines elsewhere have the same errors: a line exactly on an axis would be known as wrong by that alone
    return FoundLine(_disturbed(course, diameter_px, hidden_from, rng), diameter_px)


def _disturbed(line: Float, diameter_px: float, hidden_from: float, rng: np.random.Generator) -> Float:
    """Returns ``line`` with errors like those of the locator or an earlier round: beside the line, and at both ends.

    ``hidden_from``: share of the line at which its end is hidden; the guess may leave the line from there on.
    """
    count, share = len(line), np.linspace(0.0, 1.0, len(line))
    modes = rng.integers(2, 7)
    weights = 1.2 * rng.normal(size=modes) / math.sqrt(modes) * diameter_px * rng.choice([0.6, 0.3, 0.12, 0.04])
    beside = weights @ np.cos(math.pi * np.arange(modes)[:, None] * share)
    beyond = np.maximum(share - hidden_from, 0.0) / max(1.0 - hidden_from, 1e-6)
    beside = beside + beyond**2 * rng.normal(0.0, 1.5) * diameter_px * (hidden_from < 0.97)
    tangent, normal = tangents_and_normals(line)
    moved = line + beside[:, None] * normal
    length = float(np.linalg.norm(np.diff(moved, axis=0), axis=1).sum())
    start, stop = np.clip(rng.normal(0.0, rng.choice([0.05, 0.02, 0.006]), 2), -0.1, 0.1) * length
    if start < 0.0:
        moved = np.vstack([moved[0] + start * tangent[0], moved])
    if stop > 0.0:
        moved = np.vstack([moved, moved[-1] + stop * tangent[-1]])
    arc = arc_length(moved)
    wanted = np.linspace(max(start, 0.0), arc[-1] + min(stop, 0.0), count)
    return np.column_stack([np.interp(wanted, arc, moved[:, k]) for k in (0, 1)])


def _elsewhere(line: Float, diameter_px: float, shape: tuple[int, ...], rng: np.random.Generator) -> Float:
    """A line that is not the catheter's: with the sheath or along it, from the tip back, turned, anywhere."""
    kind, size = rng.random(), np.array([shape[1], shape[0]])
    if kind < 0.25 and ((line[0] > 3.0) & (line[0] < size - 4.0)).all():
        root = line[0] + (line[0] - line[len(line) // 8]) * 8.0 * np.linspace(rng.uniform(0.5, 2.5), 0.02, 80)[:, None]
        return resampled(np.vstack([root, line]), len(line))
    if kind < 0.4:
        return line + (line[-1] - line[0]) * rng.uniform(0.25, 0.6) * rng.choice([-1.0, 1.0])
    if kind < 0.55:
        return line[::-1]
    turn = rng.normal(0.0, 0.5)
    matrix = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    if kind < 0.8:
        return (line - line[0]) @ matrix.T + line[0] + rng.normal(0.0, 0.3, 2) * diameter_px
    return (line - line.mean(axis=0)) @ matrix.T + rng.uniform(0.1, 0.9, 2) * size


def _offsets(
    line: Float, points: Float, normals: Float, diameter_px: float
) -> tuple[Float, npt.NDArray[np.bool_], npt.NDArray[np.int64]]:
    """Where ``line`` crosses each station's normal, in diameters; whether it does so nearby; at which of its points."""
    way = line[None] - points[:, None]
    along = (way * np.column_stack([normals[:, 1], -normals[:, 0]])[:, None]).sum(axis=-1)
    across = (way * normals[:, None]).sum(axis=-1)
    far = np.where(np.abs(across) > 2.2 * diameter_px, np.inf, np.abs(along))
    at, station = np.clip(far.argmin(axis=1), 1, len(line) - 2), np.arange(len(points))
    other = np.where(along[station, at] > 0.0, at - 1, at + 1)
    gap = np.maximum(np.abs(along[station, at] - along[station, other]), 1e-9)
    share = np.clip(np.abs(along[station, at]) / gap, 0.0, 1.0)
    offset = (1.0 - share) * across[station, at] + share * across[station, other]
    near = far[station, at] < 0.75 * np.linalg.norm(points[1] - points[0])
    return offset / diameter_px, near & (np.abs(offset) < MAX_OFFSET_DIAMETERS * diameter_px), at


def _follows(
    points: Float, line: Float, state: npt.NDArray[np.uint8], near: npt.NDArray[np.bool_], diameter_px: float
) -> bool:
    """Returns whether a found line follows the visible part of ``line``: its hidden part proves nothing.

    Args:
        points: (ALONG, 2) px, the found line.
        line: (n, 2) px, the true line.
        state: (n,) of its points.
        near: (ALONG,) whether the true line is beside each point of the found line.
        diameter_px: diameter of the strip.
    """
    visible = line[state == SEEN]
    apart = np.linalg.norm(visible[:, None] - points[None], axis=2)
    start, stop = int(apart[0].argmin()), int(apart[-1].argmin()) + 1
    if stop - start <= MIN_VISIBLE_SHARE * ALONG:
        return False
    covered = (apart.min(axis=1) < MAX_OFFSET_DIAMETERS * diameter_px).mean()
    return min(covered, near[start:stop].mean()) >= FOLLOWED_SHARE


def _first_inside(line: Float, shape: tuple[int, ...]) -> int:
    """Returns the index of the first point of ``line`` (n, 2) in an image of ``shape``; a found line begins there."""
    return int(((line >= 0.0) & (line <= (shape[1] - 1.0, shape[0] - 1.0))).all(axis=1).argmax())


def _station(points: Float, end: Float) -> tuple[float, float]:
    """The station next to ``end`` (2,), as a fraction, and its distance in px."""
    apart = np.linalg.norm(points - end, axis=1)
    at = int(apart.argmin())
    low, high = max(at - 1, 0), min(at + 1, len(points) - 1)
    way = (points[high] - points[low]) / (high - low)
    return at + float((end - points[at]) @ way / (way @ way)), float(apart[at])


def lit_otherwise(image: npt.NDArray[Any], rng: np.random.Generator) -> npt.NDArray[np.float32]:
    """Returns ``image`` (h, w, 3) in another light, polarity or tint, blurred or noisy; grey levels, not clipped."""
    height, width = image.shape[:2]
    if rng.random() < 0.15:
        image = 255.0 - image
    if rng.random() < 0.3:
        image = np.repeat(image @ _GREY, 3, axis=2)
    elif rng.random() < 0.3:
        image = image[..., rng.permutation(3)]
    if rng.random() < 0.5:
        image = 255.0 * np.clip(image / 255.0, 0.0, 1.0) ** math.exp(rng.normal(0.0, 0.35))
    if rng.random() < 0.5:
        image = image * np.exp(rng.normal(0.0, 0.08, 3))
    if rng.random() < 0.3:
        light = rng.uniform(0.6, 1.4, (3, 3)).astype(np.float32)
        image = image * cv2.resize(light, (width, height), interpolation=cv2.INTER_CUBIC)[..., None]
    if rng.random() < 0.3:
        image = cv2.GaussianBlur(np.asarray(image, np.float32), (0, 0), rng.uniform(0.3, 1.3))
    if rng.random() < 0.5:
        image = image + rng.normal(0.0, rng.uniform(1.0, 9.0), (height, width, 3 if rng.random() < 0.5 else 1))
    return np.asarray(image, np.float32)
