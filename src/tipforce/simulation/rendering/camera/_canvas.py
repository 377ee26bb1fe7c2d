"""A canvas on which static things are painted at twice the image's size (outlines, shadows, noise), and its patches."""

import math
from dataclasses import dataclass, field

import cv2
import numpy as np
import numpy.typing as npt

from ....types import FloatArray
from ._scene import CameraScene, Colour

FloatImage = npt.NDArray[np.float32]
Part = tuple[slice, slice]
"""Rows and columns of a canvas."""


@dataclass(frozen=True, slots=True, eq=False)
class Patch:
    """Share of each pixel of a canvas that an object covers.

    Attributes:
        shape: rows and columns of the canvas.
        part: rows and columns of the canvas outside of which the cover is 0.
        values: (rows, columns) cover in ``part``, 0 to 1.
    """

    shape: tuple[int, int]
    part: Part
    values: FloatImage

    @classmethod
    def of(cls, shape: tuple[int, int], part: Part, values: FloatImage) -> "Patch":
        """Makes a patch; outer rows and columns whose values are all 0 are cut off, which saves time later.

        Args:
            shape: rows and columns of the canvas.
            part: rows and columns of the canvas that ``values`` cover.
            values: share of each pixel that the thing covers, 0 to 1.

        Returns:
            The patch; it is empty if all values are 0.
        """
        sides: list[slice] = []
        for axis in (1, 0):
            not_empty = np.flatnonzero(values.any(axis=axis))
            sides.append(slice(int(not_empty[0]), int(not_empty[-1]) + 1) if not_empty.size else slice(0, 0))
        rows, columns = sides
        (top, left), patch = (side.start for side in part), values[rows, columns]
        if not patch.size:
            return cls(shape, (slice(0, 0), slice(0, 0)), np.zeros((0, 0), np.float32))
        found_part = slice(top + rows.start, top + rows.stop), slice(left + columns.start, left + columns.stop)
        return cls(shape, found_part, patch)

    def around(self, reach: float) -> Part:
        """Returns the part with ``reach`` px more on every side, within the canvas."""
        more = math.ceil(reach)
        rows, columns = (
            slice(max(0, side.start - more), min(side.stop + more, size))
            for side, size in zip(self.part, self.shape, strict=True)
        )
        return rows, columns

    def within(self, part: Part) -> FloatImage:
        """Returns the cover in ``part``, which contains all of it."""
        whole = np.zeros((part[0].stop - part[0].start, part[1].stop - part[1].start), np.float32)
        whole[self.seen_from(part)] = self.values
        return whole

    def seen_from(self, part: Part) -> Part:
        """Returns the patch's part, counted from the corner of ``part``, which contains all of it."""
        (top, left), (rows, columns) = (side.start for side in part), self.part
        return slice(rows.start - top, rows.stop - top), slice(columns.start - left, columns.stop - left)

    def times(self, share: float) -> "Patch":
        """Returns the patch of an object that lets light through."""
        return Patch(self.shape, self.part, self.values * np.float32(share))

    def joined(self, other: "Patch") -> "Patch":
        """Returns the greater cover of both."""
        if not self.values.size or not other.values.size:
            return self if self.values.size else other
        rows, columns = (
            slice(min(a.start, b.start), max(a.stop, b.stop)) for a, b in zip(self.part, other.part, strict=True)
        )
        whole = rows, columns
        return Patch(self.shape, whole, np.maximum(self.within(whole), other.within(whole)))


FINER = 2
"""SceneCanvas pixels per image pixel."""
_SUBPIXEL = 4


def multi_scale_noise(
    rng: np.random.Generator, shape: tuple[int, int], scales_px: tuple[float, ...], fall: float = 0.6
) -> FloatImage:
    """Makes smooth noise: a sum of random fields of several scales.

    Args:
        rng: random numbers.
        shape: (h, w) rows and columns.
        scales_px: distances of the random numbers in px, one for each field; between them the field is cubic.
        fall: weight of each field relative to that of the next coarser one.

    Returns:
        (h, w) noise of mean 0 and standard deviation 1.
    """
    h, w = shape
    total, weighted = np.zeros(shape, np.float32), np.empty(shape, np.float32)
    for k, scale in enumerate(sorted(scales_px, reverse=True)):
        # A field of independent numbers is enlarged to its scale; a part of it at a random position is added.
        numbers = rng.standard_normal((int(h / scale) + 4, int(w / scale) + 4), np.float32)
        enlarged_size = (round(numbers.shape[1] * scale), round(numbers.shape[0] * scale))
        smooth = cv2.resize(numbers, enlarged_size, interpolation=cv2.INTER_CUBIC)
        top, left = int(rng.integers(0, enlarged_size[1] - h + 1)), int(rng.integers(0, enlarged_size[0] - w + 1))
        total += np.multiply(smooth[top : top + h, left : left + w], np.float32(fall**k), out=weighted)
    mean, spread = total.mean(), total.std()
    total -= mean
    total /= spread
    return total


