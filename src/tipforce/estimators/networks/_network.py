"""What all methods that are networks share: fit, export, hold the export to the network, answer by the graph alone."""

import contextlib
import json
import math
import tempfile
from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
import numpy.typing as npt

from ...dataset import Dataset
from ...errors import InputError, ModelError, NotFittedError
from ...learning import (
    LOG,
    Recipe,
    Samples,
    Task,
    export_graph,
    learn,
    network_of,
    parity_n,
    require_torch,
    validation_part,
    weights_of,
)
from ...types import BoolArray, Context, FloatArray, ForceEstimate, Observation
from .._answers import AXES, Answers, Interval
from .._base import Estimator, Progress
from .._conformal import interval_from
from .._reading import Refusal, actuation_names, read_actuation
from .._words import Words
from ._graph import Graph
from ._prepared import Forms, Prepared, prepare
from ._words import network_words

__all__ = ["MIN_SAMPLES", "PARITY_N", "NetworkEstimator", "Reader"]

MIN_SAMPLES = 20
"""Fewer samples cannot be trained and validated on."""

PARITY_N = 1e-3
"""The graph's answers may differ from the trained network's by less than this, or training fails: it keeps weights in
half precision, and a tenth of a gram is far below what any picture tells."""

MODEL = "model.onnx"

COMPARED = 8
"""So many samples' answers are compared."""

Arrays = dict[str, npt.NDArray[Any]]


Reader = Callable[[Observation], Arrays | Refusal]
"""Makes the network's inputs, all but the actuation, of the observations of one session."""

Answering = Callable[[int, Mapping[str, npt.NDArray[Any]]], ForceEstimate]
"""Makes an estimate of a stamp and what the graph returned for one sample, (1, ...) each."""


@dataclass(frozen=True, eq=False)
class _Fitted:
    """Everything that was learnt."""

    actuation: tuple[str, ...]
    known: BoolArray
    graph: Graph
    data: bytes
    log: bytes
    interval: Interval
    facts: dict[str, Any]


