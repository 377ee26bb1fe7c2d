"""What is judged, and everything that came out of it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ..datasets import Dataset, Protocol
from ..estimators import Estimator
from ..types import FloatArray
from ._bounds import Bounds
from ._outcome import Outcome
from ._protocols import Trained

__all__ = ["AS_SAVED", "BY_SESSION", "PROTOCOLS", "Candidate", "Evaluation", "Row"]

PROTOCOLS: tuple[Protocol, ...] = ("random", "blocked", "session")
"""The thesis's split, contiguous blocks with a gap, and whole sessions held out: the one that counts."""

AS_SAVED = "as saved"
"""Stands in place of a protocol where a saved model is scored without training it anew."""

BY_SESSION = (AS_SAVED, "catheter", "session", "standard")
"""Protocols whose test sessions were never seen."""

_STRICTNESS = (AS_SAVED, "thesis", "random", "blocked", "catheter", "session", "standard")
"""A saved model alone cannot be told beside others: it leads where nothing else was run."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A method to be judged: ``recipe`` is trained anew on every split.

    ``saved``: a fitted model, scored as it is on the sessions that are not in ``trained_sessions``
    (their fingerprints; names, where a model was made before these were kept);
    ``trained_fingerprint``: of the data it was trained on. Where a ``recipe`` begins with a model's weights,
    ``trained_sessions`` are that model's.
    """

    label: str
    recipe: Estimator
    saved: Estimator | None = None
    trained_sessions: frozenset[str] = frozenset()
    trained_fingerprint: str = ""


@dataclass(frozen=True, eq=False)
class Row:
    """One line of the table: a method under a protocol, against the sensor and, where known, truth and bound."""

    outcome: Outcome
    figures: dict[str, Any]
    truth_figures: dict[str, Any] | None = None
    bound_figures: dict[str, Any] | None = None
    fits: tuple[Trained, ...] = ()

    @property
    def method(self) -> str:
        """The candidate's label."""
        return self.outcome.method

    @property
    def protocol(self) -> str:
        """Its name, or `AS_SAVED`."""
        return self.outcome.protocol

    @property
    def mae_n(self) -> float:
        """Mean absolute error of the magnitude against the sensor, in newtons."""
        return float(self.figures["quantities"]["magnitude"]["mae_n"])


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Everything a report is made of.

    ``rows``: by protocol, within it the candidates in their order and the constant predictor last. ``fitted``: method
    -> its answers on the part it was trained on (thesis fig. 24). ``timing``: method -> microseconds a frame.
    ``notes``: what could not be done, and why. ``dataset``: the samples that were scored, drawn from ``everything``;
    ``truth_n`` (len(everything), 3) or None; ``bounds``: of ``dataset``, or None. ``disturbed``: method -> a table's
    lines (see `bear`), empty where it was not asked for.
    """

    dataset: Dataset
    everything: Dataset
    candidates: tuple[Candidate, ...]
    rows: tuple[Row, ...]
    fitted: dict[str, Outcome]
    timing: dict[str, dict[str, Any]]
    notes: tuple[str, ...]
    seed: int
    samples: int | None
    folds: int | None
    every: int = 1
    truth_n: FloatArray | None = field(default=None, repr=False)
    bounds: Bounds | None = field(default=None, repr=False)
    disturbed: Mapping[str, Sequence[Mapping[str, Any]]] = field(default_factory=dict[str, Any], repr=False)

    def row(self, method: str, protocol: str) -> Row | None:
        """The line of one method under one protocol, None where there is none."""
        return next((row for row in self.rows if (row.method, row.protocol) == (method, protocol)), None)

    @property
    def protocols(self) -> tuple[str, ...]:
        """Those that were run, in order."""
        return tuple(dict.fromkeys(row.protocol for row in self.rows))

    @property
    def honest(self) -> str:
        """The strictest protocol that was run: whole sessions before blocks before random frames."""
        return max((p for p in self.protocols if p in _STRICTNESS), key=_STRICTNESS.index)
