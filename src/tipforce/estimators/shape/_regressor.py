"""The common part of all regressions from the centreline's shape: features, folds, intervals, abstention, state.

A method states how it learns from a table and how it estimates from one: `ShapeRegressor.learn` and
`ShapeRegressor.regress`. Everything else is here. `svr` is one of them.
"""

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Self

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field

from ..._system.rows import evenly_spread
from ...datasets import Dataset
from ...errors import InputError, NotFittedError
from ...types import FloatArray, ForceEstimate, Image, IntArray, Observation, SessionInfo
from ...vision import ResolvedVision, SessionDetector, ShapeDetector, auto_calibrate
from .._base import CentrelineEstimator, Progress, no_progress
from .._builder import AXES, EstimateBuilder
from .._left_out import refuse_left_out
from .._reading import Abstention, actuation_names, limits_of, unlike_training
from .._values import LARGEST, Count, Known, Number, StoredArrays, StoredFiles, StoredValues, stored_array
from ..uncertainty import StoredInterval, conformal_interval
from ._facts import ShapeFacts, TargetFacts
from ._folds import draw_samples, make_folds
from ._inputs import Inputs
from ._rows import Rows, gather_rows, warn_of_sizes
from ._settings import ShapeRegressorSettings
from ._window import Window

MIN_SAMPLES = 20
"""Fewer samples cannot be trained and cross-validated on."""

CALIBRATION_SAMPLES = 10
"""Number of images on which open settings of the detection are resolved."""

Regression = Callable[[FloatArray], FloatArray]
"""Estimates from the features (k,) of one frame the forces (t,) in newtons."""


@dataclass(frozen=True, eq=False)
class Trained:
    """A trained model, and estimates of models that were trained without the estimated samples.

    Attributes:
        model: the model, in the method's own form.
        index: (m,) positions of the samples of the cross-validation.
        held_out_n: (m, t) their estimates in newtons.
        by_session: True where whole sessions were held out.
    """

    model: Any
    index: IntArray
    held_out_n: FloatArray
    by_session: bool


class FittedRegressor(BaseModel):
    """The learnt state of a shape regressor.

    Attributes:
        actuation: names of the drives among its inputs.
        actuation_limits: name -> smallest and largest value that it answers to, see `limits_of`; empty in models that
            were saved before these were known.
        shape: names of the shape numbers among its inputs.
        known: (3,) the force components that it estimates; none where it estimates the magnitude alone.
        cv_rmse_n: root mean square error of each target over the folds, in newtons.
        interval: conformal intervals.
        samples: number of samples that it learnt from.
        left_out: session -> samples that it could not learn from, and all of its samples.
        sessions: number of sessions that it learnt from.
        vision: resolved on images of the training data; None where these hold no images.
        model: the model, in the method's own form.
    """

    model_config = ConfigDict(frozen=True, extra="ignore")

    actuation: tuple[str, ...]
    actuation_limits: dict[str, tuple[Number, Number]] = {}
    shape: tuple[str, ...]
    known: Known
    cv_rmse_n: tuple[Annotated[float, Field(ge=0, le=LARGEST)], ...]
    interval: StoredInterval
    samples: Count
    left_out: dict[str, list[Count]]
    sessions: Count
    vision: ResolvedVision | None
    model: Annotated[Any, Field(exclude=True)]

    @property
    def targets(self) -> tuple[str, ...]:
        """Names of the estimated numbers."""
        return tuple(AXES[axis] for axis in np.flatnonzero(self.known)) or ("magnitude",)


