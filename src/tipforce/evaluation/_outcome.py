"""What one method answered on the samples it was not trained on, beside what was measured there."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ..datasets import Dataset
from ..types import BoolArray, FloatArray, ForceEstimate, IntArray

__all__ = ["AXES", "CONTACT_N", "Outcome", "against", "gather", "join"]

AXES = ("x", "y", "z")
CONTACT_N = 0.01
"""Above this magnitude a sample counts as in contact."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """The test samples of one method under one protocol.

    ``index`` (n,): places in the evaluated dataset; ``fold`` (n,): which split scored the sample; ``session``,
    ``names``, ``stamp_ns`` (n,). ``reference_n`` (n, 3) and ``reference_magnitude_n`` (n,): what the answers are
    scored against; ``contact`` (n,). ``force_n`` (n, 3), ``magnitude_n`` (n,), ``interval_n`` (n, 3, 2),
    ``magnitude_interval_n`` (n, 2): the answers, NaN where refused or unknown; ``status`` and ``detail`` (n,).
    """

    method: str
    protocol: str
    index: IntArray
    fold: npt.NDArray[np.str_]
    session: npt.NDArray[np.str_]
    names: npt.NDArray[np.str_]
    stamp_ns: IntArray
    reference_n: FloatArray
    reference_magnitude_n: FloatArray
    contact: BoolArray
    force_n: FloatArray
    magnitude_n: FloatArray
    interval_n: FloatArray
    magnitude_interval_n: FloatArray
    status: npt.NDArray[np.str_]
    detail: npt.NDArray[np.str_]

    def __len__(self) -> int:
        return len(self.index)

    @property
    def answered(self) -> BoolArray:
        """(n,): True where the method gave a value."""
        return np.isfinite(self.magnitude_n)

    @property
    def quantities(self) -> tuple[str, ...]:
        """``magnitude`` and those of x, y, z that were measured and that the method yields."""
        shown = [
            axis
            for place, axis in enumerate(AXES)
            if np.isfinite(self.reference_n[:, place]).all() and np.isfinite(self.force_n[:, place]).any()
        ]
        return ("magnitude", *shown)

    def column(self, quantity: str) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Reference (n,), estimate (n,) and 90 % interval (n, 2) of one of `quantities`, in newtons."""
        if quantity == "magnitude":
            return self.reference_magnitude_n, self.magnitude_n, self.magnitude_interval_n
        axis = AXES.index(quantity)
        return self.reference_n[:, axis], self.force_n[:, axis], self.interval_n[:, axis]

    def where(self, chosen: BoolArray | IntArray) -> "Outcome":
        """Only the samples at ``chosen`` (a mask or places)."""
        arrays = {
            name: value[chosen]
            for name in self.__dataclass_fields__
            if name not in ("method", "protocol")
            for value in (getattr(self, name),)
        }
        return replace(self, **arrays)


def gather(
    method: str,
    protocol: str,
    fold: str,
    dataset: Dataset,
    index: IntArray,
    estimates: Sequence[ForceEstimate],
    contact: BoolArray,
) -> Outcome:
    """The ``estimates`` of the samples of ``dataset`` at ``index``; ``contact`` (len(dataset),)."""
    chosen = dataset.subset(index)
    return Outcome(
        method=method,
        protocol=protocol,
        index=index,
        fold=np.full(len(index), fold),
        session=chosen.session,
        names=chosen.names,
        stamp_ns=chosen.stamp_ns,
        reference_n=chosen.force_n,
        reference_magnitude_n=chosen.magnitude_n,
        contact=contact[index],
        force_n=np.array([e.force_n for e in estimates], dtype=np.float64).reshape(-1, 3),
        magnitude_n=np.array([e.magnitude_n for e in estimates], dtype=np.float64),
        interval_n=np.array([e.interval_n for e in estimates], dtype=np.float64).reshape(-1, 3, 2),
        magnitude_interval_n=np.array([e.magnitude_interval_n for e in estimates], dtype=np.float64).reshape(-1, 2),
        status=np.array([e.status.value for e in estimates], dtype=np.str_),
        detail=np.array([e.detail for e in estimates], dtype=np.str_),
    )


def join(parts: Sequence[Outcome]) -> Outcome:
    """The outcomes of the splits of one protocol as one."""
    first = parts[0]
    names = [name for name in first.__dataclass_fields__ if name not in ("method", "protocol")]
    return replace(first, **{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})


def against(outcome: Outcome, truth_n: FloatArray) -> Outcome:
    """The same answers scored against ``truth_n`` (len(dataset), 3) in place of the sensor; NaN rows are left out."""
    truth = truth_n[outcome.index]
    columns = np.isfinite(outcome.reference_n).any(axis=0)
    magnitude = np.sqrt(np.sum(truth[:, columns] ** 2, axis=1))
    scored = replace(outcome, reference_n=np.where(columns, truth, np.nan), reference_magnitude_n=magnitude)
    return scored.where(np.isfinite(magnitude))
