"""Quantum noise: whole numbers of X-ray quanta, Poisson distributed, from a hash of (key, pixel).

Below `FEW` quanta: Walker's alias method on tables a small step of the mean apart; a mean between two of them takes one
or the other with the odds that keep it. Above: a Cornish-Fisher expansion of a Gaussian, rounded. Any frame can be
drawn alone, on any thread, and comes out the same.
"""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit

from ...._compile import STEADY
from ....types import FloatArray
from .._random import gauss_row, gauss_table, hash_row

__all__ = ["FEW", "QuantumTables", "draw_quanta", "frame_key", "quantum_tables"]

Picture = npt.NDArray[np.float32]
Words = npt.NDArray[np.uint32]
Quanta = npt.NDArray[np.uint16]

FEW = 36.0
_COLUMNS = 128
_STEP = 0.02
"""Between tables, of the root of the mean: a mixture of two neighbours has at most 1 + 0.02^2 times the variance."""


@dataclass(frozen=True, slots=True, eq=False)
class QuantumTables:
    """``alias`` (means, 128) uint32: threshold in the upper 25 bits, alias in the lower 7; ``gauss``: `gauss_table`."""

    alias: Words
    gauss: Picture


def frame_key(seed: int, view: int, frame: int, purpose: int) -> Words:
    """(3,) words that no other session, view, frame and purpose share but by chance."""
    return np.random.SeedSequence([seed, view, frame, purpose]).generate_state(3, np.uint32).astype(np.uint32)


def _alias_row(chance: FloatArray) -> Words:
    """Vose's construction for (128,) probabilities."""
    scaled = chance / chance.sum() * _COLUMNS
    threshold, alias = np.ones(_COLUMNS), np.arange(_COLUMNS)
    small = [k for k in range(_COLUMNS) if scaled[k] < 1.0]
    large = [k for k in range(_COLUMNS) if scaled[k] >= 1.0]
    while small and large:
        less, more = small.pop(), large[-1]
        threshold[less], alias[less] = scaled[less], more
        scaled[more] -= 1.0 - scaled[less]
        if scaled[more] < 1.0:
            small.append(large.pop())
    top = (1 << 25) - 1
    # A column that is sure of itself is its own alias, so that its threshold does not matter.
    return (
        (np.minimum(threshold * (1 << 25), top).astype(np.uint32) << np.uint32(7)) | alias.astype(np.uint32)
    ).astype(np.uint32)


def quantum_tables() -> QuantumTables:
    """The tables that `draw_quanta` reads; made once."""
    from scipy.special import gammaln

    k = np.arange(_COLUMNS)
    means = (np.arange(math.ceil(math.sqrt(FEW) / _STEP) + 2) * _STEP) ** 2
    rows = [_alias_row(np.exp(k * math.log(m) - m - gammaln(k + 1.0)) if m > 0 else (k == 0) * 1.0) for m in means]
    return QuantumTables(np.stack(rows), gauss_table())


@njit(cache=True, error_model="numpy", fastmath=STEADY, nogil=True)
def _many(means: Picture, row: Picture) -> None:
    """Gaussian numbers in ``row`` to quanta of these ``means`` plus a half, not yet rounded down."""
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
        bent = z + skew * sixth * (square - one)
        bent += skew * skew * z * (over24 * (square - three) - over36 * (two * square - five))
        row[u] = mean + sigma * bent + half


@njit(cache=True, error_model="numpy", nogil=True)
def draw_quanta(means: Picture, key: Words, alias: Words, gauss: Picture, quanta: Quanta) -> None:
    """Poisson numbers of ``means`` (h, w) into ``quanta`` (h, w); more than 65,535 are cut off."""
    h, w = means.shape
    words, row = np.empty(w, np.uint32), np.empty(w, np.float32)
    top, zero, few = np.float32(65535.0), np.float32(0.0), np.float32(FEW)
    per_step = np.float32(1.0 / _STEP)
    for v in range(h):
        hash_row(v * w, key, words)
        level, out = means[v], quanta[v]
        least, most = level[0], level[0]
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
                    place = np.sqrt(max(mean, zero)) * per_step
                    k = int(place)
                    # The chance of the upper table that keeps the mean: tables lie evenly in the root of the mean.
                    part = (place * place - k * k) / (2 * k + 1)
                    word = words[u]
                    other = np.uint32(np.uint32(word ^ (word >> np.uint32(7))) * np.uint32(0x9E3779B1))
                    if np.float32(other >> np.uint32(8)) < part * np.float32(16777216.0):
                        k += 1
                    column = word & np.uint32(127)
                    entry = alias[k, column]
                    if (word >> np.uint32(7)) >= (entry >> np.uint32(7)):
                        column = entry & np.uint32(127)
                    out[u] = np.uint16(column)
