"""Finds stiffness and sensor pose from lines and forces: one fit of the rod to all frames of one session.

Unknown for the whole session: the constants of the rod, its clamp and the camera (`UNKNOWNS` behind the force, with the
priors of the rod estimators), the constant error of the line, and the sensor's angle about the camera's axis, its tare
and its clock. Unknown in each frame: the force, which the sensor reads with noise, and a small part of the
pre-curvature, which drifts. The method is Gauss-Newton with Levenberg's damping; the unknowns of the frames are
eliminated (Schur complement), and the inverse of the remaining matrix is the covariance (Laplace). If the residual of
the lines is larger than their noise, the covariance is increased by the same factor.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..estimators.session import MODES, POINTS, Knowledge, LineError, RodSettings, rod_model, stated_stds
from ..mechanics.planar import FORCE, UNKNOWNS, Line, Model, Work, fit_line, make_work, predict_line
from ..types import FloatArray, IntArray, SessionInfo

_CONSTANTS = len(UNKNOWNS) - FORCE
_SENSOR = ("turn_rad", "tare_x_n", "tare_y_n", "late_s")
_COUNT = _CONSTANTS + MODES + len(_SENSOR)
_TURN, _TARE, _LATE = _CONSTANTS + MODES, _CONSTANTS + MODES + 1, _CONSTANTS + MODES + 3
_K0 = UNKNOWNS.index("precurvature_per_m")
_STIFFNESS = UNKNOWNS.index("stiffness") - FORCE
_BASE = UNKNOWNS.index("base_x_m") - FORCE
_LOCAL = FORCE + 1
"""Number of unknowns of a frame: its force, and the deviation of its pre-curvature from the session's."""
_Equations = tuple[float, FloatArray, FloatArray, list[tuple[FloatArray, FloatArray, FloatArray]]]
"""Cost; matrix and right side of the step of the shared unknowns; for each frame the matrices of its own step."""
MIN_FORCE_STD_N = 5e-3
"""Least standard deviation of a reading at a frame: noise and steps of such a sensor, and errors of a planar rod."""
MAX_NOISE_ROUNDS, NOISE_GROWTH = 3, 1.1
"""The readings' standard deviation is estimated again this number of times, while it grows by this factor."""
DRIFT_SHARE = 0.01
"""Drift of the pre-curvature that the knob sets, relative to it."""
MIN_DRIFT_PER_M = 0.02
HUBER_STDS = 4.0
FORCE_PRIOR_STD_N = 0.25
"""Standard deviation of each component of the force, where the line alone gives it."""
RESIDUAL_FACTORS = (1.0 / 64.0, 1.0 / 8.0, 1.0)
"""Factors of the line's residual: the first rounds use a larger noise."""
OUTLIER_MEDIANS, OUTLIER_VARIANCES = 16.0, 30.0
"""A frame is left out if its squares exceed this many medians, and this many variances per point."""
MAX_LOAD, MIN_FACTOR, MAX_TURN_RAD, MAX_STIFFENING = 10.0, 0.3, 2.0 * math.pi, 3.0
"""Force x length^2 / EI, four times the buckling load; relative changes; turn of the unloaded rod; growth of EI."""
MAX_STEPS = 12
CONVERGED_COST = 1e-2
"""The fit has converged when the cost decreases by less."""
MAX_DAMPING = 1e6


