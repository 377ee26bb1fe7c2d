"""Force at the tip from stations of the centreline, by a rod model: the most probable force and its covariance."""

from dataclasses import dataclass

import numpy as np

from ...mechanics import RodModel
from ...types import FloatArray

STATIONS = 8
"""Points of the centreline that a model is compared with, uniform in arc length, the tip last."""

_STEP_N = 1e-6
"""Step of derivatives by differences: so small that the curvature has no effect on weak directions, and far above the
residual of the models' own iterations."""
_STUCK_N = 1e-4
"""Where no step is better and the last one tried was shorter, it is rounding that is in the way."""
_MAX_STEP_N = 0.1
"""Longer steps could leave the branch of the unloaded shape."""
_TOLERANCE_N = 1e-5
"""The fit ends with a step that is shorter."""
_ITERATIONS, _TRIALS = 25, 10


@dataclass(frozen=True, slots=True)
class ForceFit:
    """A fitted force.

    Attributes:
        force_n: (2,) force on the tip in newtons.
        covariance_n2: (2, 2) its covariance.
        misfit: squared misfit in standard deviations.
        converged: whether the fit converged.
    """

    force_n: FloatArray
    covariance_n2: FloatArray
    misfit: float
    converged: bool


@dataclass(frozen=True, slots=True, eq=False)
class StationNoise:
    """Noise of the detected stations, and prior of the force.

    Attributes:
        weight: (2 k, 2 k) inverse covariance of the stations in 1/m^2.
        force_std_n: prior standard deviation of a force component.
    """

    weight: FloatArray
    force_std_n: float

    @classmethod
    def of(cls, covariance_m2: FloatArray, force_std_n: float) -> "StationNoise":
        """Makes the noise from a covariance.

        Args:
            covariance_m2: (2 k, 2 k) covariance of the stations.
            force_std_n: prior standard deviation of a force component in newtons.

        Raises:
            LinAlgError: the covariance is not positive definite.
        """
        np.linalg.cholesky(covariance_m2)
        inverse = np.linalg.inv(covariance_m2)
        return cls(0.5 * (inverse + inverse.T), force_std_n)


def line_stations(points_m: FloatArray) -> FloatArray:
    """Returns the stations of a centreline (n, 2), base to tip and uniform in arc length: (2 STATIONS,) x, y, x, y, ...

    >>> line_stations(np.array([[0.0, 0.0], [0.04, 0.0], [0.08, 0.0]]))[-4:].round(3).tolist()
    [0.07, 0.0, 0.08, 0.0]
    """
    shares = np.arange(1, STATIONS + 1) / STATIONS
    known = np.linspace(0.0, 1.0, len(points_m))
    return np.column_stack([np.interp(shares, known, points_m[:, axis]) for axis in range(2)]).ravel()


def model_stations(model: RodModel, force_n: FloatArray, last: int = STATIONS) -> FloatArray:
    """Computes the last stations of a model under a force.

    Args:
        model: the rod model.
        force_n: (2,) force on the tip in newtons.
        last: number of stations.

    Returns:
        (2 last,) x and y of each in metres; NaN without an equilibrium.
    """
    shape = model.solve_static(force_n)
    if not shape.converged:
        return np.full(2 * last, np.nan)
    return shape.centreline_m(STATIONS + 1)[-last:].ravel()


def fit_force(model: RodModel, stations_m: FloatArray, noise: StationNoise) -> ForceFit:
    """Fits the force under which a model has its stations where they were detected, as far as the noise allows.

    It minimises the squared misfit of the stations plus that of the force to its prior, a normal distribution about 0,
    by Levenberg-Marquardt from no force, so on the unloaded shape's branch; derivatives by differences. Along a
    direction that does not move the stations the prior alone decides: there the force is 0 and the covariance the
    prior's.

    Args:
        model: the rod model.
        stations_m: (2 k,) x and y of the detected stations in metres.
        noise: noise of the stations, and the prior.

    Returns:
        The force with its covariance and the misfit.
    """
    last, prior = len(stations_m) // 2, noise.force_std_n**-2
    force = np.zeros(2)
    residual = stations_m - model_stations(model, force, last)
    cost, damping, converged = _cost(residual, force, noise), 1e-3, False
    normal, step = prior * np.eye(2), np.zeros(2)
    for _ in range(_ITERATIONS):
        moved = [stations_m - model_stations(model, force + step, last) for step in _STEP_N * np.eye(2)]
        slopes = np.column_stack([(residual - each) / _STEP_N for each in moved])  # of the model's stations, m/N
        normal = slopes.T @ noise.weight @ slopes + prior * np.eye(2)
        if not np.isfinite(normal).all():
            break
        downhill = slopes.T @ (noise.weight @ residual) - prior * force
        for _ in range(_TRIALS):
            step = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), downhill)
            step *= min(1.0, _MAX_STEP_N / max(float(np.linalg.norm(step)), 1e-300))
            trial = stations_m - model_stations(model, force + step, last)
            trial_cost = _cost(trial, force + step, noise)
            if trial_cost <= cost:  # False for NaN
                force, residual, cost, damping = force + step, trial, trial_cost, damping / 8.0
                break
            damping *= 8.0
        else:
            converged = bool(np.linalg.norm(step) < _STUCK_N)  # no better within rounding
            break
        if np.linalg.norm(step) < _TOLERANCE_N:
            converged = True
            break
    covariance = np.linalg.inv(normal) if np.isfinite(normal).all() else np.full((2, 2), np.nan)
    return ForceFit(force, covariance.astype(np.float64), cost, converged)


def _cost(residual: FloatArray, force: FloatArray, noise: StationNoise) -> float:
    return float(residual @ noise.weight @ residual + force @ force / noise.force_std_n**2)
