"""Synthetic images of a tube with exact truth, for the tests of vision.

Every image is drawn at four times its size from the distance to an exactly known curve, shrunk by areas, blurred,
lit and made noisy. The truth is the curve itself, far finer than the pixels, cut at the base's border.
"""

import math
from dataclasses import dataclass, field

import cv2
import numpy as np
from numba import njit

SUPER = 4
SPACING = 0.2


@dataclass(frozen=True)
class Look:
    """Settings of a drawn tube; grey levels 0..255, lengths in pixels."""

    size: tuple[int, int] = (640, 480)
    diameter: float = 12.0
    shaft: float = 60.0
    ground: float = 190.0
    noise: float = 5.0
    blur: float = 1.0
    rings: int = 3
    ring_width: float = 8.0
    ring_grey: float = 215.0
    gradient: float = 0.25
    tip: str = "dome"
    electrode: float | None = None
    electrode_length: float = 40.0
    highlight: float = 0.0
    shadow: float = 0.0
    texture: float = 0.0
    gap: float = 0.0
    cable: float = 0.0
    cable_grey: float = 60.0
    tissue: float | None = None
    exposure: float = 0.0
    vignette: float = 0.0
    colour: bool = True
    length: tuple[float, float] = (200.0, 340.0)
    turning: float = 2.2


@dataclass(frozen=True)
class Tube:
    """One image and its truth: ``curve`` (n, 2) u, v from the base's border to the tip, about 0.2 px apart."""

    image: np.ndarray
    curve: np.ndarray
    side: str
    look: Look = field(repr=False)


def light_on_dark(look: Look) -> Look:
    """The same image with the greys turned round."""
    from dataclasses import replace

    return replace(
        look,
        shaft=250 - look.shaft,
        ground=250 - look.ground,
        ring_grey=250 - look.ring_grey,
        cable_grey=250 - look.cable_grey,
        electrode=None if look.electrode is None else 250 - look.electrode,
        tissue=None if look.tissue is None else 250 - look.tissue,
    )


@njit  # no cache: it would tie this file to the name it was first imported under
def _field(points, tangents, reach, width, height, distance, along, across):
    for k in range(points.shape[0]):
        cx, cy = points[k, 0], points[k, 1]
        for y in range(max(0, int(cy - reach)), min(height, int(cy + reach) + 2)):
            for x in range(max(0, int(cx - reach)), min(width, int(cx + reach) + 2)):
                dx, dy = x - cx, y - cy
                d2 = dx * dx + dy * dy
                if d2 < distance[y, x]:
                    distance[y, x] = d2
                    along[y, x] = k
                    across[y, x] = -tangents[k, 1] * dx + tangents[k, 0] * dy


def shape(rng: np.random.Generator, length: float, turning: float) -> np.ndarray:
    """(n, 2) points of a smooth random curve from (0, 0) along +x: sums of three cosines of curvature."""
    n = int(length / SPACING)
    x = (np.arange(n) + 0.5) / n
    curvature = sum(rng.normal() / (1 + k) * np.cos(math.pi * k * x) for k in range(4))
    angle = np.cumsum(curvature) / n
    angle *= rng.uniform(0.0, turning) / max(1e-9, float(np.abs(angle).max()))
    angle += rng.uniform(-0.5, 0.5)
    steps = np.stack([np.cos(angle), np.sin(angle)], axis=1) * SPACING
    return np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])


def _fits(points: np.ndarray, look: Look, size: tuple[int, int]) -> bool:
    w, h = size
    margin = look.diameter / 2 + 14
    inner = points[int(60 / SPACING) :]
    if inner[:, 0].min() < margin or points[:, 0].max() > w - 1 - margin:
        return False
    if points[:, 1].min() < margin or points[:, 1].max() > h - 1 - margin:
        return False
    turn = np.diff(np.unwrap(np.arctan2(*np.diff(points, axis=0).T[::-1]))) / SPACING
    if np.abs(turn).max() > 1 / max(3.0 * look.diameter, 30.0):
        return False
    coarse = points[:: int(5 / SPACING)]
    gap = np.linalg.norm(coarse[:, None] - coarse[None], axis=2)
    apart = np.abs(np.subtract.outer(np.arange(len(coarse)), np.arange(len(coarse)))) * 5
    return bool(gap[apart > 5 * look.diameter].min(initial=1e9) > 3 * look.diameter)


