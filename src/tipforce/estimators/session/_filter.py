"""The session model over time: each line has its force, and some of them teach the constants.

If all frames taught the constants as if their errors were independent, the posterior would be narrow about wrong
constants: errors of the model (friction, creep, the third dimension) stay for many frames. So the constants are learnt
from one frame in `RodTrackSettings.update_s`, and every frame has its force from them.
"""

import math

import numpy as np
from scipy.special import expit

from ...mechanics.planar import Line, Model
from ...types import FloatArray, SessionInfo
from ...vision.contact import ContactReading
from ._direction import SessionDirection
from ._knowledge import Knowledge
from ._lines import StatedErrors
from ._mixture import Mixed, mixed_constants
from ._noise_level import NoiseLevel
from ._posterior import Hypotheses, LinePosterior, Posterior
from ._settings import RodTrackSettings
from ._state import COUNT, SessionState

_LEAST_SHARE = 1e-6
"""No hypothesis is ever given up."""
_UNCLEAR = 0.1
"""A frame teaches the constants if the probability of contact is within this of 0 or 1, in general by the likelier
hypothesis alone: the few percent of the other are far away, and a Gaussian of both would forget the constants. Where
both explain the line they are near each other: see `taught_contact`."""
_FREE_N = 0.1
"""A frame without contact whose 90 % interval ends above this force teaches the constants by both hypotheses."""
_GROWN = 1.5
"""The session starts again if the noise is found to be larger by this factor."""


def taught_contact(contact: float, high_n: float, free_cost: float, touch_cost: float) -> float:
    """Returns the share of contact with which a clear frame teaches the constants of its session, 0 to 1.

    A push along the shaft bends it little. Few directions of the force explain such a line, so it is most likely
    without contact. If it taught so, the constants would learn the push as the shape without load, and the session
    would deny every later force of this size. So the two hypotheses count by their best likelihoods, without a prior
    of the direction (docs/results/session.md).

    Args:
        contact: probability of contact.
        high_n: upper end of the 90 % interval of the magnitude, N.
        free_cost: negative logarithm of the likelihood of the best fit without a force.
        touch_cost: the same with a force.
    """
    if contact > 0.5:
        return 1.0
    if high_n < _FREE_N:
        return 0.0
    return float(expit(free_cost - touch_cost))