@dataclass(frozen=True, slots=True, eq=False)
class RodFit:
    """Result of the fit.

    Attributes:
        mean: mean of each of `UNKNOWNS` behind the force, relative to the metadata; then the constant errors of the
            line, the turn (rad), the tare (2,) (N) and the clock offset (s).
        covariance: covariance of ``mean``.
        prior_std: standard deviations before the fit.
        precurvature_per_m: (n,) pre-curvature of each frame.
        misfit: mean square of the whitened residual; 1 if the lines differ from the rod by their noise.
        force_std_n: standard deviation of the difference between sensor and rod.
        cost: cost at the end.
        frames: number of frames that were used.
        converged: whether the fit has converged.
        kept: indices of the frames that were used.
        precurvature_std: (n,) standard deviation of each frame's pre-curvature.
    """

    mean: FloatArray
    covariance: FloatArray
    prior_std: FloatArray
    precurvature_per_m: FloatArray
    misfit: float
    force_std_n: float
    cost: float
    frames: int
    converged: bool
    kept: IntArray
    precurvature_std: FloatArray

    def value(self, name: str) -> float:
        """Returns the mean of one of `UNKNOWNS` behind the force."""
        return float(self.mean[UNKNOWNS.index(name) - FORCE])

    def std(self, name: str) -> float:
        """Returns its standard deviation."""
        at = UNKNOWNS.index(name) - FORCE
        return math.sqrt(self.covariance[at, at])

    def prior(self, name: str) -> float:
        """Returns its standard deviation before the fit."""
        return float(self.prior_std[UNKNOWNS.index(name) - FORCE])

    @property
    def turn_rad(self) -> float:
        """Angle that must be added to the sensor's stated angle."""
        return float(self.mean[_TURN])

    @property
    def turn_std_rad(self) -> float:
        """Standard deviation of this angle."""
        return math.sqrt(self.covariance[_TURN, _TURN])

    @property
    def late_s(self) -> float:
        """Time that must be added to the clock offset."""
        return float(self.mean[_LATE])

    @property
    def late_std_s(self) -> float:
        """Standard deviation of this time."""
        return math.sqrt(self.covariance[_LATE, _LATE])


def fit_rod(
    info: SessionInfo,
    lines: Sequence[Line],
    scale_m_per_px: float,
    force_n: FloatArray,
    precurvature_per_m: FloatArray,
    *,
    past_n: FloatArray | None = None,
    rate_n_per_s: FloatArray | None = None,
    turn_rad: float = 0.0,
    turn_std_rad: float = math.radians(2.0),
    tare_std_n: float = 3e-3,
    late_std_s: float = 1e-3,
    drift_per_m: float | None = None,
    settings: RodSettings | None = None,
) -> RodFit:
    """Fits the rod of ``info`` to the lines of one session.

    Args:
        info: states length and stiffness.
        lines: (n) detected lines, in m by ``scale_m_per_px``; without any the result is the prior.
        scale_m_per_px: stated scale.
        force_n: (n, 2) force of the tissue on the tip, in the stated base frame.
        precurvature_per_m: (n,) pre-curvature that the knob sets; the fit finds an offset to all of them.
        past_n: (n, 2) mean of the preceding forces over the time constant of creep; None: no creep.
        rate_n_per_s: (n, 2) rate of the force; None: 0.
        turn_rad: turn of the sensor at which the fit starts.
        turn_std_rad: standard deviation of the stated angle.
        tare_std_n: standard deviation of the remaining tare.
        late_std_s: standard deviation of the clock offset.
        drift_per_m: standard deviation of a frame's pre-curvature about the session's; None: a hundredth of it.
        settings: priors and noise.

    Returns:
        The fitted values with their covariance, and the residuals.

    Raises:
        InputError: length or stiffness is not stated, or no shape of the rod fits the lines.
    """
    settings = settings or RodSettings()
    model = rod_model(info, settings.segments)
    error = LineError.of(settings.noise, MODES)
    whiten, modes = error.whiten / scale_m_per_px, error.modes * scale_m_per_px
    knowledge = Knowledge.stated(settings)
    mean = np.concatenate([knowledge.constants, np.zeros(MODES + len(_SENSOR))])
    prior = np.ones(_COUNT)
    prior[:_CONSTANTS] = np.sqrt(np.diag(knowledge.constants_covariance))
    for at, std in stated_stds(info, settings.vision.view).items():
        if at != _STIFFNESS:  # the stiffness is fitted; its prior is in the settings
            prior[at] = std
    prior[_TURN:] = turn_std_rad, tare_std_n, tare_std_n, late_std_s
    play = abs(info.actuation.knob_gain_per_m_deg or 0.0) * settings.prior.knob_play_deg / math.sqrt(12.0)
    prior[0] = math.hypot(prior[0], play)
    drift = np.maximum(MIN_DRIFT_PER_M, DRIFT_SHARE * np.abs(precurvature_per_m))
    if drift_per_m is not None:
        drift = np.full(len(lines), drift_per_m)
    past = np.zeros((len(lines), FORCE)) if past_n is None else past_n
    lines = [line._replace(past_n=past_force) for line, past_force in zip(lines, past, strict=True)]
    work = make_work(model, POINTS, FORCE + _CONSTANTS + MODES)
    rate = np.zeros((len(lines), FORCE)) if rate_n_per_s is None else rate_n_per_s
    problem = _Problem(model, lines, force_n, rate, precurvature_per_m, drift, modes, whiten, work, mean, prior)
    start = mean.copy()
    start[_TURN] = turn_rad
    if not lines:  # returns the prior
        none = np.zeros(0)
        return RodFit(mean, np.diag(prior**2), prior, none, math.nan, MIN_FORCE_STD_N, 0.0, 0,
                      True, np.zeros(0, np.int64), none)  # fmt: skip
    start[_BASE : _BASE + 2] = np.median([line.points[0] for line in lines], axis=0)
    return problem.solve(start)


