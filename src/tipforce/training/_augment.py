"""What is altered at random in training, so that it does not matter later: place, turn, light, blur, noise, objects.

Turning the picture about the catheter's base is a bench that lies otherwise under the camera: its base turns, and the
frame of the forces with it, so their numbers stay. In a mirror what points to the left points to the right.
"""

import math
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, Protocol

import cv2
import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field

__all__ = ["CURVATURE", "Altered", "Augmentation", "augmented", "middle"]

Grey = npt.NDArray[np.uint8]
Numbers = npt.NDArray[np.float32]
_Move = tuple[float, float, npt.NDArray[np.float64]]
"""Angle in radians, scale, shift (2,) in pixels."""

CURVATURE = 3
"""Place in the sheet of what changes its sign where the picture is mirrored: the curvature that the knob asks for."""

Share = Annotated[float, Field(ge=0.0, le=1.0)]
Amount = Annotated[float, Field(ge=0.0)]


class Augmentation(BaseModel):
    """How far; 0 leaves a thing out."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    shift: Share = 0.07
    """Of the window's side, each way."""
    turn_deg: Annotated[float, Field(ge=0.0, le=90.0)] = 6.0
    """About the base; the base frame turns along, and the force in it stays."""
    zoom: Share = 0.03
    """The scale that a session states is known no better than that."""
    mirror: Share = 0.5
    """Share of pictures mirrored across the base's tangent, force and curvature along. Above 0 the trained network
    looks at each picture and its mirror image, which doubles its work, and answers their mean."""
    contrast: Amount = 0.4
    """Standard scale of its logarithm, uniform both ways; also of the mean level."""
    tones: Share = 0.5
    """Share of pictures whose grey levels are drawn through a random curve, half-way at most: the edges stay, what is
    darker than what does not."""
    slope: Amount = 0.3
    """Light that grows across the picture, of the mean level."""
    blur_px: Amount = 0.8
    noise: Amount = 4.0
    """Grey levels."""
    inverted: Share = 0.1
    """Share of pictures shown as their negatives."""
    strokes: Share = 0.25
    """Share of pictures with one or two straight rods across, or discs."""
    moved: Annotated[float, Field(ge=0.0, le=0.5)] = 0.15
    """Share of pictures shifted, turned or zoomed so far that they are not to be answered: it learns to tell them."""


_SHIFT, _TURN_DEG, _ZOOM = 0.12, 12.0, 0.15
"""So far is too far, at least: of the window's side, degrees, logarithm of the scale."""
_NOISES = 1 << 20


@cache
def _noises() -> Numbers:
    """Drawn once: a stretch that begins anywhere in it is as good as a new draw, which was two fifths of the work."""
    return np.random.default_rng(0).standard_normal(_NOISES, dtype=np.float32)


class _Sizes(Protocol):
    @property
    def size(self) -> int: ...
    @property
    def planar(self) -> tuple[int, int] | None: ...
    @property
    def mirrors(self) -> bool: ...
    @property
    def augmentation(self) -> Augmentation | None: ...


def middle(picture: Grey, side: int) -> Grey:
    """(side, side): the middle of ``picture`` (h, h)."""
    margin = (len(picture) - side) // 2
    return picture[margin : margin + side, margin : margin + side]


@dataclass(frozen=True, slots=True)
class Altered:
    """``picture`` (size, size), ``heat`` (size / 4, size / 4) where it had a map; ``moved``: too far to be answered."""

    picture: Grey
    heat: npt.NDArray[Any] | None
    moved: bool


