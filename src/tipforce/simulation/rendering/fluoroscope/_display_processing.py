"""The vendor's processing: temporal filter, flattening, edge enhancement, and the text that is burned in."""

import math

import cv2
import numpy as np
import numpy.typing as npt

from ....geometry import CArm
from ....types import BoolArray, FloatArray
from ._scene import XrayBeam
from ._variety import DisplayProcessing

FloatImage = npt.NDArray[np.float32]
Bytes = npt.NDArray[np.uint8]
_LEFT = 0.02
"""The temporal filter's memory ends where less than this share of the light is left."""
_MAX_FRAMES = 6
_BLANK_LEVEL = 6.0
"""Grey level of the pixels behind the collimator that the display blanks."""


def temporal_weights(lag: FloatArray, kept: float) -> FloatArray:
    """Returns the weights (m,) of this frame and those before it after lag and the recursive filter; their sum is 1.

    Args:
        lag: (k,) weights of the detector's lag.
        kept: share of the filtered image before that the filter keeps.

    Returns:
        The weights, cut at 7 frames at the latest.
    """
    if not kept:
        return lag
    weights = np.convolve(lag, (1.0 - kept) * kept ** np.arange(_MAX_FRAMES + 1))[: _MAX_FRAMES + 1]
    remaining = np.cumsum(weights[::-1])[::-1]
    weights = weights[remaining > _LEFT]
    return weights / weights.sum()


def noise_gain(kept: float) -> float:
    """Returns the factor by which the recursive filter changes the standard deviation of independent noise.

    >>> noise_gain(0.6)
    0.5
    """
    return math.sqrt((1.0 - kept) / (1.0 + kept))


