"""Segments, joints and arc lengths of a rod."""

import numpy as np

from ..types import FloatArray


def element_lengths_m(flexible_length_m: float, rigid_length_m: float, segments: int) -> FloatArray:
    """Returns the lengths of the segments, then of the electrode.

    Args:
        flexible_length_m: length of the shaft.
        rigid_length_m: length of the electrode.
        segments: number of segments of the shaft.

    Returns:
        (segments + 1,) lengths in metres.
    """
    lengths = np.full(segments + 1, flexible_length_m / segments)
    lengths[-1] = rigid_length_m
    return lengths


def joint_spans_m(flexible_length_m: float, segments: int) -> FloatArray:
    """Returns the length of shaft that belongs to each joint: half a segment at both ends.

    Args:
        flexible_length_m: length of the shaft.
        segments: number of its segments.

    Returns:
        (segments + 1,) lengths in metres.
    """
    spans = np.full(segments + 1, flexible_length_m / segments)
    spans[[0, -1]] /= 2
    return spans


def arc_m(element_lengths_m: FloatArray, points: int | FloatArray) -> FloatArray:
    """Returns arc lengths from the base.

    Args:
        element_lengths_m: (segments + 1,) lengths of the segments and of the electrode.
        points: number of arc lengths, uniform and with both ends; or the arc lengths themselves.

    Returns:
        (points,) arc lengths in metres.

    Raises:
        ValueError: an arc length is outside the rod.
    """
    length = float(element_lengths_m.sum())
    if isinstance(points, int):
        return np.linspace(0.0, length, points)
    arc = np.asarray(points, dtype=np.float64)
    if arc.ndim != 1 or not ((arc >= 0) & (arc <= length * (1 + 1e-12))).all():
        raise ValueError(f"points: expected a row of arc lengths within 0 and {length} m, got {points}")
    return arc


def way_m(element_lengths_m: FloatArray, arc: FloatArray) -> FloatArray:
    """Returns the length of each element between the base and given arc lengths.

    Args:
        element_lengths_m: (segments + 1,) lengths of the segments and of the electrode.
        arc: (points,) arc lengths in metres.

    Returns:
        (points, segments + 1) lengths in metres; their sum over the elements is the arc length.
    """
    begins = np.cumsum(element_lengths_m) - element_lengths_m
    return np.clip(arc[:, None] - begins, 0.0, element_lengths_m)
