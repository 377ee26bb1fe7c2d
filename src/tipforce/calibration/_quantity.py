"""A calibrated quantity, and the combination of its values from several sessions."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True, slots=True)
class Quantity:
    """A value with its standard deviation.

    Attributes:
        name: name in the table.
        value: the value; NaN if it is not known.
        std: its standard deviation.
        unit: unit of both.
        frames: number of frames from which it was found.
        key: key in ``bench.toml``; "" if it has none.
        before: stated value.
        written: whether it is accurate enough to be written to ``bench.toml``.
        stated: content for the file in place of the number.
    """

    name: str
    value: float
    std: float
    unit: str
    frames: int
    key: str = ""
    before: float | None = None
    written: bool = False
    doubt: str = ""
    """Reason why the value is not accurate, or ""."""
    stated: Any = None

    @property
    def known(self) -> bool:
        """Whether there is a value."""
        return math.isfinite(self.value)

    def figures(self) -> dict[str, Any]:
        """Returns the values as JSON values."""
        return {
            "name": self.name, "key": self.key, "value": self.value, "std": self.std, "unit": self.unit,
            "before": self.before, "frames": self.frames, "written": self.written, "doubt": self.doubt,
        }  # fmt: skip


def combined(values: Sequence[float], stds: Sequence[float], prior_std: float = math.inf) -> tuple[float, float]:
    """Returns the weighted mean and its standard deviation.

    Values that differ by more than their standard deviations widen the result (Birge's ratio).

    Args:
        values: values of the sessions.
        stds: their standard deviations.
        prior_std: standard deviation of a prior about 0 that each value, as a posterior, contains; it is counted once.

    >>> combined([1.0, 3.0], [1.0, 1.0])
    (2.0, 1.0)
    """
    means, information = np.asarray(values, np.float64), np.asarray(stds, np.float64) ** -2
    prior_information = 0.0 if math.isinf(prior_std) else prior_std**-2
    # a posterior is the product of prior and data: the prior is removed from each value, and added to the sum once
    data_information = np.maximum(information - prior_information, 1e-9 * information)
    data_means = means * information / data_information
    total = float(data_information.sum() + prior_information)
    mean = float((data_information * data_means).sum() / total)
    widening = 1.0
    if len(means) > 1:
        widening = max(1.0, float(np.sum(information * (means - mean) ** 2)) / (len(means) - 1))
    return mean, math.sqrt(widening / total)
