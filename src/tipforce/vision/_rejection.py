"""Checks of a calibrated detection: can the object that it finds in a session's images be a catheter?

A catheter has a base that stays, one width, the stated diameter, and it moves or bends when the images change. A dark
and long object alone may be a post, an edge, or a sheath with the shaft behind it.
"""

import math
import statistics
from collections.abc import Sequence

import cv2
import numpy as np

from ..types import FloatArray, Image, SessionInfo, Status
from ._session_size import for_session
from ._settings import ResolvedVision
from ._tip_consensus import flanks_about_tip
from .tracer import Trace, Tracer

TWO_OBJECTS = "two objects could be the catheter"
MIN_FRAMES = 3
"""Fewest images of a session that are checked."""
MIN_FOUND_SHARE, MIN_FOUND_SHARE_STRICT = 1 / 3, 0.45
"""The catheter must be found in this share of the images; the second value holds where `rejection_reason` is strict."""
_SURE = 0.2
"""In so large a share of the images the line must be right with the least probability of the settings."""
_THINNER, _THICKER, _DIAMETER_PX = 0.22, 0.3, 0.3
"""The detected width may differ from the stated diameter by these shares, plus px: 5 % of the diameter, 2 % of
the scale, and the effect of blur, gloss and shadow at the flanks of a thin tube."""
_BASE, _BASE_PX, _TURN = 0.5, 2.0, 0.15
"""Largest distance of the base in diameters (but at least px), and of its angle in radians, between images."""
_STAYS = 0.75
"""In so large a share of the images."""
_STEP, _STEP_PX = 1.16, 1.2
"""A shaft whose width decreases by this ratio and this number of px in one step came out of a thicker tube."""
_FLANKS_GREY, _BEYOND = 8.0, 0.25
"""Before the tip the flanks must separate this number of grey levels, and beyond it less than this share of that."""
_EACH = 0.9
"""Share of the images in which they must, where `rejection_reason` is strict."""
_LENGTH = 0.08
"""A length may differ from the stated one by this share: 5 % of the catheter, 2 % of the scale, and the base."""
_SPREAD = 0.02
"""The lengths found in the images of a session may scatter by this share (standard deviation)."""
_STILL_PX, _STILL_LINES = 0.1, 80.0
"""A line of which half is nearer than this to one and the same curve, in this percentage of the images, does not bend
or move across itself: a post, an edge, or a cable that another object crosses. Half of a catheter moved by 0.15 px
and more in all sessions that were examined."""
_ELSEWHERE, _OFTEN, _TWICE = 3.0, 0.1, 2
"""An object that begins this number of diameters away, in this share of the images, in two at least, is another one."""
_CELL, _CHANGED_GREY, _CHANGED = 8, 8.0, 0.004
"""The images differ where this share of cells of this size in px changes by this number of grey levels."""


def enough_images(frames: Sequence[Image]) -> bool:
    """Whether there are enough ``frames`` for `rejection_reason`."""
    return len(frames) >= MIN_FRAMES


def with_rejection(vision: ResolvedVision) -> ResolvedVision:
    """Returns ``vision`` that refuses each frame whose line is not right with the least probability.

    Unchanged where the catheter's size is not stated.
    """
    if vision.nominal_px is None:
        return vision
    return vision.model_copy(update={"least_probability": vision.settings.least_probability})


def _remedy(marked: bool) -> str:
    """Returns the remedy for the user; ``marked``: the base is marked already."""
    if marked:
        return "base_region must cross the shaft right behind its base, and roi must exclude similar objects"
    return "mark the shaft's base with base_region"


