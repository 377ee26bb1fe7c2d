"""Drawings of the detected shape and the force on a copy of the image."""

import math
from collections.abc import Sequence

import cv2
import numpy as np

from ..types import BoolArray, DetectedShape, FloatArray, ForceEstimate, Image
from ..units import newtons_to_grams
from ._advice import Candidate
from ._canvas import FONT, SHIFT, WHITE, Canvas, Colour, fixed, plain, rgb

CENTRELINE: Colour = (255, 214, 0)
FITTED: Colour = (255, 70, 220)
X_AXIS: Colour = (255, 60, 50)
Y_AXIS: Colour = (60, 220, 80)
FORCE: Colour = (0, 225, 255)
OBJECTS: tuple[Colour, ...] = ((255, 214, 0), (0, 225, 255), (255, 70, 220), (60, 220, 80))
"""Colours of the numbered objects that could be the catheter."""
MAX_OBJECTS_LINES = 8
"""Lines of advice above a drawing of objects, at most."""
TALLEST = 4
"""Largest ratio of height to width of an image on a contact sheet; a taller one is made smaller."""


def shaft_mask(shape: DetectedShape, size: tuple[int, int]) -> BoolArray:
    """Returns the pixels within half a diameter of the centreline; none where no shape was found.

    Args:
        shape: the detected shape.
        size: (h, w) of the image in px.

    Returns:
        (h, w), True on the shaft.
    """
    ground = np.ones(size, dtype=np.uint8)
    if shape.centreline is None or not math.isfinite(shape.diameter_px):
        return np.zeros(size, dtype=np.bool_)
    # OpenCV's own thick lines are up to two pixels too wide.
    cv2.polylines(ground, [fixed(shape.centreline.points)], False, 0, 1, cv2.LINE_8, SHIFT)
    return cv2.distanceTransform(ground, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) <= 0.5 * shape.diameter_px


def stretches(shape: DetectedShape) -> list[tuple[int, int, bool]]:
    """Returns the stretches of the centreline: indices of the first and the last point, and whether it is visible."""
    if shape.centreline is None:
        return []
    if shape.seen is None:
        return [(0, len(shape.centreline.points) - 1, True)]
    pieces = shape.seen[:-1] & shape.seen[1:]
    starts = [0, *(np.flatnonzero(np.diff(pieces)) + 1).tolist()]
    return [(first, last, bool(pieces[first])) for first, last in zip(starts, [*starts[1:], len(pieces)], strict=True)]


def draw_shape(
    image: Image,
    shape: DetectedShape,
    *,
    curve_px: FloatArray | None = None,
    mask: BoolArray | None = None,
    legend: bool = True,
) -> Image:
    """Draws mask, centreline, base frame, tip and fitted curve over an image, or the reason why there is no shape.

    Args:
        image: (h, w) or (h, w, 3).
        shape: the detected shape.
        curve_px: (n, 2) fitted curve in image points; None: none is drawn.
        mask: (h, w) pixels of the catheter; None: the tube around the centreline.
        legend: whether the colours are named below.

    Returns:
        The drawing (h', w', 3), enlarged where the image is small.
    """
    if mask is None:
        mask = shaft_mask(shape, (image.shape[0], image.shape[1]))
    canvas = Canvas.over(image, mask)
    _draw_shape(canvas, shape, curve_px)
    if not shape.found:
        canvas.banner(f"NOT FOUND: {shape.status.replace('_', ' ')}", shape.detail)
    elif legend:
        hidden = shape.seen is not None and not shape.seen.all()
        entries = [("centreline, hidden: dashed" if hidden else "centreline", CENTRELINE)]
        if curve_px is not None:
            entries.append(("fitted curve", FITTED))
        canvas.footer([[*entries, ("base frame x", X_AXIS), ("y", Y_AXIS), ("tip", WHITE)]])
    return canvas.image


