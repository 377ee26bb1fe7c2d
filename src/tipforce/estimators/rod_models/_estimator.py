"""The model-based methods of thesis table 2 as estimators: from the detected centreline by mechanics, not by learning.

Each uses a rod model of `tipforce.mechanics.models` to find the force under which force at the tip the centreline would
be where it was detected. The rod is that of the session's metadata, bent beforehand as the knob's nominal gain says.
Nothing needs to be fitted where the stiffness is stated. ``fit`` finds a factor of the stiffness and an offset of the
pre-curvature by least squares on training frames whose force is known, and how far detected and modelled stations then
still are apart: their covariance is the weight of the stations from then on.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Annotated, Any, ClassVar, Self

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field
from scipy.optimize import least_squares

from ...datasets import Dataset, calibration_images
from ...errors import InputError
from ...mechanics import PlanarRod, RodModel
from ...types import Catheter, FloatArray, ForceEstimate, Image, Observation, SessionInfo, Status
from ...vision import ResolvedVision, SessionDetector, VisionSettings
from .._base import PlanarRodEstimator, Progress, Stream, no_progress
from .._builder import MAX_FORCE_N, implausible
from .._facts import ModelFacts, ModelSummary
from .._left_out import left_out_by_session, left_out_text, refuse_left_out
from .._reading import Abstention
from .._session_metadata import UninformedStream
from .._values import LARGEST, StoredArrays, StoredFiles, StoredValues, stored_array
from ..uncertainty import Interval, gaussian_interval, magnitude_sigma, normalised_interval
from ._inverse import STATIONS, ForceFit, StationNoise, fit_force, model_stations
from ._reader import RodLine, RodReader

MIN_SAMPLES = 20
"""Fewer samples say too little of the stations' covariance."""

_STATED_SESSIONS = 4.0
"""Weight of the stated uncertainties in training sessions: frames of one session err alike."""
_KNOWN = np.array([True, True, False])
_TYPICAL_STIFFNESS_NM2 = 4.3e-4
"""Stiffness of a slightly bent 7F ablation catheter (Khoshnam et al. 2012); start of ``fit`` when none is stated."""
_TYPICAL_LENGTH_M = 0.05
_STATED_WITHIN, _TYPICAL_WITHIN = 2.0, 10.0
"""Factors within which a stated stiffness is right, and the typical one where none is stated."""
MAX_OFFSET_PER_M = 20.0
_USUAL_QUANTILE = 0.99
"""Share of the training lines whose misfit is usual; see `RodModelSettings.max_misfit`."""
_GAUSSIAN = gaussian_interval(
    _KNOWN, "stated uncertainties of detection and pre-curvature, as normal distributions; never compared with forces"
)
"""In standard deviations: 90 % of a normal distribution."""


class RodModelSettings(BaseModel):
    """Settings of all rod models. Standard deviations hold until ``fit`` has measured their sum."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    vision: VisionSettings = VisionSettings()
    """How the catheter is looked for."""
    max_left_out: Annotated[float, Field(ge=0, le=1)] = 0.1
    """Training stops where a larger share of the samples, or a whole session, cannot be learnt from; 1: never."""
    stiffness_nm2: Annotated[float, Field(ge=1e-8, le=10)] | None = None
    """Bending stiffness in place of the one that the session's metadata state."""
    force_std_n: Annotated[float, Field(gt=0, le=10)] = 0.2
    """Prior standard deviation of each force component, about 0: contact forces are some 0.1 to 0.4 N. It decides along
    directions in which a force bends the shaft least."""
    station_std_m: Annotated[float, Field(gt=0, le=0.1)] = 1e-4
    """Standard deviation of a detected point: half a pixel of a usual bench."""
    base_std_m: Annotated[float, Field(ge=0, le=0.1)] = 2e-4
    """Standard deviation of the base's position."""
    base_std_rad: Annotated[float, Field(ge=0, le=1)] = 0.017
    """Standard deviation of the base tangent's direction: one degree."""
    length_std_m: Annotated[float, Field(ge=0, le=0.1)] = 1e-3
    """Standard deviation of the detected length: of the scale, the free length and where the tip ends."""
    precurvature_std_per_m: Annotated[float, Field(ge=0, le=100)] = 1.0
    """Standard deviation of the pre-curvature that the knob gives: about 2 degrees of play and error of a knob."""
    max_misfit: Annotated[float, Field(gt=1, le=1e6)] = 4.0
    """A line that no force explains: its squared misfit is larger than that of 99 % of the training lines times
    this factor, or, without ``fit``, than its expectation times this factor."""