def augmented(
    picture: Grey, heat: Grey | None, force: Numbers, sheet: Numbers, sizes: _Sizes, draw: np.random.Generator
) -> Altered:
    """``picture`` (h, h) altered at random; ``force`` and ``sheet`` are altered in place.

    The base lies in the middle of the left border of the middle of ``picture``.
    """
    how, size = sizes.augmentation or Augmentation(), sizes.size
    moved = draw.random() < how.moved
    angle, zoom, shift = _far(how, size, draw) if moved else _near(how, size, draw)
    mirror = sizes.mirrors and draw.random() < how.mirror
    cos, sin = math.cos(angle) / zoom, math.sin(angle) / zoom
    matrix = np.array([[cos, -sin, 0.0], [sin, cos, 0.0]])
    if mirror:
        matrix[:, 1] *= -1.0
    margin = 0.5 * (len(picture) - size)
    base = np.array([-0.5, 0.5 * size - 0.5])
    matrix[:, 2] = base + margin + shift - matrix[:, :2] @ base
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    out = cv2.warpAffine(picture, matrix, (size, size), flags=flags, borderMode=cv2.BORDER_REPLICATE)
    if mirror and sizes.planar is not None:
        force[sizes.planar[1]] *= -1.0
        sheet[CURVATURE] *= -1.0
    where = None
    if heat is not None:
        quarter = matrix.copy()
        quarter[:, 2] = (matrix[:, :2].sum(axis=1) * 1.5 + matrix[:, 2] - 1.5) / 4.0
        where = cv2.warpAffine(heat, quarter, (size // 4, size // 4), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
    return Altered(_other_light(out.astype(np.float32), how, draw), where, moved)


def _near(how: Augmentation, size: int, draw: np.random.Generator) -> _Move:
    return (
        math.radians(draw.uniform(-how.turn_deg, how.turn_deg)),
        math.exp(draw.uniform(-how.zoom, how.zoom)),
        draw.uniform(-how.shift, how.shift, 2) * size,
    )


def _far(how: Augmentation, size: int, draw: np.random.Generator) -> _Move:
    """Too far along or across, in angle or in scale, about a point between the base and the picture's other border."""
    angle, zoom, shift = _near(how, size, draw)
    kind, arm = draw.integers(3), draw.uniform(0.0, size)
    if kind == 0:
        towards = draw.uniform(0.0, 2.0 * math.pi)
        shift = _beyond(_SHIFT, how.shift, draw) * size * np.array([math.cos(towards), math.sin(towards)])
    elif kind == 1:
        angle = math.copysign(math.radians(min(180.0, _beyond(_TURN_DEG, how.turn_deg, draw))), draw.uniform(-1.0, 1.0))
        shift = shift + arm * np.array([1.0 - math.cos(angle), -math.sin(angle)])
    else:
        zoom = math.exp(math.copysign(_beyond(_ZOOM, how.zoom, draw), draw.uniform(-1.0, 1.0)))
        shift = shift + np.array([arm * (1.0 - 1.0 / zoom), 0.0])
    return angle, zoom, shift


def _beyond(least: float, usual: float, draw: np.random.Generator) -> float:
    """From the ``least`` that is too far, or half as far again as ``usual``, to four times that."""
    begin = max(least, 1.5 * usual)
    return draw.uniform(begin, 4.0 * begin)


def _other_light(grey: Numbers, how: Augmentation, draw: np.random.Generator) -> Grey:
    """Everything that does not move the catheter; ``grey`` (size, size) is used up."""
    if draw.random() < how.tones:
        knots = draw.uniform(0.0, 255.0, int(draw.integers(4, 8)))
        share = np.float32(draw.uniform(0.2, 0.8))
        curved = np.interp(np.arange(256), np.linspace(0.0, 255.0, len(knots)), knots).astype(np.float32)
        grey += share * (cv2.LUT(np.clip(grey, 0.0, 255.0).astype(np.uint8), curved) - grey)
    size, mean = len(grey), float(grey.mean())
    level = mean * math.exp(draw.uniform(-how.contrast, how.contrast))
    grey = (grey - mean) * math.exp(draw.uniform(-how.contrast, how.contrast)) + level
    if how.slope and draw.random() < 0.5:
        right, down = draw.uniform(-how.slope, how.slope, 2) * level
        ramp = np.linspace(-1.0, 1.0, size, dtype=np.float32)
        grey += np.float32(right) * ramp + np.float32(down) * ramp[:, None]
    if how.blur_px and draw.random() < 0.3:
        cv2.GaussianBlur(grey, (0, 0), draw.uniform(0.3, max(0.31, how.blur_px)), dst=grey)
    if draw.random() < how.strokes:
        for _ in range(int(draw.integers(1, 3))):
            ends = draw.integers(0, size, 4).tolist()
            shade, thick = float(draw.uniform(0.0, 255.0)), int(draw.integers(1, 1 + max(2, size // 32)))
            if draw.random() < 0.7:
                cv2.line(grey, (ends[0], ends[1]), (ends[2], ends[3]), shade, thick)
            else:
                cv2.circle(grey, (ends[0], ends[1]), 2 * thick, shade, cv2.FILLED)
    if how.noise:
        first = int(draw.integers(0, _NOISES - size * size))
        grey += _noises()[first : first + size * size].reshape(size, size) * np.float32(draw.uniform(0.0, how.noise))
    if draw.random() < how.inverted:
        grey = 255.0 - grey
    return np.clip(grey + 0.5, 0.0, 255.0).astype(np.uint8)
