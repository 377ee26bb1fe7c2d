"""What a centreline can tell of the force: Fisher information and the Cramer-Rao bound."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, cholesky, solve_triangular

from ..types import FloatArray, frozen
from ._sensitivity import Derivatives

__all__ = ["Bound", "CentrelineNoise", "Information", "Priors", "cramer_rao", "fisher_information"]


@dataclass(frozen=True, slots=True)
class CentrelineNoise:
    """Error of a centreline's points: each coordinate has the standard deviation ``std_m``, independent of the other.

    Along the shaft errors are correlated as exp(-distance / ``correlation_length_m``); 0: white.
    """

    std_m: float
    correlation_length_m: float = 0.0

    def __post_init__(self) -> None:
        if not (self.std_m > 0 and self.correlation_length_m >= 0):
            raise ValueError(f"noise needs a positive std_m and no negative correlation length, got {self}")

    @classmethod
    def from_px(cls, std_px: float, scale_m_per_px: float, correlation_length_px: float = 0.0) -> "CentrelineNoise":
        """The same noise as it is seen in a picture."""
        return cls(std_px * scale_m_per_px, correlation_length_px * scale_m_per_px)

    def covariance_m2(self, arc_m: FloatArray) -> FloatArray:
        """(points, points): covariance of one coordinate."""
        if self.correlation_length_m == 0.0:
            return self.std_m**2 * np.eye(arc_m.size)
        return self.std_m**2 * np.exp(-np.abs(arc_m[:, None] - arc_m) / self.correlation_length_m)


@dataclass(frozen=True, slots=True)
class Priors:
    """What is known beforehand, as standard deviations: 0 is known exactly, infinite is not known at all.

    ``base_position_m`` and ``base_angle_rad`` hold for each coordinate of the clamp's place and for its rotation.
    """

    force_n: float = math.inf
    moment_nm: float = 0.0
    precurvature_per_m: float = 0.0
    stiffness_nm2: float = 0.0
    base_position_m: float = 0.0
    base_angle_rad: float = 0.0

    def __post_init__(self) -> None:
        named = {name: getattr(self, name) for name in self.__slots__}
        wrong = {name: value for name, value in named.items() if not value >= 0}
        if wrong or self.force_n == 0.0:
            raise ValueError(f"priors are standard deviations, that of the force above 0, got {wrong or named}")


@dataclass(frozen=True, slots=True, eq=False)
class Information:
    """Fisher information of the parameters that are not known exactly, (K, K), priors included.

    ``blocks``: name of a block of `Derivatives` -> its rows in ``matrix``; ``tip_axis`` (D,).
    """

    matrix: FloatArray
    blocks: dict[str, slice]
    tip_axis: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Bound:
    """The smallest covariance of the force that an unbiased estimate can have; infinite where the shape tells nothing.

    ``covariance_n2`` (D, D), base frame. ``axial_std_n``: of the part along the tip's axis. ``lateral_std_n``: of the
    part across it; in space, in the direction in which it is largest.
    """

    covariance_n2: FloatArray
    axial_std_n: float
    lateral_std_n: float


_ALL_KNOWN = Priors()


def fisher_information(
    derivatives: Derivatives, noise: CentrelineNoise | FloatArray, priors: Priors = _ALL_KNOWN
) -> Information:
    """Information of a centreline on the force and on all that is not known exactly beforehand.

    ``noise``, or the covariance of all coordinates, (points D, points D) in m^2, point after point. With priors this
    is the information of the posterior (Bayesian) bound, at this shape.

    Raises ValueError where the covariance is not positive definite or of another size.
    """
    d = derivatives
    size = d.centreline_m.shape[1]
    stds = {
        "force": np.full(d.force.shape[2], priors.force_n),
        "moment": np.full(d.moment.shape[2], priors.moment_nm),
        "precurvature": np.full(d.precurvature.shape[2], priors.precurvature_per_m),
        "stiffness": np.full(d.stiffness.shape[2], priors.stiffness_nm2),
        "base": np.array([priors.base_position_m] * size + [priors.base_angle_rad] * (d.base.shape[2] - size)),
    }
    columns: list[FloatArray] = []
    known: list[FloatArray] = []
    blocks: dict[str, slice] = {}
    begin = 0
    for name, std in stds.items():
        free = std > 0
        columns.append(getattr(d, name)[:, :, free])
        known.append(std[free])
        blocks[name] = slice(begin, begin + int(free.sum()))
        begin = blocks[name].stop
    white = _whitened(np.concatenate(columns, axis=2), noise, d.arc_m)
    prior = np.diag(1.0 / np.concatenate(known) ** 2)
    return Information(white.T @ white + prior, blocks, d.tip_axis)


def cramer_rao(information: Information) -> Bound:
    """The bound on the force, all other parameters marginalised out.

    >>> from tipforce.mechanics import Rod, bend, derivatives
    >>> rod = Rod(0.065, 4.3e-4, precurvature_per_m=10.0)
    >>> seen = derivatives(bend(rod, np.array([0.0, 0.1])), 20)
    >>> bound = cramer_rao(fisher_information(seen, CentrelineNoise(0.2e-3)))
    >>> round(bound.axial_std_n * 1e3, 1), round(bound.lateral_std_n * 1e3, 1)
    (25.5, 8.7)
    """
    matrix, force = information.matrix, information.blocks["force"]
    rest = np.delete(np.arange(len(matrix)), force)
    seen, cross, nuisance = matrix[force, force], matrix[force][:, rest], matrix[np.ix_(rest, rest)]
    if rest.size:
        # Scaled to one on the diagonal: units apart by ten powers of ten would hide what is singular.
        size = np.sqrt(np.maximum(np.diag(nuisance), 1e-300))
        inverse = np.linalg.pinv(nuisance / np.outer(size, size), rcond=1e-13, hermitian=True)
        seen = seen - (cross / size) @ inverse @ (cross / size).T
    values, vectors = np.linalg.eigh(seen)
    blind = values <= 1e-12 * max(float(np.trace(matrix[force, force])), 1e-300)
    with np.errstate(divide="ignore"):
        variances = np.where(blind, math.inf, 1.0 / values)
    axis = information.tip_axis
    across = np.linalg.svd(axis[None])[2][1:]
    return Bound(
        _turned(np.eye(axis.size) @ vectors, variances),
        math.sqrt(_largest(_turned(axis[None] @ vectors, variances))),
        math.sqrt(_largest(_turned(across @ vectors, variances))),
    )


def _turned(rows: FloatArray, variances: FloatArray) -> FloatArray:
    """(r, D) directions, given along the axes of independent ``variances`` -> (r, r) covariance, infinities kept."""
    sighted = np.isfinite(variances)
    covariance = (rows[:, sighted] * variances[sighted]) @ rows[:, sighted].T
    for column in rows[:, ~sighted].T:
        share = np.outer(column, column)
        covariance = np.where(np.abs(share) > 1e-18, np.copysign(math.inf, share), covariance)
    return covariance


def _largest(covariance: FloatArray) -> float:
    return float(np.linalg.eigvalsh(covariance)[-1]) if np.isfinite(covariance).all() else math.inf


def _whitened(columns: FloatArray, noise: CentrelineNoise | FloatArray, arc_m: FloatArray) -> FloatArray:
    """(points, D, K) -> (points D, K), in which the noise is white with a standard deviation of 1."""
    points, size, count = columns.shape
    if isinstance(noise, CentrelineNoise):
        # One coordinate's covariance does for all of them: they lie side by side while it is divided out.
        covariance, rows = noise.covariance_m2(arc_m), columns.reshape(points, size * count)
    else:
        covariance = frozen("noise", noise, (points * size, points * size))
        rows = columns.reshape(points * size, count)
    try:
        white = solve_triangular(cholesky(covariance, lower=True), rows, lower=True)
    except LinAlgError as error:
        raise ValueError("the covariance of the centreline's noise is not positive definite") from error
    return white.reshape(points * size, count)
