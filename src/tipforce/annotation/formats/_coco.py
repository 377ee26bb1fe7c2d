"""COCO keypoints: ``images`` with id, file name and size; ``annotations`` with keypoints [u, v, visibility, ...]."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from ...errors import FileFormatError
from .._spline import curve_through
from .._store import MAX_PIXEL, MarkedFrame
from ._cells import marked_points
from ._tables import Marks

NOT_LABELLED, NOT_VISIBLE, VISIBLE = 0, 1, 2
"""Values of a keypoint's visibility."""
KEYPOINTS = 16
"""Keypoints of a line that is written."""
NO_CATHETER = "no_catheter"
"""Our addition to an image: true where a person has seen that no catheter is in it."""


def read_coco(path: Path, values: Any) -> Marks:
    """Reads COCO keypoints; their order is from base to tip.

    A last keypoint that is labelled but not visible (1) is a hidden tip. Keypoints that are not labelled (0) are
    passed over.

    Args:
        path: the file, for messages.
        values: its JSON.

    Returns:
        The frames.

    Raises:
        FileFormatError: the JSON has another form, or an image has two annotations.
    """
    if not (isinstance(values, dict) and {"images", "annotations"} <= values.keys()):
        _fail(path, "expected an object with images and annotations (COCO keypoints)")
    names: dict[Any, str] = {}
    marks = Marks([])
    for k, image in enumerate(_objects(path, values, "images")):
        if not isinstance(image.get("file_name"), str) or not isinstance(image.get("id"), int | str):
            _fail(path, f"images[{k}] has no id or no file_name")
        name = names[image["id"]] = image["file_name"]
        width, height = image.get("width"), image.get("height")
        if isinstance(width, int) and isinstance(height, int):
            marks.sizes_px[name] = (width, height)
        if image.get(NO_CATHETER) is True:
            marks.frames.append(MarkedFrame(name, np.empty((0, 2)), present=False, done=True))
    annotated: set[str] = set()
    for k, annotation in enumerate(_objects(path, values, "annotations")):
        name = names.get(annotation.get("image_id"))
        if name is None:
            _fail(path, f"annotations[{k}] has image_id {annotation.get('image_id')!r}, which no image has")
        points, visible = _keypoints(path, annotation.get("keypoints"), f"annotations[{k}] ({name})")
        if not any(points):
            continue
        if name in annotated:
            _fail(path, f"annotations[{k}]: {name} is annotated twice; keep the annotation of the catheter only")
        annotated.add(name)
        line, reason = marked_points(points)
        if line is None or len(line) < 2:
            marks.left_out[name] = reason or "only one point is marked"
        else:
            marks.frames.append(MarkedFrame(name, line, visible[-1] == NOT_VISIBLE, done=True))
    return marks


def coco_values(frames: Sequence[MarkedFrame], sizes_px: Mapping[str, tuple[int, int]]) -> dict[str, Any]:
    """Returns frames as COCO keypoints: `KEYPOINTS` points of each line, uniform in arc length.

    Args:
        frames: the finished frames.
        sizes_px: name of each image -> its width and height.

    Returns:
        The JSON values.
    """
    between = [f"point_{k}" for k in range(1, KEYPOINTS - 1)]
    skeleton = [[k, k + 1] for k in range(1, KEYPOINTS)]
    category = {"id": 1, "name": "catheter", "supercategory": "device", "keypoints": ["base", *between, "tip"]}
    images: list[dict[str, Any]] = []
    annotations: list[dict[str, Any]] = []
    for number, frame in enumerate(frames, 1):
        width, height = sizes_px[frame.image]
        image = {"id": number, "file_name": frame.image, "width": width, "height": height}
        images.append(image if frame.present else {**image, NO_CATHETER: True})
        if not frame.present:
            continue
        line = np.round(curve_through(frame.points_px, KEYPOINTS), 3)
        visible = np.full(KEYPOINTS, VISIBLE)
        if frame.tip_hidden:
            visible[-1] = NOT_VISIBLE
        low, size = line.min(axis=0), np.ptp(line, axis=0)
        annotations.append(
            {
                "id": len(annotations) + 1,
                "image_id": number,
                "category_id": 1,
                "iscrowd": 0,
                "bbox": [*low.tolist(), *size.tolist()],
                "area": float(np.prod(size)),
                "num_keypoints": KEYPOINTS,
                "keypoints": [
                    value
                    for (u, v), visibility in zip(line.tolist(), visible.tolist(), strict=True)
                    for value in (u, v, visibility)
                ],
            }
        )
    return {"images": images, "annotations": annotations, "categories": [{**category, "skeleton": skeleton}]}


def _objects(path: Path, values: Mapping[str, Any], key: str) -> list[dict[str, Any]]:
    listed = values[key]
    if not isinstance(listed, list) or not all(isinstance(each, dict) for each in listed):
        _fail(path, f"{key} is no list of objects")
    return listed


def _keypoints(path: Path, values: Any, place: str) -> tuple[list[tuple[float, float] | None], list[int]]:
    """Returns the keypoints of an annotation, and their visibility.

    Args:
        path: the file, for messages.
        values: the JSON of the keypoints: u, v and visibility of each, in one list.
        place: position of the annotation in the file, for messages.

    Returns:
        The points (u, v) in px, None where a point is not labelled; and all visibilities (0, 1 or 2).
    """
    if not isinstance(values, list) or len(values) < 6 or len(values) % 3:
        _fail(path, f"{place}: expected at least two keypoints [u, v, visibility, ...]")
    if not all(isinstance(each, int | float) and abs(each) <= MAX_PIXEL for each in values):  # not a number: false
        _fail(path, f"{place}: keypoints hold a value that is no number, or larger than {MAX_PIXEL:g}")
    visible = [int(each) for each in values[2::3]]
    if not set(visible) <= {NOT_LABELLED, NOT_VISIBLE, VISIBLE}:
        _fail(path, f"{place}: a visibility is not 0, 1 or 2")
    points = zip(values[::3], values[1::3], visible, strict=True)
    return [(float(u), float(v)) if visibility else None for u, v, visibility in points], visible


def _fail(path: Path, found: str) -> NoReturn:
    raise FileFormatError(f"{path}: {found}; export the annotations as COCO keypoints again")