@dataclass(frozen=True, eq=False)
class _Fitted:
    """The learnt state; ``interval`` in standard deviations."""

    stiffness_factor: float
    stiffness_stated: bool
    precurvature_offset_per_m: float
    covariance_m2: FloatArray
    largest_misfit: float
    interval: Interval
    samples: int
    left_out: dict[str, list[int]]
    vision: ResolvedVision | None


class RodModelFacts(ModelFacts, frozen=True):
    """Facts of every rod model.

    Attributes:
        stations: number of stations of the centreline that are compared, counted from the tip.
        stiffness_factor: factor of the nominal stiffness.
        precurvature_offset_per_m: added to the pre-curvature that the knob gives, in 1/m.
        station_rms_m: root mean square distance of detected and modelled stations, in metres.
        required_metadata: keys of the session metadata without which there is no estimate.
        breaks: limits of the model.
    """

    stations: int = STATIONS
    stiffness_factor: float = 1.0
    precurvature_offset_per_m: float = 0.0
    station_rms_m: float = 0.0
    required_metadata: tuple[str, ...] = ()
    breaks: str = ""

    def summary(self) -> ModelSummary:
        """Returns stiffness, pre-curvature, and where the model breaks."""
        text = (
            f"stiffness {self.stiffness_factor:.3f} times the nominal one, pre-curvature "
            f"{self.precurvature_offset_per_m:+.2f} 1/m; detected and modelled stations are "
            f"{self.station_rms_m * 1e3:.2f} mm apart (RMS)"
        )
        lost = (f"left out: {left_out_text(self.left_out)}",) if self.left_out else ()
        inputs = f"The last {self.stations} of {STATIONS} stations of the centreline, and the knob."
        return ModelSummary(inputs, "a rod model", (f"{text}. {self.breaks}",), (text, *lost))