class Display:
    """Processes the images of one view, and burns in their text.

    Args:
        processing: the vendor's processing.
        opened: (h, w) pixels that the collimator leaves open.
        arm: the C-arm's nominal position.
        beam: the beam.
        seed: seed of the numbers in the text.
    """

    def __init__(self, processing: DisplayProcessing, opened: BoolArray, arm: CArm, beam: XrayBeam, seed: int) -> None:
        """Prepares the shading of the corners and the lines of text."""
        self._processing, self._opened, self._rate_hz = processing, opened, beam.rate_hz
        height, width = opened.shape
        self._finer = width / 512.0
        v, u = np.mgrid[0:height, 0:width]
        square_radius = (2.0 * (u + 0.5) / width - 1.0) ** 2 + (2.0 * (v + 0.5) / height - 1.0) ** 2
        # Brighter in the middle, darker in the corners.
        self._shade = (processing.vignetting * 0.5 * (0.4 - square_radius)).astype(np.float32)
        self._lines = _text_lines(arm, beam, seed)

    def apply(self, levels: npt.NDArray[np.uint8] | npt.NDArray[np.uint16], frame: int) -> Bytes:
        """Processes an image.

        Args:
            levels: (h, w) grey levels, 16 bits.
            frame: number of the frame, which the text states.

        Returns:
            (h, w) image, 8 bits.
        """
        processing = self._processing
        image = levels.astype(np.float32) * np.float32(1.0 / 257.0)  # 65535 becomes 255
        out = image
        if processing.flattening:
            # The slow differences of brightness: a wide blur, done on an image that is 16 times smaller.
            small = cv2.resize(image, None, fx=1 / 16, fy=1 / 16, interpolation=cv2.INTER_AREA)
            slow = cv2.GaussianBlur(small, (0, 0), 2.0, borderType=cv2.BORDER_REPLICATE)
            slow = cv2.resize(slow, image.shape[::-1], interpolation=cv2.INTER_CUBIC)
            out = out + np.float32(processing.flattening) * (np.float32(slow[self._opened].mean()) - slow)
        if processing.edge_gain:
            smooth = cv2.GaussianBlur(image, (0, 0), processing.edge_px * self._finer, borderType=cv2.BORDER_REPLICATE)
            out = out + np.float32(processing.edge_gain) * (image - smooth)
        if processing.vignetting:
            out = out + self._shade
        if processing.blanked:
            out = np.where(self._opened, out, np.float32(_BLANK_LEVEL))
        pixels = np.asarray(np.clip(out + 0.5, 0.0, 255.0).astype(np.uint8))
        self._write(pixels, frame)
        return pixels

    def covered(self) -> BoolArray:
        """Returns the pixels (h, w) behind the boxes of the text."""
        blank = np.zeros(self._opened.shape, np.uint8)
        if self._processing.boxed:
            for (u, v), (wide, high), _, _ in self._places(0):
                cv2.rectangle(blank, (u - 2, v - high - 2), (u + wide + 2, v + 4), 1, -1)
        return np.asarray(blank > 0, np.bool_)

    def _places(self, frame: int) -> list[tuple[tuple[int, int], tuple[int, int], str, float]]:
        """Returns position (u, v) in px of the lower left corner, size in px, text and font scale of each line."""
        height, width = self._opened.shape
        scale, step = 0.36 * self._finer, round(15 * self._finer)
        places: list[tuple[tuple[int, int], tuple[int, int], str, float]] = []
        first_line = 0
        for corner, count in enumerate(self._processing.text):  # top left, top right, bottom left, bottom right
            for k in range(count):
                text = self._lines[(first_line + k) % len(self._lines)].format(frame=frame, time=frame / self._rate_hz)
                (width_px, height_px), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, scale, 1)
                u = round(8 * self._finer) if corner % 2 == 0 else width - width_px - round(8 * self._finer)
                v = step * (k + 1) if corner < 2 else height - step * (count - k) + round(8 * self._finer)
                places.append(((u, v), (width_px, height_px), text, scale))
            first_line += count
        return places

    def _write(self, pixels: Bytes, frame: int) -> None:
        """Burns text, cross and ruler of frame number ``frame`` into ``pixels`` (h, w)."""
        made = self._processing
        height, width = pixels.shape
        thick = max(1, round(self._finer))
        for (u, v), (text_width, text_height), text, scale in self._places(frame):
            if made.boxed:
                cv2.rectangle(pixels, (u - 2, v - text_height - 2), (u + text_width + 2, v + 4), 0, -1)
            cv2.putText(pixels, text, (u, v), cv2.FONT_HERSHEY_SIMPLEX, scale, made.text_level, thick, cv2.LINE_AA)
        if made.cross:
            cv2.drawMarker(pixels, (width // 2, height // 2), made.text_level, cv2.MARKER_CROSS, width // 24, thick)
        if made.ruler:
            u, step = width - round(12 * self._finer), round(40 * self._finer)
            low, text_height = height // 2 - 4 * step, height // 2 + 4 * step
            cv2.line(pixels, (u, low), (u, text_height), made.text_level, thick)
            for v in range(low, text_height + 1, step):
                cv2.line(pixels, (u - round(6 * self._finer), v), (u, v), made.text_level, thick)


def _text_lines(arm: CArm, beam: XrayBeam, seed: int) -> list[str]:
    """Returns the lines of text that a display may show, in random order; {frame} and {time} are filled in later."""
    rng = np.random.default_rng([seed, 21])
    side = "LAO" if arm.primary_deg >= 0 else "RAO"
    tilt = "CRA" if arm.secondary_deg >= 0 else "CAU"
    lines = [
        f"{side} {abs(arm.primary_deg):.0f}  {tilt} {abs(arm.secondary_deg):.0f}",
        f"SID {100 * arm.source_detector_m:.0f} cm",
        f"{beam.kvp:.0f} kV  {rng.integers(5, 900)} mA  {1e3 * beam.pulse_s:.1f} ms",
        f"{beam.rate_hz:g} f/s",
        f"FOV {rng.choice([15, 20, 22, 25, 31])} cm",
        f"Run {rng.integers(1, 40)}",
        "Img {frame}",
        "{time:.1f} s",
        f"DAP {rng.uniform(0.1, 90):.1f} Gycm2",
        f"ID {rng.integers(10**5, 10**7)}",
        f"W {rng.integers(100, 256)} C {rng.integers(90, 160)}",
        f"HR {rng.integers(55, 120)}",
        "Cardiac 15 low",
        "FLUORO",
    ]
    return [lines[k] for k in rng.permutation(len(lines))]
