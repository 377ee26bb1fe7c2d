"""Train on one part, score on the rest: one method under one protocol."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..datasets import Dataset, Split
from ..estimators import Estimator, Progress
from ..types import BoolArray, IntArray
from ._outcome import Outcome, gather, join

__all__ = ["Trained", "places_in", "run_splits"]


@dataclass(frozen=True, eq=False)
class Trained:
    """What one fit was: the split, the seconds it took, the method's own facts, the fitted method itself."""

    protocol: str
    split: Split
    seconds: float
    facts: dict[str, Any]
    estimator: Estimator


def places_in(everything: Dataset, part: Dataset) -> IntArray:
    """(len(part),): where the samples of ``part`` stand in ``everything``, which it was drawn from."""
    place = {row: position for position, row in enumerate(everything.rows.tolist())}
    return np.array([place[row] for row in part.rows.tolist()], dtype=np.int64)


def run_splits(
    recipe: Estimator,
    label: str,
    protocol: str,
    splits: Sequence[Split],
    dataset: Dataset,
    contact: BoolArray,
    progress: Progress | None = None,
) -> tuple[Outcome, list[Trained]]:
    """``recipe`` trained anew on each split's training part and scored on its test part, all splits as one outcome."""
    parts: list[Outcome] = []
    fits: list[Trained] = []
    for number, split in enumerate(splits):
        what = f"{label}, {protocol} {number + 1}/{len(splits)}"

        def report(_: str, share: float, *, what: str = what, number: int = number) -> None:
            if progress is not None:
                progress(what, (number + share) / len(splits))

        report("", 0.0)
        start = time.perf_counter()
        fitted = recipe.unfitted().fit(dataset.subset(split.train), report)
        if len(split.calibrate):
            fitted = fitted.calibrate(dataset.subset(split.calibrate), report)
        fits.append(Trained(protocol, split, time.perf_counter() - start, fitted.describe(), fitted))
        found = fitted.answers(dataset.subset(split.test))
        parts.append(gather(label, protocol, split.name, dataset, split.test, found, contact))
        report("", 1.0)
    return join(parts), fits
