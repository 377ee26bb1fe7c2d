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


def shares_of(logits: FloatArray) -> FloatArray:
    """Returns the probability of each cell, (k, h, w); a logit of 0 is as likely as that the point is nowhere."""
    top = np.maximum(logits.max(axis=(1, 2), keepdims=True), 0.0)
    weights = np.exp(logits - top)
    return weights / (weights.sum(axis=(1, 2), keepdims=True) + np.exp(-top))


def peak_at(shares: FloatArray, row: int, column: int) -> tuple[FloatArray, float]:
    """Returns the point (2,) of a peak in px of the network's image, and its mass.

    Args:
        shares: (h, w) probability of each cell.
        row: row of the peak's cell.
        column: column of the peak's cell.
    """
    height, width = shares.shape
    rows = np.arange(max(row - 1, 0), min(row + 2, height))
    columns = np.arange(max(column - 1, 0), min(column + 2, width))
    near = shares[np.ix_(rows, columns)]
    mass = float(near.sum())
    inside = max(mass, 1e-12)
    return (np.array([near.sum(axis=0) @ columns, near.sum(axis=1) @ rows]) / inside + 0.5) * STRIDE - 0.5, mass


def course(shares: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Returns the points (k, 2) of one course in px of the network's image, and their masses (k,).

    Args:
        shares: (k, h, w) probability of each cell, for the points in their order along the catheter.
    """
    peaks = [_peaks(each) for each in shares]
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


def _peaks(shares: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Returns the highest peaks (n, 2) of ``shares`` (h, w) in px of the network's image, and their masses (n,)."""
    least = min(MIN_PEAK_SHARE, float(shares.max()))
    small = shares.astype(np.float32)
    rows, columns = np.nonzero((small >= cv2.dilate(small, np.ones((3, 3), np.uint8))) & (shares >= least))
    order = np.argsort(-shares[rows, columns], kind="stable")[:MAX_PEAKS]
    found = [peak_at(shares, int(rows[k]), int(columns[k])) for k in order]
    return np.array([point for point, _ in found]), np.array([mass for _, mass in found])
