"""Gathers the table that a regression learns from."""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import numpy.typing as npt

from ...datasets import Dataset, calibration_images
from ...errors import InputError
from ...types import BoolArray, FloatArray, IntArray, Observation
from ...vision import ResolvedVision, SessionDetector, detector_kind
from .._left_out import left_out_by_session
from .._reading import Abstention
from ._inputs import Inputs
from ._settings import ShapeRegressorSettings
from ._window import Window


@dataclass(frozen=True, eq=False)
class Rows:
    """Features and labels of n samples.

    Attributes:
        features: (n, k) features, in windows of ``width``.
        learn_n: (n, t) forces to learn in newtons.
        truth_n: (n, t) measured forces in newtons.
        session: (n,) sessions.
        names: names of the shape numbers of one lag; actuation follows them in ``features``.
        width: number of features of one lag.
        why_not: the first sample without a shape, and why.
        left_out: see `left_out_by_session`.
        vision: the detection of the first session in whose images a catheter was found; None if in no session.
    """

    features: FloatArray
    learn_n: FloatArray
    truth_n: FloatArray
    session: npt.NDArray[np.str_]
    names: tuple[str, ...]
    width: int
    why_not: str
    left_out: dict[str, list[int]]
    vision: ResolvedVision | None

    def at(self, index: IntArray) -> "Rows":
        """Returns only the rows at ``index``."""
        return replace(
            self,
            features=self.features[index],
            learn_n=self.learn_n[index],
            truth_n=self.truth_n[index],
            session=self.session[index],
        )


def gather_rows(
    settings: ShapeRegressorSettings,
    actuation: Sequence[str],
    dataset: Dataset,
    report: Callable[[float], None],
    shared: ResolvedVision | None = None,
) -> Rows:
    """Gathers features and labels of the samples of ``dataset`` whose shape is known.

    Args:
        settings: settings of the detection and the features.
        actuation: names of the drives among the features.
        dataset: the samples.
        report: called with the share that is done.
        shared: detection of all sessions, for a detector that is not resolved session by session.

    Raises:
        InputError: a sample has no force.
    """
    source = dataset.whole or dataset
    wanted = _needed(settings, dataset, source)
    frames = source if wanted.all() else source.subset(wanted)
    sample_names = frames.names_of(settings.vision.view)
    done = 0

    def read(observation: Observation, inputs: Inputs) -> tuple[tuple[str, ...], FloatArray | Abstention]:
        """Returns the names of the shape numbers of a frame, and its features or the reason why there are none."""
        nonlocal done
        done += 1
        report(done / len(frames))
        view = observation.views.get(settings.vision.view)
        return (() if view is None else inputs.names(view)), inputs.read(observation)

    # first the features of each frame, session by session, kept with the dataset under a key of all that they depend on
    chosen = settings.model_dump_json(include={"vision", "features", "angles"}) + repr(tuple(actuation))
    by_session = detector_kind(settings.vision.method).by_session
    vision: ResolvedVision | None = None
    frame_features: list[tuple[tuple[str, ...], FloatArray | Abstention]] = []
    for name in frames.sessions:
        info, images = frames.session_info[name], ()
        if by_session:
            images = calibration_images(frames, name, settings.vision.view)
        detector = SessionDetector(settings.vision, info, images, shared)
        if vision is None and isinstance(detector.vision, ResolvedVision) and not detector.vision.refused:
            vision = detector.vision
        inputs = Inputs(settings, actuation, detector)
        key = f"shape inputs {chosen} {detector.key}"
        frame_features += frames.subset(frames.session == name).derive(key, partial(read, inputs=inputs))
    # then the windows over them
    by_row: dict[int, FloatArray] = {}
    names: tuple[str, ...] | None = None
    why_not = ""
    window, session = Window(settings.window), None
    dataset_rows = set(dataset.rows.tolist())
    for index, (shape_names, row) in enumerate(frame_features):
        if frames.session[index] != session:
            window, session = Window(settings.window), frames.session[index]
        number = int(frames.rows[index])
        if isinstance(row, Abstention):
            if number in dataset_rows and not why_not:
                why_not = f"{sample_names[index]}: {row.detail} ({row.status})"
            continue
        if names is not None and shape_names != names:
            raise InputError(
                f"{dataset.title}: the samples differ in their shape numbers: {sample_names[index]} has "
                f"{', '.join(shape_names)}, the first has {', '.join(names)}"
            )
        names = shape_names
        by_row[number] = window.push(int(frames.stamp_ns[index]), row) if settings.window.used else row
    kept = np.array([row in by_row for row in dataset.rows.tolist()], np.bool_)
    truth = _targets(settings, dataset)
    learn = _averaged(truth, dataset, settings.label_average_ms) if settings.label_average_ms else truth
    features = [by_row[row] for row in dataset.rows[kept].tolist()]
    width = 0 if names is None else len(names) + len(actuation)
    return Rows(
        features=np.array(features).reshape(len(features), -1) if features else np.empty((0, 0)),
        learn_n=learn[kept],
        truth_n=truth[kept],
        session=dataset.session[kept],
        names=names or (),
        width=width,
        why_not=why_not,
        left_out=left_out_by_session(dataset.session, kept),
        vision=vision,
    )


