"""Base class of the methods that are networks: training, export with a parity check, estimates by the graph alone."""

import contextlib
import json
import math
import tempfile
from abc import abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import repeat
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
import numpy.typing as npt

from ...datasets import Dataset
from ...errors import InputError, ModelError, NotFittedError
from ...training import (
    CHECKPOINT_FILE,
    LOG_FILE,
    Task,
    TrainConfig,
    export_graph,
    graph_weights,
    network_from_weights,
    parity_n,
    require_torch,
    train_network,
    train_val_split,
)
from ...types import BoolArray, FloatArray, ForceEstimate, Image, Observation, SessionInfo, Status
from .._base import FineTunable, Progress, no_progress
from .._builder import AXES, EstimateBuilder
from .._left_out import left_out_by_session, refuse_left_out
from .._reading import Abstention, actuation_names, limits_of, unlike_training
from .._values import StoredArrays, StoredFiles, StoredValues
from ..uncertainty import Interval, conformal_interval
from ._calibration import CalibrationBatch, Outputs, quantise_checked, spread_evenly
from ._facts import NetworkFacts, NetworkTraining
from ._fitted import FittedNetwork
from ._graph import Graph
from ._image_input import UNLIKE, modality, without_structure
from ._preparation import (
    PREPARED_FILE,
    Arrays,
    InputReader,
    Masks,
    PreparedData,
    Spec,
    Specs,
    actuation_spec,
    joint_masks,
    prepare,
    read_inputs,
    standardisation,
    training_components,
    training_samples,
)
from ._stored_names import current_array_names, current_weight_names

MIN_SAMPLES = 20
"""Least number of samples for training and validation."""

MAX_PARITY_N = 1e-3
"""Largest deviation of the exported graph from the trained network. 1 mN is a tenth of a gram, far below the error of
any estimate. Beyond it the weights are stored in single instead of half precision, and if that is not enough, training
fails."""

GRAPH_FILE, QUANTISED_FILE = "model.onnx", "model.int8.onnx"
"""Files of the graph in a model folder; the quantised one is used where it is there."""

_PARITY_SAMPLES = 64

BuildEstimate = Callable[[int, Outputs], ForceEstimate]
"""Makes an estimate from a stamp and the graph's outputs for one sample, (1, ...) each."""


