"""Drawing a tube: every pixel near it finds its position along and across the axis, and looks up its light there.

Between two nodes the axis is a cubic (Hermite). The planes across the axis at the nodes part the pixels, so each is
drawn once. The distance to the axis is exact to 1e-4 px for bends wider than three tube widths.
"""

import math

import numpy as np
import numpy.typing as npt
from numba import njit

from ...._system.compilation import STEADY
from ....types import FloatArray
from .._raster import columns

STEPS_PER_PX = 8
"""Steps of the tables across: interpolated linearly between, which is within 0.001 of the contrast for any blur."""
FloatImage = npt.NDArray[np.float32]
NODE_SIZE = 8
"""Columns of a node: u, v; unit tangent (2); derivative by the node's number (2); half width; blur; all px."""
POINTS_PER_M = 200_000.0
"""Steps of the table of materials along the tube: 1/40 px at 0.2 mm/px."""


@njit(cache=True, error_model="numpy", nogil=True)
def _look_up(table: FloatImage, blur: float, turn: float, column: float, out: FloatImage) -> None:
    """Interpolates ``table`` (blur, direction, across, 4) at fractional indices into ``out`` (4,).

    ``turn`` is the fractional index of the direction, not negative; directions are cyclic.
    """
    k = min(int(blur), table.shape[0] - 2)
    n = table.shape[1]
    d = int(turn)
    x = int(column)
    fb, fd, fx = np.float32(blur - k), np.float32(turn - d), np.float32(column - x)
    turn_0, turn_1 = d % n, (d + 1) % n
    one = np.float32(1.0)
    for q in range(4):
        low = (table[k, turn_0, x, q] * (one - fd) + table[k, turn_1, x, q] * fd) * (one - fx) + (
            table[k, turn_0, x + 1, q] * (one - fd) + table[k, turn_1, x + 1, q] * fd
        ) * fx
        high = (table[k + 1, turn_0, x, q] * (one - fd) + table[k + 1, turn_1, x, q] * fd) * (one - fx) + (
            table[k + 1, turn_0, x + 1, q] * (one - fd) + table[k + 1, turn_1, x + 1, q] * fd
        ) * fx
        out[q] = low + (high - low) * fb


@njit(cache=True, error_model="numpy", fastmath=STEADY, nogil=True)
def _blend_row(table: FloatImage, blur: float, turn: float, row: FloatImage) -> None:
    """Interpolates ``table`` (blur, direction, across, 4) at fractional ``blur``, ``turn`` into ``row`` (across, 4)."""
    k = min(int(blur), table.shape[0] - 2)
    d = int(turn)
    fb, fd = np.float32(blur - k), np.float32(turn - d)
    one = np.float32(1.0)
    w00, w01, w10, w11 = (one - fb) * (one - fd), (one - fb) * fd, fb * (one - fd), fb * fd
    d0, d1 = d % table.shape[1], (d + 1) % table.shape[1]
    at_00, at_01 = table[k, d0].reshape(row.size), table[k, d1].reshape(row.size)
    at_10, at_11 = table[k + 1, d0].reshape(row.size), table[k + 1, d1].reshape(row.size)
    out = row.reshape(row.size)
    for x in range(out.size):
        out[x] = w00 * at_00[x] + w01 * at_01[x] + w10 * at_10[x] + w11 * at_11[x]


