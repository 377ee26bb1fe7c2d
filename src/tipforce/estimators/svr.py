"""Method 1: support vector regression from the shape of the centreline and the knob (thesis ch. 3).

Five polynomial coefficients (eq. 2) and the actuation, each divided by its largest absolute value on the training part;
kernel eq. (15), epsilon-insensitive loss eq. (8); C, epsilon and sigma by cross-validation on the training part. Two
defaults go beyond the thesis: the tracer finds the centreline, and all drives of the data are inputs, not the knob
alone; `Svr.thesis_settings` are the thesis's to the letter. All else beyond it is an option of `SvrSettings`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np
import numpy.typing as npt

from ..datasets import Dataset
from ..errors import InputError, ModelError, NotFittedError
from ..types import KNOB, BoolArray, FloatArray, ForceEstimate, Image, Observation, SessionInfo
from ..vision import ResolvedVision, SessionDetector, ShapeDetector, auto_calibrate
from ._base import CentrelineEstimator, Progress, no_progress
from ._builder import AXES, EstimateBuilder
from ._inputs import Inputs
from ._machine import Constants, Machines, fit_machines
from ._onnx import PARITY_N, regression_graph
from ._reading import Abstention, actuation_names, limits_of, unlike_training
from ._settings import SvrSettings
from ._summary import ModelSummary, refuse_left_out
from ._svr_state import SvrState
from ._svr_summary import svr_summary
from ._training import Rows, gather_rows, warn_of_sizes
from ._tuning import choose, make_folds, residuals, scaling_of
from ._window import Window
from .uncertainty import Interval, conformal_interval

MIN_SAMPLES = 20
"""Fewer samples cannot be trained and cross-validated on."""

CALIBRATION_SAMPLES = 10
"""So many images decide what the vision's settings leave open."""


@dataclass(frozen=True)
class _Fitted:
    """Everything that was learnt."""

    actuation: tuple[str, ...]
    actuation_limits: Mapping[str, tuple[float, float]]
    """See `limits_of`; empty in models that were saved before these were known."""
    shape: tuple[str, ...]
    known: BoolArray
    machines: Machines
    constants: tuple[Constants, ...]
    cv_rmse_n: tuple[float, ...]
    interval: Interval
    samples: int
    left_out: dict[str, list[int]]
    sessions: int
    vision: ResolvedVision | None
    """Of the auto-calibration; None where the data hold no images."""

    @property
    def targets(self) -> tuple[str, ...]:
        """What each machine answers."""
        return tuple(AXES[axis] for axis in np.flatnonzero(self.known)) or ("magnitude",)


