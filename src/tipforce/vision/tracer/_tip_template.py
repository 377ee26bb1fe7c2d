"""Compares the tip of a catheter with its appearance in the other images of the session, and searches it near by.

The last stations of a trace may be on a shadow or on the rim of another object; an extrapolation from them misses the
tip. With a template of the last stretch of the catheter (rings, metal, lustre), the line is compared with
arcs from a point further back, and the one that fits the template best is taken.
"""

import math

import numpy as np

from ._pixels import Raster, colour_between, fast
from ._spline import Spline, axis_at, heading
from ._stations import ARC, add_station

TEMPLATE_ROWS = 13
"""Rows of a template, a radius apart, the first half a radius before the tip."""
TEMPLATE_COLUMNS, TEMPLATE_WIDTH = 7, 0.85
"""Points across the shaft in a row, and the distance of the outermost from the axis in radii."""
ARC_RADII = 16.0
"""The arcs begin at this distance before the tip."""
STIFF_TIP_RADII = 7.0
"""Length of the straight metal tip."""
MAX_POINT_GREY = 40.0
"""Largest difference of one point that counts: an object may cover it."""
MAX_ALIKE_GREY = 6.0
"""A line with a smaller mean difference is accepted without a search."""
BETTER_SHARE, BETTER_BY_GREY = 0.75, 1.0
"""The difference of an arc must be below this share of the line's difference, minus this number of grey levels."""
MAX_TURN_STEPS, TURN_STEP_RAD, LIKELY_TURN_RAD = 8, 0.012, 0.06
MAX_BEND_STEPS, BEND_STEP, LIKELY_BEND = 5, 0.004, 0.012
"""Arcs to try on either side, how far apart, and their standard deviation: radians, and 1 / radius."""
FINE_STEPS = 3
TIP_ROWS = 6
"""Rows of the metal tip; further back the rings are known to a few px only."""
ADDED_WEIGHT = 0.2


@fast
def _difference(image: Raster, template: np.ndarray, nodes: np.ndarray, half: float, every: int) -> float:
    """Returns the mean difference of points along ``nodes`` (k, 4: u, v, du, dv) from the template; every so many."""
    channels = image.channels
    total, count = 0.0, 0
    for i in range(0, nodes.shape[0], every):
        u, v, du, dv = nodes[i, 0], nodes[i, 1], nodes[i, 2], nodes[i, 3]
        for k in range(0, TEMPLATE_COLUMNS, every):
            x = half * TEMPLATE_WIDTH * (2.0 * k / (TEMPLATE_COLUMNS - 1) - 1.0)
            a = min(max(u - x * dv, image.left), image.right - 1.001)
            b = min(max(v + x * du, image.top), image.bottom - 1.001)
            for c in range(channels):
                total += min(abs(colour_between(image, c, a, b) - template[i, k * channels + c]), MAX_POINT_GREY)
            count += channels
    return total / count


@fast
def _arc_point(u: float, v: float, angle: float, bend: float, curved: float, s: float) -> tuple[float, float, float]:
    """Returns position and direction at ``s`` of an arc that is straight behind ``curved``."""
    arc = min(s, curved)
    middle, end = angle + 0.5 * bend * arc, angle + bend * arc
    over = s - arc
    return (
        u + arc * math.cos(middle) + over * math.cos(end),
        v + arc * math.sin(middle) + over * math.sin(end),
        end,
    )


@fast
def _nodes_along_arc(
    u: float, v: float, angle: float, bend: float, curved: float, back: float, half: float, nodes: np.ndarray
) -> None:
    """Fills ``nodes`` with the rows of a template along an arc from (u, v) that reaches the tip after ``back``."""
    for k in range(TEMPLATE_ROWS):
        nodes[k, 0], nodes[k, 1], end = _arc_point(u, v, angle, bend, curved, back - (k + 0.5) * half)
        nodes[k, 2], nodes[k, 3] = math.cos(end), math.sin(end)


@fast
def _nodes_along_spline(spline: Spline, straight: float, tip: float, half: float, nodes: np.ndarray) -> None:
    """Fills ``nodes`` with the rows of a template along a spline with its tip at ``tip``."""
    for i in range(nodes.shape[0]):
        u, v, du, dv = axis_at(spline, straight, tip - (i + 0.5) * half)
        norm = math.sqrt(du * du + dv * dv)
        nodes[i, 0], nodes[i, 1], nodes[i, 2], nodes[i, 3] = u, v, du / norm, dv / norm


