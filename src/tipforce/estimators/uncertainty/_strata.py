"""Intervals of the magnitude that hold for small and large forces alike, with separate lower and upper ends.

One half-width for all forces holds 90 % of all frames and hides that it misses most of the large forces, which are rare
and which a regression reads too small. Here the magnitude's interval is the hull of two conformal sets. The first holds
for each force (label-conditional, Vovk, Lindsay, Nouretdinov and Gammerman 2003): a force belongs to the set if the
estimate is plausible for forces of its stratum. So the coverage holds for every true force, and the computation needs
no knowledge of it. The second set holds for each estimate (Mondrian): for all forces with an estimate of this size.

Within a stratum, the lower and the upper end are the 5 and 95 % quantiles of the signed errors about their median,
where each session has the same weight. One factor widens both so that they hold 90 % of a new session (as in
`_conformal`). With fewer than 20 sessions in a stratum the factor is Student's (the prediction of one more session from
a few), and the ends are not nearer than those of the stratum below, or of all frames for strata of the estimate.
"""

import math
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.special import ndtri, stdtrit

from ...types import FloatArray

TAIL_SHARE = 0.05
"""Share of the errors beyond either end."""
_COVERAGE = 1.0 - 2.0 * TAIL_SHARE
MIN_CONFORMAL_SESSIONS = 20
"""Number of sessions from which on the factor is conformal. It is finite from 9 on, but up to 19 it is about the
largest error of all sessions, and Student's factor holds as much with less width (docs/results/trust.md)."""
STRATUM_WIDTH_N, MIN_STRATA, MAX_STRATA = 0.1, 3, 8
"""Width of a stratum: a quarter of the force window, less where forces are small; smallest and largest number of
strata."""
LARGEST_FORCE_QUANTILE = 0.99
"""Quantile of the forces up to which there are strata; the last one is open."""
MAX_STUDENT_FACTOR = 5.0
"""Largest of Student's factors: one or two sessions predict a further one badly, and an interval must be finite."""
MIN_RELATIVE_DISTANCE = 1e-3
"""Smallest distance of an end from the median, relative to the larger one: all errors may be equal."""