class SessionFilter(LinePosterior):
    """The state of one session; `step` takes its next line.

    Args:
        settings: the settings.
        knowledge: knowledge of the constants beforehand.
        model: the rod.
        info: the session metadata.

    Attributes:
        state: constants and slow states; None before the first line.
        newest: result of the newest line.
        prior_std: (COUNT,) standard deviations of the unknowns before the first line.
    """

    def __init__(self, settings: RodTrackSettings, knowledge: Knowledge, model: Model, info: SessionInfo) -> None:
        super().__init__(settings, knowledge, model, info)
        self._over_time = settings
        self._level = NoiseLevel(settings.noise, settings.level_s)
        self.state: SessionState | None = None
        self.newest: Posterior | None = None
        self.prior_std = np.zeros(COUNT)
        self._fits: Hypotheses | None = None
        self._begun_factor = 0.0
        self._start()

    def _start(self) -> None:
        """Forgets the frames before; the infinite wait lets the next clear frame teach the constants."""
        self._last_n: FloatArray | None = None
        self._share, self._crept_per_m = self._knowledge.contact_share, np.zeros(self._model.segments + 1)
        self._waited_s, self._lost_s, self._advance_m = math.inf, 0.0, 0.0
        self._direction, self._unlearnt_s = SessionDirection(), math.inf

    def step(
        self,
        line: Line,
        scale: float,
        knob_deg: float,
        elapsed_s: float,
        advance_m: float = 0.0,
        stated: StatedErrors | None = None,
        reading: ContactReading | None = None,
    ) -> Posterior:
        """Returns the force from the next line of the session, and learns from it.

        In this order: predict constants and probability of contact to this time; fit the line; then learn the level of
        the noise, the visibility of the tissue, the direction of the force and, from some clear frames, the constants
        and the tissue's law.

        Args:
            line: the line.
            scale: metres per pixel.
            knob_deg: reading of the knob; NaN: not known.
            elapsed_s: time since the previous line.
            advance_m: advance of the clamp, with which the line's frame goes.
            stated: vision's statements about the line.
            reading: the geometry of the contact, where a network has read it.

        Returns:
            The force, and whether the rod explains the line.
        """
        settings = self._over_time
        self._waited_s += elapsed_s
        self._unlearnt_s += elapsed_s
        self._lost_s += elapsed_s
        if self.state is None or scale != self._scale or self._lost_s > settings.gap_s:
            self._start()
            self.state = self._new_state(knob_deg)
            self.prior_std = np.sqrt(np.diag(self.state.covariance))
            self._scale, self._begun_factor = scale, self._level.factor
            self._advance_m = advance_m
            self._lay_out_noise(self._level.factor, begins=True)
        elif self._level.factor != self._factor:
            self._lay_out_noise(self._level.factor, begins=False)
        state = self.state
        state.predict(settings, elapsed_s, knob_deg, advance_m - self._advance_m)
        self._advance_m = advance_m
        change = 1.0 - math.exp(-elapsed_s / settings.contact_s)
        share = self._share * (1.0 - change) + (1.0 - self._share) * change  # prior probability of contact
        self._fill_noise(line, stated)
        line = line._replace(crept_per_m=self._crept_per_m)
        fits = self._fit(line, state, self._last_n)
        found = self._result(fits, self._force(fits, line, share, reading))
        if found.explained:
            self._lost_s = 0.0
            self._follow(found.force, fits, elapsed_s)
        elif found.impossible:
            self._last_n = None  # the next line is fitted from the straight rod on, not from this bent shape
        if math.isfinite(found.misfit):
            self._level.add(found.misfit, elapsed_s)
        if self._level.factor > _GROWN * self._begun_factor:
            self._lost_s = math.inf  # the next line begins the session again
        contact = round(found.force.contact)
        clear = abs(found.force.contact - contact) < _UNCLEAR and (contact == 1 or fits.free.ok)
        if reading is not None:
            self.tissue.look(reading, elapsed_s / settings.update_s if settings.update_s else 1.0)
        if found.explained and clear and contact == 1 and settings.direction_s:
            self._direction.learn(self._scratch.directions, self._unlearnt_s / settings.direction_s)
            self._unlearnt_s = 0.0
        if found.explained and clear and self._waited_s >= settings.update_s:
            touch_cost = float(self._scratch.costs[: fits.found].min()) if fits.found else math.inf
            share = taught_contact(found.force.contact, found.force.high_n[-1], fits.free.cost, touch_cost)
            state.mean, state.covariance = self._constants(fits, self._scratch.weights, share)
            self._waited_s = 0.0
            if reading is not None and contact == 1:
                forces = np.hypot(*self._scratch.forces[: fits.found].T)
                self.tissue.learn(reading, forces, self._scratch.by_line[: fits.found])
        self._fits, self.newest = fits, found
        return found

    def _constants(self, fits: Hypotheses, shares: FloatArray, contact: float) -> tuple[FloatArray, FloatArray]:
        """Returns mean and covariance of all unknowns; see `mixed_constants`."""
        return mixed_constants(
            fits.found, shares, contact, fits.free_q, fits.free_factor, fits.c, fits.s, self._scratch
        )  # fmt: skip

    def joint(self) -> tuple[FloatArray, FloatArray]:
        """Returns mean (COUNT,) and covariance (COUNT, COUNT) of force and unknowns from the newest line, in contact.

        Raises:
            ValueError: no force fits it.
        """
        fits = self._fits
        if fits is None or not fits.found or not self._scratch.shares[: fits.found].any():
            raise ValueError("no force fits the newest line")
        return self._constants(fits, self._scratch.shares, 1.0)

    def _follow(self, force: Mixed, fits: Hypotheses, elapsed_s: float) -> None:
        """Remembers for the next frame: probability of contact, force, and the bend under which the shaft creeps.

        This bend is the curvature at the joints beyond the unloaded one, averaged over the time of creep.
        """
        self._share = min(1.0 - _LEAST_SHARE, max(_LEAST_SHARE, force.contact))
        self._last_n = fits.touch_n if fits.found else force.force_n
        assert self.state is not None
        keeps = math.exp(-elapsed_s / self._over_time.creep_s)
        shape = self._shapes["touch" if force.contact > 0.5 else "free"]
        step_m = self._model.flexible_m / self._model.segments
        curvature_per_m = np.diff(shape, prepend=0.0) / step_m  # the shape is the angle of each segment, rad
        bend = curvature_per_m - self.state.unloaded_curvature_per_m()[0] - self._model.rest_per_m
        bend[[0, -1]] = bend[[1, -2]]  # these joints are half as long
        self._crept_per_m = keeps * self._crept_per_m + (1.0 - keeps) * bend
