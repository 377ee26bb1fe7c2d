"""What a centreline tells of the force: noise of a centreline, Fisher information, Cramer-Rao bounds."""

import math
from collections.abc import Callable
from dataclasses import astuple, dataclass, fields
from typing import Any, Self

import numpy as np
from scipy.linalg import LinAlgError, cholesky, solve_triangular
from scipy.optimize import least_squares

from ..types import FloatArray, frozen
from ._derivatives import Derivatives


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
        """The same noise as it is seen in an image."""
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
class CramerRaoBound:
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


def cramer_rao(information: Information) -> CramerRaoBound:
    """The bound on the force, all other parameters marginalised out.

    >>> from tipforce.mechanics import Rod, solve_static, derivatives
    >>> rod = Rod(0.065, 4.3e-4, precurvature_per_m=10.0)
    >>> seen = derivatives(solve_static(rod, np.array([0.0, 0.1])), 20)
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
    return CramerRaoBound(
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


_CHUNK = 256


def posterior_covariance(slopes: FloatArray, prior: FloatArray, wanted: int) -> FloatArray:
    """(m, wanted, wanted): covariance of the first ``wanted`` unknowns, each instant on its own.

    ``slopes`` (m, rows, unknowns): of what is seen, divided by its noise, so that every row has an independent error
    of standard deviation 1. ``prior`` (unknowns, unknowns): covariance of what is known beforehand. The result is the
    inverse of information = slopes' slopes + inverse of the prior (van Trees 1968): exact for Gaussian unknowns that
    are seen linearly, and for others the bound of whoever knows the point at which the slopes were taken.

    Raises ValueError where ``prior`` is not positive definite.

    >>> slopes = np.array([[[3.0, 0.0]], [[0.0, 0.0]]])
    >>> posterior_covariance(slopes, np.eye(2), 1).ravel()  # 1 / (9 + 1), and what was known before
    array([0.1, 1. ])
    """
    slopes = np.asarray(slopes, np.float64)
    root = _root(frozen("prior", prior, (slopes.shape[2], slopes.shape[2])))
    out = np.empty((len(slopes), wanted, wanted))
    for begin in range(0, len(slopes), _CHUNK):
        part = slopes[begin : begin + _CHUNK] @ root
        inside = np.swapaxes(part, 1, 2) @ part + np.eye(root.shape[1])
        rows = np.broadcast_to(root[:wanted].T, (len(part), root.shape[1], wanted))
        half = np.linalg.solve(np.linalg.cholesky(inside), rows)
        out[begin : begin + _CHUNK] = np.swapaxes(half, 1, 2) @ half
    return out


def posterior_covariance_along(
    slopes: FloatArray, prior: FloatArray, wanted: int, time_s: FloatArray, memory_s: FloatArray
) -> FloatArray:
    """(m, wanted, wanted): as `posterior_covariance`, with all that was seen until each of the instants ``time_s``.

    ``memory_s`` (unknowns,): infinite: the same for good; 0: drawn anew at each instant; else a stationary
    Gauss-Markov course (Ornstein-Uhlenbeck) with this correlation time. The recursion of Tichavsky, Muravchik and
    Nehorai (1998): what is behind is eliminated as soon as it is passed, so that an instant costs the same however
    many came before. Unknowns that are correlated beforehand must share their memory.

    Raises ValueError where ``prior`` is not positive definite.

    >>> same = posterior_covariance_along(np.ones((3, 1, 1)), np.eye(1), 1, np.arange(3.0), np.array([np.inf]))
    >>> (1 / same).ravel().round(9)  # information adds up
    array([2., 3., 4.])
    """
    slopes = np.asarray(slopes, np.float64)
    m, _, count = slopes.shape
    prior, times = frozen("prior", prior, (count, count)), frozen("time_s", time_s, (m,))
    memory = frozen("memory_s", memory_s, (count,))
    root, eye = _root(prior), np.eye(count)
    out = np.empty((m, wanted, wanted))
    covariance = prior
    for row in range(m):
        if row:
            keep = np.array([_kept(times[row] - times[row - 1], each) for each in memory.tolist()])
            share = np.outer(keep, keep)
            root = _root(share * covariance + (1.0 - share) * prior)
        seen = slopes[row] @ root
        inside = cholesky(seen.T @ seen + eye, lower=True, check_finite=False)
        half = solve_triangular(inside, root.T, lower=True, check_finite=False)
        covariance = half.T @ half
        out[row] = covariance[:wanted, :wanted]
    return out


def _kept(step_s: float, memory_s: float) -> float:
    """Share of an unknown's deviation that is left after ``step_s``."""
    return math.exp(-step_s / memory_s) if memory_s > 0 else 0.0


def _root(covariance: FloatArray) -> FloatArray:
    """Lower triangular, times its transpose the covariance."""
    # Scaled to one on the diagonal: the unknowns' units lie ten powers of ten apart.
    size = np.sqrt(np.diag(covariance))
    if not (size > 0).all():
        raise ValueError("every unknown needs a prior: a standard deviation above 0; leave out what is known exactly")
    try:
        return size[:, None] * cholesky(covariance / np.outer(size, size), lower=True, check_finite=False)
    except LinAlgError as error:
        raise ValueError("the covariance of the unknowns is not positive definite") from error


