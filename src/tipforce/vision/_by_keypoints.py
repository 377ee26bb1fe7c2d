"""Detection by the trained networks: over a session's images first, then in one image after another."""

import math
from collections.abc import Sequence

import numpy as np

from ..types import BasePose, BaseSide, CentrelinePx, DetectedShape, FloatArray, Image, SessionInfo, Status
from ._rejection import stands_still
from ._session_size import nominal_px
from ._settings import SIDES, Box, KeypointPrior, ResolvedVision, VisionSettings
from .keypoints import Located, consensus, locate, probability, signs
from .tracer import Tracer

MIN_FRAMES = 3
"""Fewest images of a session that are compared."""
_SHARE = 0.2
"""In so large a share of the images the line must be right with the least probability."""
MIN_LENGTH_SHARE, MAX_LENGTH_SHARE = 0.85, 1.08
"""Limits of a line's length in shares of the stated length; its base may be outside the image."""
MAX_BASE_DIAMETERS = 2.0
"""A line begins within this number of diameters of the session's base."""
MAX_LINE_DIAMETERS, MAX_TIP_DIAMETERS = 0.35, 1.0
"""Two lines, or tips, of the same shaft are at most this number of diameters apart."""
MAX_OUTSIDE_DIAMETERS = 0.5
"""A line may leave ``roi``, or begin beside ``base_region``, by this number of diameters."""


def _within(points: FloatArray, box: Box | None, diameter_px: float) -> bool:
    """Whether all ``points`` (n, 2) are in ``box``, or at most `MAX_OUTSIDE_DIAMETERS` outside it."""
    if box is None:
        return True
    margin = MAX_OUTSIDE_DIAMETERS * diameter_px
    return bool(((points >= np.array(box[:2]) - margin) & (points <= np.array(box[2:]) + margin)).all())


def _fits(line: Located, nominal: tuple[float, float], stated: VisionSettings) -> bool:
    """Returns whether a line has about the ``nominal`` length and is inside the stated regions.

    Args:
        line: the line of the networks.
        nominal: length and diameter of the catheter in px.
        stated: settings with the regions.
    """
    length_px, diameter_px = nominal
    return (
        MIN_LENGTH_SHARE * length_px < line.length_px < MAX_LENGTH_SHARE * length_px
        and _within(line.points, stated.roi, diameter_px)
        and _within(line.points[:1], stated.base_region, diameter_px)
    )


def find_by_keypoints(
    settings: VisionSettings, stated: VisionSettings, frames: Sequence[Image], info: SessionInfo,
    traced: ResolvedVision | None, *, whole: bool,
) -> ResolvedVision | None:  # fmt: skip
    """Finds the catheter in the images of one session by the networks.

    Args:
        settings: settings of the detection.
        stated: ``settings`` with the session metadata of the view.
        frames: images of the session.
        info: metadata of the session.
        traced: settings that the tracer found; kept where tracer and networks find the same line. None: it found none.
        whole: whether the images are from all parts of the session, so that the catheter must have moved in some.

    Returns:
        The settings with the base in px and the length in px that the networks found; None where too few images have a
        probable line, or the line does not move.
    """
    nominal = nominal_px(info, stated.view)
    if nominal is None or len(frames) < MIN_FRAMES:
        return None
    length_px, diameter_px = nominal
    sides = SIDES if stated.base_side == "auto" else (stated.base_side,)
    best: tuple[float, BaseSide, list[Located | None], FloatArray, float] | None = None
    for side in sides:
        located = [locate(frame, side, length_px, diameter_px, settings.points) for frame in frames]
        lines = [line if line is not None and _fits(line, nominal, stated) else None for line in located]
        found = [line for line in lines if line is not None]
        if len(found) < MIN_FRAMES:
            continue
        base, length = consensus(found)
        expected_right = sum(probability(signs(line, length)) for line in found)
        if best is None or expected_right > best[0]:
            best = (expected_right, side, lines, base, length)
    least = settings.least_probability
    if best is None:
        return None
    _, side, lines, base, length = best
    probable = [line if line is not None and probability(signs(line, length)) >= least else None for line in lines]
    kept = [line for line in probable if line is not None]
    if len(kept) < max(MIN_FRAMES, _SHARE * len(frames)):
        return None
    if whole and stands_still(np.array([line.points for line in kept]), frames):
        return None
    agrees = traced is not None and _agrees(Tracer(traced), frames, probable, diameter_px)
    prior = KeypointPrior(
        session=info.name,
        base_px=(round(float(base[0]), 2), round(float(base[1]), 2)),
        length_px=round(length, 2),
        alone=not agrees,
    )
    if traced is not None and agrees:
        return traced.model_copy(update={"keypoints": prior, "nominal_px": nominal})
    dark = sum(line.darker for line in kept) * 2 > len(kept)
    polarity = stated.polarity if stated.polarity != "auto" else "dark" if dark else "light"
    resolved = ResolvedVision.stated(stated.model_copy(update={"base_side": side, "polarity": polarity}))
    return resolved.model_copy(
        update={
            "settings": settings,
            "nominal_px": nominal,
            "length_px": prior.length_px,
            "diameter_px": diameter_px,
            "least_probability": least,
            "keypoints": prior,
        }
    )


