"""Posterior of the force from one line, where the session's constants and slow states have a Gaussian prior."""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...mechanics.planar import FORCE, Line, Model, fit_line, inverse, loaded_point_aside, make_work, solve_in
from ...types import FloatArray, SessionInfo
from ...vision.contact import ContactReading, tip_axis
from ._direction import SessionDirection
from ._knowledge import Knowledge, noise_unit_m
from ._line_error import MODES, LineError
from ._lines import POINTS, StatedErrors
from ._mixture import NO_EVIDENCE, Mixed, mixed_force
from ._noise_level import noisier
from ._settings import RodSettings
from ._state import ANGLE, COUNT, K0, ROD, SessionState, X, fill_camera_modes, line_modes
from ._tissue import Tissue, evidence_of
from ._walk import ALONG, Fit, Session, make_scratch, relax, walk

_START_N = 0.3
"""Standard deviation of each component of the force in the fit from which the walk starts."""
_NO_FORCE_STD_N = 1e-6
"""The same in the fit without a force."""
_COLD_STEPS, _STEPS, _FREE_STEPS = 60, 25, 8
"""Largest number of steps; in contact no step makes a rod without force fit, so few are tried."""
_LEAST_CONTACT = 0.01
"""Where contact is less probable, a fit of contact that fails does not count."""
_MOST_EXCESS = 4.5
"""Where no possible force explains the line within this of the best one, 3 standard deviations, there is no answer."""
_REFITS, _NOISY_MISFIT = 2, 1.5
"""A line is fitted again with more noise, this often at most, while its mean square misfit is larger than this."""


class Posterior(NamedTuple):
    """``force``: see `Mixed`; ``misfit``: mean square, of the better hypothesis, in the noise's variances.

    ``off``: mean square of the constants' distance from the priors of the session, in these priors' variances;
    ``explained``: whether the rod explains the line; ``level``: of the noise relative to the stated one.
    """

    force: Mixed
    misfit: float
    off: float
    explained: bool
    level: float

    @property
    def impossible(self) -> bool:
        """Whether the line shows a force that is larger than the prior's largest, or that pulls."""
        return self.force.excess > _MOST_EXCESS


class Hypotheses(NamedTuple):
    """The fits of one line without and with a force.

    ``touch_n`` (2,): force of the second; ``found``: number of nodes of the walk along the chord (``c``, ``s``).
    """

    free: Fit
    free_q: FloatArray
    free_factor: FloatArray
    touch: Fit
    touch_q: FloatArray
    touch_n: FloatArray
    found: int
    step_n: float
    c: float
    s: float


