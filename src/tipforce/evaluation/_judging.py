"""From answers to a line of the table: told apart by contact, scored against sensor, truth and bounds."""

from collections.abc import Sequence

import numpy as np

from ..datasets import Dataset
from ..types import BoolArray, FloatArray
from ._bounds import Bounds
from ._evaluation import Row
from ._metrics import score
from ._outcome import CONTACT_N, Outcome, against
from ._protocols import Trained

__all__ = ["in_contact", "row_of"]


def in_contact(dataset: Dataset, truth_n: FloatArray | None) -> BoolArray:
    """(n,): by the truth where it is known, else by the sensor."""
    if truth_n is None:
        return dataset.magnitude_n > CONTACT_N
    magnitude = np.sqrt(np.sum(truth_n[:, dataset.known] ** 2, axis=1))
    return np.where(np.isfinite(magnitude), magnitude, dataset.magnitude_n) > CONTACT_N


def row_of(
    outcome: Outcome,
    constant: Outcome | None,
    fits: Sequence[Trained] = (),
    *,
    truth_n: FloatArray | None,
    bounds: Bounds | None,
) -> Row:
    """The outcome scored against the sensor and, where they are known, against the truth and the bounds."""
    figures = score(outcome, None if constant is None else constant.magnitude_n)
    if truth_n is None:
        return Row(outcome, figures, fits=tuple(fits))
    true = against(outcome, truth_n)
    held = None if bounds is None or not bounds.std_n else bounds.figures(true)
    return Row(outcome, figures, score(true), held, tuple(fits))
