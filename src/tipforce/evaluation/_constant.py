"""The constant predictor, which looks at nothing: the baseline beside every method."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict

from ..datasets import Dataset
from ..errors import InputError, NotFittedError
from ..estimators import Estimator, Progress, Stream
from ..types import ForceEstimate, Image, Observation, SessionInfo


class _NoSettings(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


@dataclass(frozen=True, slots=True)
class _ConstantStream:
    estimate: ForceEstimate

    def update(self, observation: Observation) -> ForceEstimate:
        return replace(self.estimate, stamp_ns=observation.stamp_ns)


class Constant(Estimator):
    """Estimates the mean of its training labels, per component and for the magnitude; 5-95 % quantiles as interval.

    A method whose error is not clearly below this one's has read nothing from the image.
    """

    name: ClassVar[str] = "constant"
    settings_type: ClassVar[type[BaseModel]] = _NoSettings

    def __init__(self, settings: BaseModel | None = None) -> None:
        self.settings = settings or _NoSettings()
        self.estimate_: ForceEstimate | None = None

    def fit(self, dataset: Dataset, progress: Progress | None = None) -> Self:
        """Takes the means of the labels; see `Estimator.fit`. Raises InputError without samples."""
        if not len(dataset):
            raise InputError("the constant predictor got no samples to take the mean of; give it at least one")
        known = np.asarray(dataset.known)  # (3,) axes that the sensor measures
        force, magnitude = dataset.force_n, dataset.magnitude_n
        both_known = np.outer(known, known)
        covariance = np.where(both_known, np.cov(np.nan_to_num(force), rowvar=False, bias=True), math.nan)
        self.estimate_ = ForceEstimate(
            stamp_ns=0, force_n=np.where(known, np.mean(force, axis=0), math.nan), known=known,
            covariance_n2=covariance, interval_n=np.full((3, 2), math.nan), magnitude_n=float(magnitude.mean()),
            magnitude_interval_n=np.full(2, math.nan),
        )  # fmt: skip
        if progress is not None:
            progress("mean of the labels", 1.0)
        return self.calibrate(dataset)

    def calibrate(self, dataset: Dataset, progress: Progress | None = None) -> Self:
        """Takes the quantiles of the labels; see `Estimator.calibrate`. Raises NotFittedError before `fit`."""
        band = np.quantile(np.nan_to_num(dataset.force_n), (0.05, 0.95), axis=0).T
        self.estimate_ = replace(
            self._fitted(),
            interval_n=np.where(np.asarray(dataset.known)[:, None], band, math.nan),
            magnitude_interval_n=np.quantile(dataset.magnitude_n, (0.05, 0.95)),
        )
        if progress is not None:
            progress("quantiles of the labels", 1.0)
        return self

    def start(self, info: SessionInfo, images: Sequence[Image] = ()) -> Stream:  # noqa: ARG002 - always the same
        """Starts a stream that gives the same estimate every time; see `Estimator.start`."""
        return _ConstantStream(self._fitted())

    def predict(
        self,
        dataset: Dataset,
        progress: Callable[[float], None] | None = None,  # noqa: ARG002 - it takes no time
    ) -> list[ForceEstimate]:
        """Returns the same estimate for each sample, without reading an image; see `Estimator.predict`."""
        return [replace(self._fitted(), stamp_ns=stamp) for stamp in dataset.stamp_ns.tolist()]

    def _fitted(self) -> ForceEstimate:
        if self.estimate_ is None:
            raise NotFittedError("the constant predictor has no mean yet; call fit first")
        return self.estimate_

    def unfitted(self) -> Self:
        """Returns a constant predictor without its mean."""
        return type(self)()

    def state(self) -> tuple[dict[str, Any], dict[str, npt.NDArray[Any]]]:
        """Returns the means and quantiles."""
        estimate = self._fitted()
        arrays: dict[str, npt.NDArray[Any]] = {
            "force_n": estimate.force_n,
            "known": estimate.known,
            "covariance_n2": estimate.covariance_n2,
            "interval_n": estimate.interval_n,
            "magnitude_interval_n": estimate.magnitude_interval_n,
        }
        return {"magnitude_n": estimate.magnitude_n}, arrays

    @classmethod
    def from_state(
        cls,
        settings: Mapping[str, Any],
        values: Mapping[str, Any],
        arrays: Mapping[str, npt.NDArray[Any]],
        files: Mapping[str, bytes] | None = None,  # noqa: ARG003 (it leaves none)
    ) -> Self:
        """Makes a fitted predictor from the result of `state`; see `Estimator.from_state`."""
        predictor = cls(_NoSettings.model_validate(dict(settings)))
        predictor.estimate_ = ForceEstimate(
            stamp_ns=0, magnitude_n=float(values["magnitude_n"]), force_n=arrays["force_n"], known=arrays["known"],
            covariance_n2=arrays["covariance_n2"], interval_n=arrays["interval_n"],
            magnitude_interval_n=arrays["magnitude_interval_n"],
        )  # fmt: skip
        return predictor
