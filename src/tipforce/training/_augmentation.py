"""Data augmentation: random changes of position, angle, scale, light, blur, noise and objects in the training images.

An image is rotated about the base of the catheter: the base frame, and the force in it, rotate with it, so the force
components stay as they are. In a mirrored image y components change their sign.
"""

import math
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, Protocol

import cv2
import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field

Grey = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float32]
_Transform = tuple[float, float, npt.NDArray[np.float64]]
"""Angle in radians, scale, shift (2,) in pixels."""

CURVATURE = 3
"""Index of the metadata feature that changes its sign in a mirrored image: the curvature that the knob sets."""

Share = Annotated[float, Field(ge=0.0, le=1.0)]
Amount = Annotated[float, Field(ge=0.0, le=1000.0)]


class Augmentation(BaseModel):
    """Strength of each random change; 0 leaves it out."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    shift: Share = 0.07
    """Largest shift in either direction, as a share of the window's side."""
    turn_deg: Annotated[float, Field(ge=0.0, le=90.0)] = 6.0
    """Largest rotation about the base. The base frame rotates with it, so the force components stay."""
    zoom: Share = 0.03
    """Largest logarithm of the scale: the stated scale of a session is not more accurate than that."""
    mirror: Share = 0.5
    """Share of images that are mirrored across the base tangent, with force and curvature. Above 0 the trained network
    evaluates each image and its mirror image, which doubles its work, and returns the mean of both."""
    contrast: Amount = 0.4
    """Largest logarithm of the contrast, and of the mean level, in either direction."""
    tones: Share = 0.5
    """Share of images whose grey levels go through a random tone curve, blended half-way at most: edges stay, which
    side of an edge is darker may not."""
    slope: Amount = 0.3
    """Largest brightness gradient across the image, as a share of the mean level."""
    blur_px: Amount = 0.8
    """Largest standard deviation of the blur."""
    noise: Amount = 4.0
    """Largest standard deviation of the noise, in grey levels."""
    inverted: Share = 0.1
    """Share of images with inverted grey levels."""
    strokes: Share = 0.25
    """Share of images with one or two lines or discs drawn across them."""
    out_of_distribution: Annotated[float, Field(ge=0.0, le=0.5)] = 0.15
    """Share of images shifted, rotated or scaled so far that no force is to be estimated. The network learns to detect
    them."""


_OOD_SHIFT, _OOD_TURN_DEG, _OOD_ZOOM = 0.12, 12.0, 0.15
"""Smallest out-of-distribution changes: share of the window's side, degrees, logarithm of the scale."""
_NOISE_VALUES = 1 << 20


@cache
def _noise_values() -> Floats:
    """Returns standard normal values. A slice that begins anywhere in them costs far less than new values."""
    return np.random.default_rng(0).standard_normal(_NOISE_VALUES, dtype=np.float32)


class _Target(Protocol):
    """The part of a task on which augmentation depends: see `CompactTask`."""

    @property
    def size(self) -> int: ...
    @property
    def planar(self) -> tuple[int, int] | None: ...
    @property
    def mirrors(self) -> bool: ...
    @property
    def augmentation(self) -> Augmentation | None: ...


def centre_crop(image: Grey, side: int) -> Grey:
    """Returns the central part of an image.

    Args:
        image: (h, h).
        side: side of the part in pixels, at most h.

    Returns:
        (side, side), a view of ``image``.
    """
    margin = (len(image) - side) // 2
    return image[margin : margin + side, margin : margin + side]


@dataclass(frozen=True, slots=True)
class AugmentedImage:
    """An augmented image.

    Attributes:
        image: (size, size) uint8.
        heatmap: (size / 4, size / 4), None where the sample has no heatmap.
        in_distribution: False where it was changed so far that no force is to be estimated.
    """

    image: Grey
    heatmap: npt.NDArray[Any] | None
    in_distribution: bool