class Svr(CentrelineEstimator):
    """Method 1; see the module. ``fitted_`` is None before ``fit``."""

    name: ClassVar[str] = "svr"
    settings_type = SvrSettings
    thesis_settings: ClassVar[Mapping[str, Any] | None] = {
        "vision": {"method": "classic", "threshold": 110},
        "actuation": [KNOB],
        "hold_out": "sample",
    }
    """The thesis names neither C, epsilon and sigma nor how they were chosen: they are chosen from the same values as
    always, on single samples held out, as the thesis holds them out to test. Its threshold is a constant c that it does
    not name: 110 lies between shaft and ground of the simulated ``thesis-2021``; state the one of another bench."""
    settings: SvrSettings

    def __init__(self, settings: SvrSettings | None = None) -> None:
        super().__init__(settings)
        self.fitted_: _Fitted | None = None

    @property
    def uses_history(self) -> bool:
        """True with a window over earlier frames."""
        return self.settings.window.used

    @property
    def required_actuation(self) -> tuple[str, ...]:
        """What it was trained with. Raises NotFittedError before ``fit``."""
        return self._known().actuation

    def fit(self, dataset: Dataset, progress: Progress | None = None) -> Self:
        """Calibrate the vision, choose the constants by cross-validation, train, and find the interval.

        Raises InputError for fewer than `MIN_SAMPLES` samples, actuation that the data do not have, or images in
        which the catheter is not found.
        """
        report = progress or no_progress
        count = len(dataset)
        if count < MIN_SAMPLES:
            raise InputError(f"{dataset.title}: has {count} samples; training svr needs at least {MIN_SAMPLES}")
        settings, vision = self.settings, self._calibrated_vision(dataset)
        actuation = actuation_names(settings.actuation, dataset)
        rows = gather_rows(
            settings, actuation, dataset, lambda share: report("detecting the catheter", 0.4 * share), vision
        )
        vision = vision or rows.vision
        if len(rows.features) < MIN_SAMPLES:
            raise InputError(
                f"{dataset.title}: the catheter's shape is known in {len(rows.features)} of {count} samples, svr needs "
                f"{MIN_SAMPLES}; the first other one says: {rows.why_not}; look at an image with `tipforce inspect`"
            )
        left_out = rows.left_out
        refuse_left_out(dataset.title, left_out, count, settings.max_left_out)
        if settings.training_samples is not None:
            rows = rows.at(_drawn(len(rows.features), settings.training_samples, settings.seed))
        known = dataset.known.copy() if settings.force == "components" else np.zeros(3, np.bool_)
        shift, scale = scaling_of(rows.features, settings.scaling)
        linear = _linear_weights(settings, rows)
        part = _drawn(len(rows.features), settings.tuning_samples, settings.seed)
        folds, held_out = make_folds(rows.session[part], settings)
        raw, learn, truth = rows.features[part], rows.learn_n[part], rows.truth_n[part]
        constants, errors = choose(
            raw, learn, truth, folds, settings, linear,
            lambda what, share: report(what, 0.4 + 0.5 * share),
        )  # fmt: skip
        found, wrong = residuals(raw, learn, truth, folds, constants, settings, linear)
        report("training", 0.92)
        share = len(part) / len(rows.features)
        constants = [replace(each, c=each.c * share) for each in constants]
        machines = fit_machines(rows.features, rows.learn_n, constants, shift, scale, linear)
        self.fitted_ = _Fitted(
            actuation=actuation,
            actuation_limits=limits_of(actuation, dataset),
            shape=rows.names,
            known=known,
            machines=machines,
            constants=tuple(constants),
            cv_rmse_n=tuple(errors.tolist()),
            interval=conformal_interval(known, found, wrong, truth, rows.session[part], held_out),
            samples=len(rows.features),
            left_out=left_out,
            sessions=len(set(rows.session.tolist())),
            vision=vision,
        )
        report("training", 1.0)
        return self

    def calibrate(self, dataset: Dataset, progress: Progress | None = None) -> Self:
        """Find the intervals anew on ``dataset``, of whose sessions ``fit`` saw none; the answers stay as they are.

        Raises InputError where the catheter is found in none of its images, NotFittedError before ``fit``.
        """
        report, fitted = progress or no_progress, self._known()
        rows = gather_rows(
            self.settings, fitted.actuation, dataset, lambda share: report("calibrating", share), fitted.vision
        )
        if not len(rows.features):
            raise InputError(
                f"{dataset.title}: intervals cannot be found on {len(dataset)} samples without a known shape; the "
                f"first says: {rows.why_not}"
            )
        found = np.array([fitted.machines(row) for row in rows.features])
        interval = conformal_interval(
            fitted.known, found, found - rows.truth_n, rows.truth_n, rows.session, held_out=True
        )
        self.fitted_ = replace(fitted, interval=interval)
        return self

    def _calibrated_vision(self, dataset: Dataset) -> ResolvedVision | None:
        """Returns the detection for images of any session, from images all over the dataset; None where that fails.

        A session whose images are not at hand begins with it; that of each session is resolved on its own images.
        """
        some = dataset.subset(np.unique(np.linspace(0, len(dataset) - 1, CALIBRATION_SAMPLES).astype(np.int64)))
        warn_of_sizes(dataset, self.settings.vision.view)
        images: list[Image] = []
        infos: list[SessionInfo] = []
        for session, observation in zip(some.session.tolist(), some.observations(), strict=True):
            view = observation.views.get(self.settings.vision.view)
            if isinstance(view, np.ndarray):
                images.append(view)
                infos.append(dataset.session_info[session])
        if not images:
            return None
        try:
            return auto_calibrate(self.settings.vision, images, infos)
        except InputError:
            return None

    def start(self, info: SessionInfo, images: Sequence[Image] = ()) -> "SvrStream":
        """A stream for one session; see `Estimator.start`. Raises NotFittedError before ``fit``."""
        return SvrStream(self.settings, self._known(), info, images)

    def to_onnx(self) -> tuple[bytes, dict[str, Any]]:
        """The regression without the detection; see `regression_graph`."""
        fitted = self._known()
        return regression_graph(fitted.machines, (*fitted.shape, *fitted.actuation), fitted.targets)

    def normalised(self, dataset: Dataset) -> tuple[tuple[str, ...], FloatArray, tuple[str, ...], FloatArray]:
        """Thesis table 3: names (k,) and scaled values (m, k) of the features, then (t,) and (m, t) of the forces.

        Samples without a shape are left out. With a window, a feature's name says how old it is.
        """
        fitted = self._known()
        rows = gather_rows(self.settings, fitted.actuation, dataset, lambda _: None, fitted.vision)
        machines, lags = fitted.machines, self.settings.window.lags_ms
        own = (*fitted.shape, *fitted.actuation)
        names = tuple(name if lag == 0 else f"{name} {lag:g} ms ago" for lag in lags for name in own)
        return names, (rows.features - machines.shift) * machines.scale, fitted.targets, rows.truth_n / machines.unit_n

    def _known(self) -> _Fitted:
        if self.fitted_ is None:
            raise NotFittedError("svr was not fitted; train it with `tipforce train` or load a model")
        return self.fitted_

    def state(self) -> tuple[dict[str, Any], dict[str, npt.NDArray[Any]]]:
        """Raises ModelError where the answers differ from scikit-learn's by `PARITY_N` or more."""
        fitted = self._known()
        if not fitted.machines.parity_n < PARITY_N:
            raise ModelError(
                f"svr answers differ from scikit-learn's by up to {fitted.machines.parity_n:.2g} N, more than "
                f"{PARITY_N:g} N: the model was not saved; train it with a smaller C"
            )
        values: dict[str, Any] = {
            "actuation": list(fitted.actuation),
            "actuation_limits": {name: list(pair) for name, pair in fitted.actuation_limits.items()},
            "shape": list(fitted.shape),
            "known": fitted.known.tolist(),
            "targets": list(fitted.targets),
            "constants": [{"c": c.c, "epsilon": c.epsilon, "sigma": c.sigma} for c in fitted.constants],
            "cv_rmse_n": list(fitted.cv_rmse_n),
            "interval": fitted.interval.values(),
            "samples": fitted.samples,
            "left_out": fitted.left_out,
            "sessions": fitted.sessions,
            "vision": None if fitted.vision is None else fitted.vision.model_dump(mode="json"),
            "parity_n": fitted.machines.parity_n,
        }
        return values, fitted.machines.arrays()

    @classmethod
    def from_state(
        cls,
        settings: Mapping[str, Any],
        values: Mapping[str, Any],
        arrays: Mapping[str, npt.NDArray[Any]],
        files: Mapping[str, bytes] | None = None,  # noqa: ARG003 (it leaves none)
    ) -> "Svr":
        """The inverse of `state`."""
        svr = cls(SvrSettings.model_validate(settings))
        state = SvrState.model_validate(values)
        known = np.array(state.known, np.bool_)
        targets = int(known.sum()) or 1
        features = len(state.shape) + len(state.actuation)
        if svr.settings.force == "magnitude" and known.any():
            raise ValueError("force=magnitude goes with no known component")
        if not len(state.constants) == len(state.cv_rmse_n) == targets:
            raise ValueError(f"{targets} targets need as many constants and errors")
        if state.vision is not None:
            if state.vision.settings != svr.settings.vision:
                raise ValueError("vision was resolved with other settings than those of the model")
            ShapeDetector(state.vision)  # what does not fit is missed here, not at the first image
        svr.fitted_ = _Fitted(
            actuation=state.actuation,
            actuation_limits=state.actuation_limits,
            shape=state.shape,
            known=known,
            machines=Machines.of(arrays, features * len(svr.settings.window.lags_ms), targets, state.parity_n),
            constants=state.constants,
            cv_rmse_n=state.cv_rmse_n,
            interval=Interval.of(values["interval"], known),
            samples=state.samples,
            left_out=state.left_out,
            sessions=state.sessions,
            vision=state.vision,
        )
        return svr

    def describe(self) -> dict[str, Any]:
        """Chosen constants, errors over the folds, interval and its basis, counts."""
        fitted = self._known()
        interval = fitted.interval
        chosen: dict[str, Any] = {}
        half = [*interval.half_n[fitted.known].tolist()] or [interval.magnitude_half_n]
        ends = [0, *fitted.machines.ends.tolist()]
        for t, target in enumerate(fitted.targets):
            constants = fitted.constants[t]
            chosen[target] = {
                "c": constants.c,
                "epsilon": constants.epsilon,
                "sigma": constants.sigma,
                "cv_rmse_n": fitted.cv_rmse_n[t],
                "interval_half_width_n": half[t] if np.isfinite(half[t]) else None,
                "support_vectors": ends[t + 1] - ends[t],
            }
        return {
            "targets": chosen,
            "magnitude_interval_half_width_n": (
                interval.magnitude_half_n if np.isfinite(interval.magnitude_half_n) else None
            ),
            "magnitude_interval_n": interval.magnitude_examples(),
            "interval_basis": interval.basis,
            "features": [*fitted.shape, *fitted.actuation],
            "detection": None if fitted.vision is None else self.settings.vision.method,
            "samples": fitted.samples,
            "left_out": fitted.left_out,
            "sessions": fitted.sessions,
            "parity_with_scikit_learn_n": fitted.machines.parity_n,
        }

    @classmethod
    def summary(cls, facts: Mapping[str, Any]) -> ModelSummary:
        """Constants, errors over the folds, intervals."""
        return svr_summary(facts)