@fast
def template_difference(
    image: Raster, template: np.ndarray, spline: Spline, straight: float, tip: float, half: float, work: np.ndarray,
) -> float:  # fmt: skip
    """Returns the mean difference of the tip from the template, in grey levels.

    Args:
        image: the frame.
        template: (`TEMPLATE_ROWS`, `TEMPLATE_COLUMNS` x channels) grey levels of the tip.
        spline: the axis.
        straight: arc length in px beyond which the axis follows its tangent.
        tip: arc length of the tip in px.
        half: half of the shaft's width in px.
        work: working memory of 4 `TIP_ROWS` numbers, or more.
    """
    nodes = work[: 4 * TIP_ROWS].reshape((TIP_ROWS, 4))
    _nodes_along_spline(spline, straight, tip, half, nodes)
    return _difference(image, template, nodes, half, 1)


@fast
def match_template(
    image: Raster, template: np.ndarray, spline: Spline, straight: float, goal: float, half: float, work: np.ndarray,
    stations: np.ndarray, n: int,
) -> int:  # fmt: skip
    """Searches the arc along which the image is most like the template of the metal tip, and adds stations along it.

    The arcs begin `ARC_RADII` before the tip. Stations after that point are replaced.

    Args:
        image: the frame.
        template: (`TEMPLATE_ROWS`, `TEMPLATE_COLUMNS` x channels) grey levels, the first row at the tip.
        spline: axis fitted to the stations.
        straight: arc length in px from which on the spline is extended straight.
        goal: arc length of the tip in px.
        half: half of the shaft's width in px.
        work: buffer of 4 x `TEMPLATE_ROWS` numbers.
        stations: (k, 6) array of stations; receives those of the arc.
        n: number of stations.

    Returns:
        The new number of stations; 0, with the stations as they were, if the spline fits well already, no arc fits
        clearly better, or there are too few stations.
    """
    nodes = work[: 4 * TEMPLATE_ROWS].reshape((TEMPLATE_ROWS, 4))
    _nodes_along_spline(spline, straight, goal, half, nodes)
    kept = _difference(image, template, nodes, half, 1)
    cut = n
    while cut > 0 and stations[cut - 1, ARC] > goal - ARC_RADII * half:
        cut -= 1
    if kept < MAX_ALIKE_GREY or cut < 8:
        return 0
    back = goal - stations[cut - 1, ARC]
    curved = back - STIFF_TIP_RADII * half
    u, v, angle, bend = heading(stations, cut, half, 0.0)
    best, turn, curve = 1e9, 0.0, 0.0
    from_turn, from_curve = 0.0, 0.0
    for finer in range(2):
        turns, bends = (FINE_STEPS, FINE_STEPS) if finer else (MAX_TURN_STEPS, MAX_BEND_STEPS)
        share = 1.0 / (FINE_STEPS + 1.0) if finer else 1.0
        from_turn, from_curve = turn, curve
        for i in range(-turns, turns + 1):
            for j in range(-bends, bends + 1):
                way, arc = from_turn + share * i * TURN_STEP_RAD, from_curve + share * j * BEND_STEP
                _nodes_along_arc(u, v, angle + way, bend + arc / half, curved, back, half, nodes)
                total = _difference(image, template, nodes, half, 2)
                total *= 1.0 + 0.1 * ((way / LIKELY_TURN_RAD) ** 2 + (arc / LIKELY_BEND) ** 2)
                if total < best:
                    best, turn, curve = total, way, arc
    _nodes_along_arc(u, v, angle + turn, bend + curve / half, curved, back, half, nodes)
    best = _difference(image, template, nodes, half, 1)
    if best > BETTER_SHARE * kept - BETTER_BY_GREY:
        return 0
    count = max(2, int((back - 0.5 * half) / (0.5 * half)))
    n = cut
    for k in range(1, count + 1):
        if n == stations.shape[0]:
            break
        s = (back - 0.5 * half) * k / count
        at_u, at_v, _ = _arc_point(u, v, angle + turn, bend + curve / half, curved, s)
        n = add_station(stations, n, at_u, at_v, goal - back + s, half, ADDED_WEIGHT)
    return n
