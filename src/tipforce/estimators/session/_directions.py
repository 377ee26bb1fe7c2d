"""The directions of a rod's elements, as a line shows them."""

import numpy as np
from numpy.polynomial import legendre

from ...mechanics.planar import UNKNOWNS, Line, Model
from ...types import BoolArray, FloatArray
from ..rod import StatedErrors

_DEGREE = 6
"""Degree of the polynomial that smooths the direction along the rod."""
_LENGTH, _ANGLE = UNKNOWNS.index("length"), UNKNOWNS.index("base_angle_rad")


def directions_of(line: Line, stated: StatedErrors | None, model: Model, q: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Returns the directions of the rod's elements by the seen part of a line.

    Args:
        line: the line.
        stated: vision's statements about it; None: all of it is seen.
        model: the rod.
        q: (unknowns,) values of `UNKNOWNS`, of which length and direction of the clamp count.

    Returns:
        (segments + 1,) directions in the line's frame, rad, and whether the line shows each of them.
    """
    flexible = model.flexible_m * (1.0 + q[_LENGTH])
    length = flexible + model.rigid_m
    seen = np.ones(len(line.from_tip), np.bool_) if stated is None else stated.seen[:-1]
    arc = (line.from_tip[0] if line.from_clamp else length) - line.from_tip
    # the clamp holds the direction at the base
    arc = np.append(0.0, arc[seen])
    angle = np.append(q[_ANGLE], np.unwrap(np.arctan2(-line.normals[:, 0], line.normals[:, 1]))[seen])
    smooth = legendre.legfit(2.0 * arc / length - 1.0, angle, min(_DEGREE, len(arc) // 2))
    at = np.append((np.arange(model.segments) + 0.5) * flexible / model.segments, flexible)
    shown = at <= arc.max()
    return np.asarray(legendre.legval(2.0 * np.minimum(at, arc.max()) / length - 1.0, smooth), np.float64), shown