class NetworkEstimator(Estimator):
    """A network behind the face of all methods; it remembers nothing of earlier frames.

    A method states what its network is given (`forms`, `reader`), the task that trains it (`task`), and its settings,
    which derive from `Recipe` and have ``view``, ``actuation`` and ``components``.
    """

    outputs: ClassVar[tuple[str, ...]] = ("force_n",)
    """Names of what the network returns, in order."""

    def __init__(self, settings: Any = None) -> None:
        self.settings = settings or self.settings_type()
        self.fitted_: _Fitted | None = None

    @abstractmethod
    def forms(self, *, training: bool) -> Forms:
        """What `reader` makes of an observation: name -> shape and dtype; to train, or as the graph takes it."""

    @abstractmethod
    def reader(self, context: Context, *, training: bool) -> Reader:
        """Makes those of the observations of one session."""

    @abstractmethod
    def task(self, components: int, actuation: tuple[tuple[float, float], ...]) -> Task:
        """What is trained; ``actuation``: mean and deviation of each actuation value."""

    @property
    def needed_actuation(self) -> tuple[str, ...]:
        """What it was trained with. Raises NotFittedError before ``fit``."""
        return self._known().actuation

    def fit(self, dataset: Dataset, progress: Progress | None = None) -> Self:
        """Train on ``dataset``, all but a part that says when to stop and how wide the interval is.

        Raises InputError for fewer than `MIN_SAMPLES` samples, data without pictures or force components, actuation
        that they do not have, or training that diverges; MissingExtraError without torch; ModelError where the exported
        graph answers otherwise than the network.
        """
        return self.fit_from(dataset, progress)

    def fit_from(
        self,
        dataset: Dataset,
        progress: Progress | None = None,
        *,
        start: "NetworkEstimator | None" = None,
        folder: Path | None = None,
        resume: bool = False,
    ) -> Self:
        """`fit` that begins with the weights of ``start``, and can be killed and gone on with.

        ``folder`` takes the prepared pictures, a checkpoint after every epoch and the log; ``resume``: go on from what
        is there. Without it a temporary one is used and removed.
        """
        report = progress or _silent
        require_torch()
        if len(dataset) < MIN_SAMPLES:
            raise InputError(
                f"{dataset.title}: has {len(dataset)} samples; training {self.name} needs at least {MIN_SAMPLES}"
            )
        known = _components(dataset, self.settings.components, self.name)
        names = actuation_names(self.settings.actuation, dataset)
        with contextlib.ExitStack() as stack:
            place = folder or Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="tipforce-")))
            prepared = self._prepared(dataset, names, place, lambda share: report("preparing pictures", 0.1 * share))
            samples = _samples(dataset, prepared, known)
            part = validation_part(samples.session, self.settings)
            task = self.task(int(known.sum()), _spread(samples.inputs.get("actuation")))
            learnt = learn(
                task, samples, part, self.settings,
                start=None if start is None else weights_of(start.files()[MODEL]),
                folder=folder, resume=resume,
                progress=lambda what, share: report(what, 0.1 + 0.85 * share),
            )  # fmt: skip
            kept, left_out = prepared.kept, len(dataset) - len(prepared.kept)
            del prepared, samples  # before the files they are maps of
        report("exporting", 0.95)
        network, held_out = network_of(task, learnt.weights), dataset.subset(kept[part.validate])
        inputs = {**self.forms(training=False), **_actuation_form(names)}
        noted = {"method": self.name, "components": ", ".join(np.array(AXES)[known])}
        data = export_graph(network, inputs, self.outputs, noted)
        deviation_n = parity_n(data, network, self._inputs(held_out.subset(np.arange(len(held_out))[:COMPARED]), names))
        if not deviation_n < PARITY_N:
            raise ModelError(
                f"the exported graph differs from the trained network by up to {deviation_n:.2g} N, more than "
                f"{PARITY_N:g} N: there is no model; train it with a smaller rate"
            )
        self.fitted_ = _Fitted(
            actuation=names,
            known=known,
            graph=Graph(data, MODEL),
            data=data,
            log="".join(json.dumps(row) + "\n" for row in learnt.rows).encode(),
            interval=_UNKNOWN,
            facts={
                **learnt.facts,
                "samples": len(kept),
                "samples_left_out": left_out,
                "parity_with_network_n": deviation_n,
                "started_from": None if start is None else start.describe()["network"],
            },
        )
        # the part that chose the epoch promises nothing about another session, even where it was whole ones
        drawn = f"{'held-out' if part.sessions else 'random'} samples that also chose the epoch,"
        self._set_interval(held_out, drawn, lambda share: report("measuring", 0.96 + 0.04 * share))
        return self

    def _prepared(
        self, dataset: Dataset, names: tuple[str, ...], folder: Path, report: Callable[[float], None]
    ) -> Prepared:
        readers: dict[str, Reader] = {}

        def read(session: str, observation: Observation) -> Arrays | Refusal:
            if session not in readers:
                readers.clear()
                readers[session] = self.reader(dataset.contexts[session], training=True)
            return _read(readers[session], names, observation)

        forms = {**self.forms(training=True), **_actuation_form(names)}
        key = f"{self.name} {self.settings.model_dump_json(exclude=set(Recipe.model_fields))}"
        prepared = prepare(dataset, forms, read, folder, key, dataset.names_of(self.settings.view), report)
        if len(prepared.kept) < MIN_SAMPLES:
            raise InputError(
                f"{dataset.title}: {len(prepared.kept)} of {len(dataset)} samples can be read, {self.name} needs "
                f"{MIN_SAMPLES}; the first other one says: {prepared.why_not}"
            )
        return prepared

    def _inputs(self, dataset: Dataset, names: tuple[str, ...]) -> Arrays:
        """The graph's inputs of all samples of ``dataset``, which are few and can be read."""
        rows: list[Arrays] = []
        for session, observation in zip(dataset.session.tolist(), dataset.observations(), strict=True):
            row = _read(self.reader(dataset.contexts[session], training=False), names, observation)
            assert not isinstance(row, Refusal)
            rows.append(row)
        return {name: np.stack([row[name] for row in rows]) for name in rows[0]}

    def calibrate(self, dataset: Dataset, progress: Progress | None = None) -> Self:
        """Find the intervals anew on ``dataset``, of whose sessions ``fit`` saw none; the answers stay as they are.

        Raises InputError where none of its samples can be answered, NotFittedError before ``fit``.
        """
        report = progress or _silent
        self._known()
        self._set_interval(dataset, "", lambda share: report("calibrating", share))
        return self

    def _set_interval(self, dataset: Dataset, drawn: str, report: Callable[[float], None]) -> None:
        """By the answers to ``dataset``, whole sessions that were held out unless it was ``drawn``, which says how."""
        fitted = self._known()
        found: list[FloatArray] = []
        answered: list[int] = []
        why_not = ""
        for place, estimate in enumerate(self.estimates(dataset)):
            if estimate.valid:
                found.append(estimate.force_n[fitted.known])
                answered.append(place)
            else:
                why_not = why_not or f"{estimate.detail} ({estimate.status})"
            report((place + 1) / len(dataset))
        if not answered:
            raise InputError(
                f"{dataset.title}: intervals cannot be found on {len(dataset)} samples without an answer; the first "
                f"says: {why_not}"
            )
        force, truth = np.array(found), dataset.force_n[answered][:, fitted.known]
        interval = interval_from(fitted.known, force, force - truth, truth, dataset.session[answered], not drawn, drawn)
        self.fitted_ = replace(fitted, interval=interval)

    def start(self, context: Context) -> "NetworkStream":
        """A stream for one session. Raises NotFittedError before ``fit``."""
        fitted = self._known()
        return NetworkStream(fitted.graph, self.reader(context, training=False), fitted.actuation, self.answering())

    def answering(self) -> Answering:
        """What makes estimates of the graph's outputs."""
        fitted = self._known()
        answers = Answers(fitted.known, fitted.interval)
        return lambda stamp_ns, outputs: answers.valid(stamp_ns, outputs["force_n"][0])

    def unfitted(self) -> Self:
        """The same recipe without what was learnt."""
        return type(self)(self.settings)

    def state(self) -> tuple[dict[str, Any], dict[str, npt.NDArray[Any]]]:
        """All but the graph and the log, which are `files`."""
        fitted = self._known()
        values = {
            "actuation": list(fitted.actuation),
            "known": fitted.known.tolist(),
            "interval": fitted.interval.values(),
            "facts": fitted.facts,
        }
        return values, {}

    def files(self) -> dict[str, bytes]:
        """The graph, and the log of the training, one JSON line an epoch."""
        fitted = self._known()
        return {MODEL: fitted.data, LOG: fitted.log}

    @classmethod
    def from_state(
        cls,
        settings: Mapping[str, Any],
        values: Mapping[str, Any],
        arrays: Mapping[str, npt.NDArray[Any]],  # noqa: ARG003 (it has none)
        files: Mapping[str, bytes] | None = None,
    ) -> Self:
        """The inverse of `state` and `files`. Raises KeyError without the graph, ModelError where it is damaged."""
        files = files or {}
        made = cls(cls.settings_type.model_validate(settings))
        made.fitted_ = _Fitted(
            actuation=tuple(values["actuation"]),
            known=np.array(values["known"], np.bool_),
            graph=Graph(files[MODEL], MODEL),
            data=files[MODEL],
            log=files[LOG],
            interval=Interval.of(values["interval"]),
            facts=dict(values["facts"]),
        )
        return made

    def describe(self) -> dict[str, Any]:
        """The network, the budget that was used, errors, intervals and their basis."""
        fitted = self._known()
        interval = fitted.interval
        halves = dict(zip(np.array(AXES)[fitted.known].tolist(), interval.half_n[fitted.known].tolist(), strict=True))
        halves["magnitude"] = interval.magnitude_half_n
        return {
            **fitted.facts,
            "actuation": list(fitted.actuation),
            "interval_half_width_n": {name: half if np.isfinite(half) else None for name, half in halves.items()},
            "interval_basis": interval.basis,
        }

    @classmethod
    def words(cls, facts: Mapping[str, Any]) -> Words:
        """Budget, best epoch, intervals."""
        return network_words(facts)

    def _known(self) -> _Fitted:
        if self.fitted_ is None:
            raise NotFittedError(f"{self.name} was not fitted; train it with `tipforce train` or load a model")
        return self.fitted_


