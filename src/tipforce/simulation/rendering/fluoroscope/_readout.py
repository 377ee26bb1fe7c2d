"""From quanta to grey levels: lag, the detector's blur, electronic noise, the display's curve."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
from numba import njit

from ...._compile import STEADY
from ....types import FloatArray
from .._random import gauss_row, hash_row
from ._quanta import Quanta, Words
from ._scene import Detector

__all__ = ["Curve", "blurred", "display_curve", "read_out", "with_lag"]

Picture = npt.NDArray[np.float32]

_POINTS = 8192


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """Grey levels by the root of the signal: ``levels`` (n,), ``per_root`` of them for a root of one quantum."""

    levels: Picture
    per_root: float


def display_curve(detector: Detector, mean: float, bits: int) -> Curve:
    """``mean``: the signal, in quanta, that the exposure control holds."""
    top = float((1 << bits) - 1)
    most = math.sqrt(20.0 * mean)
    signal = np.linspace(0.0, most, _POINTS) ** 2
    if detector.curve == "log":
        share = 0.5 + detector.contrast / 255.0 * np.log(np.maximum(signal, 1e-3 * mean) / mean)
    else:
        share = detector.contrast / 255.0 * signal / mean
    return Curve(np.clip(top * share, 0.0, top).astype(np.float32), (_POINTS - 1) / most)


@njit(cache=True, error_model="numpy", fastmath=STEADY, nogil=True)
def _add(total: Picture, quanta: Quanta, weight: float, fresh: bool) -> None:
    share = np.float32(weight)
    for v in range(total.shape[0]):
        row, out = quanta[v], total[v]
        if fresh:
            for u in range(out.size):
                out[u] = share * np.float32(row[u])
        else:
            for u in range(out.size):
                out[u] += share * np.float32(row[u])


def with_lag(planes: Sequence[Quanta], weights: FloatArray, total: Picture) -> None:
    """``planes``: this frame's quanta, then those of the frames before it, as far as there are any.

    What frames that are not there would leave behind is taken from this one, so that the brightness is the same.
    """
    known = weights[: len(planes)].copy()
    known[0] += 1.0 - known.sum()
    for k, plane in enumerate(planes):
        _add(total, plane, known[k], k == 0)


def blurred(signal: Picture, detector: Detector, finer: float) -> Picture:
    """The light's spread in the detector; ``finer``: pixels a pixel of a picture of 512 columns."""
    near, far = (finer * sigma for sigma in detector.blur_px)
    share = detector.blur_tail
    core = cv2.GaussianBlur(signal, _size(near), near, borderType=cv2.BORDER_REPLICATE)
    half = cv2.resize(signal, (signal.shape[1] // 2, signal.shape[0] // 2), interpolation=cv2.INTER_AREA)
    # Means of 2 x 2 pixels and going back between them spread by 11/12 px^2 already.
    rest = 0.5 * math.sqrt(max(far**2 - 11 / 12, 0.04))
    half = cv2.GaussianBlur(half, _size(rest), rest, borderType=cv2.BORDER_REPLICATE)
    tail = cv2.resize(half, signal.shape[::-1], interpolation=cv2.INTER_LINEAR)
    return np.asarray(cv2.addWeighted(core, 1.0 - share, tail, share, 0.0), np.float32)


def _size(sigma: float) -> tuple[int, int]:
    side = 2 * math.ceil(3.0 * sigma) + 1
    return side, side


@njit(cache=True, error_model="numpy", fastmath=STEADY, nogil=True)
def read_out(
    signal: Picture,
    key: Words,
    gauss: Picture,
    electronic: float,
    line_noise: float,
    levels: Picture,
    per_root: float,
    picture: npt.NDArray[np.uint8] | npt.NDArray[np.uint16],
) -> None:
    """``signal`` (h, w) in quanta with electronic noise, by the display's curve, rounded, into ``picture``."""
    h, w = signal.shape
    words, row, of_rows = np.empty(w, np.uint32), np.empty(w, np.float32), np.empty(h, np.float32)
    of_words = np.empty(h, np.uint32)
    hash_row(h * w, key, of_words)
    gauss_row(of_words, gauss, of_rows)
    sigma, scale, none, half = np.float32(electronic), np.float32(per_root), np.float32(0.0), np.float32(0.5)
    last = np.float32(levels.size - 2)
    for v in range(h):
        hash_row(v * w, key, words)
        gauss_row(words, gauss, row)
        line = np.float32(line_noise) * of_rows[v]
        values, out = signal[v], picture[v]
        for u in range(w):
            row[u] = min(np.sqrt(max(values[u] + sigma * row[u] + line, none)) * scale, last)
        for u in range(w):
            k = np.int32(row[u])
            part, at = row[u] - np.float32(k), np.uint32(k)
            below, above = levels[at], levels[at + np.uint32(1)]
            out[u] = np.int32(below + (above - below) * part + half)
