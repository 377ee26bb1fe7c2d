"""The tissue's face, flat or part of a sphere; at one instant its tangent plane is used."""

import math

import numpy as np

from ...types import FloatArray
from ._compile import compiled

_MAX_LEAN_RAD = math.asin(0.6)
"""The sphere ends at this angle of its normal (some 37 degrees); from there on the face is straight, as a cone."""


@compiled
def face_axes(axes: FloatArray, radius: float, place: FloatArray, turned: FloatArray) -> float:
    """Computes the axes of the face at its point nearest to a position.

    Args:
        axes: (3, 3) rows d (into the tissue), t1, t2 at the apex.
        radius: radius of the sphere in m, positive for a convex face, negative for a concave one.
        place: (3,) position relative to the apex in m.
        turned: (3, 3) axes that are written: ``axes`` turned by the smallest rotation from d to the normal there.

    Returns:
        Position of the tangent plane along its own normal, from the apex, in m.
    """
    side = math.copysign(1.0, radius)
    # from the dome to the sphere's centre if the face is convex, opposite if it is concave
    deep, first, second = radius, 0.0, 0.0
    for k in range(3):
        deep -= axes[0, k] * place[k]
        first -= axes[1, k] * place[k]
        second -= axes[2, k] * place[k]
    deep, first, second = side * deep, side * first, side * second
    sideways = math.hypot(first, second)
    lean_rad = min(math.atan2(sideways, deep), _MAX_LEAN_RAD)
    first, second = (first / sideways, second / sideways) if sideways > 0.0 else (1.0, 0.0)
    c, s = math.cos(lean_rad), math.sin(lean_rad)
    for k in range(3):
        outward = first * axes[1, k] + second * axes[2, k]
        around = second * axes[1, k] - first * axes[2, k]
        turned[0, k] = c * axes[0, k] + s * outward
        outward_turned = c * outward - s * axes[0, k]
        turned[1, k] = first * outward_turned + second * around
        turned[2, k] = second * outward_turned - first * around
    return radius * (c - 1.0)


@compiled
def _normals(axes: FloatArray, radius: float, places: FloatArray, normals: FloatArray) -> None:
    """Writes ``normals`` (m, 3) at ``places`` (m, 3), see `face_normals`."""
    turned = np.empty((3, 3))
    for row in range(places.shape[0]):
        face_axes(axes, radius, places[row], turned)
        normals[row] = turned[0]


def face_normals(axes: FloatArray, radius_m: float | None, places_m: FloatArray) -> FloatArray:
    """Returns the directions into the tissue at the face's points nearest to given positions.

    Args:
        axes: (3, 3) rows d (into the tissue), t1, t2 at the apex.
        radius_m: radius of the sphere, positive for a convex face, negative for a concave one; None: flat.
        places_m: (m, 3) positions relative to the apex.

    Returns:
        (m, 3) unit vectors.
    """
    normals = np.tile(axes[0], (len(places_m), 1))
    if radius_m is not None:
        _normals(axes, radius_m, np.ascontiguousarray(places_m, np.float64), normals)
    return normals


def face_depths(radius_m: float, aside_m: FloatArray) -> FloatArray:
    """Returns the depth of the face in the tissue at ``aside_m`` from its apex; negative for a concave face.

    Args:
        radius_m: radius of the sphere, positive for a convex face.
        aside_m: (m,) distances from the apex along its tangent plane.

    Returns:
        (m,) depths.

    >>> face_depths(0.015, np.array([0.0, 0.009, 0.013])).round(6)
    array([0.   , 0.003, 0.006])
    """
    size = abs(radius_m)
    edge = size * math.sin(_MAX_LEAN_RAD)
    aside = np.abs(aside_m)
    ball = size - np.sqrt(size * size - np.minimum(aside, edge) ** 2)  # beyond the edge the face is a cone
    return math.copysign(1.0, radius_m) * (ball + np.maximum(aside - edge, 0.0) * math.tan(_MAX_LEAN_RAD))