def draw(rng: np.random.Generator, look: Look, side: str = "left") -> Tube:
    """One random image whose tube enters from ``side``."""
    w, h = look.size if side in ("left", "right") else look.size[::-1]
    for _ in range(2000):
        lead = 40.0
        points = shape(rng, rng.uniform(*look.length), look.turning)
        start = np.array([0.0, rng.uniform(0.2, 0.8) * h])
        back = points[1] - points[0]
        back = back / np.linalg.norm(back)
        before = -back * np.arange(lead, 0, -SPACING)[:, None]
        whole = np.vstack([before, points]) + start
        if _fits(points + start, look, (w, h)):
            break
    else:
        raise ValueError("no shape of this length fits this image")
    image = _render(rng, look, whole, (w, h), lead)
    curve = whole[whole[:, 0] >= -0.5]
    if side == "right":
        image, curve = image[:, ::-1], np.stack([w - 1 - curve[:, 0], curve[:, 1]], axis=1)
    elif side == "top":
        image, curve = image.swapaxes(0, 1), curve[:, ::-1]
    elif side == "bottom":
        image, curve = image.swapaxes(0, 1)[::-1], np.stack([curve[:, 1], w - 1 - curve[:, 0]], axis=1)
    return Tube(np.ascontiguousarray(image), np.ascontiguousarray(curve), side, look)


def _soft_noise(rng: np.random.Generator, w: int, h: int, scale: float) -> np.ndarray:
    rough = rng.normal(size=(int(h / scale) + 3, int(w / scale) + 3)).astype(np.float32)
    return cv2.resize(rough, (w, h), interpolation=cv2.INTER_CUBIC)