class SvrStream:
    """One session, frame after frame; ``images``: see `SessionDetector`."""

    def __init__(self, settings: SvrSettings, fitted: _Fitted, info: SessionInfo, images: Sequence[Image] = ()) -> None:
        self._fitted, self._info = fitted, info
        detector = SessionDetector(settings.vision, info, images, fitted.vision)
        self._inputs = Inputs(settings, fitted.actuation, detector, fitted.shape)
        self._window = Window(settings.window) if settings.window.used else None
        self._machines = fitted.machines
        self._builder = EstimateBuilder(fitted.known, fitted.interval)

    def update(self, observation: Observation) -> ForceEstimate:
        """The force at this observation; its status says why where there is none."""
        row, fitted = self._inputs.read(observation), self._fitted
        shape = self._inputs.shape
        if not isinstance(row, Abstention):
            row = unlike_training(observation, fitted.actuation_limits, fitted.actuation, self._info) or row
        if isinstance(row, Abstention):
            return ForceEstimate.invalid(observation.stamp_ns, row.status, row.detail, shape)
        if self._window is not None:
            row = self._window.push(observation.stamp_ns, row)
        return self._builder.valid(observation.stamp_ns, self._machines(row), shape)


def _linear_weights(settings: SvrSettings, rows: Rows) -> FloatArray:
    """(k,): weight of each feature's products in the kernel."""
    width = rows.features.shape[1]
    if settings.linear == 0.0:
        return np.zeros(width)
    one = np.ones(rows.width, np.bool_)
    if settings.angles is not None:
        one = np.array([name.startswith("angle ") for name in rows.names] + [True] * (rows.width - len(rows.names)))
    chosen = np.tile(one, width // rows.width)
    return np.where(chosen, settings.linear / np.count_nonzero(chosen), 0.0)


def _drawn(count: int, most: int, seed: int) -> npt.NDArray[np.int64]:
    if count <= most:
        return np.arange(count)
    return np.sort(np.random.default_rng(seed).choice(count, most, replace=False))
