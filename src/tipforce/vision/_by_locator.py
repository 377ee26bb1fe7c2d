"""Detection by the locator in one image after another of a session whose constants are known."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from .._system.json_files import read_json
from ..errors import FileFormatError, InputError
from ..geometry import tangents_and_normals
from ..types import BasePose, Box, CentrelinePx, DetectedShape, FloatArray, Image, SessionInfo, Status
from ._session_size import stated_size_px
from ._settings import ResolvedVision, VisionSettings, usual_tip_std_px
from .locator import (
    DETECTOR_FACTS,
    DETECTOR_GRAPHS,
    MARKED_LOG_ODDS,
    XRAY_DETECTOR,
    Known,
    Located,
    Prompts,
    locate,
    probability,
)
from .tracer import Tracer

MAX_BASE_DIAMETERS = 2.0
"""A line begins within this number of diameters of the session's base."""
BASE_STD_DIAMETERS, MIN_BASE_STD_PX = 0.15, 1.5
"""Standard error of the session's base."""
MAX_LINE_DIAMETERS, MAX_TIP_DIAMETERS = 0.35, 1.0
"""Two lines, or tips, of the same shaft are at most this number of diameters apart."""
MAX_OUTSIDE_DIAMETERS = 0.5
"""A line may leave ``roi``, or begin beside ``base_region``, by this number of diameters."""
MIN_UNCLEAR_PROBABILITY = 0.5
"""A line that is less likely the catheter than not is no catheter; a likelier one that is refused is unclear."""
MIN_TIP_SEEN = 0.5
"""With less probability that it is visible a tip is hidden."""


def detector_folder(detector: str | None, *, xray: bool) -> Path | None:
    """Returns the folder of a detector; None for the networks that come with tipforce for camera images.

    Args:
        detector: folder of the fine-tuned detector; None: the detector that comes with tipforce.
        xray: whether the images are X-ray images.

    Raises:
        InputError: one of its files does not exist.
    """
    if detector is None:
        return XRAY_DETECTOR if xray else None
    for name in (*DETECTOR_GRAPHS, DETECTOR_FACTS):
        path = Path(detector) / name
        if not path.is_file():
            raise InputError(
                f"{path}: does not exist; correct views.VIEW.detector in bench.toml, or run tipforce annotate"
            )
    return Path(detector)


def detector_log_odds(folder: Path | None, *, marked: bool) -> float:
    """Returns the ``log_odds`` of the lines of a detector, with or without a mark; see `probability`.

    Args:
        folder: folder of the detector; None or `XRAY_DETECTOR`: one that comes with tipforce.
        marked: whether a user has marked the base.

    Raises:
        FileFormatError: its facts cannot be read.
    """
    own = MARKED_LOG_ODDS if marked else 0.0
    if folder in (None, XRAY_DETECTOR):
        return own
    facts = read_json(folder / DETECTOR_FACTS)
    found = facts.get("log_odds") if isinstance(facts, dict) else None
    if not isinstance(found, int | float):
        raise FileFormatError(f"{folder / DETECTOR_FACTS}: has no number log_odds; run tipforce annotate again")
    return own + float(found)


def session_prompts(stated: VisionSettings, info: SessionInfo) -> tuple[Prompts, Path | None]:
    """Returns the prompts that settings and metadata of a session state, and the folder of its detector.

    Args:
        stated: the settings, with the facts of the view.
        info: the session metadata.

    Raises:
        InputError: see `detector_folder`.
    """
    xray = info.view(stated.view).modality == "xray"
    prompts = replace(stated_prompts(stated, stated_size_px(info, stated.view)), xray=xray)
    return prompts, detector_folder(stated.detector, xray=xray)


def stated_prompts(stated: VisionSettings, size_px: tuple[float | None, float | None] = (None, None)) -> Prompts:
    """Returns the prompts that settings state; ``size_px``: length and diameter of the catheter, None if unknown."""
    length_px, diameter_px = size_px
    return Prompts(
        region=stated.base_region,
        border=None if stated.base_side == "auto" or stated.base_region is not None else stated.base_side,
        length_px=stated.length_px or length_px,
        diameter_px=stated.diameter_px or diameter_px,
    )


def same_line(one: FloatArray, other: FloatArray, diameter_px: float) -> bool:
    """Whether both lines (n, 2) are of the same shaft and end at the same tip."""
    apart = np.linalg.norm(one[:, None] - other[None], axis=-1).min(axis=1)
    tips = float(np.linalg.norm(one[-1] - other[-1]))
    return (
        float(np.median(apart)) < MAX_LINE_DIAMETERS * diameter_px + 1.0
        and tips < MAX_TIP_DIAMETERS * diameter_px + 3.0
    )


