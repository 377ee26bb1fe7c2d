"""From expected photons to grey levels: photon noise, lag, blur, electronic noise, display curve.

Photon counts are Poisson distributed numbers from a hash of (key, pixel), so any frame can be drawn alone, on any
thread, and comes out the same. Below `FEW` photons: Walker's alias method on tables a small step of the mean apart; a
mean between two of them takes one or the other with the odds that keep it. Above: a Cornish-Fisher expansion of a
Gaussian, rounded.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
from numba import njit

from ...._system.compilation import STEADY
from ....types import FloatArray
from .._random import gauss_row, gauss_table, hash_row
from ._scene import Detector

FloatImage = npt.NDArray[np.float32]
Words = npt.NDArray[np.uint32]
PhotonCounts = npt.NDArray[np.uint16]
FEW = 36.0
"""Mean of photons below which a table is used."""
_COLUMNS = 128
"""Numbers of photons, 0 to 127, in a table: for a mean below `FEW` larger ones are never drawn."""
_STEP = 0.02
"""Between tables, of the root of the mean: a mixture of two neighbours has at most 1 + 0.02^2 times the variance."""


@dataclass(frozen=True, slots=True, eq=False)
class PhotonTables:
    """Tables of `sample_photons`.

    Attributes:
        alias: (means, 128) threshold in the upper 25 bits, alias in the lower 7.
        gauss: `gauss_table`.
    """

    alias: Words
    gauss: FloatImage


def frame_key(seed: int, view: int, frame: int, purpose: int) -> Words:
    """Returns the key from which the noise of an image is drawn.

    Args:
        seed: seed of the scene.
        view: number of the view.
        frame: number of the frame.
        purpose: 0 for photons, 1 for the read-out.

    Returns:
        (3,) words that other arguments have with a probability of 2^-96 only.
    """
    return np.random.SeedSequence([seed, view, frame, purpose]).generate_state(3, np.uint32).astype(np.uint32)


def _alias_row(chance: FloatArray) -> Words:
    """Makes the alias table (128,) of the probabilities of 0 to 127 photons by Vose's method.

    A word has in its upper 25 bits the probability to keep the column's own number; otherwise the number is that in the
    lower 7 bits. So one draw takes one column and one comparison.
    """
    scaled = chance / chance.sum() * _COLUMNS
    threshold, alias = np.ones(_COLUMNS), np.arange(_COLUMNS)
    small = [k for k in range(_COLUMNS) if scaled[k] < 1.0]
    large = [k for k in range(_COLUMNS) if scaled[k] >= 1.0]
    while small and large:
        receiver, giver = small.pop(), large[-1]
        threshold[receiver], alias[receiver] = scaled[receiver], giver
        scaled[giver] -= 1.0 - scaled[receiver]
        if scaled[giver] < 1.0:
            small.append(large.pop())
    # A column with probability 1 is its own alias, so that the cut of its threshold to 25 bits has no effect.
    kept = np.minimum(threshold * (1 << 25), (1 << 25) - 1).astype(np.uint32)
    return ((kept << np.uint32(7)) | alias.astype(np.uint32)).astype(np.uint32)


def photon_tables() -> PhotonTables:
    """Makes the tables that `sample_photons` reads."""
    from scipy.special import gammaln

    k = np.arange(_COLUMNS)
    means = (np.arange(math.ceil(math.sqrt(FEW) / _STEP) + 2) * _STEP) ** 2
    rows = [_alias_row(np.exp(k * math.log(m) - m - gammaln(k + 1.0)) if m > 0 else (k == 0) * 1.0) for m in means]
    return PhotonTables(np.stack(rows), gauss_table())


@njit(cache=True, error_model="numpy", fastmath=STEADY, nogil=True)
def _many(means: FloatImage, row: FloatImage) -> None:
    """Converts Gaussian numbers in ``row`` (w,) to photons with these ``means`` (w,) plus 0.5, not yet rounded down.

    The Cornish-Fisher expansion gives them the skewness and kurtosis of Poisson numbers. Smaller means than `FEW` are
    replaced by it: their photons are drawn elsewhere.
    """
    one, two, three, five = np.float32(1.0), np.float32(2.0), np.float32(3.0), np.float32(5.0)
    half, sixth, twelfth = np.float32(0.5), np.float32(1 / 6), np.float32(1 / 12)
    over24, over36, few = np.float32(1 / 24), np.float32(1 / 36), np.float32(FEW)
    for u in range(means.size):
        mean = max(means[u], few)
        z = row[u]
        variance = mean - twelfth  # rounding adds a twelfth
        sigma = np.sqrt(variance)
        skew = mean / (variance * sigma)  # the excess kurtosis is its square, nearly
        square = z * z
        corrected = z + skew * sixth * (square - one)
        corrected += skew * skew * z * (over24 * (square - three) - over36 * (two * square - five))
        row[u] = mean + sigma * corrected + half


@njit(cache=True, error_model="numpy", nogil=True)
def sample_photons(means: FloatImage, key: Words, alias: Words, gauss: FloatImage, counts: PhotonCounts) -> None:
    """Draws Poisson numbers; those above 65,535 are cut off.

    Args:
        means: (h, w) expected photons.
        key: (3,) key of the image, see `frame_key`.
        alias: alias tables, see `PhotonTables`.
        gauss: `gauss_table`.
        counts: (h, w) photons that are written.
    """
    h, w = means.shape
    words, row = np.empty(w, np.uint32), np.empty(w, np.float32)
    top, zero, few = np.float32(65535.0), np.float32(0.0), np.float32(FEW)
    per_step = np.float32(1.0 / _STEP)
    for v in range(h):
        hash_row(v * w, key, words)
        level, out = means[v], counts[v]
        least, most = level[0], level[0]  # a row that is all dark or all bright needs one method only
        for u in range(w):
            least, most = min(least, level[u]), max(most, level[u])
        if most >= few:
            gauss_row(words, gauss, row)
            _many(level, row)
            for u in range(w):
                out[u] = np.uint16(min(max(row[u], zero), top))
        if least < few:
            for u in range(w):
                mean = level[u]
                if mean < few:
                    table_index = np.sqrt(max(mean, zero)) * per_step
                    k = int(table_index)
                    # The chance of the upper table that keeps the mean: tables are even in the root of the mean.
                    upper_chance = (table_index * table_index - k * k) / (2 * k + 1)
                    word = words[u]
                    # A second random number from the same word, of which 24 bits count, chooses between the two tables.
                    second_word = np.uint32(np.uint32(word ^ (word >> np.uint32(7))) * np.uint32(0x9E3779B1))
                    if np.float32(second_word >> np.uint32(8)) < upper_chance * np.float32(16777216.0):
                        k += 1
                    column = word & np.uint32(127)  # the alias method: 7 bits for the column, 25 for the threshold
                    entry = alias[k, column]
                    if (word >> np.uint32(7)) >= (entry >> np.uint32(7)):
                        column = entry & np.uint32(127)
                    out[u] = np.uint16(column)


_POINTS = 8192


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """The display's curve: grey levels by the root of the signal.

    Attributes:
        levels: (n,) grey levels.
        per_root: number of levels for a root of one photon.
    """

    levels: FloatImage
    per_root: float


def display_curve(detector: Detector, mean: float, bits: int) -> Curve:
    """Makes the display's curve.

    Args:
        detector: the detector, with the kind of its curve and its contrast.
        mean: photons that the exposure control holds.
        bits: bits of a grey level.

    Returns:
        Grey levels from 0 to 20 ``mean`` photons.
    """
    top = float((1 << bits) - 1)
    most = math.sqrt(20.0 * mean)
    signal = np.linspace(0.0, most, _POINTS) ** 2  # even in the root, as photon noise is
    if detector.curve == "log":
        share = 0.5 + detector.contrast / 255.0 * np.log(np.maximum(signal, 1e-3 * mean) / mean)
    else:
        share = detector.contrast / 255.0 * signal / mean
    return Curve(np.clip(top * share, 0.0, top).astype(np.float32), (_POINTS - 1) / most)


@njit(cache=True, error_model="numpy", fastmath=STEADY, nogil=True)
def _add(total: FloatImage, counts: PhotonCounts, weight: float, fresh: bool) -> None:
    """Adds ``weight`` times ``counts`` (h, w) to ``total`` (h, w), or writes it there if ``fresh``."""
    share = np.float32(weight)
    for v in range(total.shape[0]):
        row, out = counts[v], total[v]
        if fresh:
            for u in range(out.size):
                out[u] = share * np.float32(row[u])
        else:
            for u in range(out.size):
                out[u] += share * np.float32(row[u])


def sum_with_lag(planes: Sequence[PhotonCounts], weights: FloatArray, total: FloatImage) -> None:
    """Writes into ``total`` the signal of a frame: its photons, and the lag of the frames before it.

    Args:
        planes: (h, w) photons of this frame, then of those before it, the newest first; at most one for each weight.
        weights: shares of the frames in the signal, whose sum is 1. Those of missing frames are added to this frame's,
            so that the brightness stays the same.
        total: (h, w) receives the signal in photons.
    """
    known = weights[: len(planes)].copy()
    known[0] += 1.0 - known.sum()
    for k, plane in enumerate(planes):
        _add(total, plane, known[k], k == 0)


def blurred(signal: FloatImage, detector: Detector, finer: float) -> FloatImage:
    """Spreads the light in the detector.

    Args:
        signal: (h, w) photons.
        detector: the detector, with its blur.
        finer: columns of the image / 512.

    Returns:
        (h, w) photons.
    """
    core_px, tail_px = (finer * sigma for sigma in detector.blur_px)
    share = detector.blur_tail
    core = cv2.GaussianBlur(signal, _size(core_px), core_px, borderType=cv2.BORDER_REPLICATE)
    half_size = cv2.resize(signal, (signal.shape[1] // 2, signal.shape[0] // 2), interpolation=cv2.INTER_AREA)
    # Means of 2 x 2 pixels and going back between them spread by 11/12 px^2 already.
    rest_px = 0.5 * math.sqrt(max(tail_px**2 - 11 / 12, 0.04))
    half_size = cv2.GaussianBlur(half_size, _size(rest_px), rest_px, borderType=cv2.BORDER_REPLICATE)
    tail = cv2.resize(half_size, signal.shape[::-1], interpolation=cv2.INTER_LINEAR)
    return np.asarray(cv2.addWeighted(core, 1.0 - share, tail, share, 0.0), np.float32)


def _size(sigma: float) -> tuple[int, int]:
    side = 2 * math.ceil(3.0 * sigma) + 1
    return side, side


@njit(cache=True, error_model="numpy", fastmath=STEADY, nogil=True)
def read_out(
    signal: FloatImage,
    key: Words,
    gauss: FloatImage,
    electronic: float,
    line_noise: float,
    levels: FloatImage,
    per_root: float,
    image: npt.NDArray[np.uint8] | npt.NDArray[np.uint16],
) -> None:
    """Adds electronic noise to the signal and converts it to grey levels by the display's curve.

    Args:
        signal: (h, w) photons.
        key: (3,) key of the image, see `frame_key`.
        gauss: `gauss_table`.
        electronic: standard deviation of a pixel's noise in photons.
        line_noise: standard deviation of a row's noise in photons.
        levels: (n,) grey levels of the `Curve`.
        per_root: its levels for a root of one photon.
        image: (h, w) image that is written.
    """
    h, w = signal.shape
    words, row, row_noise = np.empty(w, np.uint32), np.empty(w, np.float32), np.empty(h, np.float32)
    row_words = np.empty(h, np.uint32)
    hash_row(h * w, key, row_words)
    gauss_row(row_words, gauss, row_noise)
    sigma, scale, zero, half = np.float32(electronic), np.float32(per_root), np.float32(0.0), np.float32(0.5)
    last = np.float32(levels.size - 2)
    for v in range(h):
        hash_row(v * w, key, words)
        gauss_row(words, gauss, row)
        line = np.float32(line_noise) * row_noise[v]  # the same for all pixels of this row
        values, out = signal[v], image[v]
        for u in range(w):
            row[u] = min(np.sqrt(max(values[u] + sigma * row[u] + line, zero)) * scale, last)
        for u in range(w):
            k = np.int32(row[u])
            share, index = row[u] - np.float32(k), np.uint32(k)
            below, above = levels[index], levels[index + np.uint32(1)]
            out[u] = np.int32(below + (above - below) * share + half)