class NetworkEstimator(FineTunable):
    """A network with the interface of all methods.

    A subclass states the inputs of its network (`input_specs`, `reader`), the `task` that trains it, and its settings,
    which derive from `TrainConfig` and have ``actuation`` and ``components``, and its ``views``.
    """

    view_setting = "view"

    input_text: ClassVar[str] = "the whole image"
    """The image input in a few words."""

    def __init__(self, settings: Any = None) -> None:
        super().__init__(settings)
        self.fitted_: FittedNetwork | None = None
        self._init_from: NetworkEstimator | None = None

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the network's outputs, in order."""
        return ("force_n",)

    @abstractmethod
    def input_specs(self, *, training: bool) -> Specs:
        """Returns shape and dtype of the inputs that `reader` reads: for training, or for the graph."""

    @abstractmethod
    def reader(self, info: SessionInfo, *, training: bool) -> InputReader:
        """Returns a function that reads the inputs from the observations of one session.

        Args:
            info: metadata of the session.
            training: whether the inputs are for training, with a margin for augmentation.
        """

    @abstractmethod
    def task(self, known: BoolArray, base_frame: bool, actuation: tuple[tuple[float, float], ...]) -> Task:
        """Returns the network to train.

        Args:
            known: (3,) the force components.
            base_frame: whether the forces are in the base frame.
            actuation: mean and standard deviation of each actuation value.
        """

    def resolve_settings(self, dataset: Dataset) -> None:
        """Resolves the open settings on ``dataset``."""

    def heatmap_spec(self) -> Spec | None:
        """Returns shape and dtype of the "heatmap" that `reader` makes of masks; None for a method without one."""
        return None

    def metadata_names(self, dataset: Dataset) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Returns the names of the metadata that all sessions have, which are then required, and that any has."""
        del dataset
        return (), ()

    def further_actuation(self, required_metadata: Sequence[str]) -> tuple[str, ...]:
        """Returns actuation that is needed beside the one that joins the network's inputs as it is."""
        del required_metadata
        return ()

    def fit_arrays(self, calibration: CalibrationBatch) -> Arrays:
        """Fits the arrays that a method keeps beside its graph, such as its uncertainty."""
        del calibration
        return {}

    def initial_model(self) -> FittedNetwork | None:
        """Returns the model that it is fine-tuned from; None: it is trained from random weights."""
        return None if self._init_from is None else self._init_from.fitted_

    @property
    def required_actuation(self) -> tuple[str, ...]:
        """See `Estimator`. Raises NotFittedError before ``fit``."""
        return self._fitted().actuation

    @property
    def required_metadata(self) -> tuple[str, ...]:
        """Metadata keys that all training sessions stated. Raises NotFittedError before ``fit``."""
        return self._fitted().facts.required_metadata

    @property
    def training_sessions(self) -> frozenset[str]:
        """Those of the model it is fine-tuned from, too, which alone are known before ``fit``."""
        fitted = self.fitted_ or self.initial_model()
        return frozenset() if fitted is None else frozenset(fitted.sessions)

    def fit(self, dataset: Dataset, progress: Progress | None = None) -> Self:
        """Trains on all samples but a validation split for the best epoch and the interval; see `fit_resumable`."""
        return self.fit_resumable(dataset, progress)

    def fit_resumable(
        self, dataset: Dataset, progress: Progress | None = None, *, folder: Path | None = None, resume: bool = False
    ) -> Self:
        """Returns the method, fitted as by `fit`; a training that was killed can be resumed.

        Steps: check the data, prepare the inputs on disk, train, export the network to a graph, fit its uncertainty,
        and measure the intervals on the validation samples.

        Args:
            dataset: the training data.
            progress: called during training.
            folder: run directory for prepared images, log and a checkpoint after every epoch; None: a temporary one.
            resume: continue from the checkpoint in ``folder``.

        Raises:
            InputError: there are fewer than `MIN_SAMPLES` samples, no images, force components or actuation values
                that are needed, or training diverges.
            MissingExtraError: torch is not installed.
            ModelError: the exported graph differs from the network.
        """
        report, initial = progress or no_progress, self._init_from
        require_torch()
        if len(dataset) < MIN_SAMPLES:
            raise InputError(
                f"{dataset.title}: has {len(dataset)} samples; training {self.name} needs at least {MIN_SAMPLES}"
            )
        self.resolve_settings(dataset)
        required, available = self.metadata_names(dataset)
        known = training_components(dataset, self.settings.components, self.name)
        names = actuation_names(self.settings.actuation, dataset)
        if initial is not None and names and names != initial._fitted().actuation != ():
            raise InputError(
                f"the initial model was trained with {', '.join(initial._fitted().actuation)}, not with "
                f"{', '.join(names)}; state the same, or start from another model"
            )
        with contextlib.ExitStack() as stack:
            cache = folder or Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="tipforce-")))
            prepared = self._prepared(dataset, names, cache, lambda share: report("preparing images", 0.1 * share))
            left_out = left_out_by_session(dataset.session, np.isin(np.arange(len(dataset)), prepared.index))
            refuse_left_out(dataset.title, left_out, len(dataset), self.settings.max_left_out)
            samples = training_samples(dataset, prepared, known)
            split = train_val_split(samples.session, self.settings)
            task = self.task(known, dataset.force_frames == {"base"}, standardisation(samples.inputs.get("actuation")))
            result = train_network(
                task,
                samples,
                split,
                self.settings,
                init_from=None if initial is None else current_weight_names(graph_weights(initial.files()[GRAPH_FILE])),
                folder=folder,
                resume=resume,
                progress=lambda what, share: report(what, 0.1 + 0.85 * share),
            )
            report("exporting", 0.95)
            network, index = network_from_weights(task, result.weights), prepared.index
            rows = spread_evenly(split.val if len(split.val) else split.train, _PARITY_SAMPLES)
            compared = task.batch(samples, rows, None)
            data, deviation_n = self._exported(network, names, known, {name: compared[name] for name in task.inputs})
            quantised, growth = None, None
            if self.settings.bits == 8:
                quantised, growth = quantise_checked(data, task, samples, split)
            graph = Graph(data, GRAPH_FILE) if quantised is None else Graph(quantised, QUANTISED_FILE)
            calibration = CalibrationBatch(graph, task, samples, split, dataset.stamp_ns[index])
            arrays = self.fit_arrays(calibration) if len(split.val) else {}
            del prepared, samples, calibration  # before the files that they map
        held_out, parent = dataset.subset(index[split.val]), self.initial_model()
        trained_on = f"{len(index)} samples of {dataset.title}"
        self.fitted_ = FittedNetwork(
            actuation=names,
            actuation_limits=self._actuation_limits(dataset, (*names, *self.further_actuation(required))),
            known=known,
            graph=graph,
            data=data,
            quantised=quantised,
            arrays=arrays,
            log="".join(json.dumps(row) + "\n" for row in result.rows).encode(),
            interval=_no_interval(known),
            facts=NetworkTraining(
                **dict(result.facts),
                modalities=tuple(
                    sorted({modality(info, view) for info in dataset.session_info.values() for view in self.views})
                ),
                required_metadata=required,
                known_metadata=available,
                samples=len(index),
                left_out=left_out,
                parity_with_network_n=deviation_n,
                bits=32 if quantised is None else 8,
                error_growth_in_8_bits=growth,
                fine_tuned_from=None if initial is None else initial.describe().network,
                trained_on=(*(parent.facts.trained_on if parent else ()), trained_on),
            ),
            sessions=tuple(sorted({*dataset.session_fingerprints.values(), *(parent.sessions if parent else ())})),
        )
        if not len(split.val):
            return self
        # the split that chose the epoch guarantees nothing for another session, even where it has whole ones
        sampling = f"{'held-out' if split.by_session else 'random'} samples that also chose the epoch,"
        self._set_interval(held_out, sampling, lambda share: report("measuring", 0.96 + 0.04 * share))
        return self

    def _exported(
        self, network: Any, actuation: tuple[str, ...], known: BoolArray, inputs: Mapping[str, npt.NDArray[Any]]
    ) -> tuple[bytes, float]:
        """Returns the trained network as a graph, and the largest difference of their forces, N.

        They are compared on ``inputs``, those of some samples. Half precision, with half the file, is tried first; it
        is too coarse for a network whose large features cancel.

        Raises:
            ModelError: the difference is larger than `MAX_PARITY_N` in full precision, too.
        """
        specs = {**self.input_specs(training=False), **actuation_spec(actuation)}
        metadata = {"method": self.name, "components": ", ".join(np.array(AXES)[known])}
        deviation_n = math.inf
        for half_precision in (True, False):
            data = export_graph(network, specs, self.outputs, metadata, half_precision=half_precision)
            deviation_n = parity_n(data, network, inputs)
            if deviation_n < MAX_PARITY_N:
                return data, deviation_n
        raise ModelError(
            f"the exported graph differs from the trained network by up to {deviation_n:.2g} N, more than "
            f"{MAX_PARITY_N:g} N: there is no model; train it with a smaller rate"
        )

    def _actuation_limits(self, dataset: Dataset, names: Sequence[str]) -> dict[str, tuple[float, float]]:
        """Returns the smallest and largest value of each actuation value that the network has been trained with.

        After fine-tuning the limits contain those of the initial model. A value that the initial model used without
        stored limits has none here either: its limits are unknown.
        """
        limits, initial = limits_of(dict.fromkeys(names), dataset), self._init_from
        if initial is None:
            return limits
        old = initial._fitted().actuation_limits
        return {
            name: (min(low, old[name][0]), max(high, old[name][1])) if name in old else (low, high)
            for name, (low, high) in limits.items()
            if name in old or name not in initial.required_actuation
        }

    def _prepared(
        self, dataset: Dataset, actuation: tuple[str, ...], folder: Path, report: Callable[[float], None]
    ) -> PreparedData:
        """Prepares the inputs of the network for all samples of ``dataset`` and keeps them in ``folder``.

        Args:
            dataset: the training data; its masks give heatmaps where the network uses them.
            actuation: names of the actuation values that are inputs.
            folder: folder of the prepared arrays; they are used again for the same settings and sessions.
            report: called with the finished share.

        Raises:
            InputError: fewer than `MIN_SAMPLES` samples can be read.
        """
        readers: dict[str, InputReader] = {}

        def read(session: str, observation: Observation, masks: Masks | None) -> Arrays | Abstention:
            if session not in readers:  # the samples come session by session: one reader is kept
                readers.clear()
                readers[session] = self.reader(dataset.session_info[session], training=True)
            return read_inputs(readers[session], actuation, observation, masks)

        specs = {**self.input_specs(training=True), **actuation_spec(actuation)}
        heatmap = self.heatmap_spec()
        masks: Iterable[Masks | None] = repeat(None, len(dataset))
        if heatmap is not None and all(dataset.has_masks(view) for view in self.views):
            specs["heatmap"], masks = heatmap, joint_masks(dataset, self.views)
        sessions = [repr(dataset.session_info[name]) for name in sorted(dataset.session_info)]
        irrelevant = {*TrainConfig.model_fields, "max_left_out"}  # these settings do not change the prepared inputs
        key = "\n".join([self.name, self.settings.model_dump_json(exclude=irrelevant), *sessions])
        prepared = prepare(dataset, masks, specs, read, folder, key, dataset.names_of(self.views[0]), report)
        if len(prepared.index) < MIN_SAMPLES:
            raise InputError(
                f"{dataset.title}: {len(prepared.index)} of {len(dataset)} samples can be read, {self.name} needs "
                f"{MIN_SAMPLES}; the first other one says: {prepared.first_skipped}"
            )
        return prepared

    def calibrate(self, dataset: Dataset, progress: Progress | None = None) -> Self:
        """Sets the intervals on sessions that `fit` did not use; the forces stay. See `Estimator.calibrate`.

        Raises:
            InputError: none of its samples has an estimate.
            NotFittedError: before ``fit``.
        """
        report = progress or no_progress
        self._fitted()
        self._set_interval(dataset, "", lambda share: report("calibrating", share))
        return self

    def _set_interval(self, dataset: Dataset, sampling: str, report: Callable[[float], None]) -> None:
        """Fits the intervals of the fitted network to its errors on ``dataset``.

        Args:
            dataset: samples that the network was not trained on.
            sampling: how the samples were drawn; empty: they are whole held-out sessions.
            report: called with the finished share.

        Raises:
            InputError: no sample has an estimate.
        """
        fitted = self._fitted()
        estimates = self.predict(dataset, report)
        valid = [index for index, estimate in enumerate(estimates) if estimate.valid]
        if not valid:
            raise InputError(
                f"{dataset.title}: none of its {len(dataset)} samples has an estimate, so there is nothing to set the "
                f"intervals on; the first says: {estimates[0].detail} ({estimates[0].status})"
            )
        truth = dataset.force_n[valid][:, fitted.known]
        interval = self.fit_interval([estimates[index] for index in valid], truth, dataset.session[valid], sampling)
        self.fitted_ = fitted.model_copy(update={"interval": interval})

    def fit_interval(
        self, estimates: Sequence[ForceEstimate], truth: FloatArray, session: npt.NDArray[np.str_], sampling: str
    ) -> Interval:
        """Returns the intervals of the method; see `conformal_interval`.

        Args:
            estimates: n estimates.
            truth: (n, t) their labels in newtons.
            session: (n,) their sessions.
            sampling: how the samples were drawn; "": whole sessions were held out.
        """
        known = self._fitted().known
        force = np.array([each.force_n[known] for each in estimates])
        return conformal_interval(known, force, force - truth, truth, session, not sampling, sampling)

    @property
    def views(self) -> tuple[str, ...]:
        """The view of the settings."""
        return (self.settings.view,)

    def reading(self, view: str) -> Self:
        """Returns this method for another view; see `Estimator.reading`."""
        made = super().reading(view)
        if made.fitted_ is not None:
            facts = made.fitted_.facts.for_view(self.views[0], view)
            made.fitted_ = made.fitted_.model_copy(update={"facts": facts})
        return made

    @property
    def run_files(self) -> frozenset[str]:
        """Prepared inputs, checkpoint and log."""
        arrays = {f"{name}.npy" for name in (*self.input_specs(training=True), "actuation", "heatmap")}
        return frozenset(arrays | {CHECKPOINT_FILE, LOG_FILE, PREPARED_FILE})

    def to_onnx(self) -> tuple[bytes, dict[str, Any]]:
        """Returns the graph in 32 bits, and how far it is from the trained network."""
        return self.files()[GRAPH_FILE], {"parity_n": self._fitted().facts.parity_with_network_n}

    def start(self, info: SessionInfo, images: Sequence[Image] = ()) -> "NetworkStream":
        """Returns a stream for one session; see `Estimator.start`."""
        del images  # its window follows from the metadata
        fitted = self._fitted()
        reader = self.reader(info, training=False)
        return NetworkStream(fitted, reader, self.estimate_builder(info), self.required_actuation, info, self.views)

    def estimate_builder(self, info: SessionInfo) -> BuildEstimate:
        """Returns a function that makes estimates from the graph's outputs, for one session."""
        del info
        fitted = self._fitted()
        builder = EstimateBuilder(fitted.known, fitted.interval)
        return lambda stamp_ns, outputs: builder.valid(stamp_ns, outputs["force_n"][0])

    def unfitted(self) -> Self:
        """Returns the same settings and initial model without the learnt state."""
        made = type(self)(self.settings)
        made._init_from = self._init_from
        return made

    def fine_tuned_from(self, model: FineTunable) -> Self:
        """Returns an unfitted estimator whose fits start from the weights of ``model``, with settings for fine-tuning.

        Raises:
            InputError: ``model`` is of another method.
        """
        if model.name != self.name or not isinstance(model, NetworkEstimator):
            raise InputError(f"a {self.name} cannot start from the weights of a {model.name}; name a {self.name}")
        made = self.unfitted()
        made.settings, made._init_from = self.settings.for_fine_tuning(), model
        return made

    def state(self) -> tuple[dict[str, Any], dict[str, npt.NDArray[Any]]]:
        """Returns all but the graph and the log, which are `files`."""
        fitted = self._fitted()
        return fitted.model_dump(mode="json"), fitted.arrays

    def files(self) -> dict[str, bytes]:
        """Returns the graph, and the training log with one JSON line an epoch."""
        fitted = self._fitted()
        quantised = {} if fitted.quantised is None else {QUANTISED_FILE: fitted.quantised}
        return {GRAPH_FILE: fitted.data, LOG_FILE: fitted.log, **quantised}

    @classmethod
    def from_state(
        cls, settings: StoredValues, values: StoredValues, arrays: StoredArrays, files: StoredFiles = None
    ) -> Self:
        """Inverts `state` and `files`; see `Estimator.from_state`.

        Raises:
            KeyError: the graph is missing.
            ModelError: the graph is damaged.
        """
        files = files or {}
        made = cls(cls.settings_type.model_validate(settings))
        quantised = QUANTISED_FILE in files
        graph = Graph(files[QUANTISED_FILE], QUANTISED_FILE) if quantised else Graph(files[GRAPH_FILE], GRAPH_FILE)
        made.fitted_ = FittedNetwork.model_validate(
            {
                **values,
                "graph": graph,
                "data": files[GRAPH_FILE],
                "quantised": files.get(QUANTISED_FILE),
                "log": files[LOG_FILE],
                "arrays": current_array_names(arrays),
            }
        )
        made.start(SessionInfo())  # an incomplete state is found here, not at the first frame
        made.check_fit()
        return made

    def check_fit(self) -> None:
        """Checks a loaded model: runs its graph once on zeros, and makes an estimate from its outputs.

        Raises:
            KeyError: an output or an array is missing.
            ValueError: the graph takes or gives other arrays than this method's.
        """
        fitted = self._fitted()
        specs = {**self.input_specs(training=False), **actuation_spec(fitted.actuation)}
        wanted = {name: ((None, *shape), kind) for name, (shape, kind) in specs.items()}
        if fitted.graph.inputs != wanted:
            raise ValueError(f"the graph takes {fitted.graph.inputs}, expected {wanted}")
        outputs = fitted.graph(**{name: np.zeros((1, *shape), kind) for name, (shape, kind) in specs.items()})
        expected = (1, int(fitted.known.sum()))
        if outputs["force_n"].shape != expected:
            raise ValueError(f"the graph gives force_n of the shape {outputs['force_n'].shape}, expected {expected}")
        self.check_outputs(outputs)

    def check_outputs(self, outputs: Outputs) -> None:
        """Computes from ``outputs`` for one image all that an estimate needs. Raises KeyError or ValueError."""
        self.estimate_builder(SessionInfo())(0, outputs)

    def describe(self) -> NetworkFacts:
        """Returns the network, its training, errors, intervals and their basis."""
        fitted = self._fitted()
        names = [*np.array(AXES)[fitted.known].tolist(), "magnitude"]
        half_widths = dict(zip(names, self.typical_half_n().tolist(), strict=True))
        return NetworkFacts(
            **dict(fitted.facts),
            actuation=fitted.actuation,
            input=self.input_text,
            uses_history=self.uses_history,
            interval_half_width_n={name: half if np.isfinite(half) else None for name, half in half_widths.items()},
            magnitude_interval_n=fitted.interval.magnitude_examples(self.typical_unit_n()),
            interval_basis=fitted.interval.basis,
        )

    def typical_half_n(self) -> FloatArray:
        """Returns (t + 1,) typical half-widths of the components' intervals and of the magnitude's, in newtons."""
        fitted = self._fitted()
        return np.append(fitted.interval.half_n[fitted.known], fitted.interval.magnitude_half_n)

    def typical_unit_n(self) -> float:
        """Returns the newtons that the unit of the magnitude's interval typically has."""
        return 1.0

    def _fitted(self) -> FittedNetwork:
        if self.fitted_ is None:
            raise NotFittedError(f"{self.name} was not fitted; train it with `tipforce train` or load a model")
        return self.fitted_