class ShapeRegressor(CentrelineEstimator):
    """A regression from the shape of the centreline and the drives to the force.

    A method derives from it, states its ``name`` and its ``settings_type``, and implements `learn` and `regress`. A
    model that is no mapping of arrays also needs `model_state` and `model_from_state`. ``fitted_`` is None before
    `fit`.
    """

    settings_type = ShapeRegressorSettings

    def __init__(self, settings: Any = None) -> None:
        super().__init__(settings)
        self.fitted_: FittedRegressor | None = None

    def reading(self, view: str) -> Self:
        """Returns this method for another view; see `Estimator.reading`."""
        made = super().reading(view)
        if made.fitted_ is not None and made.fitted_.vision is not None:
            made.fitted_ = made.fitted_.model_copy(update={"vision": made.fitted_.vision.reading(view)})
        return made

    def learn(self, features: FloatArray, force_n: FloatArray) -> Any:
        """Learns from a table; a method that overrides `train` need not implement it.

        Args:
            features: (n, k) k features of each of n samples: shape numbers, then drives; with a window those of each
                lag, the newest first.
            force_n: (n, t) forces in newtons: a column for each of the t targets, see `FittedRegressor.targets`.

        Returns:
            The model: arrays by name, or anything that `model_state` can save.

        Raises:
            NotImplementedError: the method overrides neither `learn` nor `train`.
        """
        raise NotImplementedError(f"{type(self).__name__} must implement learn, or override train")

    @abstractmethod
    def regress(self, model: Any, features: FloatArray) -> FloatArray:
        """Estimates the force in each of m frames.

        Args:
            model: the model, as `learn` returned it.
            features: (m, k) features of the m frames, in the same k columns as those of `learn`.

        Returns:
            (m, t) estimated forces in newtons, in the same t columns as those of `learn`: the known force
            components, or the magnitude alone.
        """

    def train(self, rows: Rows, report: Progress) -> Trained:
        """Trains on all rows, and on all but those of each fold for the errors that the intervals rest on.

        A method that chooses constants by cross-validation overrides it.

        Args:
            rows: the table.
            report: called with a description of the current work and its share.

        Returns:
            The model, and the errors on samples that were held out.
        """
        folds, by_session = make_folds(rows.session, self.settings)
        held_out_n = np.empty_like(rows.truth_n)
        for number, (train, test) in enumerate(folds):
            report("cross-validation", number / len(folds))
            model = self.learn(rows.features[train], rows.learn_n[train])
            held_out_n[test] = self._regressed(model, rows.features[test], rows.truth_n.shape[1])
        report("training", 1.0)
        model = self.learn(rows.features, rows.learn_n)
        return Trained(model, np.arange(len(rows.features)), held_out_n, by_session)

    def regression(self, model: Any) -> Regression:
        """Returns a function that estimates frame after frame with ``model``."""
        return lambda row: self.regress(model, row[None])[0]

    def model_state(self, model: Any) -> tuple[dict[str, Any], dict[str, npt.NDArray[Any]]]:
        """Returns JSON values and arrays of ``model``; the inverse of `model_from_state`."""
        return {}, dict(model)

    def model_from_state(self, values: StoredValues, arrays: StoredArrays, features: int, targets: int) -> Any:
        """Makes the model from the return values of `model_state`.

        Args:
            values: the JSON values.
            arrays: the arrays by name.
            features: number of features of a frame.
            targets: number of estimated forces.

        Returns:
            The model, as `learn` returned it.

        Raises:
            KeyError, TypeError, ValueError: the values and arrays are not those of a model.
        """
        del values, features, targets
        return {name: stored_array(arrays, name, (None,) * array.ndim) for name, array in arrays.items()}

    @property
    def uses_history(self) -> bool:
        """True with a window over earlier frames."""
        return self.settings.window.used

    @property
    def required_actuation(self) -> tuple[str, ...]:
        """The drives that it was trained with. Raises NotFittedError before `fit`."""
        return self.fitted().actuation

    def fitted(self) -> FittedRegressor:
        """Returns the learnt state. Raises NotFittedError before `fit`."""
        if self.fitted_ is None:
            raise NotFittedError(f"{self.name} was not fitted; train it with `tipforce train` or load a model")
        return self.fitted_

    def fit(self, dataset: Dataset, progress: Progress | None = None) -> Self:
        """Resolves the detection, trains, and finds the intervals by cross-validation; see `Estimator.fit`.

        Raises:
            InputError: there are fewer than `MIN_SAMPLES` samples, drives that the data do not have, or images in which
                the catheter is not found.
        """
        report = progress or no_progress
        count = len(dataset)
        if count < MIN_SAMPLES:
            raise InputError(f"{dataset.title}: has {count} samples; training {self.name} needs at least {MIN_SAMPLES}")
        settings: ShapeRegressorSettings = self.settings
        vision = self._shared_vision(dataset)
        actuation = actuation_names(settings.actuation, dataset)
        rows = gather_rows(
            settings, actuation, dataset, lambda share: report("detecting the catheter", 0.4 * share), vision
        )
        vision = vision or rows.vision
        if len(rows.features) < MIN_SAMPLES:
            raise InputError(
                f"{dataset.title}: the catheter's shape is known in {len(rows.features)} of {count} samples, "
                f"{self.name} needs {MIN_SAMPLES}; the first other one says: {rows.why_not}; look at an image with "
                "`tipforce inspect`"
            )
        left_out = rows.left_out
        refuse_left_out(dataset.title, left_out, count, settings.max_left_out)
        if settings.training_samples is not None:
            rows = rows.at(draw_samples(len(rows.features), settings.training_samples, settings.seed))
        known = dataset.known.copy() if settings.force == "components" else np.zeros(3, np.bool_)
        trained = self.train(rows, lambda what, share: report(what, 0.4 + 0.55 * share))
        index, held_out_n, truth = trained.index, trained.held_out_n, rows.truth_n[trained.index]
        error = held_out_n - truth
        if not np.isfinite(held_out_n).all():
            raise InputError(
                f"{dataset.title}: {self.name} estimates forces that are not finite, on samples that were held out"
            )
        self.fitted_ = FittedRegressor(
            actuation=actuation,
            actuation_limits=limits_of(actuation, dataset),
            shape=rows.names,
            known=known,
            model=trained.model,
            cv_rmse_n=tuple(_rms(error[:, t]) for t in range(error.shape[1])),
            interval=conformal_interval(known, held_out_n, error, truth, rows.session[index], trained.by_session),
            samples=len(rows.features),
            left_out=left_out,
            sessions=len(set(rows.session.tolist())),
            vision=vision,
        )
        report("training", 1.0)
        return self

    def calibrate(self, dataset: Dataset, progress: Progress | None = None) -> Self:
        """Finds new intervals; the forces stay. See `Estimator.calibrate`.

        Raises:
            InputError: the catheter is found in none of its images.
            NotFittedError: before `fit`.
        """
        report, fitted = progress or no_progress, self.fitted()
        rows = gather_rows(
            self.settings, fitted.actuation, dataset, lambda share: report("calibrating", share), fitted.vision
        )
        if not len(rows.features):
            raise InputError(
                f"{dataset.title}: intervals cannot be found on {len(dataset)} samples without a known shape; the "
                f"first says: {rows.why_not}"
            )
        force_n = self._regressed(fitted.model, rows.features, rows.truth_n.shape[1])
        error = force_n - rows.truth_n
        interval = conformal_interval(fitted.known, force_n, error, rows.truth_n, rows.session, held_out=True)
        self.fitted_ = fitted.model_copy(update={"interval": interval})
        return self

    def _regressed(self, model: Any, features: FloatArray, targets: int) -> FloatArray:
        """Returns the estimates (m, t). Raises InputError where the method returns another shape."""
        found = np.asarray(self.regress(model, features), np.float64)
        if found.shape != (len(features), targets):
            raise InputError(
                f"{type(self).__name__}.regress returned an array of the shape {found.shape}; expected "
                f"({len(features)}, {targets}): a row for each sample and a column for each force"
            )
        return found

    def _shared_vision(self, dataset: Dataset) -> ResolvedVision | None:
        """Resolves the detection on images from the whole dataset; None where that fails.

        A session without images beforehand begins with it, until its own images have resolved the detection.
        """
        some = dataset.subset(evenly_spread(len(dataset), CALIBRATION_SAMPLES))
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

    def start(self, info: SessionInfo, images: Sequence[Image] = ()) -> "ShapeStream":
        """Returns a stream for one session; see `Estimator.start`. Raises NotFittedError before `fit`."""
        fitted = self.fitted()
        return ShapeStream(self.settings, fitted, self.regression(fitted.model), info, images)

    def state(self) -> tuple[dict[str, Any], dict[str, npt.NDArray[Any]]]:
        """Returns the learnt state as JSON values and arrays."""
        fitted = self.fitted()
        model_values, arrays = self.model_state(fitted.model)
        return {**fitted.model_dump(mode="json"), "targets": list(fitted.targets), "model": model_values}, arrays

    @classmethod
    def from_state(
        cls, settings: StoredValues, values: StoredValues, arrays: StoredArrays, files: StoredFiles = None
    ) -> Self:
        """Makes a fitted method from the return values of `state`; see `Estimator.from_state`.

        Raises:
            KeyError, TypeError, ValueError: the values and arrays are not those of the method.
        """
        del files
        made = cls(cls.settings_type.model_validate(settings))
        state = FittedRegressor.model_validate({"model": {}, **values})
        targets = len(state.targets)
        features = (len(state.shape) + len(state.actuation)) * len(made.settings.window.lags_ms)
        if made.settings.force == "magnitude" and state.known.any():
            raise ValueError("force=magnitude goes with no known component")
        if len(state.cv_rmse_n) != targets:
            raise ValueError(f"{targets} targets need as many errors, got {len(state.cv_rmse_n)}")
        if state.vision is not None:
            if state.vision.settings != made.settings.vision:
                raise ValueError("vision was resolved with other settings than those of the model")
            ShapeDetector(state.vision)  # wrong values are found here, not at the first image
        model = made.model_from_state(state.model, arrays, features, targets)
        made._regressed(model, np.zeros((1, features)), targets)
        made.fitted_ = state.model_copy(update={"model": model})
        return made

    def describe(self) -> ShapeFacts:
        """Returns errors over the folds, intervals and their basis, features and counts."""
        fitted, interval = self.fitted(), self.fitted().interval
        half = [*interval.half_n[fitted.known].tolist()] or [interval.magnitude_half_n]
        return ShapeFacts(
            targets={
                target: TargetFacts(cv_rmse_n=fitted.cv_rmse_n[t], interval_half_width_n=_bounded(half[t]))
                for t, target in enumerate(fitted.targets)
            },
            magnitude_interval_half_width_n=_bounded(interval.magnitude_half_n),
            magnitude_interval_n=interval.magnitude_examples(),
            interval_basis=interval.basis,
            features=(*fitted.shape, *fitted.actuation),
            detection=None if fitted.vision is None else self.settings.vision.method,
            samples=fitted.samples,
            left_out=fitted.left_out,
            sessions=fitted.sessions,
        )


