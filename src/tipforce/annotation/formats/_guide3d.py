"""Guide3D: lists of tasks with frames of the cameras A and B, each an image and points or a B-spline; 1,024 px."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from scipy.interpolate import BSpline

from ...errors import FileFormatError
from ...types import FloatArray
from .._store import MAX_PIXEL, MarkedFrame
from ._tables import Marks

SIDE_PX = 1024
"""Width and height of the images of the data set."""
SPLINE_POINTS = 24
"""Points at which a spline is read."""
CAMERAS = ("cameraA", "cameraB")


def read_guide3d(path: Path, values: list[Any]) -> Marks:
    """Reads annotations of Guide3D: its points (raw.json), or its splines (b_spline.json).

    Neither states the direction of a line: it begins at the end that is nearer to the border of the image.

    Args:
        path: the file, for messages.
        values: its JSON: a list of tasks.

    Returns:
        The frames of both cameras; an image has the name of its folder and its file.

    Raises:
        FileFormatError: the JSON has another form, or an image is annotated twice.
    """
    marks = Marks([])
    for number, task in enumerate(values):
        frames = task.get("frames") if isinstance(task, dict) else None
        if not isinstance(frames, list):
            _fail(path, f"task {number} has no list of frames")
        for k, frame in enumerate(frames):
            for camera in CAMERAS:
                place = f"task {number}, frame {k}, {camera}"
                marked = frame.get(camera) if isinstance(frame, dict) else None
                if not isinstance(marked, dict) or not isinstance(name := marked.get("image"), str):
                    _fail(path, f"{place}: there is no image")
                if name in marks.sizes_px:
                    _fail(path, f"{place}: {name} is annotated twice")
                marks.sizes_px[name] = (SIDE_PX, SIDE_PX)
                points = _line(path, place, marked)
                if _to_border(points[-1]) < _to_border(points[0]):
                    points = points[::-1]
                marks.frames.append(MarkedFrame(name, np.ascontiguousarray(points), done=True))
    return marks


def _line(path: Path, place: str, camera: Mapping[str, Any]) -> FloatArray:
    """Returns the points (k, 2) in px of the line of one camera: as they are stated, or on the stated B-spline.

    Args:
        path: the file, for messages.
        place: task, frame and camera, for messages.
        camera: JSON with ``points``, or with ``tck``: knots t, coefficients c (n, 2) or (2, n), degree k.
    """
    if "points" in camera:
        return _array(path, f"{place}: points", camera["points"], columns=2)
    spline = camera.get("tck")
    if not isinstance(spline, dict) or not isinstance(spline.get("k"), int) or not 1 <= spline["k"] <= 5:
        _fail(path, f"{place}: expected points, or a spline tck with t, c and k")
    degree, knots = spline["k"], _array(path, f"{place}: t", spline.get("t"))
    weights = _array(path, f"{place}: c", spline.get("c"), columns=None)
    count = len(knots) - degree - 1
    weights = weights.T if weights.shape == (2, count) else weights
    if weights.shape != (count, 2) or count <= degree or (np.diff(knots) < 0).any() or knots[degree] >= knots[count]:
        _fail(path, f"{place}: {len(knots)} knots, coefficients {weights.shape} and degree {degree} are no curve")
    parameters = np.linspace(knots[degree], knots[count], SPLINE_POINTS)  # the range in which the spline is defined
    return np.asarray(BSpline(knots, weights, degree)(parameters), np.float64)


def _array(path: Path, place: str, values: Any, columns: int | None = 0) -> FloatArray:
    """Returns JSON numbers as an array. Raises FileFormatError if they are no numbers, or of another shape.

    Args:
        path: the file, for messages.
        place: position in the file, for messages.
        values: the JSON: a list, or a list of lists.
        columns: 0: the array is (n,); None: (n, any); else (n, ``columns``).
    """
    try:
        array = np.asarray(values, np.float64)
    except (TypeError, ValueError):
        array = np.empty(0)
    if array.ndim != (1 if columns == 0 else 2) or len(array) < 2 or (columns and array.shape[-1] != columns):
        _fail(path, f"{place}: expected a list of {'numbers' if columns == 0 else 'pairs of numbers'}")
    if not (np.abs(array) <= MAX_PIXEL).all():
        _fail(path, f"{place}: holds a value that is no number, or larger than {MAX_PIXEL:g}")
    return array


def _to_border(point: FloatArray) -> float:
    return float(min(*point, *(SIDE_PX - 1 - point)))


def _fail(path: Path, found: str) -> NoReturn:
    raise FileFormatError(f"{path}: {found}; expected the raw.json or b_spline.json of Guide3D")
