"""Errors held against the smallest that are possible: the ratio to the Cramer-Rao bound, by contact angle and force."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from ..datasets import Dataset
from ..types import BoolArray, FloatArray, IntArray
from ._outcome import Outcome
from ._stamps import values_at

__all__ = ["CONTACT_ANGLE_BINS_DEG", "FORCE_BOUND_BINS_N", "WAYS", "Bounds", "bound_at", "bound_figures"]

CONTACT_ANGLE_BINS_DEG = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0)
"""Edges of the bins of the angle between the tip's axis and the direction into the tissue."""
FORCE_BOUND_BINS_N = (0.01, 0.05, 0.1, 0.2, 0.35)
"""Edges of the bins of the force's magnitude in which ratios to the bound are told; contact begins at the first."""

WAYS = {
    "one_frame": "one frame",
    "all_frames": "all frames until then",
    "one_frame_broad": "one frame, force broad",
    "all_frames_broad": "all frames, force broad",
}
"""What a bound has seen and knows of the preset's forces beforehand, and how that is called in a report."""

_GAUSS_MEDIAN = 0.6744897501960817
"""Median of the absolute value of a Gaussian, over its standard deviation."""
_QUANTITIES = ("x", "y", "magnitude")


@dataclass(frozen=True, eq=False)
class Bounds:
    """The smallest possible errors of all samples of a dataset, and what they take for unknown.

    ``std_n``: each of `WAYS` -> (n, 3), see `bound_at`, or nothing where no session has one; ``contact_angle_deg``
    (n,). ``nuisances``: sentences without which no bound may be told; ``notes``: for which sessions there is none, and
    why.
    """

    std_n: Mapping[str, FloatArray]
    contact_angle_deg: FloatArray
    nuisances: tuple[str, ...]
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        shape = (len(self.contact_angle_deg), 3)
        if self.std_n and (self.std_n.keys() != WAYS.keys() or any(std.shape != shape for std in self.std_n.values())):
            got = ", ".join(f"{way} {std.shape}" for way, std in self.std_n.items())
            raise ValueError(f"std_n: expected {', '.join(WAYS)}, each of shape {shape}, or nothing; got {got}")

    def at(self, places: IntArray) -> "Bounds":
        """Of the samples at ``places`` only."""
        std = {way: values[places] for way, values in self.std_n.items()}
        return replace(self, std_n=std, contact_angle_deg=self.contact_angle_deg[places])

    def figures(self, outcome: Outcome) -> dict[str, Any]:
        """Way -> `bound_figures` of the outcome, which must be scored against the truth."""
        return {way: bound_figures(outcome, std, self.contact_angle_deg) for way, std in self.std_n.items()}


def bound_at(dataset: Dataset, bounds: Mapping[str, tuple[IntArray, FloatArray]]) -> FloatArray:
    """(n, 3): of every sample the bound on fx, fy and the magnitude, standard deviations in newtons; NaN: none known.

    ``bounds``: session -> stamps (m,) and (m, 3), as `limits.ForceBound` has them (``stamp_ns`` and
    ``fx_fy_magnitude_n``); more columns come too. Raises InputError where no sample has one.
    """
    return values_at(dataset, bounds, "bound", "make it from the truth beside these recordings")


def bound_figures(outcome: Outcome, bound_n: FloatArray, contact_angle_deg: FloatArray | None = None) -> dict[str, Any]:
    """Errors over their bounds, for x, y and magnitude: frames in contact that were answered and have a bound.

    ``bound_n`` (len(dataset), 3): see `bound_at`; ``contact_angle_deg`` (len(dataset),). Each ratio is the median of
    |error| / bound, divided by a Gaussian's 0.674: 1 is what an efficient method reaches. ``rms_ratio``: root mean
    square error over root mean square bound, which is what the bound bounds; a few large errors rule it. Keys: ``x``,
    ``y`` and ``magnitude``, each with ``all``, ``by_contact_angle`` and ``by_force``: ``n``, ``ratio``, ``rms_ratio``,
    ``median_error_n`` and ``median_bound_n``.
    """
    bound = bound_n[outcome.index]
    figures: dict[str, Any] = {}
    for place, quantity in enumerate(_QUANTITIES):
        reference, estimate, _ = outcome.column(quantity)
        error = np.abs(estimate - reference)
        use = outcome.contact & np.isfinite(error) & (bound[:, place] > 0)
        parts: dict[str, Any] = {"all": _ratio(error, bound[:, place], use)}
        if contact_angle_deg is not None:
            angle = contact_angle_deg[outcome.index]
            parts["by_contact_angle"] = _binned(error, bound[:, place], use, angle, CONTACT_ANGLE_BINS_DEG, "deg")
        size = outcome.reference_magnitude_n
        parts["by_force"] = _binned(error, bound[:, place], use, size, FORCE_BOUND_BINS_N, "n")
        figures[quantity] = parts
    return figures


def _binned(
    error: FloatArray, bound: FloatArray, use: BoolArray, by: FloatArray, edges: tuple[float, ...], unit: str
) -> list[dict[str, float | int]]:
    bins: list[dict[str, float | int]] = []
    for low, high in pairwise(edges):
        inside = use & (by >= low) & (by < high)
        bins.append({f"from_{unit}": low, f"below_{unit}": high, **_ratio(error, bound, inside)})
    return bins


def _ratio(error: FloatArray, bound: FloatArray, use: BoolArray) -> dict[str, float | int]:
    """NaN where nothing is left."""
    if not use.any():
        return {"n": 0} | dict.fromkeys(("ratio", "rms_ratio", "median_error_n", "median_bound_n"), math.nan)
    return {
        "n": int(use.sum()),
        "ratio": float(np.median(error[use] / bound[use])) / _GAUSS_MEDIAN,
        "rms_ratio": float(np.sqrt(np.mean(error[use] ** 2) / np.mean(bound[use] ** 2))),
        "median_error_n": float(np.median(error[use])),
        "median_bound_n": float(np.median(bound[use])),
    }