class NetworkStream:
    """Estimates one session; ``build`` keeps the necessary earlier frames, ``actuation`` names further inputs."""

    def __init__(
        self,
        fitted: FittedNetwork,
        reader: InputReader,
        build: BuildEstimate,
        actuation: Sequence[str],
        info: SessionInfo,
        views: Sequence[str],
    ) -> None:
        self._fitted, self._reader, self._build = fitted, reader, build
        self._actuation, self._info, self._views = actuation, info, views
        unlike = [each for each in (modality(info, view) for view in views) if each not in fitted.facts.modalities]
        self._unlike = UNLIKE[unlike[0]] if unlike else ""

    def update(self, observation: Observation) -> ForceEstimate:
        """Returns the estimate for this observation; its status says why where there is no force."""
        outputs = self.outputs(observation)
        return outputs if isinstance(outputs, ForceEstimate) else self._build(observation.stamp_ns, outputs)

    def outputs(self, observation: Observation) -> Outputs | ForceEstimate:
        """Returns the graph's outputs, (1, ...) each, or an invalid estimate.

        It is invalid where the session's modality, the image or an actuation value is unlike those in training, or an
        input is missing.
        """
        fitted = self._fitted
        if self._unlike:
            return ForceEstimate.invalid(observation.stamp_ns, Status.OUT_OF_DISTRIBUTION, self._unlike)
        row = read_inputs(self._reader, fitted.actuation, observation)
        if not isinstance(row, Abstention):
            row = unlike_training(observation, fitted.actuation_limits, self._actuation, self._info) or row
        if isinstance(row, Abstention):
            return ForceEstimate.invalid(observation.stamp_ns, row.status, row.detail)
        for view in self._views:
            image = observation.views.get(view)
            if isinstance(image, np.ndarray) and (reason := without_structure(image)):
                which = f"the image of view {view!r}" if len(self._views) > 1 else "the image"
                return ForceEstimate.invalid(observation.stamp_ns, Status.NO_CATHETER, f"{which} {reason}")
        return fitted.graph(**{name: value[None] for name, value in row.items()})


def _no_interval(known: BoolArray) -> Interval:
    """Returns intervals that exclude nothing, until some are measured."""
    half_n = np.where(known, np.inf, np.nan)
    return Interval(half_n, math.inf, np.full((3, 3), np.nan), False, "nothing: no sample was held out", 0, 0)