class ShapeStream:
    """Estimates one session, frame after frame.

    Args:
        settings: settings of the method.
        fitted: its learnt state.
        regression: features (k,) -> forces (t,) in newtons.
        info: metadata of the session.
        images: see `SessionDetector`.
    """

    def __init__(
        self,
        settings: ShapeRegressorSettings,
        fitted: FittedRegressor,
        regression: Regression,
        info: SessionInfo,
        images: Sequence[Image] = (),
    ) -> None:
        self._fitted, self._info, self._regression = fitted, info, regression
        detector = SessionDetector(settings.vision, info, images, fitted.vision)
        self._inputs = Inputs(settings, fitted.actuation, detector, fitted.shape)
        self._window = Window(settings.window) if settings.window.used else None
        self._builder = EstimateBuilder(fitted.known, fitted.interval)

    def update(self, observation: Observation) -> ForceEstimate:
        """Returns the force at this observation; the status states the reason of an abstention."""
        row, fitted = self._inputs.read(observation), self._fitted
        shape = self._inputs.shape
        if not isinstance(row, Abstention):
            row = unlike_training(observation, fitted.actuation_limits, fitted.actuation, self._info) or row
        if isinstance(row, Abstention):
            return ForceEstimate.invalid(observation.stamp_ns, row.status, row.detail, shape)
        if self._window is not None:
            row = self._window.push(observation.stamp_ns, row)
        return self._builder.valid(observation.stamp_ns, self._regression(row), shape)


def _rms(errors_n: FloatArray) -> float:
    return float(np.sqrt(np.mean(errors_n**2)))


def _bounded(half_n: float) -> float | None:
    return half_n if np.isfinite(half_n) else None
