"""Residuals of a detected line from shapes of the rod, in the pixels of one view, with their derivatives."""

import math

import numpy as np

from ...types import FloatArray
from ._compile import compiled

RATES = 15
"""Derivatives of a residual: by the 9 parameters of the shape, then by position and turn of the base. More of the turn
may follow."""
_SHAPE, _POSITION, _TURN = 9, 9, 12
_LEAST_ADVANCE = 0.2
"""Smallest cosine of the angle between model and detected line with which a point slides along the model."""


@compiled
def _project(camera: FloatArray, x: float, y: float, z: float, slope: FloatArray) -> tuple[float, float]:
    """Returns u and v, px, of a point in m by the projection (3, 4), and writes their derivatives (2, 3) by x, y, z."""
    w = camera[2, 0] * x + camera[2, 1] * y + camera[2, 2] * z + camera[2, 3]
    u = (camera[0, 0] * x + camera[0, 1] * y + camera[0, 2] * z + camera[0, 3]) / w
    v = (camera[1, 0] * x + camera[1, 1] * y + camera[1, 2] * z + camera[1, 3]) / w
    for k in range(3):
        slope[0, k] = (camera[0, k] - u * camera[2, k]) / w
        slope[1, k] = (camera[1, k] - v * camera[2, k]) / w
    return u, v


@compiled
def _segment(
    tangent_u: float, tangent_v: float, point: FloatArray, shown: FloatArray
) -> tuple[int, float]:  # fmt: skip
    """Finds where the model passes a detected point: crosses the line through it, perpendicular to the detected line.

    Of several such passages the nearest one counts. Without any, the first or the last segment is extended.

    Args:
        tangent_u: u of the detected line's direction at the point.
        tangent_v: v of it.
        point: (2,) the point in px.
        shown: (nodes, 2) the model's nodes in px.

    Returns:
        The segment, and the share of it before the passage; below 0 or above 1 beyond the ends of the model.
    """
    last = shown.shape[0] - 1
    nearest2, segment, share = -1.0, -1, 0.0
    # positions of the nodes along the tangent, relative to the point: the passage is where the sign changes
    node_along = tangent_u * (shown[0, 0] - point[0]) + tangent_v * (shown[0, 1] - point[1])
    first_along = node_along
    for j in range(last):
        next_along = tangent_u * (shown[j + 1, 0] - point[0]) + tangent_v * (shown[j + 1, 1] - point[1])
        if node_along <= 0.0 < next_along:
            part = -node_along / (next_along - node_along)
            u = shown[j, 0] + part * (shown[j + 1, 0] - shown[j, 0]) - point[0]
            v = shown[j, 1] + part * (shown[j + 1, 1] - shown[j, 1]) - point[1]
            distance2 = u * u + v * v
            if segment < 0 or distance2 < nearest2:
                nearest2, segment, share = distance2, j, part
        node_along = next_along
    if segment >= 0:
        return segment, share
    segment = 0 if first_along > 0.0 else last - 1
    length = tangent_u * (shown[segment + 1, 0] - shown[segment, 0])
    length += tangent_v * (shown[segment + 1, 1] - shown[segment, 1])
    start_along = tangent_u * (shown[segment, 0] - point[0]) + tangent_v * (shown[segment, 1] - point[1])
    return segment, -start_along / length if abs(length) > 1e-9 else 0.0


