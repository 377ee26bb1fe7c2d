"""Tubes drawn with shading, bands and gloss: catheters, sheaths, cables, posts and fingers."""

import math
from dataclasses import dataclass, field

import numba
import numpy as np
import numpy.typing as npt

Float = npt.NDArray[np.float64]
Float32 = npt.NDArray[np.float32]

STATIONS = 96
"""Colour stations along a tube."""


@dataclass(slots=True)
class SceneCanvas:
    """An image in linear light, with the kind of each pixel.

    ``light`` (h, w, 3) in 0..1; ``kind`` (h, w): visible object, one of the constants of `scene`; ``own`` (h, w): share
    of the pixel in which the catheter itself is seen.
    """

    light: Float32
    kind: npt.NDArray[np.uint8]
    own: Float32

    @classmethod
    def empty(cls, light: Float32) -> "SceneCanvas":
        """A canvas with a ground (h, w, 3) and nothing on it."""
        shape = light.shape[:2]
        return cls(light, np.zeros(shape, np.uint8), np.zeros(shape, np.float32))


@dataclass(slots=True)
class Surface:
    """Appearance of a tube.

    ``colour`` (STATIONS, 3): albedo along the tube; ``gloss``: strength of the highlight, per station; ``shininess``:
    its exponent; ``cover``: 1 opaque; ``braid``: contrast, turns along the tube; ``attenuation`` (STATIONS,): of X-rays
    along a diameter, 0 for visible light.
    """

    colour: Float32
    gloss: Float32
    shininess: float = 20.0
    cover: float = 1.0
    braid: tuple[float, float] = (0.0, 0.0)
    attenuation: Float32 = field(default_factory=lambda: np.zeros(STATIONS, np.float32))
    blunt: bool = False


@dataclass(slots=True)
class Lights:
    """Two lamps and the ambient light. ``directions`` (2, 3): unit vectors u, v, toward the camera."""

    directions: Float
    strengths: Float
    ambient: float


@numba.njit(cache=True, nogil=True, fastmath={"nnan", "ninf", "nsz"})
def _field(points, radius, h, w, distance, station, side, blunt):
    """Fills, for the pixels near the polyline, distance to it, station (0..n-1) and signed side in radii."""
    n = points.shape[0]
    for i in range(n - 1):
        ax, ay, bx, by = points[i, 0], points[i, 1], points[i + 1, 0], points[i + 1, 1]
        dx, dy = bx - ax, by - ay
        size = dx * dx + dy * dy
        if size < 1e-9:
            continue
        root = math.sqrt(size)
        reach = max(radius[i], radius[i + 1]) + 1.5
        u0, u1 = max(int(min(ax, bx) - reach), 0), min(int(max(ax, bx) + reach) + 2, w)
        v0, v1 = max(int(min(ay, by) - reach), 0), min(int(max(ay, by) + reach) + 2, h)
        for v in range(v0, v1):
            for u in range(u0, u1):
                px, py = u - ax, v - ay
                t = (px * dx + py * dy) / size
                if t < 0.0:
                    if i == 0 and blunt:
                        continue
                    t = 0.0
                elif t > 1.0:
                    if i == n - 2 and blunt:
                        continue
                    t = 1.0
                ex, ey = px - t * dx, py - t * dy
                d = math.sqrt(ex * ex + ey * ey)
                if d < distance[v, u] and d < reach:
                    distance[v, u] = d
                    station[v, u] = i + t
                    side[v, u] = (px * dy - py * dx) / root