def line_forces(
    info: SessionInfo,
    lines: Sequence[Line],
    scale_m_per_px: float,
    precurvature_per_m: FloatArray,
    fit: RodFit,
    settings: RodSettings | None = None,
) -> FloatArray:
    """Returns the force of each line by the calibrated rod, without the sensor's readings.

    Args:
        info: states length and stiffness.
        lines: (n) detected lines, in m by ``scale_m_per_px``.
        scale_m_per_px: stated scale.
        precurvature_per_m: (n,) pre-curvature that the knob sets.
        fit: the calibrated rod.
        settings: priors and noise.

    Returns:
        (n, 2) forces of the tissue on the tip, base frame; NaN where no rod fits.
    """
    settings = settings or RodSettings()
    model, error = rod_model(info, settings.segments), LineError.of(settings.noise, MODES)
    whiten, modes = error.whiten / scale_m_per_px, error.modes * scale_m_per_px
    count = _CONSTANTS + MODES
    work, found = make_work(model, POINTS, FORCE + count), np.full((len(lines), FORCE), math.nan)
    information = np.zeros((FORCE + count, FORCE + count))
    information[:FORCE, :FORCE] = np.eye(FORCE) / FORCE_PRIOR_STD_N**2
    information[FORCE:, FORCE:] = np.linalg.inv(fit.covariance[:count, :count])
    for k, line in enumerate(lines):
        mean = np.concatenate([np.zeros(FORCE), fit.mean[:count]])
        mean[_K0] += precurvature_per_m[k]
        q, covariance = mean.copy(), np.empty_like(information)
        result = fit_line(
            q, mean, information, model, line, modes, whiten, HUBER_STDS, 2 * MAX_STEPS, True, work, covariance
        )  # fmt: skip
        if result.converged:
            found[k] = q[:FORCE]
    return found


def _is_possible(q: FloatArray, model: Model) -> bool:
    """Returns whether this rod and its load are in the range of the solver, as `fit_line` does for its steps."""
    load = math.hypot(q[0], q[1]) * model.flexible_m**2 / model.stiffness_nm2
    factors = [1.0 + float(q[UNKNOWNS.index(name)]) for name in ("stiffness", "proximal_stiffness", "length", "scale")]
    soft, k0 = float(q[UNKNOWNS.index("stiffening_m2")]), float(q[_K0])
    return (
        load < MAX_LOAD and min(factors) > MIN_FACTOR and abs(k0) * model.flexible_m < MAX_TURN_RAD
        and soft > 0.0 and soft * k0**2 < MAX_STIFFENING
    )  # fmt: skip


