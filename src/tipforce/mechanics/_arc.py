"""Along a rod: what belongs to each segment and joint, and places by their arc length."""

import numpy as np

from ..types import FloatArray


def element_lengths_m(flexible_length_m: float, rigid_length_m: float, segments: int) -> FloatArray:
    """(segments + 1,): of the segments, then of the electrode."""
    lengths = np.full(segments + 1, flexible_length_m / segments)
    lengths[-1] = rigid_length_m
    return lengths


def joint_spans_m(flexible_length_m: float, segments: int) -> FloatArray:
    """(segments + 1,): length of shaft that belongs to each joint; half a segment at both ends."""
    spans = np.full(segments + 1, flexible_length_m / segments)
    spans[[0, -1]] /= 2
    return spans


def arc_m(element_lengths_m: FloatArray, points: int | FloatArray) -> FloatArray:
    """Arc lengths from the base: ``points`` of them, uniform and both ends included, or those that are given.

    Raises ValueError where one lies beyond the rod.
    """
    length = float(element_lengths_m.sum())
    if isinstance(points, int):
        return np.linspace(0.0, length, points)
    arc = np.asarray(points, dtype=np.float64)
    if arc.ndim != 1 or not ((arc >= 0) & (arc <= length * (1 + 1e-12))).all():
        raise ValueError(f"points: expected a row of arc lengths within 0 and {length} m, got {points}")
    return arc


def way_m(element_lengths_m: FloatArray, arc: FloatArray) -> FloatArray:
    """(points,) arc lengths -> (points, segments + 1): how far each element is walked from the base to there."""
    begins = np.cumsum(element_lengths_m) - element_lengths_m
    return np.clip(arc[:, None] - begins, 0.0, element_lengths_m)
