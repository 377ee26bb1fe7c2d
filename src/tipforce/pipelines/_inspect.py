"""Shows the content of a file, and the catheter that is detected in its images."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..datasets import dataset_at, describe_dataset, session_images
from ..io import is_image
from ..types import SessionInfo, views_text
from ..vision import InspectSettings
from ._estimate import session_info_from
from ._inspect_images import InspectionResult, inspect_frames, inspect_image_file, inspect_sessions


def inspect(
    path: str | Path,
    *,
    settings: InspectSettings | Mapping[str, Any] | None = None,
    bench: SessionInfo | str | Path | None = None,
    every: int = 1,
    drawn: int = 12,
    progress: Callable[[str, float], None] | None = None,
) -> InspectionResult:
    """Detects the catheter in the images of a file and draws it.

    Args:
        path: an image, video, DICOM file, folder of images, recording or dataset.
        settings: settings of the detection and of the curve that is fitted to the shape.
        bench: metadata in place of those in the file.
        every: examine every n-th of several images.
        drawn: number of images that are drawn.
        progress: called with the current step and the share that is done.

    Returns:
        The findings in words and figures, and a drawing (h, w, 3) RGB.

    Raises:
        InputError: the file cannot be read or holds no images.
    """
    path, stated = Path(path), session_info_from(bench)
    chosen = InspectSettings.model_validate(settings or {})
    vision, features = chosen.vision, chosen.features
    dataset = dataset_at(path)
    if dataset is not None:
        vision = vision.for_views(dataset.views, path)
        lines, facts = describe_dataset(dataset)
        shared = replace(stated, name="")
        shown = (
            (info.updated(shared), beforehand, images)
            for info, beforehand, images in session_images(dataset, vision.view, every)
        )
        result = inspect_sessions(
            shown, vision, features, title=str(path), room=drawn, progress=progress, total=-(-len(dataset) // every)
        )
        if len(dataset.views) > 1:
            lines.append(f"{views_text([vision.view])} of {', '.join(dataset.views)}")
        return replace(
            result, text="\n".join([*lines, result.text]), figures={"file": str(path), **facts, **result.figures}
        )
    if is_image(path):
        return inspect_image_file(path, vision, features, stated)
    return inspect_frames(path, vision, features, stated=stated, every=every, room=drawn, progress=progress)
