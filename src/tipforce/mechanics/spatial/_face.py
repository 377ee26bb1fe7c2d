"""The tissue's face: flat, or part of a sphere; what stands for it in one instant is its tangent plane."""

import math

import numpy as np

from ...types import FloatArray
from ._compile import compiled

_STEEPEST = math.asin(0.6)
"""The sphere ends where its normal leans by this (some 37 degrees); from there the face goes on straight, as a cone."""


@compiled
def face_axes(axes: FloatArray, radius: float, place: FloatArray, turned: FloatArray) -> float:
    """Fill ``turned`` (3, 3) with the directions of the face nearest to ``place`` (3,), counted from its apex.

    ``axes`` (3, 3): rows d (into the tissue), t1, t2 at the apex; ``turned``: the same by the least turn that brings d
    to the normal there. ``radius``: of the sphere, positive for a convex face, negative for a concave one. Returns
    where the tangent plane stands along its own normal, from the apex.
    """
    side = math.copysign(1.0, radius)
    # from the dome to the sphere's centre where the face is convex, the other way where it is concave
    deep, first, second = radius, 0.0, 0.0
    for k in range(3):
        deep -= axes[0, k] * place[k]
        first -= axes[1, k] * place[k]
        second -= axes[2, k] * place[k]
    deep, first, second = side * deep, side * first, side * second
    aside = math.hypot(first, second)
    lean = min(math.atan2(aside, deep), _STEEPEST)
    first, second = (first / aside, second / aside) if aside > 0.0 else (1.0, 0.0)
    c, s = math.cos(lean), math.sin(lean)
    for k in range(3):
        out = first * axes[1, k] + second * axes[2, k]
        round_ = second * axes[1, k] - first * axes[2, k]
        turned[0, k] = c * axes[0, k] + s * out
        bent = c * out - s * axes[0, k]
        turned[1, k] = first * bent + second * round_
        turned[2, k] = second * bent - first * round_
    return radius * (c - 1.0)


@compiled
def _normals(axes: FloatArray, radius: float, places: FloatArray, normals: FloatArray) -> None:
    turned = np.empty((3, 3))
    for row in range(places.shape[0]):
        face_axes(axes, radius, places[row], turned)
        normals[row] = turned[0]


def face_normals(axes: FloatArray, radius_m: float | None, places_m: FloatArray) -> FloatArray:
    """(m, 3): directions into the tissue nearest to ``places_m`` (m, 3), counted from the face's apex."""
    normals = np.tile(axes[0], (len(places_m), 1))
    if radius_m is not None:
        _normals(axes, radius_m, np.ascontiguousarray(places_m, np.float64), normals)
    return normals


def face_depths(radius_m: float, aside_m: FloatArray) -> FloatArray:
    """How far into the tissue the face lies at ``aside_m`` from its apex; negative where a concave one stands out.

    >>> face_depths(0.015, np.array([0.0, 0.009, 0.013])).round(6)
    array([0.   , 0.003, 0.006])
    """
    size = abs(radius_m)
    edge = size * math.sin(_STEEPEST)
    aside = np.abs(aside_m)
    ball = size - np.sqrt(size * size - np.minimum(aside, edge) ** 2)
    return math.copysign(1.0, radius_m) * (ball + np.maximum(aside - edge, 0.0) * math.tan(_STEEPEST))
