"""What all methods that are networks share: fit, export, hold the export to the network, answer by the graph alone."""

import contextlib
import json
import math
import tempfile
from abc import abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import repeat
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
import numpy.typing as npt

from ...datasets import Dataset
from ...errors import InputError, ModelError, NotFittedError
from ...training import (
    LOG,
    Task,
    TrainConfig,
    export_graph,
    network_of,
    parity_n,
    require_torch,
    train_network,
    train_val_split,
    weights_of,
)
from ...types import BoolArray, FloatArray, ForceEstimate, Image, Observation, SessionInfo
from .._answers import AXES, Answers, Interval
from .._base import Estimator, Progress
from .._conformal import interval_from
from .._reading import Refusal, actuation_names
from .._words import Words
from ._arrays import (
    Arrays,
    Looked,
    Outputs,
    Reader,
    actuation_form,
    components_of,
    read_one,
    samples_of,
    spread_of,
    spread_over,
)
from ._eight_bits import in_eight_bits
from ._graph import Graph
from ._prepared import Form, Forms, Prepared, prepare
from ._words import network_words

__all__ = ["MIN_SAMPLES", "MODEL", "PARITY_N", "Answering", "Fitted", "NetworkEstimator"]

MIN_SAMPLES = 20
"""Fewer samples cannot be trained and validated on."""

PARITY_N = 1e-3
"""The graph's answers may differ from the trained network's by less than this, a tenth of a gram, which is far below
what any picture tells: else its weights are kept whole, not in half precision, and if that is not enough, training
fails."""

MODEL, SMALL = "model.onnx", "model.int8.onnx"
"""The graph's file in a model folder; the one in 8 bits, which then answers."""

COMPARED = 64
"""So many samples' answers are compared."""

Answering = Callable[[int, Outputs], ForceEstimate]
"""Makes an estimate of a stamp and what the graph returned for one sample, (1, ...) each."""


@dataclass(frozen=True, eq=False)
class Fitted:
    """Everything that was learnt."""

    actuation: tuple[str, ...]
    known: BoolArray
    graph: Graph
    data: bytes
    small: bytes | None
    log: bytes
    own: Arrays
    interval: Interval
    facts: dict[str, Any]
    sessions: tuple[str, ...]
    """All that it learnt from, those of what it began with among them."""


