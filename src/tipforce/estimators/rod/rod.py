"""Method `rod`: the force that bends the rod into the detected centreline, by its mechanics.

Levenberg-Marquardt on the planar rod (`mechanics.planar.fit_line`): unknown are the force and, each with a prior from
the session metadata or learnt from sessions with forces, pre-curvature, stiffness, length, clamp, scale and camera. Two
hypotheses are fitted, no contact and contact, and weighed by their evidence (Laplace's approximation). The posterior's
covariance comes with the force.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np
import numpy.typing as npt

from ...datasets import Dataset
from ...errors import ModelError
from ...mechanics.planar import FORCE, UNKNOWNS, Found, Line, Work, fit_line, make_work
from ...types import FloatArray, ForceEstimate, Image, Observation, SessionInfo, Status
from .._base import PlanarRodEstimator, Progress, Stream, no_progress
from .._reading import Abstention
from .._session_metadata import UninformedStream
from ._calibration import Widths, calibrated_widths, without_widths
from ._detection import Detected, Detection
from ._facts import PriorFacts, RodFacts
from ._knowledge import HELD, NEEDED, Knowledge, LineError, noise_unit_m, rod_model
from ._learning import learn
from ._lines import POINTS, StatedErrors
from ._noise_level import noisier
from ._outcome import Outcome, estimate_of, tempered
from ._settings import LineSettings, RodFitSettings, RodSettings

_STEPS = 60
_NOISIER, _MISFITS = 2, 1.5
"""So often at most a line is fitted again with more noise, where the mean square misfit is more than this."""


@dataclass(frozen=True, eq=False)
class _Fitted:
    knowledge: Knowledge
    widths: Widths


class RodEstimator(PlanarRodEstimator):
    """Base class of `rod`, `rod-track` and `session`; before `fit`, ``fitted_`` holds the settings' own."""

    settings_type = RodSettings
    settings: LineSettings
    needs_fit: ClassVar[bool] = False

    def __init__(self, settings: LineSettings | None = None) -> None:
        super().__init__(settings)
        self.fitted_ = _Fitted(Knowledge.stated(self.settings), Widths())

    @property
    def required_metadata(self) -> tuple[str, ...]:
        """The rod's length and stiffness, and the scale."""
        return (*NEEDED, f"views.{self.settings.vision.view}.metres_per_px")

    def fit(self, dataset: Dataset, progress: Progress | None = None) -> Self:
        """Learns priors and noise from sessions with forces; with the setting ``learn`` off nothing.

        Raises InputError where the catheter is found in none of the images.
        """
        self.check_views(dataset)
        if self.settings.learn:
            knowledge = learn(self.settings, dataset, progress or no_progress)
            self.fitted_ = replace(self.fitted_, knowledge=knowledge)
        return self

    def calibrate(self, dataset: Dataset, progress: Progress | None = None) -> Self:
        """Widens or narrows the intervals so that they hold on sessions apart; the forces stay as they are."""
        report = progress or no_progress
        found = without_widths(self, dataset, lambda share: report("calibrating", share))
        self.fitted_ = replace(self.fitted_, widths=calibrated_widths(found, dataset))
        return self

    def state(self) -> tuple[dict[str, Any], dict[str, npt.NDArray[Any]]]:
        """Priors as arrays, intervals as values."""
        return {"unknowns": list(UNKNOWNS), "widths": self.fitted_.widths.values()}, self.fitted_.knowledge.arrays()

    @classmethod
    def from_state(
        cls,
        settings: Mapping[str, Any],
        values: Mapping[str, Any],
        arrays: Mapping[str, npt.NDArray[Any]],
        files: Mapping[str, bytes] | None = None,  # noqa: ARG003 (it leaves none)
    ) -> Self:
        """The inverse of `state`."""
        if values["unknowns"] != list(UNKNOWNS):
            raise ModelError(f"the model was made for the unknowns {values['unknowns']}; train it again")
        made = cls(cls.settings_type.model_validate(settings))  # type: ignore[arg-type]
        made.fitted_ = _Fitted(Knowledge.of(arrays), Widths.of(values["widths"]))
        return made

    def describe(self) -> RodFacts:
        """Returns the priors of the constants, and the basis of the intervals."""
        knowledge, widths = self.fitted_.knowledge, self.fitted_.widths
        std = np.sqrt(np.diag(knowledge.constants_covariance))
        names = UNKNOWNS[FORCE:]
        return RodFacts(
            priors={
                name: PriorFacts(mean=mean, std=each)
                for name, mean, each in zip(names, knowledge.constants.tolist(), std.tolist(), strict=True)
            },
            contact_share=knowledge.contact_share,
            sessions=knowledge.sessions,
            interval_basis=widths.basis,
        )


