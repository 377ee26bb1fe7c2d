"""The filter of `rod-track`: two hypotheses over time, no contact and contact, each with all unknowns (IMM).

Interacting multiple models (Blom and Bar-Shalom 1988): in each frame either hypothesis starts from both of the frame
before, weighed by how likely contact is made or lost meanwhile; its update is a fit of the whole rod (an iterated
extended Kalman filter); their evidence weighs them. The shape without contact is thus learnt while only
the hypothesis without contact explains it, and the force is zeroed there.
"""

import math

import numpy as np
from numba import njit

from ...mechanics.planar import FORCE, UNKNOWNS, Found, Line, Model, fit_line, inverse, make_work
from ...types import FloatArray, SessionInfo
from ._knowledge import MODES, Knowledge, LineError, noise_unit_m
from ._lines import POINTS, StatedErrors
from ._noise_level import NoiseLevel
from ._outcome import Outcome, tempered
from ._settings import RodTrackSettings

COUNT = len(UNKNOWNS) + MODES + FORCE
"""Unknowns: of the rod, lasting errors of the line, rates of the force."""
_RATE = slice(COUNT - FORCE, COUNT)
_FORCE, _MODES = slice(0, FORCE), slice(len(UNKNOWNS), len(UNKNOWNS) + MODES)
_K0, _ANGLE = UNKNOWNS.index("precurvature_per_m"), UNKNOWNS.index("base_angle_rad")
_BASE = [UNKNOWNS.index("base_x_m"), UNKNOWNS.index("base_y_m")]
_DRIFTING = np.array([k for k, name in enumerate(UNKNOWNS) if k > _K0 and not name.startswith("base_")])
_DRIFTS, _DRIFTS_OF_PRIOR = np.ix_(_DRIFTING, _DRIFTING), np.ix_(_DRIFTING - FORCE, _DRIFTING - FORCE)
_EYE_FORCE, _EYE_MODES = np.eye(FORCE), np.eye(MODES)
_NOTHING = 1e-12
"""Variance of a force that is none, N^2."""
_STEPS, _MOST_STEPS = 20, 60
_WARM_STEPS = (4, 12)
"""Largest number of steps of the two hypotheses: in contact no step makes a rod without force fit, so few are tried."""
_FREE, _TOUCH = 0, 1
_LEAST_SHARE = 1e-6
"""No hypothesis is ever given up."""
_ONSET_N = 0.01
_GROWN = 1.5
"""The session starts again if the noise is found to be larger by this factor."""