def _render(rng: np.random.Generator, look: Look, curve: np.ndarray, size: tuple[int, int], lead: float) -> np.ndarray:
    w, h = size
    r = look.diameter / 2
    big_w, big_h = w * SUPER, h * SUPER
    fine = (curve + 0.5) * SUPER - 0.5
    tangents = np.gradient(curve, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1)[:, None]
    reach = (r + 1.5) * SUPER
    distance = np.full((big_h, big_w), np.float32(1e9))
    along = np.zeros((big_h, big_w), np.int32)
    across = np.zeros((big_h, big_w), np.float32)
    _field(fine, tangents, reach, big_w, big_h, distance, along, across)
    band = distance < (r * SUPER) ** 2
    if look.tip == "flat":
        last, ahead = fine[-1], tangents[-1]
        rows, cols = np.nonzero(band & (along == len(fine) - 1))
        over = (cols - last[0]) * ahead[0] + (rows - last[1]) * ahead[1] > 0
        band[rows[over], cols[over]] = False
    s = along[band] * SPACING - lead
    lateral = across[band] / SUPER
    total = len(curve) * SPACING - lead
    grey = np.full(s.shape, look.shaft, np.float32)
    if look.highlight:
        grey += look.highlight * np.exp(-(((lateral - 0.25 * r) / (0.18 * r)) ** 2)).astype(np.float32)
    if look.electrode is not None:
        metal = s > total - look.electrode_length
        shine = np.where(np.abs(lateral - 0.2 * r) < 0.3 * r, 30, 0) * np.sign(look.ground - look.shaft)
        grey[metal] = look.electrode + shine[metal]
    visible = np.ones(s.shape, np.float32)
    for k in range(look.rings):
        at = total * (0.35 + 0.5 * k / max(1, look.rings - 1))
        grey[np.abs(s - at) < look.ring_width / 2] = look.ring_grey
    if look.gap:
        visible[np.abs(s - 0.55 * total) < look.gap / 2] = 0.0
    cover = np.zeros((big_h, big_w), np.float32)
    tint = np.zeros((big_h, big_w), np.float32)
    cover[band], tint[band] = visible, grey * visible
    small = (w, h)
    cover = cv2.resize(cover, small, interpolation=cv2.INTER_AREA)
    tint = cv2.resize(tint, small, interpolation=cv2.INTER_AREA)

    ground = np.full((h, w), look.ground, np.float32)
    if look.texture:
        ground += look.texture * (_soft_noise(rng, w, h, 6) + _soft_noise(rng, w, h, 25))
    if look.tissue is not None:
        tip, ahead = curve[-1] + (r if look.tip == "dome" else 0) * tangents[-1] * 0.7, tangents[-1]
        tilt = rng.uniform(-0.8, 0.8)
        normal = np.array(
            [
                ahead[0] * math.cos(tilt) - ahead[1] * math.sin(tilt),
                ahead[0] * math.sin(tilt) + ahead[1] * math.cos(tilt),
            ]
        )
        vv, uu = np.mgrid[0:h, 0:w].astype(np.float32)
        deep = (uu - tip[0]) * normal[0] + (vv - tip[1]) * normal[1]
        mass = np.clip(deep + 0.5, 0, 1) * (deep < 90)
        ground = ground * (1 - mass) + mass * (look.tissue + 0.1 * (ground - look.ground))
    if look.shadow:
        shift = np.array([[1, 0, 0.5 * look.diameter], [0, 1, 0.9 * look.diameter]], np.float32)
        dark = cv2.GaussianBlur(cv2.warpAffine(cover, shift, small), (0, 0), look.diameter * 0.35)
        ground *= 1 - look.shadow * dark
    image = ground * (1 - cover) + tint
    if look.cable:
        k = int(len(curve) * rng.uniform(0.5, 0.75))
        slant = math.atan2(tangents[k][1], tangents[k][0]) + rng.uniform(0.7, 2.4)
        way = np.array([math.cos(slant), math.sin(slant)])
        vv, uu = np.mgrid[0:h, 0:w].astype(np.float32)
        off = np.abs((uu - curve[k][0]) * -way[1] + (vv - curve[k][1]) * way[0])
        wire = np.clip(look.cable / 2 - off + 0.5, 0, 1)
        image = image * (1 - wire) + look.cable_grey * wire
    if look.gradient or look.vignette:
        vv, uu = np.mgrid[-1 : 1 : complex(0, h), -1 : 1 : complex(0, w)].astype(np.float32)
        turn = rng.uniform(0, 2 * math.pi)
        light = 1 + 0.5 * look.gradient * (uu * math.cos(turn) + vv * math.sin(turn))
        image *= light * (1 - look.vignette * (uu**2 + vv**2) / 2)
    if look.exposure:
        turn = rng.uniform(0, math.pi)
        n = max(3, int(look.exposure * 2) | 1)
        kernel = np.zeros((n, n), np.float32)
        for t in np.linspace(-look.exposure / 2, look.exposure / 2, 8 * n):
            kernel[round(n // 2 + t * math.sin(turn)), round(n // 2 + t * math.cos(turn))] += 1
        image = cv2.filter2D(image, -1, kernel / kernel.sum(), borderType=cv2.BORDER_REPLICATE)
    if look.blur:
        image = cv2.GaussianBlur(image, (0, 0), look.blur, borderType=cv2.BORDER_REPLICATE)
    image = image[:, :, None].repeat(3, axis=2) if look.colour else image
    if look.colour:
        image = image * np.array([1.02, 1.0, 0.95], np.float32)
    noisy = image + rng.standard_normal(image.shape, np.float32) * look.noise
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def distance_to_curve(points: np.ndarray, curve: np.ndarray) -> np.ndarray:
    """(n,) distances of ``points`` to the polyline ``curve``, extended straight at both ends."""
    ends = np.vstack([curve[0] + (curve[0] - curve[1]) * 50, curve, curve[-1] + (curve[-1] - curve[-2]) * 50])
    a, b = ends[:-1], ends[1:]
    ab = b - a
    t = np.clip(((points[:, None] - a) * ab).sum(2) / (ab**2).sum(1), 0, 1)
    return np.linalg.norm(points[:, None] - (a + t[..., None] * ab), axis=2).min(1)


def tip_along(points: np.ndarray, tube: Tube) -> float:
    """Signed error of the last point along the shaft; a dome's true tip is a radius beyond the curve's end."""
    tangent = tube.curve[-1] - tube.curve[-3]
    tangent = tangent / np.linalg.norm(tangent)
    true_tip = tube.curve[-1] + (tube.look.diameter / 2 if tube.look.tip == "dome" else 0.0) * tangent
    return float((points[-1] - true_tip) @ tangent)