@njit(cache=True, error_model="numpy", nogil=True)
def add_tube(
    drawn: FloatImage,
    nodes: FloatArray,
    weight: float,
    table: FloatImage,
    half_width: float,
    reach: float,
    blurs: FloatArray,
    start_m: float,
    step_m: float,
    along: FloatImage,
    blunt: float,
    braid: FloatArray,
) -> None:
    """Draws the tube at one instant of the exposure and adds it to the image.

    Args:
        drawn: (h, w, 1 + c) image to which it is added: the share of a pixel that the tube covers, and its light times
            this share in c colours.
        nodes: (n, 8) nodes of the axis in px, see `NODE_SIZE`; the last one is the middle of the dome.
        weight: share of the instant in the exposure.
        table: ``table`` of a `TubeProfile`.
        half_width: its half width in px.
        reach: its reach in px.
        blurs: (2,) its smallest and largest blur in px.
        start_m: arc length at the first node.
        step_m: arc length between two nodes.
        along: (m, 2 c + 1) weights of matte light and metal light (c each) and of gloss along the tube, from arc length
            0 on, `POINTS_PER_M` for each metre.
        blunt: exponent of the outline of the end: 2 for a dome, more for a flatter end.
        braid: (3,) relative change of light by the braid of the shaft, its turns in radians for each metre, and its
            strands over half the circumference.
    """
    h, w = drawn.shape[:2]
    c = drawn.shape[2] - 1
    count = nodes.shape[0]
    row = np.empty((table.shape[2], 4), np.float32)
    seen = np.empty(4, np.float32)
    per_blur = (table.shape[0] - 1) / (blurs[1] - blurs[0])
    per_turn = table.shape[1] / (2.0 * math.pi)
    last = table.shape[2] - 2
    end_m = start_m + step_m * (count - 1)
    for i in range(count):
        # One stretch: from node a, position (ax, ay) and tangent (tx, ty), to node b with the tangent (ox, oy).
        # The last node alone is the dome.
        dome = i == count - 1
        j = i if dome else i + 1
        ax, ay, bx, by = nodes[i, 0], nodes[i, 1], nodes[j, 0], nodes[j, 1]
        tx, ty, ox, oy = nodes[i, 2], nodes[i, 3], nodes[j, 2], nodes[j, 3]
        length = math.sqrt((bx - ax) ** 2 + (by - ay) ** 2)
        bend = 0.0 if dome else math.asin(max(-1.0, min(1.0, tx * oy - ty * ox))) / length
        sigma = 0.5 * (nodes[i, 7] + nodes[j, 7])
        half = 0.5 * (nodes[i, 6] + nodes[j, 6])
        scale = half_width / half
        blur = min(max((sigma * scale - blurs[0]) * per_blur, 0.0), table.shape[0] - 1.0)
        turn = math.atan2(ty + oy, tx + ox) * per_turn + 2 * table.shape[1]
        if not dome:  # all pixels of this stretch share blur and direction
            _blend_row(table, blur, turn, row)
        far = min(half + 4.0 * sigma, reach / scale - 0.01)  # distance from the axis to which the tube is visible
        near_end = end_m - (start_m + step_m * i) < 12.0 * step_m
        px_per_m = length / step_m if not dome else 0.0
        for v in range(max(0, int(min(ay, by) - far)), min(h, int(max(ay, by) + far) + 2)):
            low, high = max(0, int(min(ax, bx) - far)), min(w, int(max(ax, bx) + far) + 2)
            # Pixels of this row ahead of a's plane; for a stretch also before b's plane and within `far` of the axis.
            low, high = columns(low, high, tx, (v - ay) * ty - ax * tx)
            if not dome:
                low, high = columns(low, high, -ox, (by - v) * oy + bx * ox)
                middle = 0.5 * (ax + bx)
                level = (v - 0.5 * (ay + by)) * tx + middle * ty
                low, high = columns(low, high, -ty, far + 0.6 + level)
                low, high = columns(low, high, ty, far + 0.6 - level)
            for u in range(low, high):
                rx, ry = u - ax, v - ay
                ahead = rx * tx + ry * ty
                if ahead < 0.0:
                    continue
                if dome:
                    if blunt == 2.0:
                        across = math.sqrt(rx * rx + ry * ry)
                    else:
                        across = (ahead**blunt + abs(ry * tx - rx * ty) ** blunt) ** (1.0 / blunt)
                    if across > far:
                        continue
                    # The edge of a blurred disc is further in than the disc's; see below for the sides.
                    lean = 0.5 + 0.5 * math.erf(ahead / (1.414 * sigma))
                    shifted = across + lean * sigma * sigma / (2.0 * max(across, 0.5 * half))
                    if shifted > far:
                        continue
                    around = math.atan2(ry, rx) - 0.5 * math.pi
                    direction = around * per_turn + 2 * table.shape[1]
                    _look_up(table, blur, direction, (shifted * scale + reach) * STEPS_PER_PX, seen)
                    arc_m = end_m
                else:
                    before_b = (bx - u) * ox + (by - v) * oy
                    if before_b <= 0.0:
                        continue
                    # Exact for a circle's arc: the share of the way at which the axis passes beside the pixel.
                    t = ahead / (ahead + before_b)
                    t2, t3 = t * t, t * t * t
                    # Nearest point (qx, qy) of the Hermite cubic, and its tangent (gx, gy).
                    h1, h2, h3, h4 = 2 * t3 - 3 * t2 + 1, t3 - 2 * t2 + t, 3 * t2 - 2 * t3, t3 - t2
                    qx = h1 * ax + h2 * nodes[i, 4] + h3 * bx + h4 * nodes[j, 4]
                    qy = h1 * ay + h2 * nodes[i, 5] + h3 * by + h4 * nodes[j, 5]
                    g1, g2, g4 = 6 * t2 - 6 * t, 3 * t2 - 4 * t + 1, 3 * t2 - 2 * t
                    gx = g1 * (ax - bx) + g2 * nodes[i, 4] + g4 * nodes[j, 4]
                    gy = g1 * (ay - by) + g2 * nodes[i, 5] + g4 * nodes[j, 5]
                    across = ((v - qy) * gx - (u - qx) * gy) / math.sqrt(gx * gx + gy * gy)
                    # A blurred edge that bends moves towards the centre of its bend by bend sigma^2 / 2.
                    shifted = across - 0.5 * bend / max(0.2, 1.0 - bend * across) * sigma * sigma
                    arc_m = start_m + step_m * (i + t)
                    if near_end:
                        rest = (end_m - arc_m) * px_per_m  # px to the dome, see above
                        if rest < 3.0 * sigma:
                            lean = 0.5 - 0.5 * math.erf(rest / (1.414 * sigma))
                            size = abs(shifted)
                            shifted *= 1.0 + lean * sigma * sigma / (2.0 * max(size, 0.5 * half) * max(size, 0.05))
                    column = (shifted * scale + reach) * STEPS_PER_PX
                    if column < 0.0 or column >= last:
                        continue
                    x = int(column)
                    fx = np.float32(column - x)
                    for q in range(4):
                        seen[q] = row[x, q] + (row[x + 1, q] - row[x, q]) * fx
                m = min(along.shape[0] - 1, max(0, int(arc_m * POINTS_PER_M)))
                drawn[v, u, 0] += weight * seen[0]
                gloss = along[m, 2 * c] * seen[2]
                if braid[0] > 0.0 and not dome:
                    around_rad = math.asin(min(max(shifted / half, -1.0), 1.0))
                    seen[1] *= np.float32(1.0 + braid[0] * math.sin(braid[1] * arc_m) * math.cos(braid[2] * around_rad))
                for k in range(c):
                    drawn[v, u, 1 + k] += weight * (along[m, k] * seen[1] + along[m, c + k] * seen[3] + gloss)


