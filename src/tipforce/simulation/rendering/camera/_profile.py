"""What a lit, blurred tube looks like across: tables by direction, blur and distance from its middle.

Shading depends on the surface's normal alone (lamps and camera are far away against the tube's width). A session's
lamps and finish never change, so shading and blur are integrated once; drawing a pixel is then one look-up.
"""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import ndtr

from ....types import FloatArray

__all__ = ["STEPS_PER_PX", "Lamp", "TubeFinish", "TubeProfile", "tube_profile"]

Picture = npt.NDArray[np.float32]

STEPS_PER_PX = 8
"""Steps of the tables across: interpolated linearly between, which is within 0.001 of the contrast for any blur."""
_DIRECTIONS = 64
_BLURS = 5
_CELLS = 96


@dataclass(frozen=True, slots=True)
class Lamp:
    """``direction`` (3,): unit vector to the lamp: right, down, to the camera. ``strength``: share of the light."""

    direction: tuple[float, float, float]
    strength: float


@dataclass(frozen=True, slots=True)
class TubeFinish:
    """How a tube's surface takes the light; levels are what a camera sees at light 1, grey or (red, green, blue).

    ``shaft`` and ``metal``: levels of a face turned to the camera. ``gloss_grey``: the most a highlight adds.
    ``sharpness``: exponent of the shaft's highlight. ``rim_grey``: what the silhouette mirrors of the ground (Fresnel).
    """

    shaft: tuple[float, float, float]
    metal: tuple[float, float, float]
    gloss_grey: float
    sharpness: float
    rim_grey: float
    metal_sharpness: float


@dataclass(frozen=True, slots=True, eq=False)
class TubeProfile:
    """``table`` (blur, direction, across, 4) float32: cover; matte light, gloss and metal light times cover.

    Across: from ``-reach_px`` to ``reach_px`` for a tube of ``half_width_px``; gloss in grey levels, the others as a
    share. Direction: of the axis, whole turn. Blur: sigma from ``blur_px[0]`` to ``blur_px[1]``.
    """

    table: Picture
    half_width_px: float
    reach_px: float
    blur_px: tuple[float, float]


def _lobe(normal: FloatArray, lamp: Lamp, sharpness: float) -> FloatArray:
    """Highlight of ``lamp`` where ``normal`` (..., 3) lies halfway between it and the camera."""
    half = np.array(lamp.direction) + np.array([0.0, 0.0, 1.0])
    half /= np.linalg.norm(half)
    return np.maximum(0.0, normal @ half) ** sharpness


def _shade(normal: FloatArray, lamps: tuple[Lamp, ...], ambient: float, finish: TubeFinish) -> FloatArray:
    """(..., 3) matte, gloss, metal of surfaces with ``normal`` (..., 3)."""
    facing = ambient + sum(lamp.strength * lamp.direction[2] for lamp in lamps)
    matte = ambient * (0.6 + 0.4 * normal[..., 2])
    gloss = finish.rim_grey * (1.0 - normal[..., 2]) ** 4
    mirrored_z = 2.0 * normal[..., 2] ** 2 - 1.0
    # Brushed metal mirrors a room that is bright above, dark at the level of the table, and grey where the table is.
    metal = 0.55 + 0.25 * mirrored_z + 0.25 * (1.0 - normal[..., 2]) ** 3
    for lamp in lamps:
        # A lamp of some size still lights a face that is turned a little away from its middle.
        lit = np.maximum(0.0, normal @ np.array(lamp.direction) + 0.15) / 1.15
        matte = matte + lamp.strength * lit
        gloss = gloss + finish.gloss_grey * lamp.strength * _lobe(normal, lamp, finish.sharpness)
        metal = metal + 0.75 * lamp.strength * _lobe(normal, lamp, finish.metal_sharpness)
    return np.stack([matte / facing, gloss, metal], axis=-1)


def tube_profile(
    lamps: tuple[Lamp, ...], ambient: float, finish: TubeFinish, half_width_px: float, blur_px: tuple[float, float]
) -> TubeProfile:
    """Tables for a tube of ``half_width_px`` under ``lamps`` and all-round light ``ambient``, for ``blur_px``."""
    reach = math.ceil(half_width_px + 4.0 * blur_px[1]) + 1.0
    at = np.linspace(-reach, reach, 2 * int(reach) * STEPS_PER_PX + 1)
    borders = np.sin(np.linspace(-math.pi / 2, math.pi / 2, _CELLS + 1))
    middles = np.sin(np.linspace(-math.pi / 2, math.pi / 2, 2 * _CELLS + 1)[1::2])
    turn = 2 * math.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    normal = np.empty((_DIRECTIONS, _CELLS, 3))
    normal[..., 0] = -np.sin(turn)[:, None] * middles
    normal[..., 1] = np.cos(turn)[:, None] * middles
    normal[..., 2] = np.sqrt(1.0 - middles**2)
    values = np.concatenate([np.ones((_DIRECTIONS, _CELLS, 1)), _shade(normal, lamps, ambient, finish)], axis=-1)
    table = np.empty((_BLURS, _DIRECTIONS, at.size, 4), np.float32)
    for k, sigma in enumerate(np.linspace(*blur_px, _BLURS)):
        below = ndtr((at[:, None] - half_width_px * borders) / sigma)
        table[k] = np.einsum("xc,dcq->dxq", below[:, :-1] - below[:, 1:], values, optimize=True)
    return TubeProfile(table, half_width_px, reach, blur_px)