class ContactFilter:
    """The state of one session; `step` takes its next line."""

    def __init__(self, settings: RodTrackSettings, knowledge: Knowledge, model: Model, info: SessionInfo) -> None:
        self._settings, self._knowledge, self._model, self._info = settings, knowledge, model, info
        self._level = NoiseLevel(settings.noise)
        self._work = [make_work(model, POINTS, COUNT) for _ in range(2)]
        self._scale = self._factor = self._begun_factor = 0.0
        self._error = LineError.of(settings.noise, MODES)
        self._whiten, self._modes, self._rows = np.empty(0), np.zeros((POINTS + 1, MODES + FORCE)), POINTS + 1
        self._mean: list[FloatArray] = []
        self._covariance: list[FloatArray] = []
        self._share = knowledge.contact_share
        self._knob_deg = math.nan
        self._held: tuple[float, FloatArray, FloatArray, FloatArray] | None = None
        self._unloaded: FloatArray | None = None
        self._cold = True
        self._past_n = np.zeros(FORCE)
        self._lost_s = self._advance_m = 0.0

    def step(
        self,
        line: Line,
        scale: float,
        knob_deg: float,
        elapsed_s: float,
        advance_m: float = 0.0,
        stated: StatedErrors | None = None,
    ) -> Outcome:
        """Predicts the state and fits the next line.

        A line that no hypothesis explains changes nothing but the level of the noise. After ``gap_s`` of such lines,
        or of constants that have left their priors, the session begins anew; so it does where the noise turns out to
        be far larger than it was taken for when the constants were learnt.

        Args:
            line: the line.
            scale: metres per pixel.
            knob_deg: reading of the knob; NaN: not known.
            elapsed_s: time since the previous line.
            advance_m: advance of the clamp, with which the line's frame goes.
            stated: vision's statements about the line.
        """
        if scale != self._scale or not self._mean or self._lost_s > self._settings.gap_s:
            self._begin(line, scale, knob_deg)
        else:
            self._follow_level()
            self._turn_knob(knob_deg)
            self._predict(elapsed_s)
            self._move_clamp(advance_m - self._advance_m, elapsed_s)
        self._advance_m = advance_m
        line = line._replace(past_n=self._past_n)
        self._fill_noise(stated)
        before = self._covariance[_TOUCH][_FORCE, _FORCE].copy()
        results = [self._fit(line, which) for which in (_FREE, _TOUCH)]
        (free, q_free, covariance_free, evidence_free), (touch, q, covariance, evidence) = results
        best = touch if touch.converged else free
        misfit = min(each.chi2 for each in (free, touch)) / self._rows
        converged = touch.converged
        log_odds = math.log(self._share / (1.0 - self._share))
        self._lost_s += elapsed_s
        if converged and misfit <= self._settings.max_misfit:
            if free.converged:
                log_odds += tempered(evidence - evidence_free, covariance[_FORCE, _FORCE], self._settings.sure_n)
                self._mean, self._covariance = [q_free, q], [covariance_free, covariance]
            else:
                log_odds = math.log((1.0 - _LEAST_SHARE) / _LEAST_SHARE)
                self._mean[_TOUCH], self._covariance[_TOUCH] = q, covariance
                self._mean[_FREE], self._covariance[_FREE] = _released(q, covariance)
            share = 1.0 / (1.0 + math.exp(-max(-60.0, min(60.0, log_odds))))
            self._share = min(1.0 - _LEAST_SHARE, max(_LEAST_SHARE, share))
            self._cold = False
            forget = math.exp(-elapsed_s / self._settings.creep_s)
            self._past_n = forget * self._past_n + (1.0 - forget) * self._share * q[_FORCE]
        if converged:
            self._level.add(misfit, elapsed_s)
        if self._level.factor > _GROWN * self._begun_factor:
            self._lost_s = math.inf
        off = self._off(knob_deg)
        if converged and misfit <= self._settings.max_misfit and off <= self._settings.max_off:
            self._lost_s = 0.0 if math.isfinite(self._lost_s) else self._lost_s
        return Outcome(
            q[_FORCE].copy(),
            covariance[_FORCE, _FORCE].copy(),
            log_odds,
            float(self._work[_TOUCH].theta[-1]),
            misfit,
            best.firmness,
            converged,
            _open_n(before, covariance[_FORCE, _FORCE]) if converged else math.inf,
            off,
            self._factor,
        )

    def _off(self, knob_deg: float) -> float:
        """Distance of the constants from their priors, mean square, of the better hypothesis."""
        mean, _, information = self._prior(knob_deg)
        which = _TOUCH if self._share > 0.5 else _FREE
        apart = self._mean[which][FORCE : len(UNKNOWNS)] - mean
        return float(apart @ information @ apart) / len(mean)

    def _prior(self, knob_deg: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Mean of the constants beforehand, their covariance and its inverse."""
        held = self._held
        if held is None or held[0] != knob_deg:
            mean, covariance = self._knowledge.for_session(self._settings, self._info, knob_deg)
            information = np.asarray(np.linalg.inv(covariance), np.float64)
            self._held = held = (knob_deg, mean, covariance, information)
        return held[1:]

    def _begin(self, line: Line, scale: float, knob_deg: float) -> None:
        self._scale, self._knob_deg, self._cold = scale, knob_deg, True
        self._begun_factor = self._level.factor
        self._lay_out_noise()
        constants = len(UNKNOWNS) - FORCE
        mean, covariance = np.zeros(COUNT), np.eye(COUNT)
        inner = slice(FORCE, FORCE + constants)
        mean[inner], covariance[inner, inner] = self._knowledge.for_session(self._settings, self._info, knob_deg)
        covariance[_FORCE, _FORCE] = self._settings.prior.force_n**2 * _EYE_FORCE
        covariance[_RATE, _RATE] = self._settings.force_rate_n_per_s**2 * _EYE_FORCE
        free, free_covariance = _released(mean, covariance)
        self._mean, self._covariance = [free, mean], [free_covariance, covariance]
        self._share, self._lost_s = self._knowledge.contact_share, 0.0
        self._past_n = np.zeros(FORCE)
        self._start = line.points[0]

    def _lay_out_noise(self) -> None:
        self._factor = self._level.factor
        self._error = LineError.of(self._settings.noise, MODES, self._factor)

    def _fill_noise(self, stated: StatedErrors | None) -> None:
        unit = noise_unit_m(self._model, self._scale)
        error = self._error.beside(stated, self._scale / unit)
        self._whiten, self._rows = error.whiten / unit, error.rows
        self._modes[:, :MODES] = error.modes * unit

    def _follow_level(self) -> None:
        """Where the level of the noise has changed the errors that stay are said in the new modes."""
        if self._level.factor == self._factor:
            return
        before = self._error.modes
        self._lay_out_noise()
        turn = np.linalg.lstsq(self._error.modes, before, rcond=None)[0]
        for mean, covariance in zip(self._mean, self._covariance, strict=True):
            mean[_MODES] = turn @ mean[_MODES]
            covariance[_MODES] = turn @ covariance[_MODES]
            covariance[:, _MODES] = covariance[:, _MODES] @ turn.T

    def _turn_knob(self, knob_deg: float) -> None:
        """The curvature follows the knob once it has crossed its play."""
        actuation, prior = self._info.actuation, self._settings.prior
        gain, asked = actuation.knob_gain_per_m_deg, actuation.curvature_per_m(knob_deg)
        turned = knob_deg - self._knob_deg
        if gain is None or asked is None or math.isnan(turned) or turned == 0.0:
            self._knob_deg = self._knob_deg if math.isnan(knob_deg) else knob_deg
            return
        play = prior.knob_play_deg if actuation.knob_play_deg is None else actuation.knob_play_deg
        margin = gain * (0.5 * play + prior.knob_gain * abs(knob_deg))
        for mean, covariance in zip(self._mean, self._covariance, strict=True):
            followed = min(asked + margin, max(asked - margin, mean[_K0]))
            # how far it follows is known to the gain's error, and where the play ends
            covariance[_K0, _K0] += (prior.knob_gain * gain * turned) ** 2 + 0.1 * (followed - mean[_K0]) ** 2
            mean[_K0] = followed
        self._knob_deg = knob_deg

    def _predict(self, elapsed_s: float) -> None:
        """Walks and drifts, then the two hypotheses mixed as contact is made or lost."""
        settings, constants = self._settings, self._covariance
        gain = self._info.actuation.knob_gain_per_m_deg or 0.0
        bend = gain * abs(0.0 if math.isnan(self._knob_deg) else self._knob_deg)
        drift = 2.0 * (settings.knob_drift * bend) ** 2 * min(1.0, elapsed_s / settings.knob_drift_s)
        for covariance in constants:
            covariance[_K0, _K0] += drift
            for at in _BASE:
                covariance[at, at] += settings.base_walk_m**2 * elapsed_s
            covariance[_ANGLE, _ANGLE] += math.radians(settings.base_walk_deg) ** 2 * elapsed_s
        keeps = math.exp(-elapsed_s / settings.constants_s)
        usual, spread, _ = self._prior(self._knob_deg)
        for mean, covariance in zip(self._mean, self._covariance, strict=True):
            mean[_DRIFTING] = usual[_DRIFTING - FORCE] + keeps * (mean[_DRIFTING] - usual[_DRIFTING - FORCE])
            covariance[_DRIFTING] *= keeps
            covariance[:, _DRIFTING] *= keeps
            covariance[_DRIFTS] += (1.0 - keeps**2) * spread[_DRIFTS_OF_PRIOR]
        forgets = math.exp(-elapsed_s / settings.line_error_s)
        for mean, covariance in zip(self._mean, self._covariance, strict=True):
            mean[_MODES] *= forgets
            covariance[_MODES] *= forgets
            covariance[:, _MODES] *= forgets
            covariance[_MODES, _MODES] += (1.0 - forgets**2) * _EYE_MODES
        change = 1.0 - math.exp(-elapsed_s / settings.contact_s)
        if elapsed_s > settings.gap_s:
            change = 0.5
        touch = self._share * (1.0 - change) + (1.0 - self._share) * change
        stays, leaves = self._share * (1.0 - change) / touch, self._share * change / (1.0 - touch)
        mean, covariance = self._moved(elapsed_s)
        onset, onset_covariance = self._mean[_FREE].copy(), self._covariance[_FREE].copy()
        begun = min(settings.prior.force_n, _ONSET_N + settings.force_rate_n_per_s * elapsed_s)
        for k in range(FORCE):
            onset_covariance[k, k] = begun**2
            onset_covariance[COUNT - FORCE + k, COUNT - FORCE + k] = settings.force_rate_n_per_s**2
        left, left_covariance = _released(self._mean[_TOUCH], self._covariance[_TOUCH])
        self._mean[_FREE], self._covariance[_FREE] = _mixed(
            leaves, left, left_covariance, self._mean[_FREE], self._covariance[_FREE]
        )
        self._mean[_TOUCH], self._covariance[_TOUCH] = _mixed(stays, mean, covariance, onset, onset_covariance)
        self._share = touch

    def _move_clamp(self, moved_m: float, elapsed_s: float) -> None:
        """A clamp that moves is where it was read to be as well as reading and image are of one time."""
        off_m = moved_m * min(1.0, self._settings.advance_late_s / elapsed_s) if elapsed_s > 0.0 else 0.0
        for covariance in self._covariance:
            covariance[_BASE[0], _BASE[0]] += off_m**2

    def _moved(self, elapsed_s: float) -> tuple[FloatArray, FloatArray]:
        """The hypothesis of contact with its force moved on by its rate, which forgets itself."""
        settings = self._settings
        keep = math.exp(-elapsed_s / settings.force_rate_s)
        reach = settings.force_rate_s * (1.0 - keep)
        mean, covariance = self._mean[_TOUCH].copy(), self._covariance[_TOUCH].copy()
        if elapsed_s > settings.gap_s:
            mean[_FORCE] = mean[_RATE] = 0.0
            for part, std in ((_FORCE, settings.prior.force_n), (_RATE, settings.force_rate_n_per_s)):
                covariance[part] = 0.0
                covariance[:, part] = 0.0
                covariance[part, part] = std**2 * _EYE_FORCE
            return mean, covariance
        mean[_FORCE] += reach * mean[_RATE]
        mean[_RATE] *= keep
        covariance[_FORCE] += reach * covariance[_RATE]
        covariance[:, _FORCE] += reach * covariance[:, _RATE]
        covariance[_RATE] *= keep
        covariance[:, _RATE] *= keep
        # the rate is an Ornstein-Uhlenbeck process: its variance, and that of its integral, grow
        power = settings.force_rate_n_per_s**2
        tau = settings.force_rate_s
        place = power * (2.0 * tau * elapsed_s - 3.0 * tau**2 + 4.0 * tau**2 * keep - tau**2 * keep**2)
        both = power * tau * (1.0 - keep) ** 2
        for k in range(FORCE):
            rate = COUNT - FORCE + k
            covariance[k, k] += place
            covariance[rate, rate] += power * (1.0 - keep**2)
            covariance[k, rate] += both
            covariance[rate, k] += both
        forgets = math.exp(-elapsed_s / settings.force_s)
        mean[_FORCE] *= forgets
        covariance[_FORCE] *= forgets
        covariance[:, _FORCE] *= forgets
        covariance[_FORCE, _FORCE] += (1.0 - forgets**2) * settings.prior.force_n**2 * _EYE_FORCE
        return mean, covariance

    def _fit(self, line: Line, which: int) -> tuple[Found, FloatArray, FloatArray, float]:
        """The fit, the posterior's mean and covariance, and the logarithm of the evidence."""
        mean, prior = self._mean[which], self._covariance[which]
        information, log_det = inverse(prior)
        q, covariance = mean.copy(), np.empty((COUNT, COUNT))
        steps = _WARM_STEPS[which]
        if self._cold and which == _TOUCH and self._unloaded is not None:
            # the fit without a force is near; from the straight rod the way leads through a long, bent valley
            q, steps = self._unloaded.copy(), _STEPS
            self._work[_TOUCH].theta[:] = self._work[_FREE].theta
        elif self._cold:
            q[_BASE], steps = self._start, 0
        found = self._run(q, mean, information, line, which, covariance, steps)
        if which == _TOUCH and not found.converged:
            q = mean.copy()
            if self._cold:
                q[_BASE] = self._start
            found = self._run(q, mean, information, line, which, covariance, 0)
        if which == _FREE:
            self._unloaded = q if found.converged else None
        return found, q, covariance, -found.cost - 0.5 * found.log_det - 0.5 * log_det

    def _run(
        self,
        q: FloatArray,
        mean: FloatArray,
        information: FloatArray,
        line: Line,
        which: int,
        covariance: FloatArray,
        steps: int,
    ) -> Found:
        """``steps``: at most, from the shape of before; 0: from the straight rod."""
        return fit_line(
            q, mean, information, self._model, line, self._modes, self._whiten, self._settings.huber,
            steps or _MOST_STEPS, steps == 0, self._work[which], covariance,
        )  # fmt: skip


def _open_n(before: FloatArray, after: FloatArray) -> float:
    """Returns the largest standard deviation of the force from the image alone: the information added to ``before``."""
    seen = inverse(after)[0] - inverse(before)[0]
    (x, across), (_, y) = seen.tolist()
    least = 0.5 * (x + y) - math.hypot(0.5 * (x - y), across)
    return 1.0 / math.sqrt(max(least, 1e-12))


def _released(mean: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The same without a force."""
    mean, covariance = mean.copy(), covariance.copy()
    for part in (_FORCE, _RATE):
        mean[part] = 0.0
        covariance[part] = 0.0
        covariance[:, part] = 0.0
        covariance[part, part] = _NOTHING * _EYE_FORCE
    return mean, covariance


@njit(cache=True, nogil=True)
def _mixed(
    share: float, mean: FloatArray, covariance: FloatArray, other: FloatArray, other_covariance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Mean and covariance of a mixture, the first with ``share``."""
    apart = mean - other
    both = share * covariance + (1.0 - share) * other_covariance
    both += share * (1.0 - share) * apart[:, None] * apart
    return other + share * apart, both