def _within(points: FloatArray, box: Box | None, diameter_px: float) -> bool:
    """Whether all ``points`` (n, 2) are in ``box``, or at most `MAX_OUTSIDE_DIAMETERS` outside it."""
    if box is None:
        return True
    margin = MAX_OUTSIDE_DIAMETERS * diameter_px
    return bool(((points >= np.array(box[:2]) - margin) & (points <= np.array(box[2:]) + margin)).all())


class LocatorDetector:
    """Detects the catheter in one image after another of the session whose constants ``vision`` holds.

    Holds no memory of earlier images. Where the session's prior says so, the tracer is asked first: the locator takes
    its place in images that it refuses.
    """

    def __init__(self, vision: ResolvedVision) -> None:
        assert vision.locator is not None
        self.settings, self._prior = vision, vision.locator
        self._base = np.array(vision.locator.base_px)
        self._tracer = Tracer(vision) if vision.locator.tracer else None
        self._prompts = replace(
            stated_prompts(vision.settings),
            base_px=self._base,
            length_px=vision.locator.length_px,
            diameter_px=vision.locator.diameter_px,
            xray=vision.locator.xray,
        )
        self._detector = detector_folder(vision.detector, xray=vision.locator.xray)
        self._known = Known(
            vision.locator.length_px,
            vision.locator.length_std_px,
            self._base if vision.locator.base_in_view else None,
            max(BASE_STD_DIAMETERS * vision.locator.diameter_px, MIN_BASE_STD_PX),
            vision.locator.base_in_view,
        )

    def detect(self, image: Image) -> DetectedShape:
        """Returns the catheter in ``image`` (h, w) or (h, w, 3) RGB, uint8; or the reason why it was not found."""
        if self.settings.refused:
            return DetectedShape(Status.NO_CATHETER, self.settings.refused)
        if self._tracer is not None:
            traced = self._tracer.detect(image)
            if traced.found:
                return traced
        return self._locate(image)

    def locate(self, image: Image) -> Located | None:
        """Returns the line that the locator finds in ``image`` with the session's constants as prompts."""
        return locate(image, self._prompts, self.settings.points, self._known, self._detector)

    def _locate(self, image: Image) -> DetectedShape:
        vision, prior = self.settings, self._prior
        line = self.locate(image)
        if line is None or not line.is_there or not _within(line.points, vision.roi, prior.diameter_px):
            return DetectedShape(Status.NO_CATHETER, "the locator finds no catheter")
        begins, end = line.points[0], line.points[-1]
        if float(np.linalg.norm(begins - self._base)) > MAX_BASE_DIAMETERS * prior.diameter_px:
            return DetectedShape(
                Status.NO_CATHETER,
                f"the detected line begins at ({begins[0]:.0f}, {begins[1]:.0f}), the catheter of this session at "
                f"({self._base[0]:.0f}, {self._base[1]:.0f})",
            )
        right = probability(line, prior.log_odds)
        least = vision.least_probability if vision.nominal_px else vision.settings.least_probability
        if right < least:
            return DetectedShape(
                Status.CUT_OFF if right > MIN_UNCLEAR_PROBABILITY else Status.NO_CATHETER,
                f"the line to ({end[0]:.0f}, {end[1]:.0f}) is the catheter with a probability of {right:.0%} only",
            )
        hidden = line.tip_seen < MIN_TIP_SEEN
        shape = DetectedShape(
            Status.VALID,
            "the tip is hidden: it is placed by the session's length" if hidden else "",
            CentrelinePx(line.points),
            BasePose(begins, -line.heading_rad),
            line.diameter_px,
            float(line.seen.mean()),
            probability_right=right,
            seen=line.seen,
            covariance_px2=covariance(line),
        )
        limit = vision.settings.max_tip_std_px or usual_tip_std_px(prior.diameter_px)
        if shape.tip_std_px > limit:
            return DetectedShape(
                Status.CUT_OFF,
                f"the tip near ({end[0]:.0f}, {end[1]:.0f}) is {'hidden' if hidden else 'unclear'}: its position is "
                f"known to {shape.tip_std_px:.1f} px only (max_tip_std_px = {limit:g})",
            )
        return shape


def covariance(line: Located) -> FloatArray:
    """Returns (n, 2, 2) px^2: the covariance of each point, across the line and along it.

    Along the line the error grows from the base to the tip, whose error is that of the length.
    """
    tangent, normal = tangents_and_normals(line.points)
    along = np.linspace(0.0, 1.0, len(tangent)) * line.length_std_px
    return (
        line.std_px[:, None, None] ** 2 * normal[:, :, None] * normal[:, None, :]
        + along[:, None, None] ** 2 * tangent[:, :, None] * tangent[:, None, :]
    )
