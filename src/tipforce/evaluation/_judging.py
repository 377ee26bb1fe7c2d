"""From answers to a line of the table: told apart by contact, scored against sensor, truth and bounds."""

from collections.abc import Callable, Sequence

import numpy as np

from ..dataset import Dataset
from ..types import BoolArray, FloatArray
from ._bounds import Bounds
from ._evaluation import AS_SAVED, Candidate, Row
from ._metrics import score
from ._outcome import CONTACT_N, Outcome, against, gather
from ._protocols import Trained, answers

__all__ = ["in_contact", "row_of", "saved_row"]


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
    seen = [name for name in dataset.sessions if name in candidate.trained_sessions]
    if candidate.trained_fingerprint == everything.fingerprint() or len(seen) == len(dataset.sessions):
        notes.append(
            f"{candidate.label} is not scored as saved: it was trained on all sessions of these data; "
            "its recipe, trained anew on every split, is."
        )
        return None
    if seen:
        more = f" and {len(seen) - 5} more" if len(seen) > 5 else ""
        notes.append(
            f"{candidate.label} as saved is scored without {len(seen)} of {len(dataset.sessions)} sessions, because it "
            f"was trained on sessions of these names: {', '.join(seen[:5])}{more}."
        )
    index = np.flatnonzero(~np.isin(dataset.session, seen))
    found = answers(candidate.saved, dataset, index, everything)
    return judge(gather(candidate.label, AS_SAVED, AS_SAVED, dataset, index, found, contact), None)
