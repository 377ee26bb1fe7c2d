"""What the camera looks at, but for the catheter's shape: ground, wall, light; fixed for a session."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from ...types import BasePose, FloatArray
from ._session import Course, Session
from ._settings import SmallBenchSettings

__all__ = ["Scene", "build_scene"]

Picture = npt.NDArray[np.float32]

_NOMINAL_BASE_U = -8.0
"""The clamp lies just outside the picture's left border: the catheter enters there along its base tangent."""
_PAD_M, _PLATE_M, _ARM_M = 9e-3, 4e-3, 6e-3
"""Thickness of the tissue pad, of the plate that carries it, and half the width of the arm behind them."""
_PAD_MARGIN_M, _PAD_REACH_M = 4e-3, 16e-3
"""The pad goes on this far beyond the places where it is touched: on the side of the catheter's base, on the other."""
_TILE = 256


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """``ground`` (h, w, 3) float32 RGB; ``tile`` (256, 256): the pad's mottling; ``noise`` (m,): see `render`.

    ``into_px``, ``across_px`` (2,): the directions into and along the wall in image coordinates, unit vectors.
    ``boxes_px`` (3, 5): pad, plate, arm as depth from/to, across from/to, corner radius. ``light_px`` (3,): unit vector
    to the light (right, down, to the camera). ``metal`` (k,): share of metal along the catheter, four values a pixel.
    """

    base: BasePose
    metres_per_px: float
    ground: Picture
    tile: Picture
    noise: Picture
    into_px: FloatArray
    across_px: FloatArray
    boxes_px: FloatArray
    light_px: FloatArray
    metal: FloatArray
    blur_px: float
    brightness: float


def _texture(rng: np.random.Generator, shape: tuple[int, int], scale_px: float, border: int) -> Picture:
    """Smooth noise with standard deviation 1."""
    field = rng.standard_normal(shape).astype(np.float32)
    field = cv2.GaussianBlur(field, (0, 0), scale_px, borderType=border)
    return (field / field.std()).astype(np.float32)


def _ground(settings: SmallBenchSettings, rng: np.random.Generator, brightness: float) -> Picture:
    """A light board under a lamp that stands to one side."""
    h, w = settings.height, settings.width
    v, u = np.mgrid[0:h, 0:w].astype(np.float32)
    lamp = rng.uniform([0.1 * w, -0.3 * h], [0.9 * w, 0.2 * h])
    distance = np.hypot(u - lamp[0], v - lamp[1]) / w
    level = 212.0 - rng.uniform(25, 45) * distance**1.5
    level += rng.uniform(2, 5) * _texture(rng, (h, w), 60.0, cv2.BORDER_REFLECT)
    level += 1.2 * _texture(rng, (h, w), 1.1, cv2.BORDER_REFLECT)
    tint = np.array([1.0, 0.99, 0.96]) + rng.uniform(-0.015, 0.015, 3)
    return (brightness * level[..., None] * tint).astype(np.float32)


def _metal(session: Session, px_per_m: float, blur_px: float) -> FloatArray:
    """Share of metal by arc length: electrode, and three rings 2 mm wide, 2.5 mm apart."""
    start = session.rod.flexible_length_m
    bands = [(start, start + 1.0)] + [
        (start - (4.5 * k + 4.5) * 1e-3, start - (4.5 * k + 2.5) * 1e-3) for k in range(3)
    ]
    arc = np.arange(math.ceil(session.rod.length_m * px_per_m) * 4 + 8) / 4
    share = np.zeros(arc.size)
    for low, high in bands:
        share += [
            0.5
            * (math.erf((s - low * px_per_m) / blur_px / 2**0.5) - math.erf((s - high * px_per_m) / blur_px / 2**0.5))
            for s in arc
        ]
    return share


def build_scene(settings: SmallBenchSettings, session: Session, course: Course, rng: np.random.Generator) -> Scene:
    """The session's camera, board, wall and light."""
    scale = float(rng.uniform(*settings.metres_per_px))
    shift = rng.uniform(*settings.base_shift_m, 2) / scale
    origin = np.array([_NOMINAL_BASE_U, 0.5 * settings.height]) + shift
    base = BasePose(origin, math.radians(rng.uniform(*settings.base_turn_deg)))
    blur = float(rng.uniform(*settings.blur_px))
    brightness = float(rng.uniform(*settings.light))
    d = np.array([math.cos(session.wall.angle_rad), math.sin(session.wall.angle_rad)])
    into = d @ base.axes_px
    across = np.array([-d[1], d[0]]) @ base.axes_px

    contact = course.contact
    touch = (contact.touch_m @ [-d[1], d[0]] - course.along_m)[contact.touching]
    # The pad ends early toward the base, as it must beside a shaft that lies nearly along it.
    back, front = touch.min() - _PAD_REACH_M, touch.max() + _PAD_MARGIN_M
    if d[1] < 0:  # then t points away from the base
        back, front = touch.min() - _PAD_MARGIN_M, touch.max() + _PAD_REACH_M
    middle = 0.5 * (back + front)
    boxes = np.array(
        [
            [0.0, _PAD_M, back, front, 1.5e-3],
            [_PAD_M, _PAD_M + _PLATE_M, back - 3e-3, front + 3e-3, 0.4e-3],
            [_PAD_M + _PLATE_M, 1.0, middle - _ARM_M, middle + _ARM_M, 0.4e-3],
        ]
    )
    lamp = np.array([rng.uniform(-0.5, 0.5), rng.uniform(-0.8, -0.3), 1.0])
    tile = 0.7 * _texture(rng, (_TILE, _TILE), 6.0, cv2.BORDER_REFLECT) + 0.3 * _texture(
        rng, (_TILE, _TILE), 1.2, cv2.BORDER_REFLECT
    )
    # Colour noise of a sensor behind a Bayer mosaic: most of it common to the channels, 1 grey level in sum.
    common, single = rng.standard_normal((1 << 17, 1)), rng.standard_normal((1 << 17, 3))
    noise = (math.sqrt(0.75) * common + 0.75 * single).astype(np.float32).ravel()
    return Scene(
        base=base,
        metres_per_px=scale,
        ground=_ground(settings, rng, brightness),
        tile=tile.astype(np.float32),
        noise=noise,
        into_px=into,
        across_px=across,
        boxes_px=boxes / scale,
        light_px=lamp / np.linalg.norm(lamp),
        metal=_metal(session, 1 / scale, blur),
        blur_px=blur,
        brightness=brightness,
    )