class NetworkEstimator(Estimator):
    """A network behind the face of all methods.

    A method states what its network is given (`forms`, `reader`), the task that trains it (`task`), and its settings,
    which derive from `TrainConfig` and have ``view``, ``actuation`` and ``components``.
    """

    looks_at: ClassVar[str] = "the whole picture"
    """What of each picture it is given, in a few words."""
    outputs: ClassVar[tuple[str, ...]] = ("force_n",)
    """Names of what the network returns, in order."""

    def __init__(self, settings: Any = None) -> None:
        self.settings = settings or self.settings_type()
        self.fitted_: Fitted | None = None
        self._begin: NetworkEstimator | None = None

    @abstractmethod
    def forms(self, *, training: bool) -> Forms:
        """What `reader` makes of an observation: name -> shape and dtype; to train, or as the graph takes it."""

    @abstractmethod
    def reader(self, info: SessionInfo, *, training: bool) -> Reader:
        """Makes those of the observations of one session."""

    @abstractmethod
    def task(self, known: BoolArray, in_base: bool, actuation: tuple[tuple[float, float], ...]) -> Task:
        """What is trained: the components ``known`` (3,) of forces, which may be ``in_base``, the base frame.

        ``actuation``: mean and deviation of each actuation value.
        """

    def settle(self, dataset: Dataset) -> None:
        """Decide what the settings leave open."""

    def mask_form(self) -> Form | None:
        """Shape and dtype of the "heat" that `reader` makes of masks; None for a method that has no use for them."""
        return None

    def told(self, dataset: Dataset) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Facts that all sessions of ``dataset`` tell it, which becomes `Estimator.needed_facts`; that any tells it."""
        del dataset
        return (), ()

    def own_arrays(self, looked: Looked) -> Arrays:
        """What a method keeps beside its graph."""
        del looked
        return {}

    def begun(self) -> Fitted | None:
        """What the model that its fits begin with had learnt."""
        return None if self._begin is None else self._begin.fitted_

    @property
    def needed_actuation(self) -> tuple[str, ...]:
        """What it was trained with. Raises NotFittedError before ``fit``."""
        return self._known().actuation

    @property
    def needed_facts(self) -> tuple[str, ...]:
        """What every session of the training told. Raises NotFittedError before ``fit``."""
        return tuple(self._known().facts["told"])

    @property
    def taught_sessions(self) -> frozenset[str]:
        """Those of what it began with, too. Raises NotFittedError before ``fit``."""
        return frozenset(self._known().sessions)

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
        folder: Path | None = None,
        resume: bool = False,
    ) -> Self:
        """`fit` that can be killed and gone on with.

        ``folder`` takes the prepared pictures, a checkpoint after every epoch and the log; ``resume``: go on from what
        is there. Without it a temporary one is used and removed.
        """
        report, start = progress or _silent, self._begin
        require_torch()
        if len(dataset) < MIN_SAMPLES:
            raise InputError(
                f"{dataset.title}: has {len(dataset)} samples; training {self.name} needs at least {MIN_SAMPLES}"
            )
        self.settle(dataset)
        every, some = self.told(dataset)
        known = components_of(dataset, self.settings.components, self.name)
        names = actuation_names(self.settings.actuation, dataset)
        if start is not None and names and names != start._known().actuation != ():
            raise InputError(
                f"the model to begin with was trained with {', '.join(start._known().actuation)}, not with "
                f"{', '.join(names)}; state the same, or begin with another model"
            )
        with contextlib.ExitStack() as stack:
            place = folder or Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="tipforce-")))
            prepared = self._prepared(dataset, names, place, lambda share: report("preparing pictures", 0.1 * share))
            samples = samples_of(dataset, prepared, known)
            part = train_val_split(samples.session, self.settings)
            task = self.task(known, dataset.force_frames == {"base"}, spread_of(samples.inputs.get("actuation")))
            learnt = train_network(
                task, samples, part, self.settings,
                start=None if start is None else weights_of(start.files()[MODEL]),
                folder=folder, resume=resume,
                progress=lambda what, share: report(what, 0.1 + 0.85 * share),
            )  # fmt: skip
            report("exporting", 0.95)
            network, kept = network_of(task, learnt.weights), prepared.kept
            inputs = {**self.forms(training=False), **actuation_form(names)}
            noted = {"method": self.name, "components": ", ".join(np.array(AXES)[known])}
            compared = task.batch(samples, spread_over(part.validate, COMPARED), None)
            shown = {name: compared[name] for name in task.inputs}
            for halved in (True, False):  # half precision is too coarse for a network whose large features cancel
                data = export_graph(network, inputs, self.outputs, noted, halved=halved)
                deviation_n = parity_n(data, network, shown)
                if deviation_n < PARITY_N:
                    break
            else:
                raise ModelError(
                    f"the exported graph differs from the trained network by up to {deviation_n:.2g} N, more than "
                    f"{PARITY_N:g} N: there is no model; train it with a smaller rate"
                )
            small, growth = in_eight_bits(data, task, samples, part) if self.settings.bits == 8 else (None, None)
            graph = Graph(data, MODEL) if small is None else Graph(small, SMALL)
            looked = Looked(graph, task, samples, part, dataset.stamp_ns[kept])
            own = self.own_arrays(looked)
            del prepared, samples, looked  # before the files they are maps of
        held_out, earlier = dataset.subset(kept[part.validate]), self.begun()
        learnt_from = f"{len(kept)} samples of {dataset.title}"
        self.fitted_ = Fitted(
            actuation=names,
            known=known,
            graph=graph,
            data=data,
            small=small,
            own=own,
            log="".join(json.dumps(row) + "\n" for row in learnt.rows).encode(),
            interval=_UNKNOWN,
            facts={
                **learnt.facts,
                "told": list(every),
                "ever_told": list(some),
                "samples": len(kept),
                "samples_left_out": len(dataset) - len(kept),
                "parity_with_network_n": deviation_n,
                "bits": 32 if small is None else 8,
                "error_growth_in_8_bits": growth,
                "started_from": None if start is None else start.describe()["network"],
                "learnt_from": [*earlier.facts["learnt_from"], learnt_from] if earlier else [learnt_from],
            },
            sessions=tuple(sorted({*dataset.session_fingerprints.values(), *(earlier.sessions if earlier else ())})),
        )
        # the part that chose the epoch promises nothing about another session, even where it was whole ones
        drawn = f"{'held-out' if part.sessions else 'random'} samples that also chose the epoch,"
        self._set_interval(held_out, drawn, lambda share: report("measuring", 0.96 + 0.04 * share))
        return self

    def _prepared(
        self, dataset: Dataset, names: tuple[str, ...], folder: Path, report: Callable[[float], None]
    ) -> Prepared:
        readers: dict[str, Reader] = {}

        def read(session: str, observation: Observation, mask: Image | None) -> Arrays | Refusal:
            if session not in readers:
                readers.clear()
                readers[session] = self.reader(dataset.session_info[session], training=True)
            return read_one(readers[session], names, observation, mask)

        forms, view = {**self.forms(training=True), **actuation_form(names)}, self.settings.view
        heat = self.mask_form()
        masks: Iterable[Image | None] = repeat(None, len(dataset))
        if heat is not None and dataset.has_masks(view):
            forms["heat"], masks = heat, dataset.masks(view)
        sheets = [repr(dataset.session_info[name]) for name in sorted(dataset.session_info)]
        key = "\n".join([self.name, self.settings.model_dump_json(exclude=set(TrainConfig.model_fields)), *sheets])
        prepared = prepare(dataset, masks, forms, read, folder, key, dataset.names_of(view), report)
        if len(prepared.kept) < MIN_SAMPLES:
            raise InputError(
                f"{dataset.title}: {len(prepared.kept)} of {len(dataset)} samples can be read, {self.name} needs "
                f"{MIN_SAMPLES}; the first other one says: {prepared.why_not}"
            )
        return prepared

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
        shown = self.answers(dataset, report)
        answered = [place for place, estimate in enumerate(shown) if estimate.valid]
        if not answered:
            raise InputError(
                f"{dataset.title}: intervals cannot be found on {len(dataset)} samples without an answer; the first "
                f"says: {shown[0].detail} ({shown[0].status})"
            )
        found = [shown[place] for place in answered]
        truth = dataset.force_n[answered][:, fitted.known]
        interval = self.interval(found, truth, dataset.session[answered], drawn)
        self.fitted_ = replace(fitted, interval=interval)

    def interval(
        self, found: Sequence[ForceEstimate], truth: FloatArray, session: npt.NDArray[np.str_], drawn: str
    ) -> Interval:
        """From the answers ``found`` to samples of ``session`` (n,) and their labels (n, t); see `interval_from`."""
        known = self._known().known
        force = np.array([each.force_n[known] for each in found])
        return interval_from(known, force, force - truth, truth, session, not drawn, drawn)

    def start(self, info: SessionInfo) -> "NetworkStream":
        """A stream for one session. Raises NotFittedError before ``fit``."""
        fitted = self._known()
        return NetworkStream(fitted.graph, self.reader(info, training=False), fitted.actuation, self.answering())

    def answering(self) -> Answering:
        """What makes estimates of the graph's outputs."""
        fitted = self._known()
        answers = Answers(fitted.known, fitted.interval)
        return lambda stamp_ns, outputs: answers.valid(stamp_ns, outputs["force_n"][0])

    def unfitted(self) -> Self:
        """The same recipe without what was learnt; it begins with the same weights, if it began with any."""
        made = type(self)(self.settings)
        made._begin = self._begin
        return made

    def beginning_with(self, model: "NetworkEstimator") -> Self:
        """The same recipe, whose fits begin with the weights of ``model`` and have the settings for that.

        Raises InputError for another method's model.
        """
        if model.name != self.name:
            raise InputError(f"a {self.name} cannot begin with the weights of a {model.name}; name a {self.name}")
        made = self.unfitted()
        made.settings, made._begin = self.settings.for_fine_tuning(), model
        return made

    def state(self) -> tuple[dict[str, Any], dict[str, npt.NDArray[Any]]]:
        """All but the graph and the log, which are `files`."""
        fitted = self._known()
        values = {
            "actuation": list(fitted.actuation),
            "known": fitted.known.tolist(),
            "interval": fitted.interval.values(),
            "facts": fitted.facts,
            "sessions": list(fitted.sessions),
        }
        return values, fitted.own

    def files(self) -> dict[str, bytes]:
        """The graph, and the log of the training, one JSON line an epoch."""
        fitted = self._known()
        small = {} if fitted.small is None else {SMALL: fitted.small}
        return {MODEL: fitted.data, LOG: fitted.log, **small}

    @classmethod
    def from_state(
        cls,
        settings: Mapping[str, Any],
        values: Mapping[str, Any],
        arrays: Mapping[str, npt.NDArray[Any]],
        files: Mapping[str, bytes] | None = None,
    ) -> Self:
        """The inverse of `state` and `files`. Raises KeyError without the graph, ModelError where it is damaged."""
        files = files or {}
        made = cls(cls.settings_type.model_validate(settings))
        made.fitted_ = Fitted(
            actuation=tuple(values["actuation"]),
            known=np.array(values["known"], np.bool_),
            graph=Graph(files[SMALL], SMALL) if SMALL in files else Graph(files[MODEL], MODEL),
            data=files[MODEL],
            small=files.get(SMALL),
            log=files[LOG],
            own=dict(arrays),
            interval=Interval.of(values["interval"]),
            facts={"learnt_from": [f"{values['facts']['samples']} samples"], **values["facts"]},
            sessions=tuple(values.get("sessions", ())),
        )
        made.start(SessionInfo())  # what an earlier version did not keep is missed here, not at the first frame
        return made

    def describe(self) -> dict[str, Any]:
        """The network, the budget that was used, errors, intervals and their basis."""
        fitted = self._known()
        names = [*np.array(AXES)[fitted.known].tolist(), "magnitude"]
        halves = dict(zip(names, self.usual_half_n().tolist(), strict=True))
        return {
            **fitted.facts,
            "actuation": list(fitted.actuation),
            "looks_at": self.looks_at,
            "remembers": self.remembers,
            "interval_half_width_n": {name: half if np.isfinite(half) else None for name, half in halves.items()},
            "interval_basis": fitted.interval.basis,
        }

    def usual_half_n(self) -> FloatArray:
        """(t + 1,): half-widths of the components' intervals and of the magnitude's, as they usually are."""
        fitted = self._known()
        return np.append(fitted.interval.half_n[fitted.known], fitted.interval.magnitude_half_n)

    @classmethod
    def words(cls, facts: Mapping[str, Any]) -> Words:
        """Budget, best epoch, intervals."""
        return network_words(facts)

    def _known(self) -> Fitted:
        if self.fitted_ is None:
            raise NotFittedError(f"{self.name} was not fitted; train it with `tipforce train` or load a model")
        return self.fitted_


class NetworkStream:
    """One session, frame after frame; what is kept of earlier ones is the matter of ``answering``."""

    def __init__(self, graph: Graph, reader: Reader, actuation: tuple[str, ...], answering: Answering) -> None:
        self._graph, self._reader, self._actuation, self._answering = graph, reader, actuation, answering

    def update(self, observation: Observation) -> ForceEstimate:
        """The force at this observation; its status says why where there is none."""
        row = read_one(self._reader, self._actuation, observation)
        if isinstance(row, Refusal):
            return ForceEstimate.invalid(observation.stamp_ns, row.status, row.detail)
        return self._answering(observation.stamp_ns, self._graph(**{name: value[None] for name, value in row.items()}))


def _silent(what: str, share: float) -> None:
    del what, share


_UNKNOWN = Interval(np.full(3, np.nan), math.nan, np.full((3, 3), np.nan), False, "not measured yet", 0, 0)