class RodModelEstimator(PlanarRodEstimator):
    """One rod model as a method; see the module. ``fitted_`` is None where it was not fitted."""

    settings_type = RodModelSettings
    settings: RodModelSettings
    needs_fit: ClassVar[bool] = False
    stations: ClassVar[int] = STATIONS
    """Number of stations, counted from the tip, that are compared."""
    model: ClassVar[Callable[[PlanarRod], RodModel]]

    def __init__(self, settings: RodModelSettings | None = None) -> None:
        super().__init__(settings)
        self.fitted_: _Fitted | None = None

    def reading(self, view: str) -> Self:
        """Returns this method for another view; see `Estimator.reading`."""
        made = super().reading(view)
        if made.fitted_ is not None and made.fitted_.vision is not None:
            made.fitted_ = replace(made.fitted_, vision=made.fitted_.vision.reading(view))
        return made

    @property
    def required_metadata(self) -> tuple[str, ...]:
        """The rod's length, the scale, and the stiffness unless a setting or training gave it."""
        known = ("catheter.flexible_length_m", f"views.{self.settings.vision.view}.metres_per_px")
        learnt = self.fitted_ is not None and not self.fitted_.stiffness_stated
        return known if learnt or self.settings.stiffness_nm2 else (*known, "catheter.bending_stiffness_nm2")

    def fit(self, dataset: Dataset, progress: Progress | None = None) -> Self:
        """Finds stiffness, pre-curvature and the stations' covariance; see `Estimator.fit`.

        Raises:
            InputError: fewer than `MIN_SAMPLES` samples are detected, Fx or Fy is unknown, or a session has no length
                or scale.
        """
        report = progress or no_progress
        self.check_views(dataset)
        if not dataset.known[:2].all():
            raise InputError(f"{dataset.title}: {self.name} needs forces along x and y, and these data lack one")
        stated = self.settings.stiffness_nm2 is not None or all(
            info.catheter.bending_stiffness_nm2 is not None for info in dataset.session_info.values()
        )
        unfitted = replace(_unfitted(self.settings, self.stations), stiffness_stated=stated)
        self.fitted_ = unfitted
        vision = self._shared_vision(dataset)
        self.fitted_ = unfitted = replace(unfitted, vision=vision)
        lines = self._lines(dataset, lambda share: report("detecting the catheter", 0.7 * share))
        kept = np.array([isinstance(line, RodLine) for line in lines], np.bool_)
        if kept.sum() < MIN_SAMPLES:
            why = next((line.detail for line in lines if isinstance(line, Abstention)), "")
            raise InputError(
                f"{dataset.title}: the centreline is known in {kept.sum()} of {len(dataset)} samples, {self.name} "
                f"needs {MIN_SAMPLES} to be fitted{'; ' if why else ''}{why}"
            )
        left_out = left_out_by_session(dataset.session, kept)
        refuse_left_out(dataset.title, left_out, len(dataset), self.settings.max_left_out)
        detected = [line for line in lines if isinstance(line, RodLine)]
        infos = [dataset.session_info[name] for name in dataset.session[kept].tolist()]
        force = dataset.force_n[kept][:, :2]
        report("fitting", 0.75)
        factor, offset = self._stiffness_and_offset(detected, infos, force)
        residuals_m = self._residuals(detected, infos, force, factor, offset)
        residuals_m = residuals_m[np.isfinite(residuals_m).all(axis=1)]
        sessions = len(dataset.sessions)
        measured = residuals_m.T @ residuals_m / len(residuals_m)
        stated_sum = _STATED_SESSIONS * unfitted.covariance_m2
        covariance = (sessions * measured + stated_sum) / (sessions + _STATED_SESSIONS)
        self.fitted_ = replace(
            unfitted,
            stiffness_factor=factor,
            precurvature_offset_per_m=offset,
            covariance_m2=covariance,
            largest_misfit=np.inf,
            samples=len(detected),
            left_out=left_out,
        )
        report("intervals", 0.9)
        fits = [self._force(line, info) for line, info in zip(detected, infos, strict=True)]
        misfit = float(np.quantile([each.misfit for each in fits], _USUAL_QUANTILE)) * self.settings.max_misfit
        interval = _interval(fits, force, dataset.session[kept], "samples that it was fitted on")
        self.fitted_ = replace(self.fitted_, largest_misfit=misfit, interval=interval)
        report("intervals", 1.0)
        return self

    def calibrate(self, dataset: Dataset, progress: Progress | None = None) -> Self:
        """Finds new intervals; the forces stay. See `Estimator.calibrate`.

        Raises:
            InputError: the catheter is found in no image.
        """
        report = progress or no_progress
        lines = self._lines(dataset, lambda share: report("calibrating", share))
        fits: list[ForceFit] = []
        rows: list[int] = []
        for row, (line, session) in enumerate(zip(lines, dataset.session.tolist(), strict=True)):
            if isinstance(line, RodLine):
                fits.append(self._force(line, dataset.session_info[session]))
                rows.append(row)
        if not rows:
            raise InputError(f"{dataset.title}: the catheter is found in none of its {len(dataset)} images")
        interval = _interval(fits, dataset.force_n[rows][:, :2], dataset.session[rows], "")
        self.fitted_ = replace(self.fitted_ or _unfitted(self.settings, self.stations), interval=interval)
        return self

    def start(self, info: SessionInfo, images: Sequence[Image] = ()) -> Stream:
        """Returns a stream for one session; see `Estimator.start`."""
        if reason := self.obstacle(info):
            return UninformedStream(reason)
        return RodModelStream(self, info, images)

    def estimate(self, line: RodLine, info: SessionInfo, stamp_ns: int) -> ForceEstimate:
        """Estimates the force of one frame.

        Args:
            line: the centreline that was read in the frame.
            info: metadata of the session.
            stamp_ns: stamp of the frame.

        Returns:
            The estimate; invalid where the model does not explain the centreline.
        """
        fit, fitted = self._force(line, info), self.fitted_ or _unfitted(self.settings, self.stations)
        if not fit.converged:
            detail = f"the {self.name} model has no equilibrium near this centreline"
            return ForceEstimate.invalid(stamp_ns, Status.UNOBSERVABLE, detail, line.shape)
        if fit.misfit > fitted.largest_misfit:
            detail = (
                f"no force at the tip bends the {self.name} model to this centreline (squared misfit "
                f"{fit.misfit:.0f}, the limit is {fitted.largest_misfit:.0f})"
            )
            return ForceEstimate.invalid(stamp_ns, Status.OUT_OF_DISTRIBUTION, detail, line.shape)
        force = fit.force_n
        magnitude_n = float(np.hypot(*force))
        if not magnitude_n <= MAX_FORCE_N:
            return implausible(stamp_ns, magnitude_n, line.shape)
        half_n = fitted.interval.half_n[:2] * np.sqrt(np.diag(fit.covariance_n2))
        sigma_n = magnitude_sigma(force, fit.covariance_n2)
        covariance_n2, interval_n = np.full((3, 3), np.nan), np.full((3, 2), np.nan)
        covariance_n2[:2, :2] = fit.covariance_n2
        interval_n[:2, 0], interval_n[:2, 1] = force - half_n, force + half_n
        ends = np.array(fitted.interval.magnitude_interval(magnitude_n, sigma_n))
        return ForceEstimate(
            stamp_ns, np.append(force, np.nan), _KNOWN, covariance_n2, interval_n, magnitude_n, ends, shape=line.shape
        )

    def _force(self, line: RodLine, info: SessionInfo) -> ForceFit:
        """Returns the force that bends the session's rod to a line, with the fitted constants or the stated ones."""
        fitted = self.fitted_ or _unfitted(self.settings, self.stations)
        model = self._model_of(info, line.knob_deg, fitted.stiffness_factor, fitted.precurvature_offset_per_m)
        noise = StationNoise.of(fitted.covariance_m2, self.settings.force_std_n)
        return fit_force(model, line.stations_m[-2 * self.stations :], noise)

    def _model_of(self, info: SessionInfo, knob_deg: float, factor: float, offset_per_m: float) -> RodModel:
        """Returns the model of a session's catheter, with ``factor`` times the nominal stiffness.

        Its pre-curvature is that of the knob's angle plus ``offset_per_m``. Without a stated stiffness in training, the
        factor belongs to the typical one.
        """
        learnt = self.fitted_ is not None and not self.fitted_.stiffness_stated
        stated_nm2 = self.settings.stiffness_nm2 or (None if learnt else info.catheter.bending_stiffness_nm2)
        stiffness_nm2 = factor * (stated_nm2 or _TYPICAL_STIFFNESS_NM2)
        curvature_per_m = (info.actuation.curvature_per_m(knob_deg) or 0.0) + offset_per_m
        return _model(type(self).model, info.catheter, stiffness_nm2, curvature_per_m)

    def _stiffness_and_offset(
        self, lines: Sequence[RodLine], infos: Sequence[SessionInfo], force: FloatArray
    ) -> tuple[float, float]:
        """Fits the stiffness factor and the offset of the pre-curvature, 1/m, to n lines with known forces (n, 2) in N.

        Least squares over the stations, weighted by the stated uncertainties; the factor by its logarithm.
        """
        stated = _unfitted(self.settings, self.stations).covariance_m2
        root = np.linalg.cholesky(np.linalg.inv(stated))

        def whitened(unknown: FloatArray) -> FloatArray:
            residuals_m = self._residuals(lines, infos, force, float(np.exp(unknown[0])), float(unknown[1]))
            return np.nan_to_num(residuals_m @ root, nan=1e3).ravel()  # NaN: no equilibrium, a bad fit

        assert self.fitted_ is not None
        widest = np.log(_STATED_WITHIN if self.fitted_.stiffness_stated else _TYPICAL_WITHIN)
        bounds = [-widest, -MAX_OFFSET_PER_M], [widest, MAX_OFFSET_PER_M]
        result = least_squares(
            whitened, np.zeros(2), x_scale=[0.1, 1.0], diff_step=1e-3, bounds=bounds, max_nfev=15
        )  # fmt: skip
        return float(np.exp(result.x[0])), float(result.x[1])

    def _residuals(
        self, lines: Sequence[RodLine], infos: Sequence[SessionInfo], force: FloatArray, factor: float, offset: float
    ) -> FloatArray:
        """Returns detected less modelled stations (n, 2 stations), x and y in m, under known forces (n, 2) in N.

        ``factor``: of the nominal stiffness; ``offset``: of the pre-curvature, 1/m. NaN without an equilibrium.
        """
        last, residuals = self.stations, list[FloatArray]()
        for line, info, force_n in zip(lines, infos, force, strict=True):
            model = self._model_of(info, line.knob_deg, factor, offset)
            residuals.append(line.stations_m[-2 * last :] - model_stations(model, force_n, last))
        return np.array(residuals)

    def _shared_vision(self, dataset: Dataset) -> ResolvedVision | None:
        """Returns the detection of the first session that shows a catheter; sessions without images begin with it."""
        for name in dataset.sessions:
            images = calibration_images(dataset, name, self.views[0])
            vision = SessionDetector(self.settings.vision, dataset.session_info[name], images).vision
            if isinstance(vision, ResolvedVision) and not vision.refused:
                return vision
        return None

    def reader(self, info: SessionInfo, images: Sequence[Image] = ()) -> RodReader:
        """Returns a reader of the centrelines in one session.

        Args:
            info: metadata of the session.
            images: images of the session that resolve its detection; see `Estimator.start`.
        """
        shared = None if self.fitted_ is None else self.fitted_.vision
        return RodReader(self.settings.vision, shared, info, images)

    def _lines(self, dataset: Dataset, report: Callable[[float], None]) -> list[RodLine | Abstention]:
        """Reads the line of each sample of ``dataset``, session after session, in its order."""
        lines: dict[int, RodLine | Abstention] = {}
        for name in dataset.sessions:
            info, part = dataset.session_info[name], dataset.subset(dataset.session == name)
            images = calibration_images(dataset, name, self.views[0]) if self.calibrates_on_images else ()
            reader = self.reader(info, images)
            key = f"rod model lines {reader.key}"
            lines |= dict(zip(part.rows.tolist(), part.derive(key, reader.read), strict=True))
            report(len(lines) / len(dataset))
        return [lines[row] for row in dataset.rows.tolist()]

    def state(self) -> tuple[dict[str, Any], dict[str, npt.NDArray[Any]]]:
        """Returns the results of `fit` and `calibrate` as JSON values, and the stations' covariance as an array."""
        fitted = self.fitted_ or _unfitted(self.settings, self.stations)
        values: dict[str, Any] = {
            "stiffness_factor": fitted.stiffness_factor,
            "stiffness_stated": fitted.stiffness_stated,
            "precurvature_offset_per_m": fitted.precurvature_offset_per_m,
            "largest_misfit": fitted.largest_misfit,
            "interval": fitted.interval.values(),
            "samples": fitted.samples,
            "left_out": fitted.left_out,
            "vision": None if fitted.vision is None else fitted.vision.model_dump(mode="json"),
        }
        return values, {"covariance_m2": fitted.covariance_m2}

    @classmethod
    def from_state(
        cls, settings: StoredValues, values: StoredValues, arrays: StoredArrays, files: StoredFiles = None
    ) -> Self:
        """Inverts `state`; see `Estimator.from_state`.

        Raises:
            KeyError, ValueError, LinAlgError: the values and arrays are not those of the method.
        """
        del files
        made = cls(RodModelSettings.model_validate(settings))
        state = _State.model_validate(values)
        size = 2 * cls.stations
        covariance = stored_array(arrays, "covariance_m2", (size, size))
        StationNoise.of(covariance, made.settings.force_std_n)
        if state.vision is not None and state.vision.settings != made.settings.vision:
            raise ValueError("vision was resolved with other settings than those of the model")
        interval = Interval.of(values["interval"], _KNOWN)
        made.fitted_ = _Fitted(covariance_m2=covariance, interval=interval, **dict(state))
        return made

    def describe(self) -> RodModelFacts:
        """Returns learnt constants, required metadata, and the basis of the intervals."""
        fitted = self.fitted_ or _unfitted(self.settings, self.stations)
        return RodModelFacts(
            stations=self.stations,
            stiffness_factor=fitted.stiffness_factor,
            precurvature_offset_per_m=fitted.precurvature_offset_per_m,
            station_rms_m=float(np.sqrt(np.mean(np.diag(fitted.covariance_m2)))),
            required_metadata=self.required_metadata,
            interval_basis=fitted.interval.basis,
            samples=fitted.samples,
            left_out=fitted.left_out,
            breaks=self.breaks,
        )


