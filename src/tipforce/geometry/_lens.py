"""Hot loops of cameras: projection with its derivatives, its inverse through the lens, triangulation.

A camera is a row of numbers (21,): fx, fy, cx, cy, k1, k2, p1, p2, k3, then the rotation row by row and the
translation that convert a world point to the camera's frame (x right, y down, z ahead).
"""

import math

import numpy as np
from numba import njit

from ..types import FloatArray

_MAX_ITERATIONS = 50
MIN_DETERMINANT_RATIO = 1e-12
"""Rays are parallel if the determinant of the normal equations, over the product of their diagonal, is below this."""


@njit(cache=True, nogil=True, error_model="numpy")
def _lens(camera: FloatArray, x: float, y: float) -> tuple[float, float, float, float, float, bool]:
    """Distorts a ray's normalised ``x``, ``y`` (Brown-Conrady).

    Returns distorted x and y, their derivatives (x by x, x by y = y by x, y by y), and whether the lens is one to one.
    """
    k1, k2, p1, p2, k3 = camera[4], camera[5], camera[6], camera[7], camera[8]
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * r2 * k3))  # times x: the derivative of radial with x
    xd = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    yd = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    dxx = radial + x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x
    dxy = x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y
    dyy = radial + y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x
    return xd, yd, dxx, dxy, dyy, radial > 0.0 and dxx * dyy > dxy * dxy


@njit(cache=True, nogil=True, error_model="numpy")
def _project_one(camera: FloatArray, px: float, py: float, pz: float, slopes: FloatArray) -> tuple[float, float]:
    """Projects the world point (px, py, pz) in m to u, v in px; NaN where the camera does not show it.

    ``camera``: (21,) see the module; ``slopes`` (2, 3) receives the derivatives of u and v by the point.
    """
    x = camera[9] * px + camera[10] * py + camera[11] * pz + camera[18]
    y = camera[12] * px + camera[13] * py + camera[14] * pz + camera[19]
    z = camera[15] * px + camera[16] * py + camera[17] * pz + camera[20]
    x, y = x / z, y / z
    xd, yd, dxx, dxy, dyy, one_to_one = _lens(camera, x, y)
    if not (z > 0.0 and one_to_one):
        slopes[:] = math.nan
        return math.nan, math.nan
    for j in range(3):
        dx = (camera[9 + j] - x * camera[15 + j]) / z
        dy = (camera[12 + j] - y * camera[15 + j]) / z
        slopes[0, j] = camera[0] * (dxx * dx + dxy * dy)
        slopes[1, j] = camera[1] * (dxy * dx + dyy * dy)
    return camera[0] * xd + camera[2], camera[1] * yd + camera[3]


@njit(cache=True, nogil=True, error_model="numpy")
def _straighten_one(camera: FloatArray, u: float, v: float) -> tuple[float, float]:
    """Returns normalised x, y of the ray of an observed pixel, by Newton's method; NaN if there is no such ray."""
    xd, yd = (u - camera[2]) / camera[0], (v - camera[3]) / camera[1]
    x, y = xd, yd
    at_x, at_y, dxx, dxy, dyy, one_to_one = _lens(camera, x, y)
    while not one_to_one and x * x + y * y > 1e-12:  # start where the lens is one to one
        x, y = 0.7 * x, 0.7 * y
        at_x, at_y, dxx, dxy, dyy, one_to_one = _lens(camera, x, y)
    for _ in range(_MAX_ITERATIONS):
        error_x, error_y = xd - at_x, yd - at_y
        determinant = dxx * dyy - dxy * dxy
        step_x, step_y = (dyy * error_x - dxy * error_y) / determinant, (dxx * error_y - dxy * error_x) / determinant
        if abs(step_x) + abs(step_y) < 1e-13 * (1.0 + abs(x) + abs(y)):
            return x + step_x, y + step_y
        share, nearer = 1.0, False
        # A step is halved until the lens is one to one there and the ray comes nearer to the pixel.
        while share > 1e-6 and not nearer:
            at_x, at_y, dxx, dxy, dyy, one_to_one = _lens(camera, x + share * step_x, y + share * step_y)
            nearer = one_to_one and (xd - at_x) ** 2 + (yd - at_y) ** 2 < error_x * error_x + error_y * error_y
            share *= 0.5
        if not nearer:
            break
        x, y = x + 2.0 * share * step_x, y + 2.0 * share * step_y  # the loop has halved the share once too often
    return math.nan, math.nan


@njit(cache=True, nogil=True, error_model="numpy")
def project(camera: FloatArray, points: FloatArray, pixels: FloatArray, slopes: FloatArray) -> None:
    """Projects points into the image.

    Args:
        camera: `CameraModel.row`.
        points: (n, 3) points in the camera's world.
        pixels: (n, 2) pixels that are written; NaN where the camera does not show the point.
        slopes: (n, 2, 3) derivatives of the pixels by the points, written; (1, 2, 3) if they are not needed.
    """
    wanted = slopes.shape[0] == points.shape[0]
    for i in range(points.shape[0]):
        row = slopes[i if wanted else 0]
        pixels[i, 0], pixels[i, 1] = _project_one(camera, points[i, 0], points[i, 1], points[i, 2], row)