@dataclass(frozen=True, slots=True)
class LineNoise:
    """Error of a line that is seen as a whole: only its displacement across itself shows, and where it ends.

    Across the line, at the arc length s of a length L, the standard deviation is the root of ``std_m``^2 +
    ``base_std_m``^2 exp(-s / ``base_m``) + ``tip_std_m``^2 exp(-(L - s) / ``tip_m``). Of the variance,
    ``white_share`` is independent from point to point, ``common_share`` the same all along, and the rest correlated
    as exp(-distance^2 / (2 ``correlation_m``^2)). ``along_std_m``: of the tip's place along the line.
    """

    std_m: float
    correlation_m: float
    along_std_m: float
    base_std_m: float = 0.0
    base_m: float = 5e-3
    tip_std_m: float = 0.0
    tip_m: float = 5e-3
    white_share: float = 0.01
    common_share: float = 0.0

    def __post_init__(self) -> None:
        lengths = (self.std_m, self.correlation_m, self.along_std_m, self.base_m, self.tip_m)
        ends = (self.base_std_m, self.tip_std_m)
        shares = self.white_share > 0 and self.common_share >= 0 and self.white_share + self.common_share <= 1
        if not (all(value > 0 for value in lengths) and all(value >= 0 for value in ends) and shares):
            raise ValueError(f"expected positive lengths and white_share, shares that add to 1 at most, got {self}")

    def std_at_m(self, arc_m: FloatArray) -> FloatArray:
        """(points,): standard deviation across the line; the first and last of ``arc_m`` (points,) are its ends."""
        from_base, from_tip = arc_m - arc_m[0], arc_m[-1] - arc_m
        base = self.base_std_m**2 * np.exp(-from_base / self.base_m)
        return np.sqrt(self.std_m**2 + base + self.tip_std_m**2 * np.exp(-from_tip / self.tip_m))

    def correlation(self, arc_m: FloatArray) -> FloatArray:
        """(points, points): of the errors across the line."""
        near = np.exp(-0.5 * ((arc_m[:, None] - arc_m) / self.correlation_m) ** 2)
        rest = 1.0 - self.white_share - self.common_share
        return self.white_share * np.eye(arc_m.size) + self.common_share + rest * near

    def covariance_m2(self, arc_m: FloatArray) -> FloatArray:
        """(points + 1, points + 1): across the line at each point, then along it at the tip."""
        std, size = self.std_at_m(arc_m), arc_m.size
        out = np.zeros((size + 1, size + 1))
        out[:size, :size] = np.outer(std, std) * self.correlation(arc_m)
        out[size, size] = self.along_std_m**2
        return out

    @classmethod
    def fit(cls, covariance_m2: FloatArray, arc_m: FloatArray) -> Self:
        """The noise whose covariance is nearest to a measured one, of the form of `covariance_m2`.

        First the standard deviations by their logarithms, then the correlations, both by least squares.
        """
        size = arc_m.size
        std = np.sqrt(np.diag(covariance_m2))
        middle = float(np.median(std[:size]))
        length = float(arc_m[-1] - arc_m[0])
        along = float(std[size])

        def spread(values: FloatArray) -> FloatArray:
            shaft, base, tip, base_m, tip_m = np.exp(values).tolist()
            noise = cls(shaft, length, along, base, base_m, tip, tip_m)
            return np.log(noise.std_at_m(arc_m) / std[:size])

        low = np.log([0.1 * middle, 1e-3 * middle, 1e-3 * middle, 0.01 * length, 0.01 * length])
        high = np.log([3.0 * middle, 30.0 * middle, 100.0 * middle, 0.5 * length, 0.5 * length])
        start = np.log([0.8 * middle, 0.3 * middle, max(std[size - 1], middle), 0.1 * length, 0.1 * length])
        shaft, base, tip, base_m, tip_m = _fitted(spread, start, low, high)
        seen = covariance_m2[:size, :size] / np.outer(std[:size], std[:size])

        def related(values: FloatArray) -> FloatArray:
            correlation, white, common = np.exp(values).tolist()
            noise = cls(shaft, correlation, along, white_share=white, common_share=common)
            return (noise.correlation(arc_m) - seen).ravel()

        low = np.log([0.5 * length / size, 1e-3, 1e-4])
        high = np.log([length, 0.3, 0.69])
        correlation, white, common = _fitted(related, np.log([0.1 * length, 0.02, 0.1]), low, high)
        return cls(shaft, correlation, along, base, base_m, tip, tip_m, white, common)

    def scaled(self, factor: float) -> Self:
        """The same noise with all lengths times ``factor``: from pixels to metres, for instance.

        >>> LineNoise(0.03, 20.0, 0.5).scaled(2e-4).correlation_m
        0.004
        """
        names = [field.name for field in fields(self)]
        values = zip(names, astuple(self), strict=True)
        changed: dict[str, Any] = {name: value if name.endswith("share") else value * factor for name, value in values}
        return type(self)(**changed)


def _fitted(
    function: Callable[[FloatArray], FloatArray], start: FloatArray, low: FloatArray, high: FloatArray
) -> list[float]:
    inner = 1e-6 * (high - low)
    found: Any = least_squares(function, np.clip(start, low + inner, high - inner), bounds=(low, high))
    return [math.exp(value) for value in found.x.tolist()]