class RodModelStream:
    """Estimates one session, each frame by itself.

    Args:
        estimator: the method.
        info: metadata of the session.
        images: images that resolve the detection; see `Estimator.start`.
    """

    def __init__(self, estimator: RodModelEstimator, info: SessionInfo, images: Sequence[Image] = ()) -> None:
        self._estimator, self._info = estimator, info
        self._reader = estimator.reader(info, images)

    def update(self, observation: Observation) -> ForceEstimate:
        """Estimates the force at this observation; the status states the reason of an abstention."""
        line = self._reader.read(observation)
        if isinstance(line, Abstention):
            return ForceEstimate.invalid(observation.stamp_ns, line.status, line.detail, self._reader.shape)
        return self._estimator.estimate(line, self._info, observation.stamp_ns)


@lru_cache(maxsize=64)
def _model(
    kind: Callable[[PlanarRod], RodModel], catheter: Catheter, stiffness_nm2: float, precurvature_per_m: float
) -> RodModel:
    """Makes the rod model ``kind`` of a catheter; it is kept, since most frames have the same knob angle."""
    assert catheter.flexible_length_m is not None
    rod = PlanarRod(catheter.flexible_length_m, stiffness_nm2, catheter.rigid_length_m or 0.0, precurvature_per_m)
    joints = rod.segments + 1
    if catheter.stiffness_profile:
        rod = replace(rod, stiffness_profile=catheter.stiffness_factors(joints))
    if catheter.rest_curvature_per_m:
        rod = replace(rod, precurvature_per_m=precurvature_per_m + catheter.rest_curvatures_per_m(joints))
    return kind(rod)


