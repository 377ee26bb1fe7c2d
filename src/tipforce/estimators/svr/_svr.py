"""Method 1: support vector regression from the shape of the centreline and the knob (thesis ch. 3).

Five polynomial coefficients (eq. 2) and the actuation, each divided by its largest absolute value on the training part;
kernel eq. (15), epsilon-insensitive loss eq. (8); C, epsilon and sigma by cross-validation on the training part. Two
defaults go beyond the thesis: the tracer finds the centreline, and all drives of the data are inputs, not the knob
alone; `Svr.thesis_settings` are exactly those of the thesis. Everything else beyond it is an option of `SvrSettings`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field

from ...datasets import Dataset
from ...errors import ModelError
from ...types import KNOB, FloatArray
from .._base import Progress
from .._values import LARGEST, StoredArrays, StoredValues
from ..shape import Rows, ShapeRegressor, Trained, draw_samples, gather_rows, make_folds
from ._facts import MachineFacts, SvrFacts
from ._graph import PARITY_N, regression_graph
from ._machine import Constants, Machines, fit_machines
from ._settings import SvrSettings
from ._tuning import choose, scaling_of


@dataclass(frozen=True, eq=False)
class SvrModel:
    """The learnt model.

    Attributes:
        machines: one support vector machine for each target.
        constants: the constants that were chosen for each target.
    """

    machines: Machines
    constants: tuple[Constants, ...]


class _ModelState(BaseModel):
    """The values of `Svr.model_state`."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    constants: tuple[Constants, ...]
    parity_n: Annotated[float, Field(ge=0, le=LARGEST)]


class Svr(ShapeRegressor):
    """Method 1; see the module. ``fitted_`` is None before ``fit``."""

    name: ClassVar[str] = "svr"
    settings_type = SvrSettings
    thesis_settings: ClassVar[Mapping[str, Any] | None] = {
        "vision": {"method": "classic", "threshold": 110},
        "actuation": [KNOB],
        "hold_out": "sample",
    }
    """The thesis states neither C, epsilon and sigma nor how they were chosen: they are chosen from the same values as
    always, on single held-out samples, as the thesis tests. Its threshold is a constant c that it does not state: 110
    is between shaft and ground of the simulated ``thesis-2021``; state the one of another bench."""
    settings: SvrSettings

    def train(self, rows: Rows, report: Progress) -> Trained:
        """Chooses the constants by cross-validation, and trains machines on all rows; see `ShapeRegressor.train`."""
        settings = self.settings
        shift, scale = scaling_of(rows.features, settings.scaling)
        linear = _linear_weights(settings, rows)
        index = draw_samples(len(rows.features), settings.tuning_samples, settings.seed)
        tuning_rows = rows.at(index)
        folds, by_session = make_folds(tuning_rows.session, settings)
        chosen, held_out_n = choose(
            tuning_rows.features, tuning_rows.learn_n, tuning_rows.truth_n, folds, settings, linear,
            lambda what, share: report(what, 0.9 * share),
        )  # fmt: skip
        report("training", 0.92)
        # C weighs the sum of the errors against flatness: with more samples it becomes smaller in proportion
        share = len(index) / len(rows.features)
        constants = tuple(replace(each, c=each.c * share) for each in chosen)
        machines = fit_machines(rows.features, rows.learn_n, constants, shift, scale, linear)
        return Trained(SvrModel(machines, constants), index, held_out_n, by_session)

    def regress(self, model: SvrModel, features: FloatArray) -> FloatArray:
        """See `ShapeRegressor`."""
        return model.machines.many(features)

    def regression(self, model: SvrModel) -> Machines:
        """See `ShapeRegressor`."""
        return model.machines

    def model_state(self, model: SvrModel) -> tuple[dict[str, Any], dict[str, npt.NDArray[Any]]]:
        """Returns constants and parity as JSON values, and the machines' arrays; see `ShapeRegressor`.

        Raises:
            ModelError: the estimates differ from scikit-learn's by `PARITY_N` or more.
        """
        parity_n = model.machines.parity_n
        if not parity_n < PARITY_N:
            raise ModelError(
                f"svr estimates differ from scikit-learn's by up to {parity_n:.2g} N, more than {PARITY_N:g} N: the "
                "model was not saved; train it with a smaller C"
            )
        constants = [{"c": each.c, "epsilon": each.epsilon, "sigma": each.sigma} for each in model.constants]
        return {"constants": constants, "parity_n": parity_n}, model.machines.arrays()

    def model_from_state(self, values: StoredValues, arrays: StoredArrays, features: int, targets: int) -> SvrModel:
        """See `ShapeRegressor`."""
        state = _ModelState.model_validate(values)
        if len(state.constants) != targets:
            raise ValueError(f"{targets} targets need as many constants, got {len(state.constants)}")
        return SvrModel(Machines.of(arrays, features, targets, state.parity_n), state.constants)

    def to_onnx(self) -> tuple[bytes, dict[str, Any]]:
        """Returns the regression without the detection; see `regression_graph`."""
        fitted = self.fitted()
        return regression_graph(fitted.model.machines, (*fitted.shape, *fitted.actuation), fitted.targets)

    def normalised(self, dataset: Dataset) -> tuple[tuple[str, ...], FloatArray, tuple[str, ...], FloatArray]:
        """Returns the scaled values of thesis table 3 for the samples whose shape is known.

        Returns:
            Names (k,) and scaled values (m, k) of the features, names (t,) and scaled values (m, t) of the forces. With
            a window, the name of a feature states its lag.
        """
        fitted = self.fitted()
        rows = gather_rows(self.settings, fitted.actuation, dataset, lambda _: None, fitted.vision)
        machines, lags = fitted.model.machines, self.settings.window.lags_ms
        frame_names = (*fitted.shape, *fitted.actuation)
        names = tuple(name if lag == 0 else f"{name} {lag:g} ms ago" for lag in lags for name in frame_names)
        return names, (rows.features - machines.shift) * machines.scale, fitted.targets, rows.truth_n / machines.unit_n

    def describe(self) -> SvrFacts:
        """Returns the facts of every shape regressor, the chosen constants, and the parity with scikit-learn."""
        model, facts = self.fitted().model, super().describe()
        shared: dict[str, Any] = dict(facts)
        ends = [0, *model.machines.ends.tolist()]
        shared["targets"] = {
            name: MachineFacts(
                **dict(each),
                c=constants.c,
                epsilon=constants.epsilon,
                sigma=constants.sigma,
                support_vectors=ends[t + 1] - ends[t],
            )
            for t, ((name, each), constants) in enumerate(zip(facts.targets.items(), model.constants, strict=True))
        }
        return SvrFacts(**shared, parity_with_scikit_learn_n=model.machines.parity_n)


def _linear_weights(settings: SvrSettings, rows: Rows) -> FloatArray:
    """Returns (k,) weights of the features in the kernel's linear part, see `SvrSettings.linear`; equal in all lags."""
    width = rows.features.shape[1]
    if settings.linear == 0.0:
        return np.zeros(width)
    of_lag = np.ones(rows.width, np.bool_)
    if settings.angles is not None:
        of_lag = np.array([name.startswith("angle ") for name in rows.names] + [True] * (rows.width - len(rows.names)))
    chosen = np.tile(of_lag, width // rows.width)
    return np.where(chosen, settings.linear / np.count_nonzero(chosen), 0.0)
