"""Thesis table 3: five samples as the method sees them."""

from typing import Any, Protocol, runtime_checkable

import numpy as np

from ..datasets import Dataset
from ..types import FloatArray
from ._evaluation import Evaluation

__all__ = ["ShowsFeatures", "five_samples"]


@runtime_checkable
class ShowsFeatures(Protocol):
    """A fitted method that can show its inputs: an optional addition to the estimator's face."""

    def normalised(self, dataset: Dataset) -> tuple[tuple[str, ...], FloatArray, tuple[str, ...], FloatArray]:
        """Names (k,) and scaled values (m, k) of the features, then (t,) and (m, t) of the forces learnt from.

        Samples without features are left out, so m may be smaller than len(dataset).
        """
        ...


def five_samples(evaluation: Evaluation, method: str) -> dict[str, Any] | None:
    """Names and five rows of the first training part, from the largest force down to the smallest; None without."""
    first = next(row for row in evaluation.rows if row.method == method).fits[0]
    if not isinstance(first.estimator, ShowsFeatures) or not len(first.split.train):
        return None
    names, values, targets, force = first.estimator.normalised(evaluation.dataset.subset(first.split.train))
    order = np.argsort(-np.linalg.norm(force, axis=1), kind="stable")
    chosen = order[np.unique(np.linspace(0, len(order) - 1, 5).round().astype(int))]
    return {"names": [*names, *targets], "rows": np.column_stack([values, force])[chosen]}
