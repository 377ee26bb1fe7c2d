"""Protocols: which samples a method is trained and scored on; a saved model is scored without training."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from ..datasets import Dataset, Protocol, Split
from ..errors import InputError
from ..estimators import Estimator, ModelFacts, Progress
from ..types import BoolArray, FloatArray, IntArray
from ._constant import Constant
from ._ground_truth import CramerRaoBounds
from ._kept_fits import KeptFits
from ._methods import Method
from ._metrics import score
from ._predictions import Predictions, collect, concatenate, with_reference
from ._trust import session_groups

PROTOCOLS: tuple[Protocol, ...] = ("random", "blocked", "session")
"""The thesis's split, contiguous blocks with a gap, and whole sessions held out: the one that counts."""

AS_SAVED = "as saved"
"""Replaces a protocol where a saved model is scored without training it anew."""

BY_SESSION = (AS_SAVED, "catheter", "session", "standard")
"""Protocols whose test sessions were never seen."""

STRICTNESS = (AS_SAVED, "thesis", "random", "blocked", "catheter", "session", "standard")
"""From lenient to strict. A saved model alone has nothing beside it: it leads only where nothing else was run."""


@dataclass(frozen=True, slots=True)
class ProtocolWords:
    """Wording of one protocol in a report.

    Attributes:
        name: Name of a line in a table.
        on: Begins a sentence.
        bar: Under a bar.
        of: "samples of ...".
        held: The part of a session that was held out.
    """

    name: str
    on: str
    bar: str
    of: str
    held: str


