"""Random smooth curves of a catheter: angle of the tangent over arc length, integrated."""

import numpy as np
import numpy.typing as npt

from tipforce.training.locator import LABEL_POINTS

Float = npt.NDArray[np.float64]


def curve(rng: np.random.Generator, length: float, points: int = LABEL_POINTS) -> Float:
    """A curve (points, 2) that begins at the origin along +x.

    The families are an arc, a J (straight, then an arc), a loaded cantilever (curvature falls linearly to the tip), an
    S, a loop, and a sum of random modes; a rigid tip is straight.

    Args:
        rng: source of randomness.
        length: length of the curve in px.
        points: number of points.

    Returns:
        (points, 2) px.
    """
    s = np.linspace(0.0, 1.0, points)
    family = rng.choice(6, p=[0.22, 0.2, 0.2, 0.16, 0.06, 0.16])
    total = rng.normal(0.0, 1.2)
    if family == 0:
        curvature = np.full(points, total)
    elif family == 1:
        start = rng.uniform(0.1, 0.7)
        curvature = total * np.clip((s - start) / 0.08, 0.0, 1.0) / max(1.0 - start, 0.2)
    elif family == 2:
        curvature = rng.normal(0.0, 0.9) + 2.0 * rng.normal(0.0, 0.8) * (1.0 - s)
    elif family == 3:
        cross = rng.uniform(0.3, 0.7)
        curvature = total * 1.6 * np.tanh((s - cross) / 0.12)
    elif family == 4:
        curvature = np.full(points, rng.choice([-1.0, 1.0]) * rng.uniform(3.0, 6.2)) * (0.6 + 0.8 * s)
    else:
        modes = np.arange(1, 5)
        weights = rng.normal(size=4) * 2.4 / modes
        curvature = np.cos(np.pi * np.outer(s, modes) + rng.uniform(0.0, 2.0 * np.pi, 4)) @ weights
    rigid = rng.uniform(0.03, 0.22)
    if rng.random() < 0.7:
        curvature = curvature * np.clip((1.0 - rigid - s) / 0.03, 0.0, 1.0)
    angle = np.concatenate([[0.0], np.cumsum(0.5 * (curvature[1:] + curvature[:-1]))]) / (points - 1)
    middle = 0.5 * (angle[1:] + angle[:-1])
    steps = np.column_stack([np.cos(middle), np.sin(middle)]) * (length / (points - 1))
    return np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])


def turned(points: Float, angle: float) -> Float:
    """``points`` (n, 2) turned by ``angle`` rad about the origin."""
    c, s = np.cos(angle), np.sin(angle)
    return points @ np.array([[c, s], [-s, c]])


def lead(rng: np.random.Generator, start: Float, direction: float, length: float, bend: float = 0.25) -> Float:
    """A gently bent line (24, 2) that leaves ``start`` (2,) px toward ``direction`` rad, ``length`` px long."""
    count = 24
    angle = direction + rng.normal(0.0, bend) * np.linspace(0.0, 1.0, count - 1) ** 1.5
    steps = np.column_stack([np.cos(angle), np.sin(angle)]) * (length / (count - 1))
    return start + np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])