@njit(cache=True, nogil=True, error_model="numpy")
def straighten(camera: FloatArray, pixels: FloatArray, normalised: FloatArray) -> None:
    """Converts observed pixels to the directions of their rays.

    Args:
        camera: `CameraModel.row`.
        pixels: (n, 2) observed pixels.
        normalised: (n, 2) x / z and y / z of the rays in the camera's frame, written; NaN where the lens has no ray.
    """
    for i in range(pixels.shape[0]):
        normalised[i, 0], normalised[i, 1] = _straighten_one(camera, pixels[i, 0], pixels[i, 1])


@njit(cache=True, nogil=True, error_model="numpy")
def _add_row(normal: FloatArray, right: FloatArray, row: FloatArray, value: float, weight: float) -> None:
    """Adds a weighted equation ``row`` . x = ``value`` to the normal equations."""
    for j in range(3):
        right[j] += weight * row[j] * value
        for k in range(3):
            normal[j, k] += weight * row[j] * row[k]


@njit(cache=True, nogil=True, error_model="numpy")
def _invert(a: FloatArray, inverse: FloatArray) -> bool:
    """Inverts a symmetric (3, 3) matrix ``a`` by its cofactors; returns False if it is nearly singular."""
    for j in range(3):
        p, q = (j + 1) % 3, (j + 2) % 3
        for k in range(3):
            r, s = (k + 1) % 3, (k + 2) % 3
            inverse[j, k] = a[p, r] * a[q, s] - a[p, s] * a[q, r]
    determinant = a[0, 0] * inverse[0, 0] + a[0, 1] * inverse[0, 1] + a[0, 2] * inverse[0, 2]
    if not determinant > MIN_DETERMINANT_RATIO * a[0, 0] * a[1, 1] * a[2, 2]:
        return False
    inverse /= determinant
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def _linear(cameras: FloatArray, pixels: FloatArray, work: FloatArray, point: FloatArray) -> bool:
    """Writes ``point`` (3,), the linear estimate from the rays of ``pixels`` (views, 2).

    Each ray gives two linear equations, such as (row_x - x row_z) . point = x t_z - t_x. ``work`` (9, 3): buffer.
    Returns False if fewer than two views have a ray, or the rays are nearly parallel.
    """
    normal, inverse, right, row = work[0:3], work[3:6], work[6], work[7]
    normal[:] = 0.0
    right[:] = 0.0
    rays = 0
    for v in range(cameras.shape[0]):
        x, y = _straighten_one(cameras[v], pixels[v, 0], pixels[v, 1])
        if math.isnan(x) or math.isnan(y):
            continue
        rays += 1
        for j in range(3):
            row[j] = cameras[v, 9 + j] - x * cameras[v, 15 + j]
        _add_row(normal, right, row, x * cameras[v, 20] - cameras[v, 18], 1.0)
        for j in range(3):
            row[j] = cameras[v, 12 + j] - y * cameras[v, 15 + j]
        _add_row(normal, right, row, y * cameras[v, 20] - cameras[v, 19], 1.0)
    if rays < 2 or not _invert(normal, inverse):
        return False
    for j in range(3):
        point[j] = inverse[j, 0] * right[0] + inverse[j, 1] * right[1] + inverse[j, 2] * right[2]
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def _refine(
    cameras: FloatArray,
    pixels: FloatArray,
    sigma: FloatArray,
    work: FloatArray,
    point: FloatArray,
    residual: FloatArray,
) -> bool:
    """Moves ``point`` (3,) to the least squared distance in the images, by Gauss-Newton steps.

    ``pixels`` (views, 2) have the standard deviations ``sigma`` (views,). The covariance is left in ``work[3:6]``, and
    observed - projected pixels in ``residual`` (views, 2). Returns whether it converged.
    """
    normal, inverse, right, slopes = work[0:3], work[3:6], work[6], work[7:9]
    for _ in range(_MAX_ITERATIONS):
        normal[:] = 0.0
        right[:] = 0.0
        for v in range(cameras.shape[0]):
            at_u, at_v = _project_one(cameras[v], point[0], point[1], point[2], slopes)
            residual[v, 0], residual[v, 1] = pixels[v, 0] - at_u, pixels[v, 1] - at_v
            if math.isnan(residual[v, 0]) or math.isnan(residual[v, 1]):
                continue
            for axis in range(2):
                _add_row(normal, right, slopes[axis], residual[v, axis], sigma[v] ** -2)
        if not _invert(normal, inverse):
            return False
        square = 0.0  # of the step, in standard deviations
        for j in range(3):
            step = inverse[j, 0] * right[0] + inverse[j, 1] * right[1] + inverse[j, 2] * right[2]
            square += step * right[j]
            point[j] += step
        if square < 1e-16:
            return True
    return False


@njit(cache=True, nogil=True, error_model="numpy")
def triangulate(
    cameras: FloatArray,
    pixels: FloatArray,
    sigma: FloatArray,
    points: FloatArray,
    covariance: FloatArray,
    residual: FloatArray,
) -> None:
    """Triangulates points; one that cannot be found is NaN.

    Args:
        cameras: (views, 21) cameras.
        pixels: (n, views, 2) observed pixels, NaN where a view does not show the point.
        sigma: (views,) standard deviation of a pixel.
        points: (n, 3) result.
        covariance: (n, 3, 3) result.
        residual: (n, views, 2) result: observed - projected.
    """
    work = np.empty((9, 3))
    for i in range(points.shape[0]):
        found = _linear(cameras, pixels[i], work, points[i])
        if found and _refine(cameras, pixels[i], sigma, work, points[i], residual[i]):
            covariance[i] = work[3:6]
        else:
            points[i] = math.nan
            covariance[i] = math.nan
            residual[i] = math.nan
