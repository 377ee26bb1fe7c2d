"""Peaks of the heat maps, and the course that leads through one peak of each map.

Each map has its own highest peak, and where two objects look alike these may be on different ones. Neighbouring points
of one catheter are near each other: the most probable course with this prior is found by dynamic programming (Viterbi).
"""

from itertools import pairwise

import cv2
import numpy as np
import numpy.typing as npt

from ...types import FloatArray

STRIDE = 4
"""Px of the network's image to one cell of its heat maps."""
MAX_PEAKS = 6
"""Number of peaks of a map that are compared."""
MIN_PEAK_SHARE = 0.003
"""A lower peak is compared only if it is the highest of its map."""
FREE_STEP_CELLS, STEP_CELLS, MAX_STEP_COST = 5.0, 3.0, 5.0
"""Neighbouring points may be this far apart: further ones cost 1 for each second number of cells, and at most the
third. In training a step is at most 3 cells long."""

_NEAR = np.arange(3)
"""A peak's cell and its neighbours, in a map with a margin of one cell."""


def shares_of(logits: FloatArray) -> FloatArray:
    """Returns the probability of each cell, (k, h, w); a logit of 0 is as likely as that the point is nowhere."""
    top = np.maximum(logits.max(axis=(1, 2), keepdims=True), 0.0)
    weights = np.exp(logits - top)
    return weights / (weights.sum(axis=(1, 2), keepdims=True) + np.exp(-top))


def peaks_at(
    shares: FloatArray, maps: npt.NDArray[np.int64], rows: npt.NDArray[np.int64], columns: npt.NDArray[np.int64]
) -> tuple[FloatArray, FloatArray]:
    """Returns the points (n, 2) of peaks in px of the network's image, and their masses (n,).

    Args:
        shares: (k, h, w) probability of each cell.
        maps: (n,) map of each peak.
        rows: (n,) row of its cell.
        columns: (n,) column of its cell.
    """
    padded = np.pad(shares, ((0, 0), (1, 1), (1, 1)))
    near = padded[maps[:, None, None], rows[:, None, None] + _NEAR[:, None], columns[:, None, None] + _NEAR]
    mass = near.sum(axis=(1, 2))
    inside = np.maximum(mass, 1e-12)
    off = np.stack([near.sum(axis=1) @ (_NEAR - 1.0), near.sum(axis=2) @ (_NEAR - 1.0)], axis=1) / inside[:, None]
    return (np.stack([columns, rows], axis=1) + off + 0.5) * STRIDE - 0.5, mass


def course(shares: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Returns the points (k, 2) of one course in px of the network's image, and their masses (k,).

    Args:
        shares: (k, h, w) probability of each cell, for the points in their order along the catheter.
    """
    peaks = _peaks(shares)
    cost = -np.log(np.maximum(peaks[0][1], 1e-9))
    back: list[npt.NDArray[np.int64]] = []
    for (before, _), (after, mass) in pairwise(peaks):
        step = np.linalg.norm(after[:, None] - before[None], axis=2) / STRIDE
        total = cost[None] + np.clip((step - FREE_STEP_CELLS) / STEP_CELLS, 0.0, MAX_STEP_COST)
        back.append(total.argmin(axis=1))
        cost = total.min(axis=1) - np.log(np.maximum(mass, 1e-9))
    chosen = [int(cost.argmin())]
    for earlier in reversed(back):
        chosen.append(int(earlier[chosen[-1]]))
    found = [(points[k], mass[k]) for (points, mass), k in zip(peaks, reversed(chosen), strict=True)]
    return np.array([point for point, _ in found]), np.array([mass for _, mass in found])


def _peaks(shares: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
    """Returns the highest peaks (n, 2) of each map of ``shares`` (k, h, w) in px of the network's image.

    Each with its mass (n,).
    """
    small = np.ascontiguousarray(shares.transpose(1, 2, 0), np.float32)
    around = cv2.dilate(small, np.ones((3, 3), np.uint8)).reshape(small.shape)
    least = np.minimum(MIN_PEAK_SHARE, shares.max(axis=(1, 2)))
    maps, rows, columns = np.nonzero(((small >= around) & (shares.transpose(1, 2, 0) >= least)).transpose(2, 0, 1))
    order = np.lexsort((-shares[maps, rows, columns], maps))
    first = np.searchsorted(maps, np.arange(len(shares) + 1))
    order = order[np.arange(len(maps)) - first[maps] < MAX_PEAKS]
    points, mass = peaks_at(shares, maps[order], rows[order], columns[order])
    ends = np.searchsorted(maps[order], np.arange(1, len(shares)))
    return list(zip(np.split(points, ends), np.split(mass, ends), strict=True))
