"""The deflection of the shaft and the levers of a force on it, from detected shapes, for `estimate_clock`.

The bell reduces the weight of badly detected parts: w and its slope vanish at both ends, so no single point of the
centreline has a large weight, and the dome, where one flank turns into the other, has a weight in the lever only. The
levers are turned by one angle for all images, because the detected base turns with the bend and the sensor does not.
They end where a ball of the shaft's diameter touches a wall across the mean force.
"""

import math
from collections.abc import Sequence

import numpy as np

from ..geometry import arc_length
from ..types import BasePose, FloatArray
from ..vision import DetectedShape

USED_LENGTH_SHARE = 0.9
"""Share of the shaft's length that is used: the rest is the dome, whose errors are five times larger."""
VISIBLE_SHARES, _FEW = (0.88, 1.04), 0.1
"""Visible share of a catheter's known length: its base may be hidden, scale and length are known to a few percent. If a
smaller share of the lines than the second is in this range, the known length is not used."""
MIN_NEAR_SHARE = 0.96
"""Least share of the common length that a line must have, apart from the rigid tip."""


def shape_coordinates(
    shapes: Sequence[DetectedShape], *, flexible_share: float = 1.0, length_px: float | None = None
) -> FloatArray:
    """Returns the deflection of shapes and the factors of the force in it.

    All centrelines are brought to one length: a longer line is another object, and where the rigid tip was not detected
    it is drawn on. The base frame's direction is the median one. The lever ends in the middle of the dome.

    Args:
        shapes: n detected shapes.
        flexible_share: share of the visible length, from the base, that is flexible; a rigid tip does not bend.
        length_px: length of the whole catheter, of which a part at the base may be hidden; None: not known.

    Returns:
        (n, 4) deflection B in rad; factors of the force's x and y in the moment G (see `estimate_clock`), in px; weight
        of the lever's end in them, in px: the dome's radius times the integral of w. NaN where nothing was found.
    """
    rows = np.full((len(shapes), 4), math.nan)
    directions = np.array([np.exp(1j * shape.base.angle_rad) for shape in shapes if shape.base is not None])
    if directions.size == 0:
        return rows
    # the median about the mean direction, where angles do not jump by a full turn
    mean = complex(directions.mean())
    angle_rad = float(np.angle(mean) + np.median(np.angle(directions * mean.conjugate())))
    end = min(flexible_share, USED_LENGTH_SHARE)
    diameters = np.array([shape.diameter_px for shape in shapes])
    finite = diameters[np.isfinite(diameters)]
    radius = 0.5 * float(np.median(finite)) if finite.size else 0.0
    length = _common_length([s.centreline.points for s in shapes if s.centreline is not None], length_px)
    for row, shape in enumerate(shapes):
        if shape.centreline is None or shape.base is None:
            continue
        line_px = _of_length(shape.centreline.points, length, flexible_share)
        if line_px is None:
            continue
        points = BasePose(shape.base.origin_px, angle_rad).to_base(line_px)
        steps = np.diff(points, axis=0)
        angle = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
        share = np.linspace(0.0, 1.0, len(points))
        bell = (1.0 - np.minimum((2.0 * share / end - 1.0) ** 2, 1.0)) ** 2  # w: 1 in the middle, 0 at 0 and ``end``
        axis = points[-1] - points[int(USED_LENGTH_SHARE * (len(points) - 1))]
        lever = (points[-1] - radius * axis / np.linalg.norm(axis) - points) * share[1]
        weight = radius * share[1] * float(bell.sum())
        # by parts: angles are smoother than their differences
        rows[row] = -(np.diff(bell) @ angle), -(bell @ lever[:, 1]), bell @ lever[:, 0], weight
    return rows


def _common_length(lines: Sequence[FloatArray], expected_px: float | None) -> float:
    """Returns the median length, of those lines that a catheter of ``expected_px`` may show where any do."""
    lengths = np.array([float(arc_length(points)[-1]) for points in lines])
    if expected_px is not None:
        share = lengths / expected_px
        likely = lengths[(share > VISIBLE_SHARES[0]) & (share < VISIBLE_SHARES[1])]
        lengths = likely if likely.size >= _FEW * lengths.size else lengths
    return float(np.median(lengths)) if lengths.size else math.nan


def _of_length(points: FloatArray, length: float, flexible_share: float) -> FloatArray | None:
    """Cuts ``points`` (n, 2) to ``length`` px, or extends them along the tip where only rigid tip is missing.

    Returns (n, 2) points, evenly spaced; None where more than rigid tip is missing.
    """
    arc = arc_length(points)
    if arc[-1] < length * min(MIN_NEAR_SHARE, flexible_share - (1.0 - MIN_NEAR_SHARE)):
        return None
    if arc[-1] < length:
        axis = points[-1] - points[int(USED_LENGTH_SHARE * (len(points) - 1))]
        points = np.vstack([points, points[-1] + (length - arc[-1]) * axis / np.linalg.norm(axis)])
        arc = np.append(arc, length)
    even = np.linspace(0.0, length, len(points))
    return np.stack([np.interp(even, arc, column) for column in points.T], axis=1)