class LinePosterior:
    """Fits lines of a session; `solve` has the posterior of one line by the session's priors alone.

    Args:
        settings: the settings.
        knowledge: knowledge of the constants beforehand.
        model: the rod.
        info: the session metadata.

    Attributes:
        tissue: the law of the tissue as it is known so far.
    """

    def __init__(self, settings: RodSettings, knowledge: Knowledge, model: Model, info: SessionInfo) -> None:
        self.tissue = Tissue(settings.contact, settings.prior.largest_force_n, info.tissue.stiffness_n_per_m)
        self._direction = SessionDirection()
        self._settings, self._knowledge, self._model, self._info = settings, knowledge, model, info
        self._scratch = make_scratch(make_work(model, POINTS, COUNT), COUNT)
        self._cold_work = make_work(model, POINTS, ROD)
        self._scale = self._factor = 0.0
        self._prior_mean, self._prior_information = np.empty(0), np.empty((0, 0))
        self._error, self._stated = LineError.of(settings.noise, MODES), None
        self._whiten, self._modes, self._rows = np.empty(0), np.empty(0), POINTS + 1
        self._shapes = {which: np.zeros(model.segments + 1) for which in ("free", "touch")}

    def solve(
        self,
        line: Line,
        scale: float,
        knob_deg: float,
        stated: StatedErrors | None = None,
        reading: ContactReading | None = None,
    ) -> Posterior:
        """Returns the force from ``line`` alone; a line that fits badly is fitted again with the noise that it shows.

        Args:
            line: the detected line, in metres.
            scale: metres per pixel.
            knob_deg: reading of the knob; NaN: not known.
            stated: vision's statements about the line.
            reading: the geometry of the contact, where a network has read it.

        Returns:
            The force, and whether the rod explains the line.
        """
        self._scale, level = scale, 1.0
        found = self._solve_at(level, line, knob_deg, stated, reading)
        for _ in range(_REFITS):
            if not _NOISY_MISFIT < found.misfit < math.inf or level > self._settings.noise.max_level:
                break
            level = noisier(level, found.misfit)
            found = self._solve_at(level, line, knob_deg, stated, reading)
        return found

    def _solve_at(
        self, level: float, line: Line, knob_deg: float, stated: StatedErrors | None, reading: ContactReading | None
    ) -> Posterior:
        """Returns the posterior of a line by the session's priors, with ``level`` times the stated noise."""
        state = self._new_state(knob_deg)
        self._lay_out_noise(level, begins=True)
        self._fill_noise(line, stated)
        fits = self._fit(line, state, None)
        return self._result(fits, self._force(fits, line, self._knowledge.contact_share, reading))

    def _new_state(self, knob_deg: float) -> SessionState:
        """Returns the state of a session that begins."""
        state = SessionState(self._settings, self._knowledge, self._info, knob_deg)
        self._prior_mean = state.mean[FORCE:ROD].copy()
        self._prior_information = inverse(np.ascontiguousarray(state.covariance[FORCE:ROD, FORCE:ROD]))[0]
        return state

    def _result(self, fits: Hypotheses, force: Mixed) -> Posterior:
        """Adds to the force the check whether the rod explains the line.

        The better of the fits without and with a force counts, with a force where the walk has nodes. The squares of
        its misfit and of the constants' distance from their priors are limited together, per measurement of the line: a
        fit must not buy a small misfit with improbable constants.
        """
        chi2, q = fits.free.chi2, fits.free_q
        if fits.found and fits.touch.chi2 < chi2:
            chi2, q = fits.touch.chi2, fits.touch_q
        from_prior = q[FORCE:ROD] - self._prior_mean
        prior_chi2 = float(from_prior @ self._prior_information @ from_prior)
        free_counts = fits.free.ok and force.contact < _LEAST_CONTACT
        fits_well = chi2 + prior_chi2 <= self._settings.max_misfit * self._rows
        explained = fits_well and (fits.found > 0 or free_counts) and force.excess <= _MOST_EXCESS
        return Posterior(force, chi2 / self._rows, prior_chi2 / len(from_prior), explained, self._factor)

    def _lay_out_noise(self, level: float, *, begins: bool) -> None:
        """Sets the line's noise to ``level`` times the stated one; ``begins``: a session begins with it."""
        self._factor = level
        error = LineError.of(self._settings.noise, MODES, level)
        # the amplitudes of the modes are unknowns: their unit stays for the session
        self._error = error if begins else replace(error, modes=self._error.modes)

    def _fill_noise(self, line: Line, stated: StatedErrors | None) -> None:
        """Sets the noise of one line, from the level of the session's noise and vision's statements about the line.

        ``_whiten``, 1/m, gives the line's deviations unit variance; ``_rows`` is the number of measurements;
        ``_modes``, m, are the displacements of the line by its lasting errors, each by one standard deviation.
        """
        self._stated, unit_m = stated, noise_unit_m(self._model, self._scale)
        # where lines are noisier than the settings state, the errors that vision states are too small by that factor
        error = self._error.beside(stated, self._factor * self._scale / unit_m)
        self._whiten, self._rows = error.whiten / unit_m, error.rows
        self._modes = line_modes(error, unit_m)
        fill_camera_modes(self._modes, line, self._model, self._settings)

    def _session(self, state: SessionState) -> Session:
        """Returns the constants of the fit of the present line."""
        model, prior = self._model, self._settings.prior
        # friction moves the force by this lever from the dome's centre; moment over EI is a curvature
        lever_per_m_n = prior.friction * model.dome_m / model.stiffness_nm2
        return Session(
            model, self._modes, self._whiten, state.gain_per_m_deg, state.knob_deg, lever_per_m_n,
            self._settings.huber, prior.largest_force_n, self._settings.across_error_n,
        )  # fmt: skip

    def _fit(self, line: Line, state: SessionState, last_n: FloatArray | None) -> Hypotheses:
        """Returns fits of the rod to the line without and with a force; walks along the chord from the second one.

        The nodes of the walk are left in ``_scratch``. ``state`` is the prior of the constants. The fits start from the
        shapes of the frame before, whose force was ``last_n`` (2,); None: from the straight rod.
        """
        session, scratch = self._session(state), self._scratch
        work, mean = scratch.rod, state.mean
        information = np.zeros((COUNT, COUNT))
        information[FORCE:, FORCE:] = inverse(np.ascontiguousarray(state.covariance[FORCE:, FORCE:]))[0]
        if last_n is None:
            starts = self._cold_starts(line, state)
        else:
            starts = mean.copy(), mean.copy()
            starts[1][:FORCE] = last_n
        free_q, touch_q = starts
        free_q[:FORCE] = 0.0
        work.theta[:] = self._shapes["free"]
        free = relax(free_q, mean, information, session, line, FORCE, 0.0, _FREE_STEPS, scratch)
        free_factor = work.factor.copy()
        if free.ok:
            self._shapes["free"] = work.theta.copy()
        session = self._held(session, touch_q, "touch")  # from here on the tip is held across the chord
        touch = relax(touch_q, mean, information, session, line, 0, _START_N**-2, _STEPS, scratch)
        if not touch.ok and free.ok:
            touch_q = free_q.copy()
            session = self._held(session, touch_q, "free")
            touch = relax(touch_q, mean, information, session, line, 0, _START_N**-2, _STEPS, scratch)
        c, s, found, step_n = session.c, session.s, 0, 0.01
        along_n, across_n = touch_q[0], work.reaction[0]
        if touch.ok:
            self._shapes["touch"] = work.theta.copy()
            column = np.zeros(COUNT)  # of the inverse of the information: its diagonal is the variance
            column[ALONG] = 1.0
            solve_in(work.factor, column)
            found, step_n = walk(touch_q, mean, information, session, line, math.sqrt(column[ALONG]), scratch)
        touch_n = np.array([c * along_n - s * across_n, s * along_n + c * across_n])
        return Hypotheses(free, free_q, free_factor, touch, touch_q, touch_n, found, step_n, c, s)

    def _held(self, session: Session, q: FloatArray, which: str) -> Session:
        """Changes ``q`` from a free tip to one that is held across the chord; returns the constants with its direction.

        The first two unknowns are the force, N; they become the force along the chord, N, and the position of the
        loaded point across it, m. The chord is that of the shape ``which``, "free" or "touch".
        """
        work, theta = self._scratch.rod, self._shapes[which]
        work.theta[:] = theta
        chord = np.array([np.cos(theta).sum(), np.sin(theta).sum()])
        c, s = (chord / np.linalg.norm(chord)).tolist()
        work.reaction[0] = c * q[1] - s * q[0]
        q[0], q[1] = c * q[0] + s * q[1], loaded_point_aside(q, c, s, self._model, work)
        return session._replace(c=c, s=s)

    def _cold_starts(self, line: Line, state: SessionState) -> tuple[FloatArray, FloatArray]:
        """Returns starts (unknowns,) of the fits without and with a force, found from the straight rod on.

        The lasting errors of the line count as noise here. The shapes are left in ``_shapes``.
        """
        prior_mean, covariance = state.rod_prior()
        mean = np.concatenate([np.zeros(FORCE), prior_mean])
        information = np.zeros((ROD, ROD))
        information[FORCE:, FORCE:] = inverse(covariance)[0]
        unit_m = noise_unit_m(self._model, self._scale)
        error = LineError.of(self._settings.noise, 0, self._factor)
        error = error.beside(self._stated, self._factor * self._scale / unit_m)
        whiten = error.whiten / unit_m
        q, result, no_modes = mean.copy(), np.zeros((ROD, ROD)), np.zeros((POINTS + 1, 0))
        q[X : X + 2] = line.points[0]
        starts: list[FloatArray] = []
        for which, std_n in (("free", _NO_FORCE_STD_N), ("touch", _START_N)):
            information[:FORCE, :FORCE] = np.eye(FORCE) / std_n**2
            fit_line(
                q, mean, information, self._model, line, no_modes, whiten, self._settings.huber, _COLD_STEPS, True,
                self._cold_work, result,
            )  # fmt: skip
            self._shapes[which] = self._cold_work.theta.copy()
            start = np.zeros(COUNT)
            start[:ROD] = q
            start[K0] -= state.gain_per_m_deg * state.knob_deg  # here the knob's curvature is a part of K0
            starts.append(start)
        return starts[0], starts[1]

    def _force(self, fits: Hypotheses, line: Line, share: float, reading: ContactReading | None) -> Mixed:
        """Returns the force by the fits and the reading of the tip's image; ``share``: prior probability of contact."""
        rod_axis_rad = float(self._shapes["touch" if fits.found else "free"][-1])
        evidence = NO_EVIDENCE
        if reading is not None:
            # its direction counts from the tip's axis in the line, here turned to the clamp's frame
            base_rad = float((fits.touch_q if fits.found else fits.free_q)[ANGLE])
            line_axis_rad = tip_axis(line.points, 1.0) - base_rad
            evidence = evidence_of(reading, line_axis_rad, self.tissue, self._settings.contact)
        if fits.found:
            evidence = evidence._replace(directions=self._direction.density(rod_axis_rad))
        return mixed_force(
            fits.found, fits.step_n, fits.c, fits.s, rod_axis_rad, fits.free, math.log(share / (1.0 - share)),
            self._settings.prior.largest_force_n, evidence, self._scratch,
        )  # fmt: skip