@njit(cache=True, error_model="numpy", nogil=True)
def add_shadow(shade: FloatImage, nodes: FloatArray, fall: FloatArray, sigma: float, strength: float) -> None:
    """Adds a tube's shadow from one lamp: each pixel gets the larger of its value and the share of light hidden.

    Args:
        shade: (h, w) share of the light that is hidden; it is changed where the tube hides more.
        nodes: (n, 8) nodes of the axis in px, see `NODE_SIZE`.
        fall: (2,) way from the tube to its shadow in px.
        sigma: softness of the shadow's edge in px.
        strength: share of the lamp in all light.
    """
    h, w = shade.shape
    count = nodes.shape[0]
    half = nodes[count - 1, 6]
    far = half + 3.0 * sigma
    steps = int(far * 4.0) + 2  # four for each px from the middle of the shadow
    profile = np.empty(steps + 1, np.float32)
    for x in range(steps + 1):
        profile[x] = strength * (
            0.5 * math.erf((0.25 * x + half) / (1.4142 * sigma)) - 0.5 * math.erf((0.25 * x - half) / (1.4142 * sigma))
        )
    total = 0.0  # length of the shadow, with 0.8 of the dome's radius
    for i in range(count - 1):
        total += math.sqrt((nodes[i + 1, 0] - nodes[i, 0]) ** 2 + (nodes[i + 1, 1] - nodes[i, 1]) ** 2)
    total += 0.8 * half
    length_done = 0.0
    for i in range(count - 1):
        ax, ay = nodes[i, 0] + fall[0], nodes[i, 1] + fall[1]
        bx, by = nodes[i + 1, 0] + fall[0], nodes[i + 1, 1] + fall[1]
        tx, ty, ox, oy = nodes[i, 2], nodes[i, 3], nodes[i + 1, 2], nodes[i + 1, 3]
        length = math.sqrt((bx - ax) ** 2 + (by - ay) ** 2)
        last = i == count - 2
        more = far if last else 0.0  # the last piece draws the pixels beyond it, too
        cx, cy = bx + more * ox, by + more * oy
        ended = total - length_done < 4.0 * sigma + 2.0 * length + more
        for v in range(max(0, int(min(ay, cy) - far)), min(h, int(max(ay, cy) + far) + 2)):
            for u in range(max(0, int(min(ax, cx) - far)), min(w, int(max(ax, cx) + far) + 2)):
                ahead = (u - ax) * tx + (v - ay) * ty
                if ahead < 0.0:
                    continue
                before_end = (bx - u) * ox + (by - v) * oy
                if before_end <= 0.0 and not last:
                    continue
                nx, ny = tx, ty
                if before_end > 0.0:
                    share = ahead / (ahead + before_end)
                    nx, ny = tx + share * (ox - tx), ty + share * (oy - ty)
                    qx, qy, length_here = ax + share * (bx - ax), ay + share * (by - ay), length_done + share * length
                else:
                    nx, ny = ox, oy
                    qx, qy, length_here = bx - before_end * ox, by - before_end * oy, length_done + length - before_end
                column = abs((v - qy) * nx - (u - qx) * ny) * 4.0
                if column >= steps:
                    continue
                x = int(column)
                value = profile[x] + (profile[x + 1] - profile[x]) * np.float32(column - x)
                if ended:
                    value *= 0.5 + 0.5 * math.erf((total - length_here) / (1.4142 * sigma))
                if value > shade[v, u]:
                    shade[v, u] = value
        length_done += length
