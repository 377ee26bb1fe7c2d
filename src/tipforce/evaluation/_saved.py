"""Saved models as they are, on sessions that they were not trained on."""

from collections.abc import Callable, Sequence

import numpy as np

from ..datasets import Dataset, Split
from ..errors import InputError
from ..types import BoolArray
from ._constant import Constant
from ._evaluation import AS_SAVED, Candidate, Row
from ._outcome import gather
from ._protocols import Trained

__all__ = ["begun_notes", "saved_alone", "saved_row"]


def saved_row(
    candidate: Candidate,
    dataset: Dataset,
    everything: Dataset,
    contact: BoolArray,
    judge: Callable[..., Row],
    notes: list[str],
) -> Row | None:
    """The saved model on the sessions it was not trained on; adds to ``notes`` why some or all were left out."""
    if candidate.saved is None:
        return None
    seen = _seen(candidate, dataset, everything)
    if len(seen) == len(dataset.sessions):
        notes.append(
            f"{candidate.label} is not scored as saved: it was trained on all sessions of these data; "
            "its recipe, trained anew on every split, is."
        )
        return None
    if seen:
        notes.append(
            f"{candidate.label} as saved is scored without {len(seen)} of {len(dataset.sessions)} sessions, because it "
            f"was trained on them: {_some(seen)}."
        )
    index = np.flatnonzero(~np.isin(dataset.session, seen))
    found = candidate.saved.answers(dataset.subset(index))
    return judge(gather(candidate.label, AS_SAVED, AS_SAVED, dataset, index, found, contact), None)


def begun_notes(candidates: Sequence[Candidate], dataset: Dataset) -> list[str]:
    """A sentence for each method that begins with weights which had learnt from sessions of ``dataset``."""
    found = {candidate.label: _taught(candidate, dataset) for candidate in candidates if candidate.saved is None}
    return [
        f"{label} begins with weights that had learnt from {len(seen)} of {len(dataset.sessions)} sessions of these "
        f"data ({_some(seen)}): where they are tested on they are not new to it."
        for label, seen in found.items()
        if seen
    ]


def saved_alone(
    candidates: Sequence[Candidate],
    dataset: Dataset,
    everything: Dataset,
    contact: BoolArray,
    judge: Callable[..., Row],
    notes: list[str],
) -> list[Row]:
    """All saved models on the sessions that none of them was trained on, then the constant that fits these best.

    Raises InputError where a candidate is no saved model, or no session is left.
    """
    seen: dict[str, None] = {}
    for candidate in candidates:
        if candidate.saved is None:
            raise InputError(
                f"{candidate.label} is a method, and without training only saved models can be scored; make one with "
                "`tipforce train`, or choose another protocol"
            )
        seen |= dict.fromkeys(_seen(candidate, dataset, everything))
    index = np.flatnonzero(~np.isin(dataset.session, list(seen)))
    if not len(index):
        raise InputError(
            f"{dataset.title}: {', '.join(c.label for c in candidates)} learnt from all of its sessions, none is left "
            "to score on; give it sessions that are new to it, or choose another protocol"
        )
    if seen:
        notes.append(
            f"Scored without {len(seen)} of {len(dataset.sessions)} sessions, because a model was trained on "
            f"them: {_some(list(seen))}."
        )
    notes.append(
        "Nothing was trained, so the constant predictor answers the mean of the very samples that it is tested on: the "
        "best that any constant could do."
    )
    split = Split(AS_SAVED, np.zeros(0, np.int64), index)

    def outcome_of(label: str, trained: Trained) -> Row:
        found = trained.estimator.answers(dataset.subset(index))
        outcome = gather(label, AS_SAVED, AS_SAVED, dataset, index, found, contact)
        return judge(outcome, constant.outcome if label != Constant.name else outcome, [trained])

    mean = Constant().fit(dataset.subset(index))
    constant = outcome_of(Constant.name, Trained(AS_SAVED, split, 0.0, {}, mean))
    rows: list[Row] = []
    for candidate in candidates:
        assert candidate.saved is not None
        trained = Trained(AS_SAVED, split, 0.0, candidate.saved.describe(), candidate.saved)
        rows.append(outcome_of(candidate.label, trained))
    return [*rows, constant]


def _seen(candidate: Candidate, dataset: Dataset, everything: Dataset) -> list[str]:
    """Sessions of ``dataset`` that the saved model was trained on."""
    if candidate.trained_fingerprint == everything.fingerprint():
        return list(dataset.sessions)
    return _taught(candidate, dataset)


def _taught(candidate: Candidate, dataset: Dataset) -> list[str]:
    return list(dataset.sessions_among(candidate.trained_sessions))


def _some(names: Sequence[str]) -> str:
    more = f" and {len(names) - 5} more" if len(names) > 5 else ""
    return ", ".join(names[:5]) + more