@compiled
def residuals(
    nodes: FloatArray, node_slopes: FloatArray, position: FloatArray, turn: FloatArray, turn_slopes: FloatArray,
    camera: FloatArray, points: FloatArray, normals: FloatArray, residual: FloatArray, slopes: FloatArray,
) -> None:  # fmt: skip
    """Computes the residuals of one view: the model minus the line, across it, and last along it at the tip.

    Each detected point is compared with the place where the model passes it, not with a point of the same arc length:
    errors along the line do not count, except at the tip.

    Args:
        nodes: (shapes, nodes, 3) of the rod in its base frame, m.
        node_slopes: (shapes, nodes, 3, 9) derivatives by the parameters of the shape.
        position: (shapes, 3) of the base in the reference frame, m.
        turn: (shapes, 3, 3) of the base.
        turn_slopes: (shapes, turns, 3, 3) its derivatives, by the three angles first.
        camera: (3, 4) from the reference frame to pixels.
        points: (points, 2) of the detected line in px, base to tip.
        normals: (points, 2) unit normals of the detected line, the tangent turned from u to v.
        residual: (shapes, points + 1) in px, written.
        slopes: (shapes, points + 1, 12 + turns) its derivatives, written; those of the turn with the base in place.
    """
    count, points_count = nodes.shape[1], points.shape[0]
    for p in range(nodes.shape[0]):
        placed = np.empty((count, 3))  # nodes in the reference frame, m
        shown = np.empty((count, 2))  # nodes in the image, px
        slope = np.empty((2, 3))  # derivatives of u and v by x, y and z
        local = np.empty(3)  # derivatives of a residual by the point in the base frame
        for j in range(count):
            for a in range(3):
                placed[j, a] = position[p, a]
                for b in range(3):
                    placed[j, a] += turn[p, a, b] * nodes[p, j, b]
            shown[j, 0], shown[j, 1] = _project(camera, placed[j, 0], placed[j, 1], placed[j, 2], slope)
        for i in range(points_count + 1):
            at_tip = i == points_count
            k = points_count - 1 if at_tip else i
            normal_u, normal_v = normals[k, 0], normals[k, 1]
            tangent_u, tangent_v = normal_v, -normal_u
            if at_tip:
                j, share = count - 2, 1.0
            else:
                j, share = _segment(tangent_u, tangent_v, points[k], shown)
            x = placed[j, 0] + share * (placed[j + 1, 0] - placed[j, 0])
            y = placed[j, 1] + share * (placed[j + 1, 1] - placed[j, 1])
            z = placed[j, 2] + share * (placed[j + 1, 2] - placed[j, 2])
            u, v = _project(camera, x, y, z, slope)
            off_u, off_v = u - points[k, 0], v - points[k, 1]
            if at_tip:
                residual[p, i] = tangent_u * off_u + tangent_v * off_v
                weight_u, weight_v = tangent_u, tangent_v
            else:
                residual[p, i] = normal_u * off_u + normal_v * off_v
                # the passage slides along the model when the model moves; this turns the direction of the derivative
                along_u = along_v = 0.0
                for a in range(3):
                    step = placed[j + 1, a] - placed[j, a]
                    along_u += slope[0, a] * step
                    along_v += slope[1, a] * step
                size = math.hypot(along_u, along_v) + 1e-12
                cosine = (tangent_u * along_u + tangent_v * along_v) / size
                sine = (normal_u * along_u + normal_v * along_v) / size
                slide = sine / max(cosine, _LEAST_ADVANCE)
                weight_u, weight_v = normal_u - slide * tangent_u, normal_v - slide * tangent_v
            # derivatives by position, then turn of the base, then the parameters of the shape
            for a in range(3):
                slopes[p, i, _POSITION + a] = weight_u * slope[0, a] + weight_v * slope[1, a]
            for r in range(turn_slopes.shape[1]):
                total = 0.0
                for a in range(3):
                    turned = 0.0
                    for b in range(3):
                        coordinate = nodes[p, j, b] + share * (nodes[p, j + 1, b] - nodes[p, j, b])
                        turned += turn_slopes[p, r, a, b] * coordinate
                    total += slopes[p, i, _POSITION + a] * turned
                slopes[p, i, _TURN + r] = total
            for b in range(3):
                local[b] = 0.0
                for a in range(3):
                    local[b] += slopes[p, i, _POSITION + a] * turn[p, a, b]
            for r in range(_SHAPE):
                total = 0.0
                for b in range(3):
                    start, end = node_slopes[p, j, b, r], node_slopes[p, j + 1, b, r]
                    total += local[b] * (start + share * (end - start))
                slopes[p, i, r] = total
