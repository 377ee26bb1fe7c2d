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
        """Returns the standard deviation of one of `UNKNOWNS` behind the force, after the fit."""
        at = UNKNOWNS.index(name) - FORCE
        return math.sqrt(self.covariance[at, at])

    def prior(self, name: str) -> float:
        """Returns the standard deviation of one of `UNKNOWNS` behind the force, before the fit."""
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
    # a knob that is somewhere in its gap: a uniform distribution has the standard deviation width / sqrt(12)
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
    constants = _CONSTANTS + MODES
    work, forces = make_work(model, POINTS, FORCE + constants), np.full((len(lines), FORCE), math.nan)
    information = np.zeros((FORCE + constants, FORCE + constants))
    information[:FORCE, :FORCE] = np.eye(FORCE) / FORCE_PRIOR_STD_N**2
    information[FORCE:, FORCE:] = np.linalg.inv(fit.covariance[:constants, :constants])
    for k, line in enumerate(lines):
        mean = np.concatenate([np.zeros(FORCE), fit.mean[:constants]])
        mean[_K0] += precurvature_per_m[k]
        q, covariance = mean.copy(), np.empty_like(information)  # `fit_line` fills both
        result = fit_line(
            q, mean, information, model, line, modes, whiten, HUBER_STDS, 2 * MAX_STEPS, True, work, covariance
        )  # fmt: skip
        if result.converged:
            forces[k] = q[:FORCE]
    return forces


def _is_possible(q: FloatArray, model: Model) -> bool:
    """Returns whether this rod and its load are in the range of the solver, as `fit_line` does for its steps."""
    load = math.hypot(q[0], q[1]) * model.flexible_m**2 / model.stiffness_nm2
    factors = [1.0 + float(q[UNKNOWNS.index(name)]) for name in ("stiffness", "proximal_stiffness", "length", "scale")]
    stiffening_m2, k0 = float(q[UNKNOWNS.index("stiffening_m2")]), float(q[_K0])
    return (
        load < MAX_LOAD and min(factors) > MIN_FACTOR and abs(k0) * model.flexible_m < MAX_TURN_RAD
        and stiffening_m2 > 0.0 and stiffening_m2 * k0**2 < MAX_STIFFENING
    )  # fmt: skip