@numba.njit(cache=True, nogil=True, fastmath={"nnan", "ninf", "nsz"})
def _shade(
    light, kind, own, points, radius, distance, station, side, box, colour, gloss, shininess, cover, braid, turns,
    attenuation, directions, strengths, ambient, label, is_own,
):  # fmt: skip
    n, stations = points.shape[0], colour.shape[0]
    for v in range(box[0], box[1]):
        for u in range(box[2], box[3]):
            d = distance[v, u]
            if d > 1e8:
                continue
            at = station[v, u]
            distance[v, u] = 1e9
            i = min(int(at), n - 2)
            f = at - i
            r = radius[i] + (radius[i + 1] - radius[i]) * f
            alpha = min(max(r + 0.5 - d, 0.0), 1.0)
            if alpha <= 0.0:
                continue
            place = at / (n - 1) * (stations - 1)
            k = min(int(place), stations - 2)
            g = place - k
            t = min(d / max(r, 0.5), 1.0)
            nz = math.sqrt(max(1.0 - t * t, 0.0))
            mu = attenuation[k] + (attenuation[k + 1] - attenuation[k]) * g
            if mu > 0.0:
                through = math.exp(-mu * max(nz, 0.15) * alpha)
                for c in range(3):
                    light[v, u, c] *= through
                if is_own:
                    own[v, u] = max(own[v, u], alpha)
                if alpha > 0.5:
                    kind[v, u] = label
                continue
            dx, dy = points[i + 1, 0] - points[i, 0], points[i + 1, 1] - points[i, 1]
            root = max(math.sqrt(dx * dx + dy * dy), 1e-6)
            sign = 1.0 if side[v, u] > 0.0 else -1.0
            nx, ny = sign * t * dy / root, -sign * t * dx / root
            bright, shine = ambient, 0.0
            for lamp in range(directions.shape[0]):
                lx, ly, lz = directions[lamp, 0], directions[lamp, 1], directions[lamp, 2]
                cosine = nx * lx + ny * ly + nz * lz
                if cosine > 0.0:
                    bright += strengths[lamp] * cosine
                    mirror = 2.0 * cosine * nz - lz
                    if mirror > 0.0:
                        shine += strengths[lamp] * mirror**shininess
            if braid > 0.0:
                around = math.asin(min(t, 0.999)) * sign
                bright *= 1.0 + braid * math.sin(6.2832 * turns * at / (n - 1) + 3.0 * around) * math.sin(
                    6.2832 * turns * at / (n - 1) - 3.0 * around
                )
            shine *= gloss[k] + (gloss[k + 1] - gloss[k]) * g
            weight = alpha * cover
            for c in range(3):
                value = (colour[k, c] + (colour[k + 1, c] - colour[k, c]) * g) * bright + shine
                light[v, u, c] += weight * (value - light[v, u, c])
            if is_own:
                own[v, u] = max(own[v, u], alpha)
            else:
                own[v, u] *= 1.0 - weight
            if weight > 0.5:
                kind[v, u] = label


class Drawer:
    """Draws tubes into canvases of one size; holds the buffers."""

    def __init__(self, height: int, width: int) -> None:
        self._distance = np.full((height, width), 1e9, np.float32)
        self._station = np.zeros((height, width), np.float32)
        self._side = np.zeros((height, width), np.float32)

    def tube(
        self, canvas: SceneCanvas, points: Float, radius: Float | float, surface: Surface, lights: Lights, kind: int,
        *, is_catheter: bool = False,
    ) -> None:  # fmt: skip
        """Draws a tube over the image.

        Args:
            canvas: image that is changed.
            points: (n, 2) px, its axis.
            radius: (n,) or one number, px.
            surface: its appearance.
            lights: the lamps.
            kind: the label of its pixels.
            is_catheter: its cover is kept in ``canvas.own``; every other tube hides the catheter below it.
        """
        h, w = canvas.kind.shape
        widths = np.broadcast_to(np.asarray(radius, np.float64), (len(points),)).copy()
        reach = float(widths.max()) + 2.0
        low, high = points.min(axis=0) - reach, points.max(axis=0) + reach
        box = np.array(
            [max(int(low[1]), 0), min(int(high[1]) + 2, h), max(int(low[0]), 0), min(int(high[0]) + 2, w)], np.int64
        )
        if box[1] <= box[0] or box[3] <= box[2]:
            return
        axis = np.ascontiguousarray(points, np.float64)
        _field(axis, widths, h, w, self._distance, self._station, self._side, surface.blunt)
        _shade(
            canvas.light, canvas.kind, canvas.own, axis, widths, self._distance, self._station, self._side, box,
            surface.colour, surface.gloss, surface.shininess, surface.cover, surface.braid[0], surface.braid[1],
            surface.attenuation, lights.directions, lights.strengths, lights.ambient, kind, is_catheter,
        )  # fmt: skip
