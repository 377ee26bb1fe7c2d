"""The knowledge of a simulation about each sample: true force, and Cramer-Rao bound of any estimator's error."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from ..datasets import Dataset
from ..errors import InputError
from ..types import BoolArray, FloatArray, IntArray
from ._predictions import Predictions
from ._statistics import CONTACT_ANGLE_BINS_DEG

FORCE_BOUND_BINS_N = (0.01, 0.05, 0.1, 0.2, 0.35)
"""Edges of the bins of the force's magnitude in which ratios to the bound are given; contact begins at the first."""

BOUND_KINDS = {
    "one_frame": "one frame",
    "all_frames": "all frames until then",
    "one_frame_broad": "one frame, force broad",
    "all_frames_broad": "all frames, force broad",
}
"""The kinds of bound and their names in a report: from which frames, and with which prior on the force.

The prior is that of the preset's forces, or a broad one.
"""

_GAUSS_MEDIAN = 0.6744897501960817
"""Median of the absolute value of a Gaussian, over its standard deviation."""
_QUANTITIES = ("x", "y", "magnitude")
_NEAR_NS = 5_000_000
"""A value belongs to a sample when their stamps differ by no more: a quarter of a frame at 50 Hz."""
_OWN_NS = 500_000
"""The values of a session have the stamps of its samples, up to a video's rounding; two sessions jitter apart."""


@dataclass(frozen=True, eq=False)
class CramerRaoBounds:
    """Posterior Cramer-Rao bounds of all n samples of a dataset, as standard deviations in newtons.

    Attributes:
        std_n: Each of `BOUND_KINDS` -> (n, 3), the bounds on fx, fy and the magnitude (see `bound_at`); empty where no
            session has one.
        contact_angle_deg: (n,) angle between the tip's axis and the direction into the tissue.
        nuisances: Sentences on the quantities that the bounds treat as unknown, without which no bound has a meaning.
        notes: Sentences on which sessions have no bound, and why.
    """

    std_n: Mapping[str, FloatArray]
    contact_angle_deg: FloatArray
    nuisances: tuple[str, ...]
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        shape = (len(self.contact_angle_deg), 3)
        kinds = self.std_n.keys()
        if self.std_n and (kinds != BOUND_KINDS.keys() or any(std.shape != shape for std in self.std_n.values())):
            got = ", ".join(f"{kind} {std.shape}" for kind, std in self.std_n.items())
            raise ValueError(f"std_n: expected {', '.join(BOUND_KINDS)}, each of shape {shape}, or nothing; got {got}")

    def at(self, index: IntArray) -> "CramerRaoBounds":
        """Returns the bounds of the samples at ``index`` only."""
        std = {kind: values[index] for kind, values in self.std_n.items()}
        return replace(self, std_n=std, contact_angle_deg=self.contact_angle_deg[index])

    def ratios(self, predictions: Predictions) -> dict[str, Any]:
        """Returns kind of bound -> `bound_ratios` of the predictions, whose reference must be the true force."""
        return {kind: bound_ratios(predictions, std, self.contact_angle_deg) for kind, std in self.std_n.items()}


def truth_at(dataset: Dataset, truths: Mapping[str, tuple[IntArray, FloatArray]]) -> FloatArray:
    """Finds the true force of every sample by session and time stamp.

    Args:
        dataset: n samples.
        truths: Session -> stamps (m,) and forces (m, 3) in newtons, base frame.

    Returns:
        (n, 3) forces in newtons, NaN where none is known.

    Raises:
        InputError: No sample has a truth, or the truth of a session is that of another recording.
    """
    remedy = "state as truth the folder that `tipforce simulate` wrote for these data"
    return _values_at(dataset, truths, "truth", remedy)


def bound_at(dataset: Dataset, bounds: Mapping[str, tuple[IntArray, FloatArray]]) -> FloatArray:
    """Finds the Cramer-Rao bound of every sample by session and time stamp.

    Args:
        dataset: n samples.
        bounds: Session -> stamps (m,) and rows (m, k): standard deviations in newtons of fx, fy and the magnitude,
            then any further columns.

    Returns:
        (n, k), NaN where none is known.

    Raises:
        InputError: No sample has a bound, or the bounds of a session are those of another recording.
    """
    return _values_at(dataset, bounds, "bound", "make it from the truth beside these recordings")