def _agrees(tracer: Tracer, frames: Sequence[Image], lines: Sequence[Located | None], diameter_px: float) -> bool:
    """Whether ``tracer`` finds the same shaft as the networks, in most images in which both find one."""
    both = [
        _same(shape.centreline.points, line.points, diameter_px)
        for frame, line in zip(frames, lines, strict=True)
        if line is not None and (shape := tracer.detect(frame)).centreline is not None
    ]
    return len(both) < MIN_FRAMES or 2 * sum(both) > len(both)


def _same(one: FloatArray, other: FloatArray, diameter_px: float) -> bool:
    """Whether both lines (n, 2) are of the same shaft and end at the same tip."""
    apart = np.linalg.norm(one[:, None] - other[None], axis=-1).min(axis=1)
    tips = float(np.linalg.norm(one[-1] - other[-1]))
    return (
        float(np.median(apart)) < MAX_LINE_DIAMETERS * diameter_px + 1.0
        and tips < MAX_TIP_DIAMETERS * diameter_px + 3.0
    )


class KeypointDetector:
    """Detects the catheter in one image after another of the session whose prior ``vision`` holds.

    Holds no memory of earlier images. Unless the prior says that the networks are alone, the tracer is asked first:
    they take its place in images that it refuses.
    """

    def __init__(self, vision: ResolvedVision) -> None:
        assert vision.keypoints is not None
        assert vision.nominal_px is not None
        self.settings = vision
        self._prior, self._nominal = vision.keypoints, vision.nominal_px
        self._base = np.array(vision.keypoints.base_px)
        self._tracer = None if vision.keypoints.alone else Tracer(vision)

    def detect(self, image: Image) -> DetectedShape:
        """Returns the catheter in ``image`` (h, w) or (h, w, 3) RGB, uint8; or the reason why it was not found."""
        traced = None
        if self._tracer is not None:
            traced = self._tracer.detect(image)
            if traced.found:
                return traced
        found = self._locate(image)
        return found if found.found or traced is None else traced

    def _locate(self, image: Image) -> DetectedShape:
        vision, diameter_px = self.settings, self._nominal[1]
        if vision.refused:
            return DetectedShape(Status.NO_CATHETER, vision.refused)
        line = locate(image, vision.base_side, self._nominal[0], diameter_px, vision.points)
        if line is None or not _within(line.points, vision.roi, diameter_px):
            return DetectedShape(Status.NO_CATHETER, "neither the tracer nor the networks see the catheter")
        begins = line.points[0]
        if float(np.linalg.norm(begins - self._base)) > MAX_BASE_DIAMETERS * diameter_px:
            return DetectedShape(
                Status.NO_CATHETER,
                f"the detected line begins at ({begins[0]:.0f}, {begins[1]:.0f}), the catheter of this session at "
                f"({self._base[0]:.0f}, {self._base[1]:.0f})",
            )
        right = probability(signs(line, self._prior.length_px))
        end = line.points[-1]
        if right < vision.settings.least_probability:
            return DetectedShape(
                Status.CUT_OFF,
                f"the line to ({end[0]:.0f}, {end[1]:.0f}) is the catheter with a probability of {right:.0%} only",
            )
        way = -3.0 * begins + 4.0 * line.points[2] - line.points[4]
        return DetectedShape(
            Status.VALID,
            "",
            CentrelinePx(line.points),
            BasePose(begins, math.atan2(-way[1], way[0])),
            diameter_px,
            line.clear,
            probability_right=right,
        )