def draw_objects(image: Image, objects: Sequence[Candidate], title: str, detail: str) -> Image:
    """Draws the objects that could be the catheter over an image: line, base region and number of each.

    Args:
        image: (h, w) or (h, w, 3).
        objects: the objects; the first is number 1.
        title: title of the red bar at the top.
        detail: sentence below the title.

    Returns:
        The drawing (h', w', 3), enlarged where the image is small.
    """
    canvas = Canvas.over(image, None)
    colours = [OBJECTS[k % len(OBJECTS)] for k in range(len(objects))]
    for candidate, colour in zip(objects, colours, strict=True):
        u0, v0, u1, v1 = candidate.region
        corners = np.array([[u0, v0], [u1, v0], [u1, v1], [u0, v1], [u0, v0]]) - 0.5
        canvas.line(corners, colour, 1.5)
        canvas.line(candidate.points, colour, 2.0)
        canvas.dot(candidate.points[-1], colour, 3.0)
    for number, (candidate, colour) in enumerate(zip(objects, colours, strict=True), start=1):
        middle = candidate.points[len(candidate.points) // 2]
        way = candidate.points[-1] - candidate.points[0]
        canvas.label(str(number), middle, np.array([-way[1], way[0]]) / max(float(np.hypot(*way)), 1e-9), colour)
    rows = [
        [(f"{number}: {candidate.probability:.0%}, base_region = {list(candidate.region)}", colour)]
        for number, (candidate, colour) in enumerate(zip(objects, colours, strict=True), start=1)
    ]
    # both bars are beside the image: they must not hide an object
    height, width = canvas.image.shape[:2]
    top, bottom = (Canvas(np.full((height, width, 3), 60, np.uint8), canvas.zoom) for _ in range(2))
    parts = [top.image[: top.banner(title, detail, MAX_OBJECTS_LINES)], canvas.image]
    if rows:
        parts.append(bottom.image[height - bottom.footer(rows) :])
    return np.vstack(parts)


def draw_estimate(
    image: Image, shape: DetectedShape | None, estimate: ForceEstimate, *, full_scale_n: float = 0.3
) -> Image:
    """Draws the shape over an image, with the force as an arrow and in N and g, interval and status.

    The arrow is the force of the tissue on the tip, so its head is on the tip. A method that yields the magnitude alone
    has no arrow. An estimate that is not valid shows its reason and no number.

    Args:
        image: (h, w) or (h, w, 3).
        shape: the detected shape; None: no shape is drawn.
        estimate: the estimate.
        full_scale_n: force in newtons whose arrow is a quarter of the shorter side of the image long.

    Returns:
        The drawing (h', w', 3), enlarged where the image is small.
    """
    canvas = Canvas.over(image, None)
    if shape is not None:
        _draw_shape(canvas, shape, None, axes=False)
    if not estimate.valid:
        canvas.banner(f"NOT VALID: {estimate.status.replace('_', ' ')}", estimate.detail)
        return canvas.image
    if shape is not None and shape.centreline is not None and shape.base is not None:
        _draw_force(canvas, shape, estimate, full_scale_n)
    low, high = estimate.magnitude_interval_n
    value = f"{estimate.magnitude_n:.3f} N   {newtons_to_grams(estimate.magnitude_n):.1f} g"
    interval = f"90 %: {low:.3f} to {high:.3f} N" if math.isfinite(low) and math.isfinite(high) else "no interval"
    parts = [
        f"F{axis} {round(value_n, 3) + 0.0:+.3f}"
        for axis, value_n, known in zip("xyz", estimate.force_n.tolist(), estimate.known, strict=True)
        if known
    ]
    second = [(interval, WHITE)] + ([(" ".join(parts) + " N", FORCE)] if parts else [])
    canvas.footer([[(value, WHITE)], second], big_first=True)
    return canvas.image


def contact_sheet(images: Sequence[Image], columns: int, titles: Sequence[str] = (), width: int = 320) -> Image:
    """Returns images of any sizes as one, in rows, each under its title.

    An image more than `TALLEST` times as high as wide is narrower than the others.

    Args:
        images: (h, w) or (h, w, 3) each.
        columns: number of images in a row.
        titles: title of each image; empty: no titles.
        width: width of each image on the sheet in px.
    """
    height = min(TALLEST * width, max(round(width * p.shape[0] / p.shape[1]) for p in images))
    bar = 22 if titles else 0
    rows = math.ceil(len(images) / columns)
    sheet = np.full((rows * (height + bar + 4) + 4, columns * (width + 4) + 4, 3), 245, dtype=np.uint8)
    for k, image in enumerate(images):
        fit = min(width / image.shape[1], height / image.shape[0])
        size = (max(1, round(fit * image.shape[1])), max(1, round(fit * image.shape[0])))
        small = cv2.resize(rgb(image), size, interpolation=cv2.INTER_AREA if fit < 1 else cv2.INTER_NEAREST)
        top, left = 4 + k // columns * (height + bar + 4), 4 + k % columns * (width + 4)
        sheet[top + bar : top + bar + size[1], left : left + size[0]] = small
        if bar and k < len(titles):
            cv2.putText(sheet, plain(titles[k]), (left + 2, top + 15), FONT, 0.42, (40, 40, 40), 1, cv2.LINE_AA)
    return sheet


def _draw_shape(canvas: "Canvas", shape: DetectedShape, curve_px: FloatArray | None, axes: bool = True) -> None:
    if shape.centreline is None or shape.base is None:
        return
    points = shape.centreline.points
    for first, last, seen in stretches(shape):
        canvas.line(points[first : last + 1], CENTRELINE, 2.0, dashed=not seen)
    if curve_px is not None:
        canvas.line(curve_px, FITTED, 2.0, dashed=True)
    if axes:
        length = 0.14 * min(canvas.image.shape[:2]) / canvas.zoom
        for row, colour, letter in ((0, X_AXIS, "x"), (1, Y_AXIS, "y")):
            axis = shape.base.axes_px[row]
            head = shape.base.origin_px + length * axis
            canvas.arrow(shape.base.origin_px, head, colour, 2.0)
            canvas.label(letter, head, axis, colour)
    canvas.dot(points[-1], WHITE, 3.5)


def _draw_force(canvas: "Canvas", shape: DetectedShape, estimate: ForceEstimate, full_scale_n: float) -> None:
    assert shape.centreline is not None
    assert shape.base is not None
    if not estimate.known[:2].all():
        return
    quarter = 0.25 * min(canvas.image.shape[:2]) / canvas.zoom
    vector = estimate.force_n[:2] @ shape.base.axes_px * (quarter / full_scale_n)
    length = float(np.hypot(*vector))
    if length < 10.0 * canvas.unit / canvas.zoom:
        return  # shorter than an arrow's head
    # A little off the tip, so that its dot stays visible.
    head = shape.centreline.points[-1] - vector * (4.0 * canvas.unit / canvas.zoom / length)
    canvas.arrow(head - vector * min(1.0, 1.5 * quarter / length), head, FORCE, 3.0)