PROTOCOL_WORDS = {
    "random": ProtocolWords(
        "random frames", "On random frames", "random frames\n(the thesis's split)",
        "random frames", "the frames held out"),
    "thesis": ProtocolWords(
        "thesis protocol", "Under the thesis's protocol", "thesis protocol\n(random frames)",
        "the thesis's random split", "the frames held out"),
    "blocked": ProtocolWords(
        "blocks of time", "On blocks of time held out", "blocks of time\nwith a gap",
        "blocks of time held out", "the block held out"),
    "session": ProtocolWords(
        "sessions never seen", "On sessions never seen", "whole sessions\nnever seen",
        "sessions never seen", "all of its frames"),
    "standard": ProtocolWords(
        "standard protocol", "Under the standard protocol (sessions never seen)",
        "standard protocol\n(sessions never seen)", "sessions never seen", "all of its frames"),
    "catheter": ProtocolWords(
        "new sessions of a known catheter", "On new sessions of a catheter, trained on its first",
        "new sessions\nof a known catheter", "sessions never seen of a catheter known by one", "all of its frames"),
    AS_SAVED: ProtocolWords(
        "as saved, new sessions", "As saved, on new sessions", "model as saved,\nnew sessions",
        "sessions never seen", "all of its frames"),
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class FittedSplit:
    """One fit.

    Attributes:
        protocol: Name of the protocol.
        split: Indices of training and test samples.
        seconds: Duration of the fit in s.
        facts: Facts of the fitted method.
        estimator: The fitted method.
    """

    protocol: str
    split: Split
    seconds: float
    facts: ModelFacts
    estimator: Estimator


@dataclass(frozen=True, eq=False)
class MethodResult:
    """One method under one protocol.

    Attributes:
        predictions: Predictions of the test samples, with the sensor's force as reference.
        metrics: Their `score`.
        truth_metrics: `score` against the true force; None where it is not known.
        bound_ratios: `CramerRaoBounds.ratios` of the errors against the true force; None where there is no bound.
        fits: One fit for each split; empty for a saved model that is scored as it is.
    """

    predictions: Predictions
    metrics: dict[str, Any]
    truth_metrics: dict[str, Any] | None = None
    bound_ratios: dict[str, Any] | None = None
    fits: tuple[FittedSplit, ...] = ()

    @property
    def method(self) -> str:
        """The method's label."""
        return self.predictions.method

    @property
    def protocol(self) -> str:
        """Name of the protocol, or `AS_SAVED`."""
        return self.predictions.protocol

    @property
    def mae_n(self) -> float:
        """Mean absolute error of the magnitude against the sensor, in newtons."""
        return float(self.metrics["quantities"]["magnitude"]["mae_n"])


@dataclass(frozen=True, eq=False)
class ScoredData:
    """The samples that are scored, with their metadata and truth.

    Attributes:
        dataset: The n samples that are split and scored.
        everything: The dataset that they were drawn from.
        contact: (n,) True where the tip is in contact.
        truth_n: (n, 3) true force in newtons, or None.
        bounds: Bounds of the n samples, or None.
        seed: Seed of the bootstrap.
    """

    dataset: Dataset
    everything: Dataset
    contact: BoolArray
    truth_n: FloatArray | None = None
    bounds: CramerRaoBounds | None = None
    seed: int = 0

    def result(
        self, predictions: Predictions, constant: Predictions | None, fits: Sequence[FittedSplit] = ()
    ) -> MethodResult:
        """Scores predictions against the sensor and, where they are known, the true force and the bounds.

        Args:
            predictions: Predictions of one method under one protocol.
            constant: Predictions of the constant predictor for the same samples, or None.
            fits: The splits with their fitted methods, for the report.

        Returns:
            The predictions with their metrics and the ratios of the errors to the bounds.
        """
        angle = None if self.bounds is None else self.bounds.contact_angle_deg
        if angle is not None and not np.isfinite(angle).any():
            angle = None
        score_of = partial(
            score, groups=session_groups(self.dataset), base_frame=self.dataset.force_frames == {"base"}, seed=self.seed
        )
        metrics = score_of(
            predictions,
            None if constant is None else constant.magnitude_n,
            contact_angle_deg=None if angle is None else angle[predictions.index],
        )
        if self.truth_n is None:
            return MethodResult(predictions, metrics, fits=tuple(fits))
        against_truth = with_reference(predictions, self.truth_n)
        angle_of_truth = None if angle is None else angle[against_truth.index]
        true_metrics = score_of(against_truth, contact_angle_deg=angle_of_truth)
        ratios = None if self.bounds is None or not self.bounds.std_n else self.bounds.ratios(against_truth)
        return MethodResult(predictions, metrics, true_metrics, ratios, tuple(fits))


def index_in(everything: Dataset, part: Dataset) -> IntArray:
    """Finds the samples of a part in the dataset from which it was drawn.

    Args:
        everything: The dataset.
        part: m samples of it.

    Returns:
        (m,) indices in ``everything``.
    """
    index = {row: position for position, row in enumerate(everything.rows.tolist())}
    return np.array([index[row] for row in part.rows.tolist()], dtype=np.int64)


def run_protocol(
    method: Method,
    protocol: str,
    splits: Sequence[Split],
    data: ScoredData,
    constant: Predictions | None = None,
    progress: Progress | None = None,
    fits: KeptFits | None = None,
) -> MethodResult:
    """Trains a method anew on each split's training part and scores it on the test samples of all splits.

    Args:
        method: The method; its ``estimator`` is copied for each split.
        protocol: Name of the protocol.
        splits: Its splits.
        data: The samples.
        constant: The constant predictor under the same splits; None for the constant predictor itself.
        progress: Called with the current step and the share that is done.
        fits: Fits the method; None: nothing is kept on disk.
    """
    fits = fits or KeptFits()
    predictions_of_splits: list[Predictions] = []
    fitted_splits: list[FittedSplit] = []
    for number, split in enumerate(splits):
        step = f"{method.label}, {protocol} {number + 1}/{len(splits)}"

        # the defaults keep the step of this split
        def report(_: str, share: float, *, step: str = step, number: int = number) -> None:
            if progress is not None:
                progress(step, (number + share) / len(splits))

        report("", 0.0)
        fitted, seconds = fits.fit(method, split, data.dataset, report)
        fitted_splits.append(FittedSplit(protocol, split, seconds, fitted.describe(), fitted))
        predictions_of_splits.append(_predict(fitted, method.label, protocol, split.name, data, split.test))
        report("", 1.0)
    predictions = concatenate(predictions_of_splits)
    return data.result(predictions, constant or predictions, fitted_splits)


def _predict(fitted: Estimator, label: str, protocol: str, fold: str, data: ScoredData, index: IntArray) -> Predictions:
    return collect(label, protocol, fold, data.dataset, index, fitted.predict(data.dataset.subset(index)), data.contact)


def run_saved(method: Method, data: ScoredData, notes: list[str]) -> MethodResult | None:
    """Scores a saved model as it is on the sessions that it was not trained on.

    Args:
        method: The method.
        data: The samples.
        notes: Gets a sentence on the sessions that were left out, and why.

    Returns:
        The result; None where the method has no saved model, or was trained on all sessions.
    """
    if method.saved is None:
        return None
    seen, dataset = _seen(method, data), data.dataset
    if len(seen) == len(dataset.sessions):
        notes.append(
            f"{method.label} is not scored as saved: it was trained on all sessions of these data; "
            "its method, trained anew on every split, is."
        )
        return None
    if seen:
        notes.append(
            f"{method.label} as saved is scored without {len(seen)} of {len(dataset.sessions)} sessions, because it "
            f"was trained on them: {_some(seen)}."
        )
    index = np.flatnonzero(~np.isin(dataset.session, seen))
    return data.result(_predict(method.saved, method.label, AS_SAVED, AS_SAVED, data, index), None)


def run_saved_alone(methods: Sequence[Method], data: ScoredData, notes: list[str]) -> list[MethodResult]:
    """Scores saved models, and methods that need no fit, without any training, on sessions that are new to them all.

    Args:
        methods: All with a saved model, or without need of a fit.
        data: The samples.
        notes: Gets sentences on the sessions that were left out and on the constant predictor.

    Returns:
        The results of ``methods``, then that of the constant that fits these samples best.

    Raises:
        InputError: A method has to be fitted and has no saved model, or no session is left.
    """
    dataset = data.dataset
    seen: dict[str, None] = {}
    for method in methods:
        if method.as_it_comes is None:
            raise InputError(
                f"{method.label} is a method that has to be fitted, and without training only saved models can be "
                "scored; make one with `tipforce train`, or choose another protocol"
            )
        seen |= dict.fromkeys(_seen(method, data))
    index = np.flatnonzero(~np.isin(dataset.session, list(seen)))
    if not len(index):
        raise InputError(
            f"{dataset.title}: {', '.join(m.label for m in methods)} learnt from all of its sessions, none is left "
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
    mean = Constant().fit(dataset.subset(index))
    constant = _predict(mean, Constant.name, AS_SAVED, AS_SAVED, data, index)
    results: list[MethodResult] = []
    for method in methods:
        saved = method.as_it_comes
        assert saved is not None
        fit = FittedSplit(AS_SAVED, split, 0.0, saved.describe(), saved)
        predictions = _predict(saved, method.label, AS_SAVED, AS_SAVED, data, index)
        results.append(data.result(predictions, constant, [fit]))
    return [*results, data.result(constant, constant, [FittedSplit(AS_SAVED, split, 0.0, mean.describe(), mean)])]


def fine_tuning_notes(methods: Sequence[Method], dataset: Dataset) -> list[str]:
    """Returns a sentence for each method whose initial weights were trained on sessions of the evaluated data.

    Args:
        methods: The evaluated methods.
        dataset: The evaluated data.
    """
    seen_by = {method.label: _trained_on(method, dataset) for method in methods if method.saved is None}
    return [
        f"{label} is fine-tuned from weights that were trained on {len(seen)} of {len(dataset.sessions)} sessions of "
        f"these data ({_some(seen)}): where they are tested on they are not new to it."
        for label, seen in seen_by.items()
        if seen
    ]


def _seen(method: Method, data: ScoredData) -> list[str]:
    """Returns the sessions of the scored data that the saved model was trained on."""
    if method.trained_fingerprint == data.everything.fingerprint():
        return list(data.dataset.sessions)
    return _trained_on(method, data.dataset)


def _trained_on(method: Method, dataset: Dataset) -> list[str]:
    return list(dataset.sessions_among(method.trained_sessions))


def _some(names: Sequence[str]) -> str:
    more = f" and {len(names) - 5} more" if len(names) > 5 else ""
    return ", ".join(names[:5]) + more
