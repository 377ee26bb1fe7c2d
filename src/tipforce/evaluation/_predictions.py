"""Predictions of one method on samples that it was not trained on, beside the reference force of each sample."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ..clinical import CONTACT_N
from ..datasets import Dataset
from ..types import BoolArray, FloatArray, ForceEstimate, IntArray

AXES = ("x", "y", "z")


@dataclass(frozen=True, eq=False)
class Predictions:
    """The test samples of one method under one protocol. All arrays have one row a sample.

    Attributes:
        method: Label of the method.
        protocol: Name of the protocol, or `AS_SAVED`.
        index: (n,) positions in the evaluated dataset.
        fold: (n,) name of the split that scored the sample.
        session: (n,) name of the session.
        names: (n,) name of the sample, such as its image file.
        stamp_ns: (n,) time stamps.
        reference_n: (n, 3) reference force in newtons, base frame; NaN where an axis was not measured.
        reference_magnitude_n: (n,) magnitude of the reference over the measured axes.
        contact: (n,) True where the tip is in contact.
        force_n: (n, 3) estimated force; NaN where abstained or not estimated.
        magnitude_n: (n,) estimated magnitude; NaN where abstained.
        interval_n: (n, 3, 2) 90 % intervals of the components.
        magnitude_interval_n: (n, 2) 90 % interval of the magnitude.
        status: (n,) value of the estimate's `Status`.
        detail: (n,) line of detail of the estimate.
        shape: (n,) `DetectedShape` of the image, None from a method that detects none.
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
    shape: npt.NDArray[np.object_]

    def __len__(self) -> int:
        return len(self.index)

    @property
    def valid(self) -> BoolArray:
        """(n,): True where the method gave a value, False where it abstained."""
        return np.isfinite(self.magnitude_n)

    @property
    def quantities(self) -> tuple[str, ...]:
        """``magnitude`` and those of x, y, z that were measured and that the method estimates."""
        shown = [
            axis
            for column, axis in enumerate(AXES)
            if np.isfinite(self.reference_n[:, column]).all() and np.isfinite(self.force_n[:, column]).any()
        ]
        return ("magnitude", *shown)

    def column(self, quantity: str) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Returns one of `quantities`: reference (n,), estimate (n,) and 90 % interval (n, 2), in newtons."""
        if quantity == "magnitude":
            return self.reference_magnitude_n, self.magnitude_n, self.magnitude_interval_n
        axis = AXES.index(quantity)
        return self.reference_n[:, axis], self.force_n[:, axis], self.interval_n[:, axis]

    def where(self, chosen: BoolArray | IntArray) -> "Predictions":
        """Returns the samples at ``chosen`` only: a mask (n,) or indices."""
        return replace(self, **{name: getattr(self, name)[chosen] for name in _ARRAYS})


_ARRAYS = [name for name in Predictions.__dataclass_fields__ if name not in ("method", "protocol")]
"""Names of the fields with a row for each sample."""


def collect(
    method: str,
    protocol: str,
    fold: str,
    dataset: Dataset,
    index: IntArray,
    estimates: Sequence[ForceEstimate],
    contact: BoolArray,
) -> Predictions:
    """Collects estimates and references of m samples of a dataset.

    Args:
        method: Label of the method.
        protocol: Name of the protocol.
        fold: Name of the split.
        dataset: The evaluated dataset.
        index: (m,) indices of the samples in ``dataset``.
        estimates: One estimate for each of ``index``.
        contact: (len(dataset),) True where the tip is in contact.
    """
    chosen = dataset.subset(index)
    shapes = np.empty(len(index), np.object_)
    shapes[:] = [e.shape for e in estimates]
    return Predictions(
        method=method, protocol=protocol, index=index, fold=np.full(len(index), fold), session=chosen.session,
        names=chosen.names, stamp_ns=chosen.stamp_ns, reference_n=chosen.force_n,
        reference_magnitude_n=chosen.magnitude_n, contact=contact[index],
        force_n=np.array([e.force_n for e in estimates], dtype=np.float64).reshape(-1, 3),
        magnitude_n=np.array([e.magnitude_n for e in estimates], dtype=np.float64),
        interval_n=np.array([e.interval_n for e in estimates], dtype=np.float64).reshape(-1, 3, 2),
        magnitude_interval_n=np.array([e.magnitude_interval_n for e in estimates], dtype=np.float64).reshape(-1, 2),
        status=np.array([e.status.value for e in estimates], dtype=np.str_),
        detail=np.array([e.detail for e in estimates], dtype=np.str_), shape=shapes,
    )  # fmt: skip


def concatenate(parts: Sequence[Predictions]) -> Predictions:
    """Returns the predictions of several splits of one protocol as one."""
    return replace(parts[0], **{name: np.concatenate([getattr(part, name) for part in parts]) for name in _ARRAYS})


def with_reference(predictions: Predictions, truth_n: FloatArray) -> Predictions:
    """Replaces the sensor's force by the true one, on the axes that the sensor measures.

    Args:
        predictions: Predictions with the sensor as reference.
        truth_n: (len(dataset), 3) true force in newtons, base frame; NaN where it is not known.

    Returns:
        The same estimates without the samples whose truth is not known.
    """
    truth = truth_n[predictions.index]
    columns = np.isfinite(predictions.reference_n).any(axis=0)  # (3,) axes that the sensor measures
    magnitude = np.sqrt(np.sum(truth[:, columns] ** 2, axis=1))
    against_truth = replace(predictions, reference_n=np.where(columns, truth, np.nan), reference_magnitude_n=magnitude)
    return against_truth.where(np.isfinite(magnitude))


def in_contact(dataset: Dataset, truth_n: FloatArray | None) -> BoolArray:
    """Finds the samples in contact: those whose force is above `CONTACT_N`.

    Args:
        dataset: n samples with the sensor's force.
        truth_n: (n, 3) true force in newtons, NaN where it is unknown; None: the sensor's force counts.

    Returns:
        (n,), True in contact.
    """
    if truth_n is None:
        return dataset.magnitude_n > CONTACT_N
    magnitude = np.sqrt(np.sum(truth_n[:, dataset.known] ** 2, axis=1))
    return np.where(np.isfinite(magnitude), magnitude, dataset.magnitude_n) > CONTACT_N