def _needed(settings: ShapeRegressorSettings, dataset: Dataset, source: Dataset) -> BoolArray:
    """Returns (len(source),) True for the samples of ``dataset`` and the earlier frames that the window needs."""
    in_dataset = np.isin(source.rows, dataset.rows)
    if not settings.window.used:
        return in_dataset
    needed = in_dataset.copy()
    reach_ns = settings.window.reach_ns + round(settings.window.gap_ms * 1e6)
    for name in dataset.sessions:
        rows = np.flatnonzero(source.session == name)
        stamps, sample_stamps = source.stamp_ns[rows], source.stamp_ns[rows[in_dataset[rows]]]
        next_sample = np.searchsorted(sample_stamps, stamps)
        near = next_sample < len(sample_stamps)
        near[near] &= sample_stamps[next_sample[near]] - stamps[near] <= reach_ns
        needed[rows[near]] = True
    return needed


def _targets(settings: ShapeRegressorSettings, dataset: Dataset) -> FloatArray:
    """Returns (n, t) newtons: the known components, or the magnitude."""
    force = dataset.force_n[:, dataset.known] if settings.force == "components" else dataset.magnitude_n[:, None]
    if not np.isfinite(force).all():
        raise InputError(f"{dataset.title}: some samples have no force; leave them out")
    return np.ascontiguousarray(force)


def _averaged(values: FloatArray, dataset: Dataset, width_ms: float) -> FloatArray:
    """Returns the mean of the labels of ``dataset`` within half of ``width_ms`` before and after each sample."""
    half_ns = round(width_ms * 0.5e6)
    means = np.empty_like(values)
    for name in dataset.sessions:
        rows: IntArray = np.flatnonzero(dataset.session == name)
        stamps = dataset.stamp_ns[rows]
        sums = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values[rows], axis=0)])
        first = np.searchsorted(stamps, stamps - half_ns, side="left")
        last = np.searchsorted(stamps, stamps + half_ns, side="right")
        means[rows] = (sums[last] - sums[first]) / (last - first)[:, None]
    return means


def warn_of_sizes(dataset: Dataset, view: str) -> None:
    """Warns where sessions differ in the size of their images, because shape numbers are in pixels.

    Args:
        dataset: the samples.
        view: name of the view.
    """
    _, first = np.unique(dataset.session, return_index=True)
    session_by_size: dict[tuple[int, ...], str] = {}
    first_frames = dataset.subset(np.sort(first))
    for name, observation in zip(first_frames.session.tolist(), first_frames.observations(), strict=True):
        image = observation.views.get(view)
        if isinstance(image, np.ndarray):
            session_by_size.setdefault(image.shape[:2], name)
    if len(session_by_size) > 1:
        sizes = ", ".join(f"{width}x{height} in {name}" for (height, width), name in session_by_size.items())
        warnings.warn(
            f"{dataset.title}: the images differ in size ({sizes}), and shape numbers are in pixels: train on "
            "sessions of one camera at one distance",
            stacklevel=4,
        )