class NetworkStream:
    """One session, frame after frame, each on its own."""

    def __init__(self, graph: Graph, reader: Reader, actuation: tuple[str, ...], answering: Answering) -> None:
        self._graph, self._reader, self._actuation, self._answering = graph, reader, actuation, answering

    def update(self, observation: Observation) -> ForceEstimate:
        """The force at this observation; its status says why where there is none."""
        row = _read(self._reader, self._actuation, observation)
        if isinstance(row, Refusal):
            return ForceEstimate.invalid(observation.stamp_ns, row.status, row.detail)
        return self._answering(observation.stamp_ns, self._graph(**{name: value[None] for name, value in row.items()}))


def _read(reader: Reader, names: tuple[str, ...], observation: Observation) -> Arrays | Refusal:
    row = reader(observation)
    if isinstance(row, Refusal) or not names:
        return row
    drives = read_actuation(observation, names)
    return drives if isinstance(drives, Refusal) else {**row, "actuation": drives.astype(np.float32)}


def _actuation_form(names: tuple[str, ...]) -> Forms:
    return {"actuation": ((len(names),), "float32")} if names else {}


def _components(dataset: Dataset, wanted: str, method: str) -> BoolArray:
    """(3,): what is learnt."""
    known = np.asarray(dataset.known) & (np.array([True, True, False]) if wanted == "xy" else True)
    if not known.any():
        raise InputError(f"{dataset.title}: has no force components to learn; {method} needs at least fx_n or fy_n")
    if not np.isfinite(dataset.force_n[:, known]).all():
        raise InputError(f"{dataset.title}: some samples have no force; leave them out")
    return known


def _samples(dataset: Dataset, prepared: Prepared, known: BoolArray) -> Samples:
    arrays = dict(prepared.arrays)
    return Samples(
        pictures=arrays.pop("picture"),
        heat=arrays.pop("heat", None),
        inputs=arrays,
        force_n=dataset.force_n[prepared.kept][:, known].astype(np.float32),
        session=dataset.session[prepared.kept],
    )


def _spread(drives: npt.NDArray[np.float32] | None) -> tuple[tuple[float, float], ...]:
    """Mean and deviation of each actuation value; 1 for one that never changes."""
    if drives is None:
        return ()
    deviation = drives.std(axis=0, dtype=np.float64)
    mean = drives.mean(axis=0, dtype=np.float64)
    return tuple(zip(mean.tolist(), np.where(deviation > 0, deviation, 1.0).tolist(), strict=True))


def _silent(what: str, share: float) -> None:
    del what, share


_UNKNOWN = Interval(np.full(3, np.nan), math.nan, np.full((3, 3), np.nan), False, "not measured yet", 0, 0)