class _Problem:
    """The frames of one fit; see `fit_rod`."""

    def __init__(
        self, model: Model, lines: Sequence[Line], force: FloatArray, rate: FloatArray, k0: FloatArray,
        drift: FloatArray, modes: FloatArray, whiten: FloatArray, work: Work, mean: FloatArray, prior: FloatArray,
    ) -> None:  # fmt: skip
        self._model, self._lines, self._force, self._k0, self._drift = model, lines, force, k0, drift
        self._rate = rate
        self._modes, self._whiten, self._work, self._mean, self._prior = modes, whiten, work, mean, prior
        self._theta = np.zeros((len(lines), work.theta.size))
        self._warm = np.zeros(len(lines), np.bool_)
        self._force_std = MIN_FORCE_STD_N
        self._kept = np.arange(len(lines))
        self._squares = np.zeros(len(lines))
        self._misfit = math.nan

    def solve(self, start: FloatArray) -> RodFit:
        shared, own = start.copy(), np.zeros((len(self._lines), _LOCAL))
        own[:, :FORCE] = self._read(shared)
        state, converged = self._normal(shared, own, RESIDUAL_FACTORS[0]), False
        for ease in RESIDUAL_FACTORS:
            shared, own, state, converged = self._descend(shared, own, ease)
            if ease < 1.0 and state[0] < math.inf:
                own = self._drop_outliers(own)
        if state[0] == math.inf:
            raise InputError("no rod as it is stated bends under the measured forces as in the images")
        for _ in range(MAX_NOISE_ROUNDS):
            difference = own[:, :FORCE] - self._read(shared)
            # the remaining difference, and the variance of a frame's force by its line
            own_variance = [inverse[0, 0] + inverse[1, 1] for inverse, *_ in state[3]]
            square = float(np.mean(difference**2)) + float(np.mean(own_variance)) / FORCE
            if square < (NOISE_GROWTH * self._force_std) ** 2:
                break
            self._force_std = math.sqrt(square)
            shared, own, state, converged = self._descend(shared, own, 1.0)
        covariance = np.linalg.inv(state[1]) * max(1.0, self._misfit)
        return RodFit(
            shared, 0.5 * (covariance + covariance.T), self._prior,
            self._k0 + shared[0] + own[:, FORCE], self._misfit, self._force_std, state[0],
            len(self._lines), converged, self._kept, np.sqrt([inverse[FORCE, FORCE] for inverse, *_ in state[3]]),
        )  # fmt: skip

    def _drop_outliers(self, own: FloatArray) -> FloatArray:
        """Returns ``own`` of the frames that are kept; in the others a different object was detected."""
        usual = float(np.median(self._squares))
        fine = np.flatnonzero(self._squares <= max(OUTLIER_MEDIANS * usual, OUTLIER_VARIANCES * self._whiten.shape[0]))
        self._lines = [self._lines[k] for k in fine.tolist()]
        self._force, self._rate, self._k0 = self._force[fine], self._rate[fine], self._k0[fine]
        self._drift, self._theta, self._warm = self._drift[fine], self._theta[fine], self._warm[fine]
        self._kept = self._kept[fine]
        return own[fine]

    def _descend(
        self, shared: FloatArray, own: FloatArray, ease: float
    ) -> tuple[FloatArray, FloatArray, _Equations, bool]:
        """Minimises by Levenberg-Marquardt; returns the unknowns, their equations, and whether it converged."""
        state, damping = self._normal(shared, own, ease), 0.0
        for _ in range(MAX_STEPS):
            cost, matrix, side, blocks = state
            if cost == math.inf:
                break
            step = np.linalg.solve(matrix + damping * np.diag(np.diag(matrix)), side)
            tried = shared + step
            tried_own = own + np.array([inverse @ (left - cross @ step) for inverse, left, cross in blocks])
            previous_theta = self._theta.copy()
            attempt = self._normal(tried, tried_own, ease)
            if attempt[0] <= cost:
                shared, own, state = tried, tried_own, attempt
                damping = 0.0 if damping < 1e-3 else 0.1 * damping
                if cost - attempt[0] < CONVERGED_COST:
                    return shared, own, state, True
            else:
                self._theta = previous_theta
                damping = max(1e-2, 8.0 * damping)
                if damping > MAX_DAMPING:
                    return shared, own, state, True
        return shared, own, state, False

    def _read(self, shared: FloatArray) -> FloatArray:
        """Returns the (n, 2) forces if the sensor's readings are exact."""
        c, s = math.cos(shared[_TURN]), math.sin(shared[_TURN])
        turn = np.array([[c, s], [-s, c]])
        # a force stamp is the frame's minus the offset: a larger offset selects an earlier force
        return (self._force - shared[_LATE] * self._rate) @ turn + shared[_TARE : _TARE + FORCE]

    def _normal(self, shared: FloatArray, own: FloatArray, ease: float) -> _Equations:
        """Returns the cost, and the equations of the next step, from which each frame's own unknowns are eliminated."""
        work, count = self._work, _CONSTANTS + MODES
        information = 1.0 / self._prior**2
        cost = 0.5 * float(np.sum(information * (shared - self._mean) ** 2))
        matrix, side = np.diag(information), -information * (shared - self._mean)
        read = self._read(shared)
        c, s = math.cos(shared[_TURN]), math.sin(shared[_TURN])
        turned = self._force @ np.array([[-s, c], [-c, -s]])
        rate = self._rate @ np.array([[c, s], [-s, c]])
        q = np.empty(FORCE + count)
        q[FORCE:] = shared[:count]
        blocks: list[tuple[FloatArray, FloatArray, FloatArray]] = []
        force_variance = self._force_std**2
        frame_squares = np.zeros(len(self._lines))
        rows = self._whiten.shape[0]
        for i, line in enumerate(self._lines):
            q[:FORCE] = own[i, :FORCE]
            q[_K0] = shared[0] + self._k0[i] + own[i, FORCE]
            warm = bool(self._warm[i])
            if warm:
                work.theta[:] = self._theta[i]
            if not _is_possible(q, self._model):
                return math.inf, matrix, side, blocks
            # a step that a warm start cannot follow is too long: it is shortened, not solved from a cold start
            found = predict_line(q, self._model, line, self._modes, work, not warm)
            if not (found[0] and found[1]):
                return math.inf, matrix, side, blocks
            self._theta[i], self._warm[i] = work.theta, True
            white = ease * (self._whiten @ work.residual)
            slopes = ease * (self._whiten @ work.slopes)
            frame_squares[i] = float(white @ white) / ease**2
            size = np.abs(white)
            cost += float(np.sum(np.where(size <= HUBER_STDS, 0.5 * size**2, HUBER_STDS * (size - 0.5 * HUBER_STDS))))
            weight = np.minimum(1.0, HUBER_STDS / np.maximum(size, 1e-12))
            local = np.empty((rows, _LOCAL))
            local[:, :FORCE], local[:, FORCE] = slopes[:, :FORCE], slopes[:, _K0]
            common = np.zeros((rows, _COUNT))
            common[:, :count] = slopes[:, FORCE:]
            difference = own[i, :FORCE] - read[i]
            cost += 0.5 * float(difference @ difference) / force_variance + 0.5 * (own[i, FORCE] / self._drift[i]) ** 2
            # derivatives of (own - read) by the turn, the clock offset and the tare
            slope_read = np.zeros((FORCE, _COUNT))
            slope_read[:, _TURN], slope_read[:, _LATE] = -turned[i], rate[i]
            slope_read[:, _TARE : _TARE + FORCE] = -np.eye(FORCE)
            inner = local.T @ (weight[:, None] * local)
            inner[:FORCE, :FORCE] += np.eye(FORCE) / force_variance
            inner[FORCE, FORCE] += self._drift[i] ** -2
            cross = local.T @ (weight[:, None] * common)
            cross[:FORCE] += slope_read / force_variance
            left = local.T @ (weight * white)
            left[:FORCE] -= difference / force_variance
            left[FORCE] -= own[i, FORCE] * self._drift[i] ** -2
            inverse = np.asarray(np.linalg.inv(inner), np.float64)
            matrix += common.T @ (weight[:, None] * common) + slope_read.T @ slope_read / force_variance
            matrix -= cross.T @ inverse @ cross
            side += (
                common.T @ (weight * white) - slope_read.T @ difference / force_variance - cross.T @ (inverse @ left)
            )
            blocks.append((inverse, left, cross))
        self._squares = frame_squares
        self._misfit = float(np.mean(frame_squares)) / rows
        return cost, matrix, side, blocks
