"""An image to draw on in the coordinates of the original, with letters that are legible at any size."""

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from ..geometry import arc_length
from ..types import BoolArray, FloatArray, Image

Colour = tuple[int, int, int]

TINT: Colour = (40, 150, 255)
WHITE: Colour = (255, 255, 255)
BLACK: Colour = (0, 0, 0)
ALARM: Colour = (190, 25, 25)
SMALLEST = 448
"""Images that are narrower are enlarged by a whole factor, so that lines and letters stay legible."""
HIGHEST = 8192
"""But to no more rows than these: an image one pixel wide would become gigabytes."""
SHIFT = 4
"""Bits of sub-pixel position that OpenCV is given."""
MAX_BANNER_LINES = 3
"""A longer reason in a red bar is cut off; the printed text holds all of it."""
FONT = cv2.FONT_HERSHEY_SIMPLEX


@dataclass(frozen=True, slots=True)
class Canvas:
    """An image that is drawn on, in the coordinates of the original.

    Attributes:
        image: (h, w, 3) enlarged image.
        zoom: factor of the enlargement, a whole number.
    """

    image: Image
    zoom: int

    @classmethod
    def over(cls, image: Image, mask: BoolArray | None) -> "Canvas":
        """Makes a canvas of an image; a small image is enlarged by a whole number.

        Args:
            image: (h, w) or (h, w, 3); not changed.
            mask: (h, w) pixels that are tinted; None: none.

        Returns:
            The canvas.
        """
        image = rgb(image)
        if mask is not None and mask.any():
            image = image.copy()
            image[mask] = (0.55 * image[mask] + 0.45 * np.array(TINT)).astype(np.uint8)
        zoom = max(1, min(math.ceil(SMALLEST / image.shape[1]), HIGHEST // image.shape[0]))
        big = np.repeat(np.repeat(image, zoom, axis=0), zoom, axis=1) if zoom > 1 else image.copy()
        return cls(np.ascontiguousarray(big), zoom)

    @property
    def unit(self) -> float:
        """Pixels of a line of width 1 on a image 640 px wide."""
        return max(0.8, max(self.image.shape[:2]) / 640.0)

    def _at(self, points: FloatArray) -> FloatArray:
        return (np.atleast_2d(points) + 0.5) * self.zoom - 0.5

    def line(self, points: FloatArray, colour: Colour, width: float, dashed: bool = False) -> None:
        """Draws a curve.

        Args:
            points: (n, 2) image points u, v in px.
            colour: RGB, 0 to 255.
            width: width in `unit`.
            dashed: whether the line is dashed.
        """
        thick = max(1, round(width * self.unit))
        at = self._at(points)
        pieces = [fixed(at)]
        if dashed:
            along = arc_length(at)
            dash = 7.0 * self.unit
            ends = np.arange(0.0, along[-1], 2.0 * dash)[:, None] + np.linspace(0.0, dash, 4)
            pieces = [fixed(np.column_stack([np.interp(e, along, at[:, k]) for k in range(2)])) for e in ends]
        cv2.polylines(self.image, pieces, False, colour, thick, cv2.LINE_AA, SHIFT)

    def arrow(self, tail: FloatArray, head: FloatArray, colour: Colour, width: float) -> None:
        """Draws an arrow, outlined in black; nothing where its ends are the same.

        Args:
            tail: (2,) image point u, v in px.
            head: (2,) image point u, v in px.
            colour: RGB, 0 to 255.
            width: width of the shaft in `unit`.
        """
        ends = self._at(np.stack([tail, head]))
        along = ends[1] - ends[0]
        length = float(np.hypot(*along))
        if length < 1.0:
            return
        along /= length
        across = np.array([-along[1], along[0]])
        size = min(0.6 * length, (4.0 + 3.0 * width) * self.unit)
        triangle = np.stack(
            [ends[1], ends[1] - size * along + 0.45 * size * across, ends[1] - size * along - 0.45 * size * across]
        )
        shaft = np.stack([ends[0], ends[1] - 0.8 * size * along])
        for paint, more in ((BLACK, 2.0), (colour, 0.0)):
            thick = max(1, round((width + more) * self.unit))
            cv2.polylines(self.image, [fixed(shaft)], False, paint, thick, cv2.LINE_AA, SHIFT)
            if more:
                cv2.polylines(self.image, [fixed(triangle)], True, paint, max(1, round(more)), cv2.LINE_AA, SHIFT)
        cv2.fillConvexPoly(self.image, fixed(triangle), colour, cv2.LINE_AA, SHIFT)

    def dot(self, point: FloatArray, colour: Colour, radius: float) -> None:
        """Draws a disc with a black rim.

        Args:
            point: (2,) image point u, v in px.
            colour: RGB, 0 to 255.
            radius: radius in `unit`.
        """
        centre = fixed(self._at(point))[0]
        for paint, more in ((BLACK, 1.5), (colour, 0.0)):
            reach = round((radius + more) * self.unit * (1 << SHIFT))
            cv2.circle(self.image, (int(centre[0]), int(centre[1])), reach, paint, -1, cv2.LINE_AA, SHIFT)

    def label(self, text: str, head: FloatArray, along: FloatArray, colour: Colour) -> None:
        """Writes a word just beyond the head of an arrow, inside the image.

        Args:
            text: the word.
            head: (2,) image point u, v in px.
            along: (2,) unit vector of the arrow.
            colour: RGB, 0 to 255.
        """
        (width, height), _ = cv2.getTextSize(text, FONT, self.font, 1)
        u, v = self._at(head)[0] + (6.0 * self.unit + 0.5 * np.hypot(width, height)) * along
        u = min(max(u - 0.5 * width, 3.0), self.image.shape[1] - width - 3.0)
        v = min(max(v + 0.5 * height, height + 3.0), self.image.shape[0] - 8.0)
        self._put(text, (round(u), round(v)), colour, self.font)

    def banner(self, title: str, detail: str, max_lines: int = MAX_BANNER_LINES) -> int:
        """Draws a red bar along the top that states a fault.

        Args:
            title: the fault.
            detail: its reason, broken into lines.
            max_lines: largest number of these lines.

        Returns:
            Height of the bar in rows of the canvas.
        """
        big, small = 1.25 * self.font, self.font
        lines = self._broken(detail, small)
        if len(lines) > max_lines:
            lines = [*lines[: max_lines - 1], lines[max_lines - 1].rsplit(" ", 1)[0] + " ..."]
        rows = [(title, big)] + [(line, small) for line in lines]
        heights = [round(38 * size) for _, size in rows]
        bottom = min(self.image.shape[0], sum(heights) + round(14 * small))
        self._shade(0, bottom, ALARM, 0.88)
        at = round(4 * small)
        for (text, size), height in zip(rows, heights, strict=True):
            at += height
            self._put(text, (round(16 * small), at - round(8 * size)), WHITE, size, outlined=False)
        return bottom

    def footer(self, rows: list[list[tuple[str, Colour]]], big_first: bool = False) -> int:
        """Draws a dark bar along the bottom with rows of coloured words.

        Args:
            rows: words of each row with their colours.
            big_first: whether the first row is larger.

        Returns:
            Height of the bar in rows of the canvas.
        """
        sizes = [self.font * (1.5 if big_first and k == 0 else 1.0) for k in range(len(rows))]
        widths = [sum(_width(text, size) + 26 * size for text, _ in row) for row, size in zip(rows, sizes, strict=True)]
        fit = min(1.0, *((self.image.shape[1] - 16 * self.font) / width for width in widths))
        sizes = [fit * size for size in sizes]
        heights = [round(36 * size) for size in sizes]
        top = max(0, self.image.shape[0] - sum(heights) - round(10 * self.font))
        self._shade(top, self.image.shape[0], BLACK, 0.6)
        at = top
        for row, size, height in zip(rows, sizes, heights, strict=True):
            at += height
            left = round(16 * self.font)
            for text, colour in row:
                self._put(text, (left, at - round(6 * size)), colour, size, outlined=False)
                left += _width(text, size) + round(26 * size)
        return self.image.shape[0] - top

    @property
    def font(self) -> float:
        """OpenCV's scale of the letters."""
        return 0.55 * max(0.75, self.image.shape[1] / 640.0)

    def _put(self, text: str, at: tuple[int, int], colour: Colour, size: float, outlined: bool = True) -> None:
        thick = max(1, round(2.0 * size))
        if outlined:
            cv2.putText(self.image, plain(text), at, FONT, size, BLACK, thick + 2, cv2.LINE_AA)
        cv2.putText(self.image, plain(text), at, FONT, size, colour, thick, cv2.LINE_AA)

    def _shade(self, top: int, bottom: int, colour: Colour, share: float) -> None:
        part = self.image[top:bottom]
        part[:] = ((1.0 - share) * part + share * np.array(colour)).astype(np.uint8)

    def _broken(self, text: str, size: float) -> list[str]:
        room = self.image.shape[1] - round(32 * size)
        lines: list[str] = []
        for word in plain(text).split():
            longer = f"{lines[-1]} {word}" if lines else word
            if lines and _width(longer, size) <= room:
                lines[-1] = longer
            else:
                lines.append(word)
        return lines


def _width(text: str, size: float) -> int:
    return cv2.getTextSize(plain(text), FONT, size, max(1, round(2.0 * size)))[0][0]


def fixed(points: FloatArray) -> Any:
    """Returns points in the fixed-point numbers that OpenCV draws with."""
    return np.round(np.clip(points, -3e4, 3e4) * (1 << SHIFT)).astype(np.int32)


def rgb(image: Image) -> Image:
    """Returns a grey or RGB image as RGB (h, w, 3)."""
    return np.repeat(image[:, :, None], 3, axis=2) if image.ndim == 2 else image


def plain(text: str) -> str:
    """Returns ``text`` in ASCII, which OpenCV can draw; other letters get their nearest spelling."""
    spelling = {0xB0: " deg", 0xD7: "x", 0x2212: "-", 0x2013: "-", 0xB5: "u"}
    return text.translate(spelling).encode("ascii", "replace").decode()