def canvas_px(image_px: FloatArray) -> FloatArray:
    """Converts image pixels to canvas pixels; the centres of both are at integers, so that their borders differ."""
    return image_px * FINER + 0.5 * (FINER - 1)


def soften(image: FloatImage, sigma: float) -> FloatImage:
    """Blurs an image; a wide blur is done on a smaller image, where the difference is not visible.

    Args:
        image: (h, w) or (h, w, c) image.
        sigma: standard deviation of the Gaussian in px.

    Returns:
        The blurred image, of the same shape.
    """
    shrink = int(sigma / 3.0)
    if shrink < 2:
        return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma, borderType=cv2.BORDER_REPLICATE), np.float32)
    h, w = image.shape[:2]
    small = cv2.resize(image, (max(1, w // shrink), max(1, h // shrink)), interpolation=cv2.INTER_AREA)
    small = cv2.GaussianBlur(small, (0, 0), sigma / shrink, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(cv2.resize(small, (w, h), interpolation=cv2.INTER_LINEAR), np.float32)


def band(start: FloatArray, end: FloatArray, half_width: float) -> FloatArray:
    """Returns the corners of a straight band.

    Args:
        start: (2,) start of the band's middle line.
        end: (2,) its end.
        half_width: half the width of the band, in the same unit.

    Returns:
        (4, 2) corners in order around the band.
    """
    direction = (end - start) / np.linalg.norm(end - start)
    side = half_width * np.array([-direction[1], direction[0]])
    return np.stack([start - side, end - side, end + side, start + side])


@dataclass(slots=True, eq=False)
class SceneCanvas:
    """A canvas of the scene.

    Attributes:
        levels: (h, w, 3) light times cover, grey levels.
        transmittance: (h, w) share of the light of the layers below that is visible.
        px_per_m: canvas pixels for each metre.
        scene: the scene.
        changed: parts in which something was painted or darkened.
    """

    levels: FloatImage
    transmittance: FloatImage
    px_per_m: float
    scene: CameraScene
    changed: list[Part] = field(default_factory=list[Part])

    @classmethod
    def empty(cls, width: int, height: int, px_per_m: float, scene: CameraScene) -> "SceneCanvas":
        """Makes an empty canvas of `FINER` times the image's size.

        Args:
            width: width of the image in px.
            height: height of the image in px.
            px_per_m: image pixels for each metre.
            scene: the scene.

        Returns:
            A canvas with levels 0 that lets all light through.
        """
        shape = (height * FINER, width * FINER)
        return cls(np.zeros((*shape, 3), np.float32), np.ones(shape, np.float32), px_per_m * FINER, scene)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.levels.shape[0], self.levels.shape[1]

    def outline(self, points: FloatArray, *, closed: bool = True, width: float = 1.0) -> Patch:
        """Returns the anti-aliased cover of a polygon or a line.

        Args:
            points: (n, 2) corners, canvas pixels.
            closed: whether the points bound a filled polygon; otherwise they are a line.
            width: width of the line in canvas pixels.

        Returns:
            Share of each pixel that is covered.
        """
        mask = np.zeros(self.shape, np.uint8)
        fixed = [np.round(points * 2**_SUBPIXEL).astype(np.int32)]  # OpenCV takes positions in 1/16 px as integers
        if closed:
            cv2.fillPoly(mask, fixed, 255, cv2.LINE_AA, _SUBPIXEL)
        else:
            cv2.polylines(mask, fixed, False, 255, max(1, round(width)), cv2.LINE_AA, _SUBPIXEL)
        part = self.box(points, 4.0 if closed else 4.0 + width)
        return Patch.of(self.shape, part, mask[part].astype(np.float32) / np.float32(255.0))

    def disc(self, centre: FloatArray, radius: float) -> Patch:
        """Returns the cover of a disc.

        Args:
            centre: (2,) centre, canvas pixels.
            radius: radius in canvas pixels.

        Returns:
            Share of each pixel that is covered.
        """
        turn = np.linspace(0.0, 2 * np.pi, 48, endpoint=False)
        return self.outline(centre + radius * np.stack([np.cos(turn), np.sin(turn)], axis=1))

    def box(self, points: FloatArray, reach: float) -> Part:
        """Returns the part of the canvas around points.

        Args:
            points: (n, 2) points, canvas pixels.
            reach: margin on every side in canvas pixels.

        Returns:
            Rows and columns, within the canvas.
        """
        ends = np.array(self.shape[::-1])
        u0, v0 = np.clip(np.floor(points.min(axis=0) - reach), 0, ends).astype(int).tolist()
        u1, v1 = np.clip(np.ceil(points.max(axis=0) + reach) + 1, 0, ends).astype(int).tolist()
        return slice(v0, v1), slice(u0, u1)

    def lay(
        self, cover: Patch, colour: Colour | FloatImage, *, height_m: float = 0.0, shading: FloatImage | float = 1.0
    ) -> None:
        """Lays an object over the canvas, after its shadow if it is high.

        Args:
            cover: share of each pixel that the object covers.
            colour: RGB grey levels, or an image (rows, columns, 3) of ``cover.part``.
            height_m: height of the object, which determines its shadow; 0: no shadow.
            shading: factor of the colour, or an image (rows, columns) of ``cover.part``.
        """
        if height_m > 0.0:
            self.darken(cover, height_m)
        paint = np.asarray(colour, np.float32)
        bright = shading[..., None] if isinstance(shading, np.ndarray) else np.float32(shading)
        self.levels[cover.part] += cover.values[..., None] * (paint * bright - self.levels[cover.part])
        self.transmittance[cover.part] *= 1.0 - cover.values
        self.changed.append(cover.part)

    def bevel(self, cover: Patch, width_px: float) -> FloatImage:
        """Returns the shading of an object with rounded edges, which are brighter where they face the lamps.

        Args:
            cover: share of each pixel that the object covers.
            width_px: width of the rounded edge in canvas pixels.

        Returns:
            (rows, columns) factors of the colour in ``cover.part``, 0.3 to 1.9; 1 away from the edges.
        """
        part = cover.around(4.0 * width_px)
        blurred = soften(cover.within(part), max(0.8, width_px))
        slope_u = cv2.Sobel(blurred, cv2.CV_32F, 1, 0, scale=0.125) * np.float32(width_px * 2.5)
        slope_v = cv2.Sobel(blurred, cv2.CV_32F, 0, 1, scale=0.125) * np.float32(width_px * 2.5)
        brightness = np.ones(blurred.shape, np.float32)
        for lamp in self.scene.light.lamps:
            # At a right edge the blurred cover falls to the right while the surface faces right: hence the minus.
            brightness -= np.float32(lamp.strength) * (slope_u * lamp.direction[0] + slope_v * lamp.direction[1])
        return np.clip(brightness[cover.seen_from(part)], 0.3, 1.9)

    def darken(self, cover: Patch, height_m: float) -> None:
        """Casts the shadows of an object.

        Args:
            cover: share of each pixel that the object covers.
            height_m: height of the object.
        """
        blur_px = max(0.6, self.scene.shadow_sigma_m(height_m) * self.px_per_m)
        seam_px = max(1.0, 0.5 * height_m * self.px_per_m)  # width of the dark seam at the foot of the object
        shadows = self.scene.shadow_falls_m(height_m)
        farthest = max((abs(x) for right, down, _ in shadows for x in (right, down)), default=0.0) * self.px_per_m
        part = cover.around(max(farthest + 3.0 * blur_px, 3.0 * seam_px))
        cover_here = cover.within(part)
        passing_light = np.ones(cover_here.shape, np.float32)
        for right_m, down_m, strength in shadows:
            shift = np.array([[1, 0, right_m * self.px_per_m], [0, 1, down_m * self.px_per_m]], np.float32)
            shadow = cv2.warpAffine(cover_here, shift, cover_here.shape[::-1], borderMode=cv2.BORDER_REPLICATE)
            passing_light *= 1.0 - np.float32(strength) * soften(np.asarray(shadow, np.float32), blur_px)
        # Ambient light does not reach the corner at the foot of the object either.
        passing_light *= 1.0 - np.float32(0.25) * soften(cover_here, seam_px)
        self.levels[part] *= passing_light[..., None]
        self.transmittance[part] *= passing_light
        self.changed.append(part)

    def fade(self, opacity: float) -> None:
        """Makes all painted objects transparent: they keep ``opacity`` of their light and of their cover."""
        self.levels *= np.float32(opacity)
        self.transmittance[:] = 1.0 - np.float32(opacity) * (1.0 - self.transmittance)

    def seen(self, sigma_px: float) -> tuple[FloatImage, FloatImage]:
        """Returns levels (3, h, w) and free share of the view (h, w), at the image's size, blurred by ``sigma_px``."""
        # The shrinking is itself a blur: a mean over FINER canvas pixels, of variance (FINER^2 - 1) / 12.
        remaining_blur_px = max(0.0, (sigma_px * FINER) ** 2 - (FINER**2 - 1) / 12.0) ** 0.5
        size = (self.transmittance.shape[1] // FINER, self.transmittance.shape[0] // FINER)
        shrunk = [
            np.asarray(cv2.resize(soften(plane, remaining_blur_px), size, interpolation=cv2.INTER_AREA), np.float32)
            for plane in (self.levels, self.transmittance)
        ]
        return np.ascontiguousarray(shrunk[0].transpose(2, 0, 1)), shrunk[1]


Box = tuple[int, int, int, int]
"""Rows and columns: from, to (exclusive)."""
