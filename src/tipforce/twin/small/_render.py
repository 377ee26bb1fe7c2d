"""Drawing one frame: exact distances to the catheter's axis and to the wall's outline, blurred edges, sensor noise.

An edge seen through a Gaussian blur is the error function of the distance to it: so outlines are drawn with sub-pixel
exactness and without supersampling. The catheter's way during the exposure is drawn as a mean of several shapes.
"""

import math

import numpy as np
import numpy.typing as npt
from numba import njit

from ..._compile import STEADY
from ...types import FloatArray, Image

__all__ = ["add_noise", "draw_catheter", "draw_wall"]

Picture = npt.NDArray[np.float32]

_FAR = 1e12
_SHADOW_PX = 12.0
_NEAR_WALL_PX = 42.0
"""Beyond this distance the wall does nothing to the picture; its shadow must not fall farther than 22 px less blur."""


@njit(cache=True, error_model="numpy", fastmath=STEADY)
def _edge(distance: float, sigma: float) -> float:
    """Share of light from inside, ``distance`` px outside a straight edge."""
    if distance > 3.5 * sigma:
        return 0.0
    if distance < -3.5 * sigma:
        return 1.0
    return 0.5 - 0.5 * math.erf(distance / (sigma * 1.4142135623730951))


@njit(cache=True, error_model="numpy", fastmath=STEADY)
def _outside(box: FloatArray, depth: float, across: float) -> float:
    """Signed distance to a rounded box, negative inside."""
    x = abs(depth - 0.5 * (box[0] + box[1])) - 0.5 * (box[1] - box[0]) + box[4]
    y = abs(across - 0.5 * (box[2] + box[3])) - 0.5 * (box[3] - box[2]) + box[4]
    if x <= 0.0 or y <= 0.0:
        return max(x, y) - box[4]
    return math.sqrt(x * x + y * y) - box[4]


@njit(cache=True, error_model="numpy", fastmath=STEADY)
def draw_wall(
    clean: Picture,
    origin: FloatArray,
    into: FloatArray,
    across: FloatArray,
    boxes: FloatArray,
    colours: FloatArray,
    place: FloatArray,
    sigma: float,
    shadow: FloatArray,
    tile: Picture,
) -> None:
    """Pad, plate and arm over ``clean`` (h, w, 3), in place.

    ``place`` (5,) px: the wall's surface along ``into``, its way along ``across``, the dent's depth, middle and width.
    ``shadow`` (2,): how far into and along the wall their shadow falls, px.
    """
    h, w = clean.shape[:2]
    behind = boxes[1, 1] + _NEAR_WALL_PX
    low = min(boxes[0, 2], boxes[1, 2]) - _NEAR_WALL_PX
    high = max(boxes[0, 3], boxes[1, 3]) + _NEAR_WALL_PX
    middle, half = 0.5 * (boxes[2, 2] + boxes[2, 3]), 0.5 * (boxes[2, 3] - boxes[2, 2])
    for v in range(h):
        for u in range(w):
            ru, rv = u - origin[0], v - origin[1]
            depth = ru * into[0] + rv * into[1] - place[0]
            side = ru * across[0] + rv * across[1] - place[1]
            if depth < -_NEAR_WALL_PX or side < low or side > high:
                continue
            if depth > behind and abs(side - middle) > half + _NEAR_WALL_PX:
                continue
            dent = 0.0
            if (
                depth < 60.0 and abs(side - place[3]) < 3.0 * place[4]
            ):  # the outline gives way around the tip, less and less with depth
                dent = place[2] * math.exp(-(((side - place[3]) / place[4]) ** 2) - max(depth, 0.0) / 25.0)
            pad = _outside(boxes[0], depth - dent, side)
            a_pad = _edge(pad, sigma)
            plate = _outside(boxes[1], depth, side)
            a_plate = _edge(plate, sigma)
            a_arm = _edge(_outside(boxes[2], depth, side), sigma)
            dim = 1.0
            if a_pad < 1.0 and a_plate < 1.0 and a_arm < 1.0:
                fall_depth, fall_side = depth - shadow[0], side - shadow[1]
                fall = min(_outside(boxes[0], fall_depth, fall_side), _outside(boxes[1], fall_depth, fall_side))
                fall = min(fall, _outside(boxes[2], fall_depth, fall_side))
                lit = min(1.0, max(0.0, 0.5 + fall / 40.0))
                dim -= 0.22 * (1.0 - lit * lit * (3.0 - 2.0 * lit))
                if a_pad + a_plate + a_arm == 0.0:
                    for c in range(3):
                        clean[v, u, c] *= dim
                    continue
            tu, tv = depth + 1024.0, side + 1024.0
            iu, iv = int(tu), int(tv)
            fu, fv = tu - iu, tv - iv
            x0, x1, y0, y1 = iu & 255, (iu + 1) & 255, iv & 255, (iv + 1) & 255
            mottle = (tile[y0, x0] * (1 - fu) + tile[y0, x1] * fu) * (1 - fv) + (
                tile[y1, x0] * (1 - fu) + tile[y1, x1] * fu
            ) * fv
            # The silicone is a little lighter along its rim, where light comes through it; the plate has a bright edge.
            glow = 1.0 + 0.022 * mottle
            if a_pad > 0.0 and pad > -20.0:
                glow += 0.06 * math.exp(min(pad, 0.0) / 5.0)
            bar = (side - middle) / half
            round_bar = 1.0 + 0.06 * bar - 0.16 * bar * bar
            steel = 1.0 + 0.008 * mottle + 0.10 * _edge(abs(plate + 1.5) - 0.8, 0.9)
            for c in range(3):
                value = clean[v, u, c] * dim
                value += a_arm * (colours[2, c] * round_bar - value)
                value += a_plate * (colours[1, c] * steel - value)
                value += a_pad * (colours[0, c] * glow - value)
                clean[v, u, c] = value