class HistoryRodEstimator(RodEstimator):
    """Base class of the methods that use all frames so far."""

    stream_type: ClassVar[Callable[..., Stream]]
    """Makes the stream from settings, knowledge, widths of the intervals, metadata and images."""

    @property
    def uses_history(self) -> bool:
        """It remembers."""
        return True

    def start(self, info: SessionInfo, images: Sequence[Image] = ()) -> Stream:
        """A stream for one session; see `Estimator.start`."""
        if why := self.obstacle(info):
            return UninformedStream(why)
        return type(self).stream_type(self.settings, self.fitted_.knowledge, self.fitted_.widths, info, images)


def late_frame(stamp_ns: int, newest_ns: int | None) -> ForceEstimate | None:
    """Returns the refusal of a frame that is not newer than the newest one; None where it is newer.

    Args:
        stamp_ns: stamp of the frame.
        newest_ns: stamp of the newest frame that was used; None before the first.
    """
    if newest_ns is None or stamp_ns > newest_ns:
        return None
    late_ms = (newest_ns - stamp_ns) * 1e-6
    return ForceEstimate.invalid(stamp_ns, Status.STALE, f"{late_ms:.1f} ms older than a frame that was used already")


class Rod(RodEstimator):
    """Each frame by itself; see the module."""

    name: ClassVar[str] = "rod"

    def start(self, info: SessionInfo, images: Sequence[Image] = ()) -> Stream:
        """A stream for one session; see `Estimator.start`."""
        if why := self.obstacle(info):
            return UninformedStream(why)
        assert isinstance(self.settings, RodSettings)
        return RodStream(self.settings, self.fitted_.knowledge, self.fitted_.widths, info, images)


class RodStream:
    """One session, frame after frame; the frame before is a starting point and nothing else."""

    def __init__(
        self, settings: RodSettings, knowledge: Knowledge, widths: Widths, info: SessionInfo, images: Sequence[Image]
    ) -> None:
        self._settings, self._knowledge, self._widths, self._info = settings, knowledge, widths, info
        self._detection = Detection(settings.vision, info, images)
        model = rod_model(info, settings.segments)
        self._solver = ContactFit(settings, knowledge, model)

    def update(self, observation: Observation) -> ForceEstimate:
        """Returns the force at this observation; the status states the reason of an abstention."""
        stamp = observation.stamp_ns
        detected = self._detection.read(observation)
        shape = self._detection.shape
        if isinstance(detected, Abstention):
            return ForceEstimate.invalid(stamp, detected.status, detected.detail, shape)
        knob = observation.actuation.get("knob_deg", math.nan)
        found = self.fit(detected, knob)
        if isinstance(found, Abstention):
            return ForceEstimate.invalid(stamp, found.status, found.detail, shape)
        return estimate_of(self._settings, self._widths, stamp, found, shape)

    def fit(self, detected: Detected, knob_deg: float) -> Outcome | Abstention:
        """Returns the force from the line, or the reason of the abstention."""
        if abstention := actuation_out_of_range(self._settings, self._info, knob_deg):
            return abstention
        mean, covariance = self._knowledge.for_session(self._settings, self._info, knob_deg)
        return self._solver.solve(detected.line(), detected.frame.scale_m_per_px, mean, covariance, detected.errors())


def actuation_out_of_range(settings: RodFitSettings, info: SessionInfo, knob_deg: float) -> Abstention | None:
    """Why there is no estimate at this knob angle, or None."""
    gain = info.actuation.knob_gain_per_m_deg
    if gain is None or math.isnan(knob_deg) or abs(gain * knob_deg) <= settings.max_precurvature_per_m:
        return None
    return Abstention(
        Status.OUT_OF_DISTRIBUTION,
        f"the knob at {knob_deg:g} degrees asks for a curvature of {gain * knob_deg:.3g} 1/m, more than "
        f"max_precurvature_per_m = {settings.max_precurvature_per_m:g}",
    )


