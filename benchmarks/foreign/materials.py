"""Materials for Mitsuba, drawn by chance: plastic and metal, and grounds with textures made here."""

from typing import Any

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter

from tipforce.types import FloatArray

__all__ = ["brushed", "cloth", "mottled", "paper", "plain", "wood"]

SIZE = 2048
MM_PER_TEXEL = 300.0 / SIZE
"""The ground is 300 mm wide."""
COLOURS = np.array(
    [[0.02, 0.05, 0.2], [0.02, 0.02, 0.02], [0.75, 0.75, 0.72], [0.6, 0.32, 0.04], [0.03, 0.2, 0.1], [0.25, 0.26, 0.28],
     [0.5, 0.04, 0.04], [0.1, 0.3, 0.5], [0.65, 0.6, 0.45]]
)  # fmt: skip
"""Linear reflectance of plastics."""


def plain(rng: np.random.Generator, *, metal: bool) -> dict[str, Any]:
    """Plastic of any colour or metal, glossy to matt."""
    if metal:
        shine = rng.uniform(0.45, 0.9) * (1 + rng.uniform(-0.06, 0.06, 3))
        return {
            "type": "roughconductor",
            "material": "none",
            "alpha": float(rng.uniform(0.08, 0.35)),
            "specular_reflectance": _rgb(shine),
        }
    colour = np.clip(COLOURS[rng.integers(len(COLOURS))] * rng.uniform(0.7, 1.25, 3), 0.01, 0.85)
    return {
        "type": "principled",
        "base_color": _rgb(colour),
        "roughness": float(rng.uniform(0.2, 0.6)),
        "specular": 0.5,
    }


def cloth(mi: Any, rng: np.random.Generator) -> dict[str, Any]:
    """Plain weave, with threads that differ and folds."""
    period = rng.uniform(0.9, 1.8) / MM_PER_TEXEL
    y, x = np.mgrid[:SIZE, :SIZE] + 3.0 * np.stack([_noise(rng, 60), _noise(rng, 60)])
    warp, weft = np.sin(2 * np.pi * x / period), np.sin(2 * np.pi * y / period)
    over = np.where((np.floor(x / period) + np.floor(y / period)) % 2 > 0, np.abs(warp), np.abs(weft))
    threads = 1 + 0.15 * gaussian_filter(rng.standard_normal((SIZE, 1)), (2, 0))
    light = (0.55 + 0.45 * over) * threads * (1 + 0.1 * _noise(rng, 80))
    base = np.array([[0.1, 0.35, 0.3], [0.12, 0.25, 0.45], [0.7, 0.7, 0.68], [0.3, 0.3, 0.32], [0.5, 0.42, 0.3]])
    return _diffuse(mi, light[..., None] * base[rng.integers(5)])


def paper(mi: Any, rng: np.random.Generator) -> dict[str, Any]:
    """White or cream, blank or with ruled lines, and lines of print."""
    page = np.ones((SIZE, SIZE, 3)) * rng.uniform(0.65, 0.82) * (1 + rng.uniform(-0.04, 0.04, 3))
    page *= (1 + 0.015 * _noise(rng, 3) + 0.02 * _noise(rng, 100))[..., None]
    ink = np.ones((SIZE, SIZE), np.float32)
    kind = rng.integers(3)
    if kind == 0:
        step = int(rng.uniform(4.0, 6.0) / MM_PER_TEXEL)
        ink[::step] = ink[:, ::step] = 0.6
    elif kind == 1:
        for line in range(20, SIZE, int(rng.uniform(5.0, 8.0) / MM_PER_TEXEL)):
            cv2.putText(ink, _words(rng), (30, line), cv2.FONT_HERSHEY_SIMPLEX, 0.6, 0.15, 1, cv2.LINE_AA)
    return _diffuse(mi, page * cv2.GaussianBlur(ink, (0, 0), 0.6)[..., None])


def wood(mi: Any, rng: np.random.Generator) -> dict[str, Any]:
    """Rings cut lengthwise, with pores."""
    y, x = np.mgrid[:SIZE, :SIZE] * MM_PER_TEXEL
    rings = y / rng.uniform(4.0, 10.0) + 0.6 * _noise(rng, (40, 400)) + 0.1 * np.sin(x / 30)
    grain = 0.5 + 0.5 * np.sin(2 * np.pi * rings)
    pores = np.clip(_noise(rng, (0.7, 14)), -2, 2)
    dark, bright = np.array([0.2, 0.1, 0.05]), np.array([0.5, 0.33, 0.18])
    tone = rng.uniform(0.7, 1.3)
    return _diffuse(mi, tone * (dark + (bright - dark) * grain[..., None]) * (1 + 0.1 * pores[..., None]))


def brushed(mi: Any, rng: np.random.Generator) -> dict[str, Any]:
    """Brushed aluminium or steel: mirrors the room along the strokes."""
    strokes = _noise(rng, (0.7, 60)) + 0.5 * _noise(rng, (1.5, 120))
    shine = rng.uniform(0.4, 0.7) * (1 + 0.08 * strokes + 0.03 * _noise(rng, 200))
    return {
        "type": "roughconductor",
        "material": "none",
        "alpha_u": float(rng.uniform(0.12, 0.2)),
        "alpha_v": float(rng.uniform(0.3, 0.45)),
        "specular_reflectance": _bitmap(mi, np.repeat(shine[..., None], 3, axis=2)),
    }


def mottled(mi: Any, rng: np.random.Generator) -> dict[str, Any]:
    """Laminate or skin-like board: a colour with spots of several sizes."""
    spots = 0.12 * _noise(rng, 1.2) + 0.1 * _noise(rng, 8) + 0.1 * _noise(rng, 50)
    base = COLOURS[rng.integers(len(COLOURS))] * 0.8 + 0.08
    return _diffuse(mi, base * (1 + spots[..., None]))


def _noise(rng: np.random.Generator, blur: float | tuple[float, float]) -> FloatArray:
    """(SIZE, SIZE): smooth noise of unit spread; made small where it is so smooth that nobody sees the difference."""
    sigma = np.broadcast_to(np.asarray(blur, float), 2)
    step = np.maximum(1, (sigma // 4).astype(int))
    small = gaussian_filter(rng.standard_normal(-(-SIZE // step)), sigma / step, mode="wrap").astype(np.float32)
    return cv2.resize(small / small.std(), (SIZE, SIZE), interpolation=cv2.INTER_CUBIC)


def _words(rng: np.random.Generator) -> str:
    letters = "abcdefghiklmnoprstuvw"
    return " ".join("".join(rng.choice(list(letters), rng.integers(2, 10))) for _ in range(60))


def _rgb(colour: FloatArray) -> dict[str, Any]:
    return {"type": "rgb", "value": [float(each) for each in colour]}


def _bitmap(mi: Any, linear: FloatArray) -> dict[str, Any]:
    image = np.clip(linear, 0.01, 0.92).astype(np.float32)
    return {"type": "bitmap", "bitmap": mi.Bitmap(image), "raw": True, "wrap_mode": "mirror"}


def _diffuse(mi: Any, linear: FloatArray) -> dict[str, Any]:
    return {"type": "diffuse", "reflectance": _bitmap(mi, linear)}