@njit(cache=True, error_model="numpy", fastmath=STEADY)
def _distances(nodes: FloatArray, arc: float, reach: float, near: Picture, u0: int, v0: int) -> None:
    """Fill ``near`` (h, w, 4) with squared distance to the polyline, the vector from it, and arc length.

    All in px; ``arc``: arc length at the first node.
    """
    h, w = near.shape[:2]
    for v in range(h):
        for u in range(w):
            near[v, u, 0] = _FAR
    for i in range(nodes.shape[0] - 1):
        ax, ay = nodes[i, 0] - u0, nodes[i, 1] - v0
        bx, by = nodes[i + 1, 0] - u0, nodes[i + 1, 1] - v0
        ex, ey = bx - ax, by - ay
        square = ex * ex + ey * ey
        length = math.sqrt(square)
        for v in range(max(0, int(min(ay, by) - reach)), min(h, int(max(ay, by) + reach) + 2)):
            for u in range(max(0, int(min(ax, bx) - reach)), min(w, int(max(ax, bx) + reach) + 2)):
                px, py = u - ax, v - ay
                share = min(1.0, max(0.0, (px * ex + py * ey) / square))
                rx, ry = px - share * ex, py - share * ey
                distance = rx * rx + ry * ry
                if distance < near[v, u, 0]:
                    near[v, u, 0], near[v, u, 1], near[v, u, 2] = distance, rx, ry
                    near[v, u, 3] = arc + share * length
        arc += length


