"""The session model over time: each line has its force, and some of them teach the constants.

If all frames taught the constants as if their errors were independent, the posterior would be narrow about wrong
constants: errors of the model (friction, creep, the third dimension) stay for many frames. So the constants are learnt
from one frame in `SessionSettings.update_s`, and every frame has its force from them.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...mechanics.planar import FORCE, Line, Model, fit_line, inverse, make_work, solve_in
from ...types import FloatArray, SessionInfo
from ..rod import MODES, POINTS, Knowledge, LineError, Mixed, NoiseLevel, StatedErrors, noise_unit_m
from ._mixture import mixed_constants, mixed_force
from ._settings import SessionSettings
from ._state import COUNT, K0, ROD, SessionState, X, fill_camera_modes, line_modes
from ._walk import Fit, Session, make_scratch, relax, walk

_START_N = 0.3
"""Standard deviation of each component of the force in the fit from which the walk starts."""
_COLD_STEPS, _STEPS, _FREE_STEPS = 60, 25, 8
"""Largest number of steps; in contact no step makes a rod without force fit, so few are tried."""
_LEAST_SHARE = 1e-6
"""No hypothesis is ever given up."""
_UNCLEAR = 0.1
"""A frame teaches the constants if the probability of contact is within this of 0 or 1. The few percent of the other
hypothesis are far away: a Gaussian of both would forget the constants."""
_LEAST_CONTACT = 0.01
"""Where contact is less probable, a fit of contact that fails does not count."""
_GROWN = 1.5
"""The session starts again if the noise is found to be larger by this factor."""


class FilterResult(NamedTuple):
    """``force``: see `Mixed`; ``misfit``: mean square, of the better hypothesis, in the noise's variances.

    ``explained``: whether the rod explains the line; ``level``: of the noise relative to the stated one.
    """

    force: Mixed
    misfit: float
    explained: bool
    level: float


class _Hypotheses(NamedTuple):
    """The fits of one line without and with a force; ``found``: number of nodes of the walk along (``c``, ``s``)."""

    free: Fit
    free_q: FloatArray
    free_factor: FloatArray
    touch: Fit
    touch_q: FloatArray
    found: int
    step_n: float
    c: float
    s: float


class SessionFilter:
    """The state of one session; `step` takes its next line.

    Attributes:
        state: constants and slow states; None before the first line.
        newest: result of the newest line.
        prior_std: (COUNT,) standard deviations of the unknowns before the first line.
    """

    def __init__(self, settings: SessionSettings, knowledge: Knowledge, model: Model, info: SessionInfo) -> None:
        self._settings, self._knowledge, self._model, self._info = settings, knowledge, model, info
        self._level = NoiseLevel(settings.noise)
        self._scratch = make_scratch(make_work(model, POINTS, COUNT), COUNT)
        self._cold_work = make_work(model, POINTS, ROD)
        self.state: SessionState | None = None
        self.newest: FilterResult | None = None
        self.prior_std = np.zeros(COUNT)
        self._fits: _Hypotheses | None = None
        self._scale = self._factor = self._begun_factor = 0.0
        self._error, self._stated = LineError.of(settings.noise, MODES), None
        self._whiten, self._modes, self._rows = np.empty(0), np.empty(0), POINTS + 1
        self._shapes = {which: np.zeros(model.segments + 1) for which in ("free", "touch")}
        self._start()

    def _start(self) -> None:
        self._cold, self._share = True, self._knowledge.contact_share
        self._last_n, self._crept_per_m = np.zeros(FORCE), np.zeros(self._model.segments + 1)
        self._waited_s, self._lost_s, self._advance_m = math.inf, 0.0, 0.0

    def step(
        self,
        line: Line,
        scale: float,
        knob_deg: float,
        elapsed_s: float,
        advance_m: float = 0.0,
        stated: StatedErrors | None = None,
    ) -> FilterResult:
        """Returns the force from ``line``.

        Args:
            line: the line.
            scale: metres per pixel.
            knob_deg: reading of the knob; NaN: not known.
            elapsed_s: time since the previous line.
            advance_m: advance of the clamp, with which the line's frame goes.
            stated: vision's statements about the line.

        Returns:
            The force, and whether the rod explains the line.
        """
        self._waited_s += elapsed_s
        self._lost_s += elapsed_s
        if self.state is None or scale != self._scale or self._lost_s > self._settings.gap_s:
            self._start()
            self.state = SessionState(self._settings, self._knowledge, self._info, knob_deg)
            self.prior_std = np.sqrt(np.diag(self.state.covariance))
            self._scale, self._begun_factor = scale, self._level.factor
            self._advance_m = advance_m
            self._lay_out_noise(begins=True)
        elif self._level.factor != self._factor:
            self._lay_out_noise(begins=False)
        state = self.state
        state.predict(elapsed_s, knob_deg, advance_m - self._advance_m)
        self._advance_m = advance_m
        change = 1.0 - math.exp(-elapsed_s / self._settings.contact_s)
        share = self._share * (1.0 - change) + (1.0 - self._share) * change
        self._fill_noise(line, stated)
        line = line._replace(crept_per_m=self._crept_per_m)
        fits = self._fit(line, state)
        force = self._force(fits, share)
        misfit = min(fits.free.chi2, fits.touch.chi2) / self._rows
        free_counts = fits.free.ok and force.contact < _LEAST_CONTACT
        explained = misfit <= self._settings.max_misfit and (fits.found > 0 or free_counts)
        if explained:
            self._lost_s, self._cold = 0.0, False
            self._follow(force, fits, elapsed_s)
        if math.isfinite(misfit):
            self._level.add(misfit, elapsed_s)
        if self._level.factor > _GROWN * self._begun_factor:
            self._lost_s = math.inf
        contact = round(force.contact)
        clear = abs(force.contact - contact) < _UNCLEAR and (contact == 1 or fits.free.ok)
        if explained and clear and self._waited_s >= self._settings.update_s:
            state.mean, state.covariance = mixed_constants(
                fits.found, float(contact), fits.free_q, fits.free_factor, fits.c, fits.s, self._scratch
            )
            self._waited_s = 0.0
        self._fits, self.newest = fits, FilterResult(force, misfit, explained, self._factor)
        return self.newest

    def joint(self) -> tuple[FloatArray, FloatArray]:
        """Returns mean (COUNT,) and covariance (COUNT, COUNT) of force and unknowns from the newest line, in contact.

        Raises:
            ValueError: no force fits it.
        """
        fits = self._fits
        if fits is None or not fits.found:
            raise ValueError("no force fits the newest line")
        return mixed_constants(fits.found, 1.0, fits.free_q, fits.free_factor, fits.c, fits.s, self._scratch)

    def _lay_out_noise(self, *, begins: bool) -> None:
        self._factor = self._level.factor
        error = LineError.of(self._settings.noise, MODES, self._factor)
        # the amplitudes of the modes are unknowns: their unit stays for the session
        self._error = error if begins else replace(error, modes=self._error.modes)

    def _fill_noise(self, line: Line, stated: StatedErrors | None) -> None:
        self._stated, unit_m = stated, noise_unit_m(self._model, self._scale)
        error = self._error.beside(stated, self._scale / unit_m)
        self._whiten, self._rows = error.whiten / unit_m, error.rows
        self._modes = line_modes(error, unit_m)
        fill_camera_modes(self._modes, line, self._model, self._settings)

    def _follow(self, force: Mixed, fits: _Hypotheses, elapsed_s: float) -> None:
        """Keeps the start of the next frame: force, contact, and the bend that the shaft has crept under."""
        self._share = min(1.0 - _LEAST_SHARE, max(_LEAST_SHARE, force.contact))
        self._last_n = fits.touch_q[:FORCE].copy() if fits.found else force.force_n
        assert self.state is not None
        keeps = math.exp(-elapsed_s / self._settings.creep_s)
        shape = self._shapes["touch" if force.contact > 0.5 else "free"]
        step_m = self._model.flexible_m / self._model.segments
        bend = np.diff(shape, prepend=0.0) / step_m - self.state.unloaded_curvature_per_m()[0]
        bend[[0, -1]] = bend[[1, -2]]  # these joints are half as long
        self._crept_per_m = keeps * self._crept_per_m + (1.0 - keeps) * bend

    def _session(self, state: SessionState) -> Session:
        model, prior = self._model, self._settings.prior
        return Session(
            model, self._modes, self._whiten, state.gain_per_m_deg, state.knob_deg,
            prior.friction * model.dome_m / model.stiffness_nm2, self._settings.huber, prior.largest_force_n,
        )  # fmt: skip

    def _fit(self, line: Line, state: SessionState) -> _Hypotheses:
        session, scratch = self._session(state), self._scratch
        work, mean = scratch.rod, state.mean
        information = np.zeros((COUNT, COUNT))
        information[FORCE:, FORCE:] = inverse(np.ascontiguousarray(state.covariance[FORCE:, FORCE:]))[0]
        if self._cold:
            starts = self._cold_starts(line, state)
        else:
            starts = mean.copy(), mean.copy()
            starts[1][:FORCE] = self._last_n
        free_q, touch_q = starts
        free_q[:FORCE] = 0.0
        work.theta[:] = self._shapes["free"]
        free = relax(free_q, mean, information, session, line, FORCE, 0.0, _FREE_STEPS, scratch)
        free_factor = work.factor.copy()
        if free.ok:
            self._shapes["free"] = work.theta.copy()
        work.theta[:] = self._shapes["touch"]
        touch = relax(touch_q, mean, information, session, line, 0, _START_N**-2, _STEPS, scratch)
        if not touch.ok and free.ok:
            touch_q = free_q.copy()
            work.theta[:] = self._shapes["free"]
            touch = relax(touch_q, mean, information, session, line, 0, _START_N**-2, _STEPS, scratch)
        found, step_n, c, s = 0, 0.01, 1.0, 0.0
        if touch.ok:
            self._shapes["touch"] = work.theta.copy()
            c, s, std_n = _weak_direction(work.factor)
            found, step_n = walk(touch_q, mean, information, session, line, c, s, std_n, scratch)
        return _Hypotheses(free, free_q, free_factor, touch, touch_q, found, step_n, c, s)

    def _cold_starts(self, line: Line, state: SessionState) -> tuple[FloatArray, FloatArray]:
        """Fits the rod alone, without and with a force, from the straight rod on."""
        prior_mean, covariance = state.rod_prior()
        mean = np.concatenate([np.zeros(FORCE), prior_mean])
        information = np.zeros((ROD, ROD))
        information[FORCE:, FORCE:] = inverse(covariance)[0]
        unit_m = noise_unit_m(self._model, self._scale)
        error = LineError.of(self._settings.noise, 0, self._factor).beside(self._stated, self._scale / unit_m)
        whiten = error.whiten / unit_m
        q, result, nothing = mean.copy(), np.zeros((ROD, ROD)), np.zeros((POINTS + 1, 0))
        q[X : X + 2] = line.points[0]
        starts: list[FloatArray] = []
        for which, std_n in (("free", 1e-6), ("touch", _START_N)):
            information[:FORCE, :FORCE] = np.eye(FORCE) / std_n**2
            fit_line(
                q, mean, information, self._model, line, nothing, whiten, self._settings.huber, _COLD_STEPS, True,
                self._cold_work, result,
            )  # fmt: skip
            self._shapes[which] = self._cold_work.theta.copy()
            start = np.zeros(COUNT)
            start[:ROD] = q
            start[K0] -= state.gain_per_m_deg * state.knob_deg
            starts.append(start)
        return starts[0], starts[1]

    def _force(self, fits: _Hypotheses, share: float) -> Mixed:
        angle = float(self._shapes["touch" if fits.found else "free"][-1])
        return mixed_force(
            fits.found, fits.step_n, fits.c, fits.s, angle, fits.free, math.log(share / (1.0 - share)),
            self._settings.prior.largest_force_n, self._scratch,
        )  # fmt: skip


def _weak_direction(factor: FloatArray) -> tuple[float, float, float]:
    """Returns the direction in which the force is known least, and its standard deviation there.

    ``factor``: of the information with the force's y before its x, see `relax`.
    """
    columns = np.zeros((FORCE, COUNT))
    for k in range(FORCE):
        columns[k, k] = 1.0
        solve_in(factor, columns[k])
    covariance = columns[::-1, FORCE - 1 :: -1]
    values, vectors = np.linalg.eigh(covariance)
    return float(vectors[0, 1]), float(vectors[1, 1]), math.sqrt(float(values[1]))