def augment_image(
    image: Grey, heatmap: Grey | None, force: Floats, metadata: Floats, target: _Target, rng: np.random.Generator
) -> AugmentedImage:
    """Changes an image at random, and its labels with it.

    Args:
        image: (h, h), larger than the result. In its central part of the size of the result the base of the catheter
            is at the middle of the left border.
        heatmap: (h / 4, h / 4) or None.
        force: (t,) force components; changed in place.
        metadata: (k,) metadata features; changed in place.
        target: size of the result, and the outputs that a mirror image changes.
        rng: source of the random numbers.

    Returns:
        The changed image (s, s) and heatmap (s / 4, s / 4) for a target of the size s, and whether they are in
        distribution.
    """
    how, size = target.augmentation or Augmentation(), target.size
    out_of_distribution = rng.random() < how.out_of_distribution
    angle, zoom, shift = _large_transform(how, size, rng) if out_of_distribution else _small_transform(how, size, rng)
    mirror = target.mirrors and rng.random() < how.mirror
    cos, sin = math.cos(angle) / zoom, math.sin(angle) / zoom
    matrix = np.array([[cos, -sin, 0.0], [sin, cos, 0.0]])
    if mirror:
        matrix[:, 1] *= -1.0
    margin = 0.5 * (len(image) - size)
    base = np.array([-0.5, 0.5 * size - 0.5])
    matrix[:, 2] = base + margin + shift - matrix[:, :2] @ base
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    out = cv2.warpAffine(image, matrix, (size, size), flags=flags, borderMode=cv2.BORDER_REPLICATE)
    if mirror and target.planar is not None:
        force[target.planar[1]] *= -1.0
        metadata[CURVATURE] *= -1.0
    warped = None
    if heatmap is not None:
        quarter = matrix.copy()
        quarter[:, 2] = (matrix[:, :2].sum(axis=1) * 1.5 + matrix[:, 2] - 1.5) / 4.0
        warped = cv2.warpAffine(heatmap, quarter, (size // 4, size // 4), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
    return AugmentedImage(_change_appearance(out.astype(np.float32), how, rng), warped, not out_of_distribution)


def _small_transform(how: Augmentation, size: int, rng: np.random.Generator) -> _Transform:
    return (
        math.radians(rng.uniform(-how.turn_deg, how.turn_deg)),
        math.exp(rng.uniform(-how.zoom, how.zoom)),
        rng.uniform(-how.shift, how.shift, 2) * size,
    )


def _large_transform(how: Augmentation, size: int, rng: np.random.Generator) -> _Transform:
    """Returns an out-of-distribution shift, rotation or scale, about a point between the base and the right border."""
    angle, zoom, shift = _small_transform(how, size, rng)
    kind, arm = rng.integers(3), rng.uniform(0.0, size)
    if kind == 0:
        towards = rng.uniform(0.0, 2.0 * math.pi)
        shift = _large_amount(_OOD_SHIFT, how.shift, rng) * size * np.array([math.cos(towards), math.sin(towards)])
    elif kind == 1:
        turn = math.radians(min(180.0, _large_amount(_OOD_TURN_DEG, how.turn_deg, rng)))
        angle = math.copysign(turn, rng.uniform(-1.0, 1.0))
        shift = shift + arm * np.array([1.0 - math.cos(angle), -math.sin(angle)])
    else:
        zoom = math.exp(math.copysign(_large_amount(_OOD_ZOOM, how.zoom, rng), rng.uniform(-1.0, 1.0)))
        shift = shift + np.array([arm * (1.0 - 1.0 / zoom), 0.0])
    return angle, zoom, shift


def _large_amount(smallest: float, usual: float, rng: np.random.Generator) -> float:
    """Returns an amount between ``smallest``, or 1.5 times ``usual`` where that is larger, and four times that."""
    low = max(smallest, 1.5 * usual)
    return rng.uniform(low, 4.0 * low)


def _change_appearance(grey: Floats, how: Augmentation, rng: np.random.Generator) -> Grey:
    """Changes everything that does not move the catheter; ``grey`` (size, size) is overwritten."""
    if rng.random() < how.tones:
        knots = rng.uniform(0.0, 255.0, int(rng.integers(4, 8)))
        share = np.float32(rng.uniform(0.2, 0.8))
        curve = np.interp(np.arange(256), np.linspace(0.0, 255.0, len(knots)), knots).astype(np.float32)
        grey += share * (cv2.LUT(np.clip(grey, 0.0, 255.0).astype(np.uint8), curve) - grey)
    size, mean = len(grey), float(grey.mean())
    level = mean * math.exp(rng.uniform(-how.contrast, how.contrast))
    grey = (grey - mean) * math.exp(rng.uniform(-how.contrast, how.contrast)) + level
    if how.slope and rng.random() < 0.5:
        right, down = rng.uniform(-how.slope, how.slope, 2) * level
        ramp = np.linspace(-1.0, 1.0, size, dtype=np.float32)
        grey += np.float32(right) * ramp + np.float32(down) * ramp[:, None]
    if how.blur_px and rng.random() < 0.3:
        cv2.GaussianBlur(grey, (0, 0), rng.uniform(0.3, max(0.31, how.blur_px)), dst=grey)
    if rng.random() < how.strokes:
        for _ in range(int(rng.integers(1, 3))):
            ends = rng.integers(0, size, 4).tolist()
            shade, width = float(rng.uniform(0.0, 255.0)), int(rng.integers(1, 1 + max(2, size // 32)))
            if rng.random() < 0.7:
                cv2.line(grey, (ends[0], ends[1]), (ends[2], ends[3]), shade, width)
            else:
                cv2.circle(grey, (ends[0], ends[1]), 2 * width, shade, cv2.FILLED)
    if how.noise:
        first = int(rng.integers(0, _NOISE_VALUES - size * size))
        noise = _noise_values()[first : first + size * size].reshape(size, size)
        grey += noise * np.float32(rng.uniform(0.0, how.noise))
    if rng.random() < how.inverted:
        grey = 255.0 - grey
    return np.clip(grey + 0.5, 0.0, 255.0).astype(np.uint8)
