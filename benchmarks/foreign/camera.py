"""The position of the camera of a foreign session, and the response of its sensor to light."""

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from tipforce.types import FloatArray, Image

from .session import Plan, Run

__all__ = ["HEIGHT", "WIDTH", "Camera", "draw_camera", "expose"]

WIDTH, HEIGHT = 512, 384
SIDES = {"left": 0.0, "bottom": 90.0, "right": 180.0, "top": 270.0}
"""Border that the catheter comes from -> how its base tangent points in the image, degrees counter-clockwise."""


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    """A pinhole for the geometry, a thin lens for the picture; millimetres. ``right``, ``down``, ``away``: its axes."""

    centre: FloatArray
    right: FloatArray
    down: FloatArray
    away: FloatArray
    focal_px: float
    aperture_mm: float
    focus_mm: float
    base_side: str

    def project(self, points_mm: FloatArray) -> FloatArray:
        """(..., 2) pixels of (..., 3) points of the base frame; pixel centres at integers."""
        seen = points_mm - self.centre
        depth = seen @ self.away
        u, v = (self.focal_px * (seen @ axis) / depth for axis in (self.right, self.down))
        return np.stack([u + (WIDTH - 1) / 2, v + (HEIGHT - 1) / 2], axis=-1)

    @property
    def metres_per_px(self) -> float:
        """At the base."""
        return 1e-3 * float(-self.centre @ self.away) / self.focal_px


def draw_camera(plan: Plan, run: Run) -> Camera:
    """Places the camera so that the whole motion is in view and the base is towards the drawn border."""
    rng = np.random.default_rng((plan.seed, 4))
    u = rng.uniform
    side = list(SIDES)[plan.seed % 4]
    turn = math.radians(SIDES[side] + u(-10.0, 10.0))
    right = np.array([math.cos(turn), -math.sin(turn), 0.0])
    up = np.array([math.sin(turn), math.cos(turn), 0.0])
    line = 1e3 * run.line_m[::25].reshape(-1, 3)
    spread = np.stack([line @ right, line @ up], axis=-1)
    low, high = spread.min(0), spread.max(0)
    axis = 0 if side in ("left", "right") else 1
    pixels = np.array([WIDTH, HEIGHT])
    needed = (high - low + np.where(np.arange(2) == axis, 12.0, 24.0)) / pixels
    scale = max(float(needed.max()), u(0.17, 0.24))  # mm a pixel
    slack = pixels * scale - (high - low)
    share = np.array([u(0.3, 0.7), u(0.3, 0.7)])  # of the slack that is left of the motion, and below it
    share[axis] = u(0.15, 0.7) if side in ("left", "bottom") else 1.0 - u(0.15, 0.7)
    corner = low - slack * share
    middle = corner + pixels * scale / 2
    target = right * middle[0] + up * middle[1]
    distance, tilt, around = u(280.0, 450.0), math.radians(u(0.0, 6.0)), u(0.0, 2 * math.pi)
    lean = math.sin(tilt) * (math.cos(around) * right + math.sin(around) * up)
    away = np.array([0.0, 0.0, -math.cos(tilt)]) + lean
    right = right - (right @ away) * away
    right /= np.linalg.norm(right)
    return Camera(
        centre=target - distance * away,
        right=right,
        down=np.cross(away, right),
        away=away,
        focal_px=distance / scale,
        aperture_mm=u(1.5, 6.0),
        focus_mm=distance + u(-3.0, 3.0),
        base_side=side,
    )


def expose(light: npt.NDArray[np.float32], gain: float, noise: float, grey: bool, rng: np.random.Generator) -> Image:
    """Renders the image that a camera with a Bayer sensor takes of a scene.

    Args:
        light: (h, w, 3) linear light.
        gain: makes the light 1 where the sensor is full.
        noise: standard deviation of the photon noise where it is full; the read noise is a third of it.
        grey: the camera has no colours.
        rng: generator of the noise.

    Returns:
        An image (h, w, 3), or (h, w) of a grey camera, uint8.
    """
    scene = cv2.bilateralFilter(np.clip(light * gain, 0.0, 1.0), 5, 0.2, 1.3)  # most of the paths' own noise
    if grey:
        single = scene @ np.array([0.3, 0.5, 0.2], np.float32)
        raw = single + rng.normal(size=single.shape) * np.sqrt(noise**2 * (single + 0.1))
        return _tone(np.clip(raw, 0.0, 1.0))
    raw = np.empty(scene.shape[:2], np.float32)
    for channel, (row, column) in ((0, (0, 0)), (1, (0, 1)), (1, (1, 0)), (2, (1, 1))):
        raw[row::2, column::2] = scene[row::2, column::2, channel]
    raw = raw + rng.normal(size=raw.shape) * np.sqrt(noise**2 * (raw + 0.1))
    mosaic = np.round(np.clip(raw, 0.0, 1.0) * 65535).astype(np.uint16)
    return _tone(cv2.demosaicing(mosaic, cv2.COLOR_BayerRG2BGR_EA) / 65535.0)  # OpenCV's name for RGGB to RGB


def _tone(linear: npt.NDArray[Any]) -> Image:
    """The tone curve of sRGB, a little sharpening, 8 bits."""
    shown = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-6) ** (1 / 2.4) - 0.055)
    shown = shown + 0.3 * (shown - cv2.GaussianBlur(shown, (0, 0), 1.2))
    return np.round(np.clip(shown, 0.0, 1.0) * 255).astype(np.uint8)