def bound_ratios(
    predictions: Predictions, bound_n: FloatArray, contact_angle_deg: FloatArray | None = None
) -> dict[str, Any]:
    """Computes the errors over their Cramer-Rao bounds, for the samples in contact that have an estimate and a bound.

    Each ratio is the median of |error| / bound, divided by a Gaussian's 0.674: an efficient estimator has 1.
    ``rms_ratio`` is the root mean square error over the root mean square bound, the figure that the bound limits; a
    few large errors dominate it.

    Args:
        predictions: Predictions whose reference is the true force.
        bound_n: (len(dataset), 3) standard deviations in newtons, see `bound_at`.
        contact_angle_deg: (len(dataset),) angle between the tip's axis and the direction into the tissue.

    Returns:
        ``x``, ``y`` and ``magnitude``, each with ``all``, ``by_contact_angle`` (where known) and ``by_force``: ``n``,
        ``ratio``, ``rms_ratio``, ``median_error_n`` and ``median_bound_n``; NaN where nothing is left.
    """
    bound = bound_n[predictions.index]
    ratios: dict[str, Any] = {}
    for column, quantity in enumerate(_QUANTITIES):
        reference, estimate, _ = predictions.column(quantity)
        error = np.abs(estimate - reference)
        use = predictions.contact & np.isfinite(error) & (bound[:, column] > 0)
        parts: dict[str, Any] = {"all": _ratio(error, bound[:, column], use)}
        if contact_angle_deg is not None:
            angle = contact_angle_deg[predictions.index]
            parts["by_contact_angle"] = _binned(error, bound[:, column], use, angle, CONTACT_ANGLE_BINS_DEG, "deg")
        size = predictions.reference_magnitude_n
        parts["by_force"] = _binned(error, bound[:, column], use, size, FORCE_BOUND_BINS_N, "n")
        ratios[quantity] = parts
    return ratios


def _binned(
    error: FloatArray, bound: FloatArray, use: BoolArray, by: FloatArray, edges: tuple[float, ...], unit: str
) -> list[dict[str, float | int]]:
    """Compares errors with their Cramer-Rao bounds in bins of another quantity.

    Args:
        error: (n,) absolute errors in newtons.
        bound: (n,) bounds of the standard deviation in newtons.
        use: (n,) whether the sample counts.
        by: (n,) quantity by which the samples are put in bins, in ``unit``.
        edges: limits of the bins in ``unit``.
        unit: unit of the quantity, for the names of the limits.

    Returns:
        For each bin its limits ``from_`` and ``below_``, and the result of `_ratio` for its samples.
    """
    bins: list[dict[str, float | int]] = []
    for low, high in pairwise(edges):
        inside = use & (by >= low) & (by < high)
        bins.append({f"from_{unit}": low, f"below_{unit}": high, **_ratio(error, bound, inside)})
    return bins


def _ratio(error: FloatArray, bound: FloatArray, use: BoolArray) -> dict[str, float | int]:
    """Returns count, ratio of error to bound (1: it is reached), and medians in newtons, of the samples in ``use``."""
    if not use.any():
        return {"n": 0} | dict.fromkeys(("ratio", "rms_ratio", "median_error_n", "median_bound_n"), math.nan)
    return {
        "n": int(use.sum()),
        "ratio": float(np.median(error[use] / bound[use])) / _GAUSS_MEDIAN,
        "rms_ratio": float(np.sqrt(np.mean(error[use] ** 2) / np.mean(bound[use] ** 2))),
        "median_error_n": float(np.median(error[use])),
        "median_bound_n": float(np.median(bound[use])),
    }


def _values_at(
    dataset: Dataset, values: Mapping[str, tuple[IntArray, FloatArray]], kind: str, remedy: str
) -> FloatArray:
    """Finds the value of every sample by session and nearest stamp.

    Args:
        dataset: n samples.
        values: session -> stamps (m,) and rows (m, k).
        kind: name of the values, for messages.
        remedy: advice for messages.

    Returns:
        (n, k); NaN where there is no row within 5 ms.

    Raises:
        InputError: no sample has any, or the stamps of a session are those of another recording: half of those found
            are more than 0.5 ms off.
    """
    columns = next((rows.shape[1] for _, rows in values.values()), 3)
    matched = np.full((len(dataset), columns), np.nan)
    for session, (stamps, session_values) in values.items():
        rows = np.flatnonzero(dataset.session == session)
        if not len(rows) or not len(stamps):
            continue
        after = np.clip(np.searchsorted(stamps, dataset.stamp_ns[rows]), 1, max(1, len(stamps) - 1))
        before = after - 1
        after = np.minimum(after, len(stamps) - 1)
        sample_ns = dataset.stamp_ns[rows]
        nearest = np.where(np.abs(stamps[before] - sample_ns) <= np.abs(stamps[after] - sample_ns), before, after)
        distance_ns = np.abs(stamps[nearest] - sample_ns)
        is_near = distance_ns <= _NEAR_NS
        if is_near.any() and np.median(distance_ns[is_near]) > _OWN_NS:
            raise InputError(
                f"the {kind} of {session} belongs to another recording than that of {dataset.title}: its stamps are "
                f"{1e-6 * np.median(distance_ns[is_near]):.1f} ms from those of the samples; {remedy}"
            )
        matched[rows[is_near]] = session_values[nearest[is_near]]
    if np.isnan(matched).all():
        ours, theirs = ", ".join(dataset.sessions[:5]), ", ".join(list(values)[:5]) or "none"
        raise InputError(
            f"no sample of {dataset.title} has a {kind}: its sessions are {ours}, the {kind} is of {theirs}; {remedy}"
        )
    return matched