def rejection_reason(
    vision: ResolvedVision, frames: Sequence[Image], info: SessionInfo, strict: bool = False, whole: bool = True
) -> tuple[str, int]:
    """Returns why the object that ``vision`` finds in images of one session cannot be the catheter, "" if it can.

    The second value is the number of ``frames`` in which it was found. The text states the finding, the expectation
    and the remedy. ``strict``: the base is a guess itself, so the end must be clear in nearly all images, and the
    length the same. ``whole``: the images are from all over the session, so the catheter must have moved in some.
    """
    tracer = Tracer(for_session(vision, info))
    found: list[tuple[Trace, FloatArray, Image]] = []
    for frame in frames:
        trace, _ = tracer.best_trace(frame)
        if trace is not None and trace.status is Status.VALID:
            found.append((trace, tracer.points.copy(), frame))
    count = len(found)
    mark = _remedy(vision.base_region is not None and not strict)
    if count < (MIN_FOUND_SHARE_STRICT if strict else MIN_FOUND_SHARE) * len(frames):
        return f"a shaft was followed to its end in only {count} of {len(frames)} images: {mark}", count
    traces, lines = [trace for trace, _, _ in found], np.array([line for _, line, _ in found])
    width = statistics.median(trace.diameter_px for trace in traces)
    stated = vision.nominal_px
    off = width - stated[1] if stated else 0.0
    if stated and abs(off) > (_THICKER if off > 0.0 else _THINNER) * stated[1] + _DIAMETER_PX:
        return f"the object found is {width:.1f} px wide, the stated diameter is {stated[1]:.1f} px: {mark}", count
    at = _step(traces, width)
    if at:
        return (
            f"the object grows thinner at ({at[0]:.0f}, {at[1]:.0f}) in most images, as at the mouth of a sheath: "
            "mark the place behind it with base_region"
        ), count
    two = _two_bases(traces, width)
    if two:
        return f"{TWO_OBJECTS}: {two}: {mark}", count
    stays = _stays(traces, width)
    if stays < _STAYS:
        return f"the object found has no base that stays: it stays in {stays:.0%} of the images only: {mark}", count
    if whole and stands_still(lines, frames):
        end = lines[0, -1]
        return (
            f"the object found, as far as ({end[0]:.0f}, {end[1]:.0f}), neither moves nor bends while the images "
            f"change: a post or an edge does so: {mark}"
        ), count
    if stated and count >= MIN_FRAMES:
        sure = sum(trace.probability >= vision.settings.least_probability for trace in traces)
        if sure < _SURE * len(frames):
            return f"its flanks and its tip are clear in only {sure} of {len(frames)} images: {mark}", sure
        count = sure
        unclear = _end(found, width) if strict else ""
        length = statistics.median(trace.length_px for trace in traces)
        if length > (1.0 + _LENGTH) * stated[0] or (strict and length < (1.0 - _LENGTH) * stated[0]):
            unclear = "that is not the stated length"
        if unclear:
            return (
                f"the object ends after {length:.0f} px (stated: {stated[0]:.0f}), but {unclear}: {mark}",
                count,
            )
    return "", count


def _end(found: Sequence[tuple[Trace, FloatArray, Image]], width: float) -> str:
    """Returns why the end that was found cannot be a tip, "" where nothing says so."""
    lengths = np.array([trace.length_px for trace, _, _ in found])
    if float(lengths.std()) > _SPREAD * float(np.median(lengths)):
        return f"by {lengths.min():.0f} to {lengths.max():.0f} px in different images"
    about = [
        flanks_about_tip([image], [line], 0.5 * width, length)
        for (_, line, image), length in zip(found, lengths, strict=True)
    ]
    begins = np.array([before >= _FLANKS_GREY for before, _ in about])
    ends = np.array([beyond <= _BEYOND * before for before, beyond in about])
    if float((begins & ends).mean()) >= _EACH:
        return ""
    return "it goes on beyond its end in many images" if ends.mean() < begins.mean() else "no flanks lead there in many"


def _step(traces: Sequence[Trace], width: float) -> tuple[float, float] | None:
    """Returns the place (u, v) where the shaft grows thinner in most images, None where there is none."""
    places = np.array([t.step_at for t in traces if t.step > _STEP and (t.step - 1.0) * width > _STEP_PX])
    if 2 * len(places) <= len(traces):
        return None
    middle = np.median(places, axis=0)
    near = int((np.linalg.norm(places - middle, axis=1) < width).sum())
    return (float(middle[0]), float(middle[1])) if 2 * near > len(traces) else None


def _stays(traces: Sequence[Trace], width: float) -> float:
    """Returns the share of the images in which the base has the position and direction that it has in most."""
    bases = np.array([trace.base for trace in traces])
    middle = np.median(bases[:, :2], axis=0)
    way = math.atan2(float(np.median(np.sin(bases[:, 2]))), float(np.median(np.cos(bases[:, 2]))))
    near = np.linalg.norm(bases[:, :2] - middle, axis=1) < max(_BASE * width, _BASE_PX)
    turned = np.abs(np.angle(np.exp(1j * (bases[:, 2] - way)))) < _TURN
    return float((near & turned).mean())


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
    return float(np.percentile(apart, _STILL_LINES, axis=1).min()) < _STILL_PX


def _two_bases(traces: Sequence[Trace], width: float) -> str:
    """Returns where the shaft begins in most images, and where in others, if these are two objects; "" if not."""
    bases = np.array([trace.base[:2] for trace in traces])
    middle = np.median(bases, axis=0)
    others = bases[np.linalg.norm(bases - middle, axis=1) > _ELSEWHERE * width]
    if len(others) < max(_TWICE, _OFTEN * len(bases)):
        return ""
    other = np.median(others, axis=0)
    return (
        f"one begins near ({middle[0]:.0f}, {middle[1]:.0f}) in {len(bases) - len(others)} images, the other near "
        f"({other[0]:.0f}, {other[1]:.0f}) in {len(others)}"
    )


def _images_differ(frames: Sequence[Image]) -> bool:
    """Whether more changes between ``frames`` than light and noise."""
    greys = [cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY) if frame.ndim == 3 else frame for frame in frames]
    size = tuple(max(1, n // _CELL) for n in greys[0].shape[1::-1])
    small = np.array([cv2.resize(g, size, interpolation=cv2.INTER_AREA).astype(np.float64) for g in greys])
    small -= np.median(small, axis=(1, 2), keepdims=True)
    return float((np.ptp(small, axis=0) > _CHANGED_GREY).mean()) > _CHANGED
