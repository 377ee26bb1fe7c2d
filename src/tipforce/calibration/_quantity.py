"""One calibrated quantity, and how several sessions' values of it become one."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True, slots=True)
class Quantity:
    """A value with its standard deviation.

    ``key``: of ``bench.toml`` where it has a place there; ``written``: whether it is good enough to stand in it.
    ``before``: what was stated; ``frames``: that it comes from; ``doubt``: where it is poor, in a sentence, or empty.
    ``stated``: what stands in the file in place of the number.
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
    stated: Any = None

    @property
    def known(self) -> bool:
        """Whether there is a value at all."""
        return math.isfinite(self.value)

    def figures(self) -> dict[str, Any]:
        """As JSON."""
        return {
            "name": self.name, "key": self.key, "value": self.value, "std": self.std, "unit": self.unit,
            "before": self.before, "frames": self.frames, "written": self.written, "doubt": self.doubt,
        }  # fmt: skip


def combined(values: Sequence[float], stds: Sequence[float], prior_std: float = math.inf) -> tuple[float, float]:
    """Weighted mean and its standard deviation.

    ``prior_std``: each value is a posterior that holds the same prior about 0 with this deviation; it counts once.
    Values farther apart than they claim widen the result (Birge's ratio).

    >>> combined([1.0, 3.0], [1.0, 1.0])
    (2.0, 1.0)
    """
    found, information = np.asarray(values, np.float64), np.asarray(stds, np.float64) ** -2
    shared = 0.0 if math.isinf(prior_std) else prior_std**-2
    own = np.maximum(information - shared, 1e-9 * information)
    data = found * information / own
    total = float(own.sum() + shared)
    mean = float((own * data).sum() / total)
    wide = 1.0
    if len(found) > 1:
        wide = max(1.0, float(np.sum(information * (found - mean) ** 2)) / (len(found) - 1))
    return mean, math.sqrt(wide / total)
