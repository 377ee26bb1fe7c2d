"""Looking through the images of a file: is the catheter found, and in how many frames."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..datasets import file_names
from ..errors import InputError
from ..io import RecordingReader, frame_count, images_beforehand, open_source, read_image
from ..types import Frame, Image, SessionInfo, Source
from ..vision import (
    ClassicDetector,
    Inspection,
    ResolvedVision,
    SessionDetector,
    ShapeFeatureSettings,
    Tally,
    VisionSettings,
    figure_17,
    figure_18,
    inspect_image,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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
    seen: Inspection = inspect_image(image, detector.detect, resolved, features)
    figures = {"file": str(path), **seen.figures(), "vision": resolved.model_dump()}
    return InspectionResult(
        f"{_settings_line(resolved, vision)}\n{seen.text()}", figures, seen.drawing, image, resolved
    )


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
        total, names = frame_count(source, vision.view), file_names(source, vision.view)
        detector = SessionDetector(vision, source.session_info, images_beforehand(source, vision.view))
        for count, frame in enumerate(_frames(source, vision.view)):
            first = frame if first is None else first
            if count % every == 0:
                seconds, name = (frame.stamp_ns - first.stamp_ns) * 1e-9, names.get(frame.stamp_ns, "")
                title = name or f"{count}  {seconds:.2f} s"
                tally.add(title, inspect_image(frame.image, detector.detect, detector.vision, features), name)
            if progress:
                progress(f"frame {count}", min(1.0, count / total) if total else 0.0)
    if first is None:
        raise InputError(f"{path}: there is no frame of the view {vision.view!r} in it{_views_in(path)}")
    resolved = detector.vision
    figures = {"file": str(path), "every": every, **tally.figures(), "vision": resolved.model_dump()}
    return InspectionResult(
        f"{_settings_line(resolved, vision)}\n{tally.text()}", figures, tally.contact_sheet(), first.image, resolved
    )


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


def _views_in(path: Path) -> str:
    if path.suffix != ".mcap":
        return ""
    with RecordingReader(path) as reader:
        views = reader.views
    return f"; there is {', '.join(views)}: set vision.view={views[0]}" if views else ""


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
