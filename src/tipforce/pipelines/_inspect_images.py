"""Looking through the images of a file: is the catheter found, and in how many frames."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from ..datasets import file_names
from ..errors import InputError
from ..io import frame_count, images_beforehand, open_source, read_image
from ..types import DetectedShape, Frame, Image, SessionInfo, Source, views_of
from ..vision import (
    Candidate,
    ClassicDetector,
    Inspection,
    ResolvedVision,
    SessionDetector,
    ShapeFeatureSettings,
    Tally,
    VisionSettings,
    advise,
    detector_kind,
    draw_objects,
    figure_17,
    figure_18,
    inspect_image,
    likely_objects,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MIN_FOUND_SHARE = 0.5
"""If the catheter is found in a smaller share of the images, the objects that could be it are drawn."""
MIN_RIVAL_PROBABILITY = 0.3
"""Another object with a larger probability could be the catheter too."""
OBJECTS_WIDTH_PX = 960
"""Width of the drawing of the objects above a contact sheet, at most."""
_MARGIN_PX = 4
"""Margin of that drawing."""


@dataclass(frozen=True, slots=True, eq=False)
class InspectionResult:
    """Findings in a file.

    Attributes:
        text: findings for people.
        figures: the same as JSON values.
        drawing: (h, w, 3) drawing of the detection, or a contact sheet.
        image: one image of the file.
        vision: settings of the detection, resolved for the session.
    """

    text: str
    figures: dict[str, Any]
    drawing: Image
    image: Image
    vision: VisionSettings | ResolvedVision

    def thesis_figures(self) -> "dict[str, Figure]":
        """Returns thesis figures 17 and 18 of ``image``: the steps of thesis algorithm 1."""
        steps = ClassicDetector(self.vision).steps(self.image)
        return {"figure17": figure_17(steps), "figure18": figure_18(steps)}


def inspect_image_file(
    path: Path, vision: VisionSettings, features: ShapeFeatureSettings, info: SessionInfo | None = None
) -> InspectionResult:
    """Inspects one image file in detail.

    Args:
        path: the image file.
        vision: settings of the detection.
        features: settings of the shape features.
        info: metadata of the session.

    Returns:
        The findings as text, figures and drawing.

    Raises:
        FileFormatError: the file is no image.
    """
    image = read_image(path)
    detector = SessionDetector(vision, info or SessionInfo(), [image])
    resolved = detector.vision
    inspection: Inspection = inspect_image(image, detector.detect, resolved, features)
    figures = {"file": str(path), **inspection.figures(), "vision": resolved.model_dump()}
    text = f"{_settings_line(resolved, vision)}\n{inspection.text()}"
    result = InspectionResult(text, figures, inspection.drawing, image, resolved)
    objects = _objects(detector, vision, [image], info or SessionInfo(), [inspection.shape], path.parent)
    return result if objects is None else objects.added_to(result, alone=True)


def inspect_frames(
    path: Path,
    vision: VisionSettings,
    features: ShapeFeatureSettings,
    *,
    stated: SessionInfo | None = None,
    every: int = 1,
    room: int = 12,
    progress: Callable[[str, float], None] | None = None,
) -> InspectionResult:
    """Inspects frames of a video, a folder or a recording, and draws some of them on one contact sheet.

    Args:
        path: the file or folder.
        vision: settings of the detection.
        features: settings of the shape features.
        stated: metadata that replace those of the file.
        every: every n-th frame is inspected.
        room: largest number of frames on the sheet.
        progress: called with the current frame and the finished share.

    Returns:
        The findings as text, figures and contact sheet.

    Raises:
        InputError: there is no frame.
    """
    tally, first = Tally(room), None
    with open_source(path, stated=stated) as source:
        vision = vision.for_views(views_of(source), path)
        total, names = frame_count(source, vision.view), file_names(source, vision.view)
        info, images = source.session_info, images_beforehand(source, vision.view)
        detector = SessionDetector(vision, info, images)
        for count, frame in enumerate(_frames(source, vision.view)):
            first = frame if first is None else first
            if count % every == 0:
                seconds, name = (frame.stamp_ns - first.stamp_ns) * 1e-9, names.get(frame.stamp_ns, "")
                title = name or f"{count}  {seconds:.2f} s"
                tally.add(title, inspect_image(frame.image, detector.detect, detector.vision, features), name)
            if progress:
                progress(f"frame {count}", min(1.0, count / total) if total else 0.0)
    if first is None:
        raise InputError(f"{path}: there is no frame of the view {vision.view!r} in it")
    resolved = detector.vision
    figures = {"file": str(path), "every": every, **tally.figures(), "vision": resolved.model_dump()}
    result = InspectionResult(
        f"{_settings_line(resolved, vision)}\n{tally.text()}", figures, tally.contact_sheet(), first.image, resolved
    )
    # the objects that could be the catheter, on the images that resolved the detection
    images = images or [first.image]
    shapes = [detector.detect(image) for image in images]
    objects = _objects(detector, vision, images, info, shapes, path)
    return result if objects is None else objects.added_to(result)


def inspect_sessions(
    sessions: Iterable[tuple[SessionInfo, Sequence[Image], Sequence[tuple[str, Image]]]],
    vision: VisionSettings,
    features: ShapeFeatureSettings,
    *,
    title: str,
    room: int = 12,
    progress: Callable[[str, float], None] | None = None,
    total: int = 0,
) -> InspectionResult:
    """Inspects images of several sessions, and draws some of them on one contact sheet.

    Args:
        sessions: metadata of each session, the images that resolve its detection, and its images by name.
        vision: settings of the detection.
        features: settings of the shape features.
        title: name of the data, for the message.
        room: largest number of images on the sheet.
        progress: called with the current image and the finished share.
        total: number of all images, for ``progress``.

    Returns:
        The findings as text, figures and contact sheet.

    Raises:
        InputError: there is no image.
    """
    tally, first = Tally(room), None
    resolved: VisionSettings | ResolvedVision = vision
    for info, beforehand, session in sessions:
        if not session:
            continue
        detector = SessionDetector(vision, info, beforehand)
        resolved = detector.vision
        for name, image in session:
            first = image if first is None else first
            tally.add(Path(name).stem, inspect_image(image, detector.detect, resolved, features), name)
            if progress:
                progress(f"image {tally.frames}", min(1.0, tally.frames / max(1, total)))
    if first is None:
        raise InputError(f"{title}: there is no image of the view {vision.view!r} in it")
    return InspectionResult(tally.text(), tally.figures(), tally.contact_sheet(), first, resolved)


@dataclass(frozen=True, slots=True, eq=False)
class _Objects:
    """Numbered objects that could be the catheter.

    Attributes:
        candidates: the objects.
        image: the image in which their lines are.
        title: title of the drawing.
        advice: the fact that would help most.
        unnamed: the same as in the messages of the detection, which do not know the path of the images.
    """

    candidates: Sequence[Candidate]
    image: Image
    title: str
    advice: str
    unnamed: str

    def added_to(self, result: InspectionResult, *, alone: bool = False) -> InspectionResult:
        """Adds these objects to the findings of an inspection.

        Args:
            result: the findings.
            alone: True: the drawing of the objects replaces that of the detection; False: it is put above it.

        Returns:
            The findings with a line and values for each object, and the advice.
        """
        text = result.text.replace(self.unnamed, self.advice)
        for number, candidate in enumerate(self.candidates, start=1):
            u, v = candidate.points[0]
            text += (
                f"\nobject {number}   begins at ({u:.0f}, {v:.0f}), {candidate.length_px:.0f} px long, "
                f"{candidate.diameter_px:.1f} px thick, the catheter with a probability of {candidate.probability:.0%}"
            )
        if self.advice not in text:
            text += f"\nadvice     {self.advice}"
        figures = {
            **result.figures,
            "objects": [
                {
                    "base_px": candidate.points[0].tolist(),
                    "tip_px": candidate.points[-1].tolist(),
                    "length_px": candidate.length_px,
                    "diameter_px": candidate.diameter_px,
                    "probability": candidate.probability,
                    "base_region": list(candidate.region),
                }
                for candidate in self.candidates
            ],
            "advice": self.advice,
        }
        drawing = draw_objects(self.image, self.candidates, self.title, self.advice)
        return replace(
            result, text=text, figures=figures, drawing=drawing if alone else _above(drawing, result.drawing)
        )


def _objects(
    detector: SessionDetector, vision: VisionSettings, images: Sequence[Image], info: SessionInfo,
    shapes: Sequence[DetectedShape], path: Path,
) -> _Objects | None:  # fmt: skip
    """Returns the objects that could be the catheter, where it is not found or is not the only one; else None.

    Args:
        detector: the detector of the session.
        vision: the settings of the user.
        images: images of the session.
        info: its metadata.
        shapes: the shape in each of ``images``.
        path: name of the images.
    """
    if not detector_kind(vision.method).by_session:
        return None
    if sum(shape.found for shape in shapes) < MIN_FOUND_SHARE * len(shapes):
        advice = detector.advice or advise(vision, images, info)
        return _Objects(
            advice.candidates, advice.image, "NOT FOUND: objects that could be the catheter",
            advice.text(str(path)), advice.text(),
        )  # fmt: skip
    image, shape = next((image, shape) for image, shape in zip(images, shapes, strict=True) if shape.found)
    assert shape.centreline is not None
    objects = likely_objects(vision, [image], info)
    rivals = [
        (number, candidate)
        for number, candidate in enumerate(objects, start=1)
        if candidate.probability > MIN_RIVAL_PROBABILITY and not candidate.is_on(shape.centreline.points)
    ]
    if not rivals:
        return None
    number, rival = rivals[0]
    advice = (
        f"another object could be the catheter: if it is object {number}, state "
        f"views.{vision.view}.base_region = {list(rival.region)}"
    )
    return _Objects(objects, image, "TWO OBJECTS could be the catheter", advice, advice)


def _above(drawing: Image, sheet: Image) -> Image:
    """Returns ``drawing``, made smaller if it is too wide, above the contact sheet ``sheet``, on its ground colour."""
    scale = min(1.0, OBJECTS_WIDTH_PX / drawing.shape[1])
    small = cv2.resize(drawing, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    height, width = small.shape[:2]
    ground = sheet[0, 0]
    both = np.full(
        (_MARGIN_PX + height + sheet.shape[0], max(width + 2 * _MARGIN_PX, sheet.shape[1]), 3), ground, np.uint8
    )
    both[_MARGIN_PX : _MARGIN_PX + height, _MARGIN_PX : _MARGIN_PX + width] = small
    both[_MARGIN_PX + height :, : sheet.shape[1]] = sheet
    return both


def _frames(source: Source, view: str) -> Iterator[Frame]:
    return (event for event in source if isinstance(event, Frame) and event.view == view)


def _as_stated(given: VisionSettings) -> ResolvedVision | None:
    return None if "auto" in (given.polarity, given.base_side) else ResolvedVision.stated(given)


def _settings_line(resolved: VisionSettings | ResolvedVision, given: VisionSettings) -> str:
    """Returns one line that shows the vision settings in use, with advice where they were found automatically."""
    threshold = "automatic" if resolved.threshold is None else str(resolved.threshold)
    text = (
        f"settings   {resolved.method}, catheter {resolved.polarity}, base {resolved.base_side}, threshold {threshold}"
    )
    if not isinstance(resolved, ResolvedVision) or resolved == _as_stated(given) or given.base_region is not None:
        return text
    return (
        f"{text}: found automatically; where the drawing shows another thing, state polarity and base_side of the view "
        "in bench.toml, and base_region, a box across the shaft, where it does not reach the border"
    )