@njit(cache=True, error_model="numpy", fastmath=STEADY)
def draw_catheter(
    clean: Picture,
    shapes: FloatArray,
    behind: float,
    radius: float,
    sigma: float,
    metal: FloatArray,
    light: FloatArray,
    brightness: float,
    shadow: FloatArray,
) -> None:
    """The catheter over ``clean`` (h, w, 3), in place: the mean of ``shapes`` (k, n, 2) px.

    Each goes from ``behind`` px behind the base to the middle of the dome.

    A glossy cylinder, dark polymer and lighter metal, lit from ``light``; its soft shadow falls by ``shadow`` px.
    """
    margin = radius + _SHADOW_PX + 4.0
    h, w = clean.shape[:2]
    # The buffers reach beyond the picture, so that what lies outside still throws its shadow into it.
    u0 = max(-int(2 * margin), int(np.min(shapes[:, :, 0]) - margin))
    v0 = max(-int(2 * margin), int(np.min(shapes[:, :, 1]) - margin))
    u1 = min(w, int(np.max(shapes[:, :, 0]) + margin + 2))
    v1 = min(h, int(np.max(shapes[:, :, 1]) + margin + 2))
    if u1 <= max(u0, 0) or v1 <= max(v0, 0):
        return
    near = np.empty((v1 - v0, u1 - u0, 4), np.float32)
    drawn = np.zeros((v1 - v0, u1 - u0, 4), np.float32)
    fall_u, fall_v = math.floor(shadow[0] + 0.5), math.floor(shadow[1] + 0.5)
    count = shapes.shape[0]
    # Halfway between light and camera: where a glossy surface must point to shine.
    half_u, half_v, half_w = light[0], light[1], light[2] + 1.0
    norm = math.sqrt(half_u**2 + half_v**2 + half_w**2)
    half_u, half_v, half_w = half_u / norm, half_v / norm, half_w / norm
    for k in range(count):
        middle = k == count // 2
        _distances(shapes[k], -behind, radius + (_SHADOW_PX if middle else 4.0), near, u0, v0)
        for v in range(max(0, -v0), v1 - v0):
            for u in range(max(0, -u0), u1 - u0):
                if middle:
                    fv, fu = v - fall_v, u - fall_u
                    if 0 <= fv < v1 - v0 and 0 <= fu < u1 - u0 and near[fv, fu, 0] < (radius + _SHADOW_PX) ** 2:
                        far = math.sqrt(near[fv, fu, 0]) / (0.8 * radius + 3.0)
                        dim = 1.0 - 0.20 * math.exp(-far * far)
                        for c in range(3):
                            clean[v0 + v, u0 + u, c] *= dim
                square = near[v, u, 0]
                if square > (radius + 3.5 * sigma) ** 2:
                    continue
                away = math.sqrt(square)
                alpha = _edge(away - radius, sigma) / count
                shrink = 1.0 / max(radius, away * 1.02)
                nu, nv = near[v, u, 1] * shrink, near[v, u, 2] * shrink
                nw = math.sqrt(max(0.0, 1.0 - nu * nu - nv * nv))
                lit = max(0.0, nu * light[0] + nv * light[1] + nw * light[2])
                shine = max(0.0, nu * half_u + nv * half_v + nw * half_w)
                shine *= shine
                shine *= shine
                shine *= shine  # to the 8th power: brushed metal
                gloss = shine * shine
                gloss *= gloss  # to the 32nd: polymer
                share = metal[min(metal.size - 1, max(0, int(4.0 * near[v, u, 3])))]
                dark = 24.0 + 26.0 * lit + 75.0 * gloss
                bright = 52.0 + 48.0 * lit + 62.0 * shine
                drawn[v, u, 0] += alpha
                drawn[v, u, 1] += alpha * (dark * 0.96 + share * (bright * 1.0 - dark * 0.96))
                drawn[v, u, 2] += alpha * (dark + share * (bright * 0.99 - dark))
                drawn[v, u, 3] += alpha * (dark * 1.08 + share * (bright * 0.96 - dark * 1.08))
    for v in range(max(0, -v0), v1 - v0):
        for u in range(max(0, -u0), u1 - u0):
            alpha = drawn[v, u, 0]
            if alpha > 0.0:
                for c in range(3):
                    value = clean[v0 + v, u0 + u, c]
                    clean[v0 + v, u0 + u, c] = value * (1 - alpha) + brightness * drawn[v, u, 1 + c]


@njit(cache=True, error_model="numpy", fastmath=STEADY)
def add_noise(clean: Picture, noise: Picture, starts: npt.NDArray[np.int64], grey: float, image: Image) -> None:
    """``clean`` (h, w, 3) plus noise, rounded, into ``image``. Row v takes its noise from place ``starts[v]``.

    Read noise and shot noise: the spread grows with the level, and is ``grey`` at level 128.
    """
    h = clean.shape[0]
    flat = clean.reshape(h, -1)
    out = image.reshape(h, -1)
    floor, slope = np.float32(0.55 * grey), np.float32(0.45 * grey / 128.0)
    for v in range(h):
        row, target = flat[v], out[v]
        chance = noise[starts[v] : starts[v] + row.size]
        for i in range(row.size):
            value = row[i] + chance[i] * (floor + slope * row[i]) + np.float32(0.5)
            target[i] = np.uint8(min(max(value, np.float32(0.0)), np.float32(255.0)))