class _Problem:
    """The frames of one fit and the state of its solver; the arguments are those of `fit_rod`, n frames.

    ``k0`` is the (n,) pre-curvature set by the knob, ``drift`` the (n,) standard deviation about it in 1/m; ``mean``
    and ``prior`` are the (`_COUNT`,) prior of the shared unknowns. ``_theta`` holds each frame's last solution of the
    rod, from which its next one starts where ``_warm`` is set.
    """

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
        """Minimises from the (`_COUNT`,) shared unknowns ``start``.

        The first rounds trust the lines less and leave out the frames that then fit badly. The last rounds increase the
        standard deviation of the sensor's readings until it explains the difference between sensor and rod.
        """
        shared, local = start.copy(), np.zeros((len(self._lines), _LOCAL))
        local[:, :FORCE] = self._read(shared)
        state, converged = self._normal(shared, local, RESIDUAL_FACTORS[0]), False
        for ease in RESIDUAL_FACTORS:
            shared, local, state, converged = self._descend(shared, local, ease)
            if ease < 1.0 and state[0] < math.inf:
                local = self._drop_outliers(local)
        if state[0] == math.inf:
            raise InputError("no rod as it is stated bends under the measured forces as in the images")
        for _ in range(MAX_NOISE_ROUNDS):
            difference = local[:, :FORCE] - self._read(shared)
            # the remaining difference, and the variance of a frame's force by its line
            line_variance = [inverse[0, 0] + inverse[1, 1] for inverse, *_ in state[3]]
            square = float(np.mean(difference**2)) + float(np.mean(line_variance)) / FORCE
            if square < (NOISE_GROWTH * self._force_std) ** 2:
                break
            self._force_std = math.sqrt(square)
            shared, local, state, converged = self._descend(shared, local, 1.0)
        covariance = np.linalg.inv(state[1]) * max(1.0, self._misfit)
        return RodFit(
            shared, 0.5 * (covariance + covariance.T), self._prior,
            self._k0 + shared[0] + local[:, FORCE], self._misfit, self._force_std, state[0],
            len(self._lines), converged, self._kept, np.sqrt([inverse[FORCE, FORCE] for inverse, *_ in state[3]]),
        )  # fmt: skip

    def _drop_outliers(self, local: FloatArray) -> FloatArray:
        """Returns ``local`` of the frames that are kept; in the others a different object was detected."""
        median_square = float(np.median(self._squares))
        kept_rows = np.flatnonzero(
            self._squares <= max(OUTLIER_MEDIANS * median_square, OUTLIER_VARIANCES * self._whiten.shape[0])
        )
        self._lines = [self._lines[k] for k in kept_rows.tolist()]
        self._force, self._rate, self._k0 = self._force[kept_rows], self._rate[kept_rows], self._k0[kept_rows]
        self._drift, self._theta, self._warm = self._drift[kept_rows], self._theta[kept_rows], self._warm[kept_rows]
        self._kept = self._kept[kept_rows]
        return local[kept_rows]

    def _descend(
        self, shared: FloatArray, local: FloatArray, ease: float
    ) -> tuple[FloatArray, FloatArray, _Equations, bool]:
        """Minimises by Levenberg-Marquardt; see `_normal` for the arguments.

        Returns:
            The shared and the local unknowns, their equations, and whether the fit has converged.
        """
        equations, damping = self._normal(shared, local, ease), 0.0
        for _ in range(MAX_STEPS):
            cost, matrix, side, blocks = equations
            if cost == math.inf:
                break
            step = np.linalg.solve(matrix + damping * np.diag(np.diag(matrix)), side)
            tried_shared = shared + step
            tried_local = local + np.array(
                [inverse @ (right_side - cross @ step) for inverse, right_side, cross in blocks]
            )
            previous_theta = self._theta.copy()
            attempt = self._normal(tried_shared, tried_local, ease)
            if attempt[0] <= cost:
                shared, local, equations = tried_shared, tried_local, attempt
                damping = 0.0 if damping < 1e-3 else 0.1 * damping
                if cost - attempt[0] < CONVERGED_COST:
                    return shared, local, equations, True
            else:
                self._theta = previous_theta
                damping = max(1e-2, 8.0 * damping)
                if damping > MAX_DAMPING:
                    return shared, local, equations, True
        return shared, local, equations, False

    def _read(self, shared: FloatArray) -> FloatArray:
        """Returns the (n, 2) forces if the sensor's readings are exact."""
        c, s = math.cos(shared[_TURN]), math.sin(shared[_TURN])
        turn = np.array([[c, s], [-s, c]])
        # a force stamp is the frame's minus the offset: a larger offset selects an earlier force
        return (self._force - shared[_LATE] * self._rate) @ turn + shared[_TARE : _TARE + FORCE]

    def _normal(self, shared: FloatArray, local: FloatArray, ease: float) -> _Equations:
        """Linearises the fit and eliminates each frame's unknowns from the equations of the next step.

        The cost is half the sum of squares, in standard deviations, of four kinds of residual: shared unknowns less
        their prior, lines (with Huber's loss), rod's force less the sensor's, and drift of the pre-curvature.

        Args:
            shared: (`_COUNT`,) unknowns of the session; see `RodFit.mean`.
            local: (n, `_LOCAL`) unknowns of the frames: force in N, and drift of the pre-curvature in 1/m.
            ease: factor of the lines' residual.

        Returns:
            The equations; the cost is infinite where no rod with these unknowns can be solved.
        """
        work, count = self._work, _CONSTANTS + MODES
        information = 1.0 / self._prior**2
        cost = 0.5 * float(np.sum(information * (shared - self._mean) ** 2))
        matrix, side = np.diag(information), -information * (shared - self._mean)
        read = self._read(shared)
        cosine, sine = math.cos(shared[_TURN]), math.sin(shared[_TURN])
        turned = self._force @ np.array([[-sine, cosine], [-cosine, -sine]])
        rate = self._rate @ np.array([[cosine, sine], [-sine, cosine]])
        q = np.empty(FORCE + count)
        q[FORCE:] = shared[:count]
        blocks: list[tuple[FloatArray, FloatArray, FloatArray]] = []
        force_variance = self._force_std**2
        frame_squares = np.zeros(len(self._lines))
        rows = self._whiten.shape[0]  # whitened residuals of a line
        for i, line in enumerate(self._lines):
            q[:FORCE] = local[i, :FORCE]
            q[_K0] = shared[0] + self._k0[i] + local[i, FORCE]
            warm = bool(self._warm[i])
            if warm:
                work.theta[:] = self._theta[i]
            if not _is_possible(q, self._model):
                return math.inf, matrix, side, blocks
            # a step that a warm start cannot follow is too long: it is shortened, not solved from a cold start
            prediction = predict_line(q, self._model, line, self._modes, work, not warm)
            if not (prediction[0] and prediction[1]):
                return math.inf, matrix, side, blocks
            self._theta[i], self._warm[i] = work.theta, True
            white = ease * (self._whiten @ work.residual)
            slopes = ease * (self._whiten @ work.slopes)
            frame_squares[i] = float(white @ white) / ease**2
            absolute = np.abs(white)
            cost += float(
                np.sum(np.where(absolute <= HUBER_STDS, 0.5 * absolute**2, HUBER_STDS * (absolute - 0.5 * HUBER_STDS)))
            )
            weight = np.minimum(1.0, HUBER_STDS / np.maximum(absolute, 1e-12))
            local_slopes = np.empty((rows, _LOCAL))
            local_slopes[:, :FORCE], local_slopes[:, FORCE] = slopes[:, :FORCE], slopes[:, _K0]
            shared_slopes = np.zeros((rows, _COUNT))
            shared_slopes[:, :count] = slopes[:, FORCE:]
            force_error = local[i, :FORCE] - read[i]
            cost += (
                0.5 * float(force_error @ force_error) / force_variance + 0.5 * (local[i, FORCE] / self._drift[i]) ** 2
            )
            # derivatives of the rod's force less the reading by the turn, the clock offset and the tare
            slope_read = np.zeros((FORCE, _COUNT))
            slope_read[:, _TURN], slope_read[:, _LATE] = -turned[i], rate[i]
            slope_read[:, _TARE : _TARE + FORCE] = -np.eye(FORCE)
            # normal equations of the frame's unknowns, which the Schur complement eliminates
            local_matrix = local_slopes.T @ (weight[:, None] * local_slopes)
            local_matrix[:FORCE, :FORCE] += np.eye(FORCE) / force_variance
            local_matrix[FORCE, FORCE] += self._drift[i] ** -2
            cross = local_slopes.T @ (weight[:, None] * shared_slopes)
            cross[:FORCE] += slope_read / force_variance
            right_side = local_slopes.T @ (weight * white)
            right_side[:FORCE] -= force_error / force_variance
            right_side[FORCE] -= local[i, FORCE] * self._drift[i] ** -2
            inverse = np.asarray(np.linalg.inv(local_matrix), np.float64)
            matrix += shared_slopes.T @ (weight[:, None] * shared_slopes) + slope_read.T @ slope_read / force_variance
            matrix -= cross.T @ inverse @ cross
            side += (
                shared_slopes.T @ (weight * white)
                - slope_read.T @ force_error / force_variance
                - cross.T @ (inverse @ right_side)
            )
            blocks.append((inverse, right_side, cross))
        self._squares = frame_squares
        self._misfit = float(np.mean(frame_squares)) / rows
        return cost, matrix, side, blocks