def _unfitted(settings: RodModelSettings, stations: int) -> _Fitted:
    """Returns the state before `fit`: the stations' covariance follows from the stated uncertainties.

    They are propagated to the last ``stations`` stations of a straight catheter of typical length. Each mode is their
    displacement in x and y, m, by one standard deviation of: position of the base, its direction, length, curvature.
    """
    arc_m = np.arange(STATIONS + 1 - stations, STATIONS + 1) / STATIONS * _TYPICAL_LENGTH_M
    none, one = np.zeros(stations), np.ones(stations)
    modes = [
        settings.base_std_m * np.column_stack([one, none]),
        settings.base_std_m * np.column_stack([none, one]),
        settings.base_std_rad * np.column_stack([none, arc_m]),
        settings.length_std_m / _TYPICAL_LENGTH_M * np.column_stack([arc_m, none]),
        settings.precurvature_std_per_m * np.column_stack([none, 0.5 * arc_m**2]),
    ]
    covariance = settings.station_std_m**2 * np.eye(2 * stations)
    for mode in modes:
        covariance += np.outer(mode.ravel(), mode.ravel())
    return _Fitted(1.0, True, 0.0, covariance, 2 * stations * settings.max_misfit, _GAUSSIAN, 0, {}, None)


def _interval(fits: Sequence[ForceFit], force: FloatArray, session: npt.NDArray[np.str_], sampling: str) -> Interval:
    """Returns the intervals, in standard deviations, of the fits that converged; unbounded where none did.

    ``force``: (n, 2) measured, N; ``sampling``: how the samples were drawn, empty: whole sessions were held out.
    """
    use = np.array([fit.converged for fit in fits], np.bool_)
    if not use.any():
        return replace(_GAUSSIAN, half_n=np.array([np.inf, np.inf, np.nan]), magnitude_half_n=np.inf)
    fitted, covariance = (np.array([getattr(fit, name) for fit in fits])[use] for name in ("force_n", "covariance_n2"))
    return normalised_interval(_KNOWN, fitted, covariance, force[use], session[use], sampling)


_Finite = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]


class _State(BaseModel):
    """The values of `RodModelEstimator.state` but the interval."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    stiffness_factor: Annotated[float, Field(gt=0, le=1e3)]
    stiffness_stated: bool
    precurvature_offset_per_m: _Finite
    largest_misfit: Annotated[float, Field(gt=0, le=LARGEST)]
    samples: Annotated[int, Field(ge=0, lt=1 << 53)]
    left_out: dict[str, list[Annotated[int, Field(ge=0, lt=1 << 53)]]]
    vision: ResolvedVision | None