@dataclass(frozen=True, eq=False)
class ForceStrata:
    """Ends of the magnitude's interval in strata of the force.

    Attributes:
        edges_n: (k + 1,) edges of the strata in newtons, from 0 to infinity.
        by_force: (k, 2) smallest and largest error (force - estimate) of forces in each stratum, in the unit of the
            intervals: newtons, or standard deviations of the estimate.
        by_estimate: (k, 2) the same of estimates in each stratum.
    """

    edges_n: FloatArray
    by_force: FloatArray
    by_estimate: FloatArray
    _rows: tuple[tuple[float, ...], ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Checks the arrays, and keeps rows for `interval`: edges of a stratum, ends by force, ends by estimate."""
        count = len(self.edges_n) - 1
        for name, ends in (("by_force", self.by_force), ("by_estimate", self.by_estimate)):
            if ends.shape != (count, 2) or not (np.isfinite(ends).all() and (ends[:, 0] <= ends[:, 1]).all()):
                raise ValueError(f"strata: {name} must be {count} pairs of ends, got {ends.tolist()}")
        edges = self.edges_n.tolist()
        if count < 1 or edges[0] != 0.0 or edges[-1] != math.inf or not (np.diff(self.edges_n) > 0).all():
            raise ValueError(f"strata: edges must rise from 0 to infinity, got {edges}")
        columns = (edges[:-1], edges[1:], *self.by_force.T.tolist(), *self.by_estimate.T.tolist())
        object.__setattr__(self, "_rows", tuple(zip(*columns, strict=True)))

    @classmethod
    def symmetric(cls, half: float) -> "ForceStrata":
        """Returns one stratum with the half-width ``half``."""
        ends = np.array([[-half, half]])
        return cls(np.array([0.0, math.inf]), ends, ends)

    def interval(self, magnitude_n: float, unit_n: float = 1.0) -> tuple[float, float]:
        """Returns the ends of the interval in newtons for an estimate; they enclose the estimate.

        Args:
            magnitude_n: estimated magnitude.
            unit_n: newtons of the unit of the ends.
        """
        low = high = magnitude_n
        # by force: all forces of a stratum for which this estimate is plausible
        for start, end, least, largest, *_ in self._rows:
            below, above = magnitude_n + least * unit_n, magnitude_n + largest * unit_n
            below, above = max(below, start), min(above, end)
            if below <= above:
                low, high = min(low, below), max(high, above)
        # by estimate: the ends of the stratum in which the estimate is
        row = self._rows[bisect_right(self._rows, magnitude_n, hi=len(self._rows), key=_start) - 1]
        return max(0.0, min(low, magnitude_n + row[4] * unit_n)), max(high, magnitude_n + row[5] * unit_n)

    def values(self) -> dict[str, Any]:
        """Returns JSON values; the last edge is left out. Inverse: `of`."""
        return {
            "edges_n": self.edges_n[:-1].tolist(),
            "by_force": self.by_force.tolist(),
            "by_estimate": self.by_estimate.tolist(),
        }

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> "ForceStrata":
        """Makes the strata from the return value of `values`.

        Raises:
            KeyError, TypeError, ValueError: they are no strata.
        """
        edges = np.append(np.array(values["edges_n"], np.float64), math.inf)
        if len(edges) > MAX_STRATA + 1:
            raise ValueError(f"strata: at most {MAX_STRATA} are expected, got {len(edges) - 1}")
        return cls(edges, *(np.array(values[name], np.float64) for name in ("by_force", "by_estimate")))


def _start(row: Sequence[float]) -> float:
    return row[0]


def fit_strata(
    estimate_n: FloatArray, force_n: FloatArray, session: npt.NDArray[np.str_], unit_n: FloatArray | None = None
) -> ForceStrata:
    """Finds the ends from samples that the method was not trained on.

    Args:
        estimate_n: (n,) estimated magnitudes.
        force_n: (n,) measured magnitudes.
        session: (n,) sessions.
        unit_n: (n,) unit of the errors, such as each estimate's standard deviation; None: newtons.

    Returns:
        The ends of each stratum, by measured and by estimated force.
    """
    error = (force_n - estimate_n) / (1.0 if unit_n is None else unit_n)
    largest = float(np.quantile(force_n, LARGEST_FORCE_QUANTILE))
    width = min(STRATUM_WIDTH_N, max(largest, 1e-6) / MIN_STRATA)
    inner = np.arange(1, min(int(largest / width + 1e-9), MAX_STRATA - 1) + 1) * width
    edges = np.concatenate([[0.0], inner, [math.inf]])
    overall = _ends(error, session)[0]
    return ForceStrata(
        edges,
        _by_stratum(force_n, error, session, edges, None),
        _by_stratum(estimate_n, error, session, edges, overall),
    )


def _by_stratum(
    by: FloatArray, error: FloatArray, session: npt.NDArray[np.str_], edges: FloatArray, least: FloatArray | None
) -> FloatArray:
    """Returns the ends (k, 2) of the errors (n,) in the strata of ``by`` (n,), the measured or the estimated force, N.

    In a stratum with few sessions the ends are not nearer than those of the stratum below, or than ``least`` (2,). The
    strata have the ``edges`` (k + 1,), N.
    """
    strata: list[FloatArray] = []
    for low, high in pairwise(edges):
        inside = (by >= low) & (by < high)
        ends, sessions = _ends(error[inside], session[inside]) if inside.any() else (np.full(2, np.nan), 0)
        if sessions < MIN_CONFORMAL_SESSIONS:
            candidates = [ends, *strata[-1:], *([] if least is None else [least])]
            if not strata and np.isnan(ends).all() and least is None:
                candidates = [_ends(error, session)[0]]
            ends = np.array([np.nanmin([each[0] for each in candidates]), np.nanmax([each[1] for each in candidates])])
        strata.append(ends)
    return np.array(strata)


def _ends(error: FloatArray, session: npt.NDArray[np.str_]) -> tuple[FloatArray, int]:
    """Returns the ends (2,) between which 90 % of a new session's errors (n,) are, and the number of sessions.

    They are the quantiles about the median, times a factor: see the module.
    """
    _, index, counts = np.unique(session, return_inverse=True, return_counts=True)
    sessions = len(counts)
    mass = 1.0 / (sessions * counts[index])  # each session has the same weight
    order = np.argsort(error)
    reached = np.cumsum(mass[order])
    low, median, high = error[order[np.minimum(np.searchsorted(reached, _SHARES), len(error) - 1)]].tolist()
    below, above = median - low, high - median
    least = max(MIN_RELATIVE_DISTANCE * max(below, above), np.finfo(np.float64).tiny)
    below, above = max(below, least), max(above, least)
    score = np.where(error > median, (error - median) / above, (median - error) / below)  # 1: at an end
    if sessions >= MIN_CONFORMAL_SESSIONS:
        ranked = np.argsort(score)
        # a new session has the mass 1 / (sessions + 1) at infinity
        held = np.cumsum(mass[ranked]) * sessions / (sessions + 1)
        factor = float(score[ranked[np.searchsorted(held, _COVERAGE - 1e-9)]])
    else:
        factor = student_factor(sessions)
    return np.array([median - factor * below, median + factor * above]), sessions


_SHARES = np.array([TAIL_SHARE, 0.5, 1.0 - TAIL_SHARE]) - 1e-9  # less the rounding of cumulative sums


def student_factor(sessions: int) -> float:
    """Returns the factor by which the 90 % prediction of one more normal value from few sessions is wider.

    >>> [round(student_factor(sessions), 2) for sessions in (1, 3, 8)]
    [4.7, 2.05, 1.22]
    """
    several = max(sessions, 2)
    wider = float(stdtrit(several - 1, 1.0 - TAIL_SHARE) / ndtri(1.0 - TAIL_SHARE)) * math.sqrt(1.0 + 1.0 / several)
    return min(wider, MAX_STUDENT_FACTOR)
