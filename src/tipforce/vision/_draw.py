"""Drawing what was seen, and the force, on a copy of the picture."""

import math
from collections.abc import Sequence

import cv2
import numpy as np

from ..types import BoolArray, FloatArray, ForceEstimate, Image
from ..units import newtons_to_grams
from ._canvas import FONT, SHIFT, WHITE, Canvas, Colour, fixed, plain, rgb
from ._sighting import Sighting

__all__ = ["contact_sheet", "draw_estimate", "draw_sighting", "shaft_mask"]

CENTRELINE: Colour = (255, 214, 0)
FITTED: Colour = (255, 70, 220)
X_AXIS: Colour = (255, 60, 50)
Y_AXIS: Colour = (60, 220, 80)
FORCE: Colour = (0, 225, 255)


def shaft_mask(sighting: Sighting, shape: tuple[int, int]) -> BoolArray:
    """(h, w): the pixels within half a diameter of the centreline; none where nothing was found."""
    ground = np.ones(shape, dtype=np.uint8)
    if sighting.centreline is None or not math.isfinite(sighting.diameter_px):
        return np.zeros(shape, dtype=np.bool_)
    # OpenCV's own thick lines are up to two pixels too wide.
    cv2.polylines(ground, [fixed(sighting.centreline.points)], False, 0, 1, cv2.LINE_8, SHIFT)
    return cv2.distanceTransform(ground, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) <= 0.5 * sighting.diameter_px


def draw_sighting(
    image: Image,
    sighting: Sighting,
    *,
    curve_px: FloatArray | None = None,
    mask: BoolArray | None = None,
    legend: bool = True,
) -> Image:
    """An RGB copy of ``image`` with mask, centreline, base frame, tip and fitted curve, or why there is none.

    ``curve_px`` (n, 2): the fitted curve in image points. ``mask`` (h, w): what was taken for the catheter; by default
    the tube around the centreline.
    """
    if mask is None:
        mask = shaft_mask(sighting, (image.shape[0], image.shape[1]))
    canvas = Canvas.over(image, mask)
    _draw_shape(canvas, sighting, curve_px)
    if not sighting.found:
        canvas.banner(f"NOT FOUND: {sighting.status.replace('_', ' ')}", sighting.detail)
    elif legend:
        entries = [("centreline", CENTRELINE)]
        if curve_px is not None:
            entries.append(("fitted curve", FITTED))
        canvas.footer([[*entries, ("base frame x", X_AXIS), ("y", Y_AXIS), ("tip", WHITE)]])
    return canvas.picture


def draw_estimate(
    image: Image, sighting: Sighting | None, estimate: ForceEstimate, *, full_scale_n: float = 0.3
) -> Image:
    """An RGB copy of ``image`` with the shape, the force's arrow on the tip, its value in N and g, interval and status.

    The arrow is what the tissue does to the tip, so its head lies on the tip; ``full_scale_n`` is as long as a quarter
    of the picture's shorter side. A method that yields the magnitude alone has no arrow. An estimate that is not valid
    shows its reason and no number.
    """
    canvas = Canvas.over(image, None)
    if sighting is not None:
        _draw_shape(canvas, sighting, None, axes=False)
    if not estimate.valid:
        canvas.banner(f"NOT VALID: {estimate.status.replace('_', ' ')}", estimate.detail)
        return canvas.picture
    if sighting is not None and sighting.centreline is not None and sighting.base is not None:
        _draw_force(canvas, sighting, estimate, full_scale_n)
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
    return canvas.picture


def contact_sheet(pictures: Sequence[Image], columns: int, titles: Sequence[str] = (), width: int = 320) -> Image:
    """Pictures of any sizes as one, ``columns`` in a row, each ``width`` px wide and under its title."""
    height = max(round(width * p.shape[0] / p.shape[1]) for p in pictures)
    bar = 22 if titles else 0
    rows = math.ceil(len(pictures) / columns)
    sheet = np.full((rows * (height + bar + 4) + 4, columns * (width + 4) + 4, 3), 245, dtype=np.uint8)
    for k, picture in enumerate(pictures):
        fit = min(width / picture.shape[1], height / picture.shape[0])
        size = (max(1, round(fit * picture.shape[1])), max(1, round(fit * picture.shape[0])))
        small = cv2.resize(rgb(picture), size, interpolation=cv2.INTER_AREA if fit < 1 else cv2.INTER_NEAREST)
        top, left = 4 + k // columns * (height + bar + 4), 4 + k % columns * (width + 4)
        sheet[top + bar : top + bar + size[1], left : left + size[0]] = small
        if bar and k < len(titles):
            cv2.putText(sheet, plain(titles[k]), (left + 2, top + 15), FONT, 0.42, (40, 40, 40), 1, cv2.LINE_AA)
    return sheet


def _draw_shape(canvas: "Canvas", sighting: Sighting, curve_px: FloatArray | None, axes: bool = True) -> None:
    if sighting.centreline is None or sighting.base is None:
        return
    points = sighting.centreline.points
    canvas.line(points, CENTRELINE, 2.0)
    if curve_px is not None:
        canvas.line(curve_px, FITTED, 2.0, dashed=True)
    if axes:
        length = 0.14 * min(canvas.picture.shape[:2]) / canvas.zoom
        for row, colour, letter in ((0, X_AXIS, "x"), (1, Y_AXIS, "y")):
            axis = sighting.base.axes_px[row]
            head = sighting.base.origin_px + length * axis
            canvas.arrow(sighting.base.origin_px, head, colour, 2.0)
            canvas.label(letter, head, axis, colour)
    canvas.dot(points[-1], WHITE, 3.5)


def _draw_force(canvas: "Canvas", sighting: Sighting, estimate: ForceEstimate, full_scale_n: float) -> None:
    assert sighting.centreline is not None
    assert sighting.base is not None
    if not estimate.known[:2].all():
        return
    quarter = 0.25 * min(canvas.picture.shape[:2]) / canvas.zoom
    vector = estimate.force_n[:2] @ sighting.base.axes_px * (quarter / full_scale_n)
    length = float(np.hypot(*vector))
    if length < 10.0 * canvas.unit / canvas.zoom:
        return  # shorter than an arrow's head
    # A little off the tip, so that its dot stays in sight.
    head = sighting.centreline.points[-1] - vector * (4.0 * canvas.unit / canvas.zoom / length)
    canvas.arrow(head - vector * min(1.0, 1.5 * quarter / length), head, FORCE, 3.0)