class ContactFit:
    """The two fits of one line, and their joint result."""

    def __init__(self, settings: RodSettings, knowledge: Knowledge, model: Any) -> None:
        self._settings, self._knowledge, self._model = settings, knowledge, model
        self._count = len(UNKNOWNS)
        self._errors: dict[float, LineError] = {}
        self._none = np.zeros((POINTS + 1, 0))
        self._work = [make_work(model, POINTS, self._count) for _ in range(2)]
        self._covariance = np.zeros((self._count, self._count))
        self._spare = np.zeros((self._count, self._count))
        self._force_information = np.eye(FORCE) / settings.prior.force_n**2
        self._last: FloatArray | None = None
        self._last_free: FloatArray | None = None
        self._held: tuple[FloatArray, FloatArray, FloatArray, FloatArray, float] | None = None
        self._whiten, self._rows = np.empty(0), POINTS + 1

    def solve(
        self, line: Line, scale: float, mean: FloatArray, covariance: FloatArray, stated: StatedErrors | None = None
    ) -> Outcome:
        """Returns the force from one line.

        A line that the rod explains badly is fitted again with as much more noise as it shows.

        Args:
            line: the line.
            scale: metres per pixel.
            mean: mean of the session's constants.
            covariance: their covariance.
            stated: vision's statements about the line.
        """
        outcome = self._solve(line, scale, mean, covariance, 1.0, stated)
        for _ in range(_NOISIER):
            if outcome.misfit <= _MISFITS or not outcome.converged or outcome.level > self._settings.noise.max_level:
                break
            outcome = self._solve(line, scale, mean, covariance, noisier(outcome.level, outcome.misfit), stated)
        return outcome

    def _error(self, level: float) -> LineError:
        if level not in self._errors:
            self._errors[level] = LineError.of(self._settings.noise, 0, level)
        return self._errors[level]

    def _solve(
        self,
        line: Line,
        scale: float,
        mean: FloatArray,
        covariance: FloatArray,
        level: float,
        stated: StatedErrors | None,
    ) -> Outcome:
        unit_m = noise_unit_m(self._model, scale)
        error = self._error(level).beside(stated, scale / unit_m)
        self._whiten, self._rows = error.whiten / unit_m, error.rows
        if self._held is None or not (np.array_equal(self._held[0], mean)):
            information = np.zeros((self._count, self._count))
            information[FORCE:, FORCE:] = np.linalg.inv(covariance)
            free, touching = information.copy(), information
            free[:FORCE, :FORCE] = HELD * np.eye(2)
            touching[:FORCE, :FORCE] = self._force_information
            log_ratio = -math.log(HELD * self._settings.prior.force_n**2)
            whole = np.concatenate([np.zeros(FORCE), mean])
            self._held = (mean.copy(), whole, free, touching, log_ratio)
        _, whole, free, touching, log_ratio = self._held
        start = whole.copy()
        base = line.points[0]
        start[UNKNOWNS.index("base_x_m")], start[UNKNOWNS.index("base_y_m")] = base[0], base[1]
        q = start if self._last_free is None else self._last_free
        without = self._fit(q, whole, free, line, 0, self._spare, cold=self._last_free is None)
        self._last_free = q.copy() if without.converged else None
        starts = [q.copy()] if self._last is None else [self._last.copy(), q.copy()]
        best: Found | None = None
        angle, spread = 0.0, self._covariance[:FORCE, :FORCE]
        for k, tried in enumerate(starts):
            cold = k > 0 or self._last is None
            found = self._fit(tried, whole, touching, line, 1, self._covariance, cold=cold)
            if best is None or found.cost < best.cost - 0.5:
                best, q, spread = found, tried, self._covariance[:FORCE, :FORCE].copy()
                angle = float(self._work[1].theta[-1])
            if best.converged and best.chi2 <= self._settings.max_misfit * self._rows:
                break
        assert best is not None
        misfit = min(best.chi2, without.chi2) / self._rows
        self._last = q if best.converged and misfit <= self._settings.max_misfit else None
        # information of the image, without the prior
        seen = np.linalg.eigvalsh(np.linalg.inv(spread) - self._force_information) if best.converged else np.zeros(2)
        share = self._knowledge.contact_share
        evidence = log_ratio + (without.cost - best.cost) + 0.5 * (without.log_det - best.log_det)
        apart = q[FORCE:] - mean
        return Outcome(
            q[:FORCE].copy(),
            spread,
            tempered(evidence, spread, self._settings.sure_n) + math.log(share / (1.0 - share)),
            angle,
            misfit,
            best.firmness,
            best.converged,
            1.0 / math.sqrt(max(float(seen[0]), 1e-12)),
            float(apart @ touching[FORCE:, FORCE:] @ apart) / len(mean),
            level,
        )

    def _fit(
        self, q: FloatArray, mean: FloatArray, information: FloatArray, line: Line, which: int, covariance: FloatArray,
        *, cold: bool,
    ) -> Found:  # fmt: skip
        work: Work = self._work[which]
        return fit_line(
            q, mean, information, self._model, line, self._none, self._whiten, self._settings.huber, _STEPS, cold,
            work, covariance,
        )  # fmt: skip
