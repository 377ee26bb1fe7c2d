"""Thesis table 3: five samples as the method sees them."""

from typing import Any, Protocol, runtime_checkable

import numpy as np

from ..dataset import Dataset
from ..types import FloatArray
from ._evaluate import Evaluation

__all__ = ["ShowsFeatures", "five_samples"]


@runtime_checkable
class ShowsFeatures(Protocol):
    """A fitted method that can show its inputs: an optional addition to the estimator's face."""

    def normalised(self, dataset: Dataset) -> tuple[tuple[str, ...], FloatArray, FloatArray]:
        """Names (k,), features (n, k) and forces (n,), each divided by its scale; NaN rows where there are none."""
        ...


def five_samples(evaluation: Evaluation, method: str) -> dict[str, Any] | None:
    """Names and five rows of the first training part, from the largest force down to the smallest; None without."""
    first = next(row for row in evaluation.rows if row.method == method).fits[0]
    if not isinstance(first.estimator, ShowsFeatures):
        return None
    part = evaluation.dataset.subset(first.split.train)
    order = np.argsort(-part.magnitude_n, kind="stable")
    chosen = order[np.unique(np.linspace(0, len(order) - 1, 5).round().astype(int))]
    names, values, force = first.estimator.normalised(part.subset(chosen))
    return {"names": [*names, "force"], "rows": [[*row, size] for row, size in zip(values, force, strict=True)]}
