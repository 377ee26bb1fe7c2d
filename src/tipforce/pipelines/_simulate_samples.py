"""Makes labelled samples of simulated sessions: the label is the one that an import of the recording gives."""

import json
import shutil
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from .._system.executor import Executor, LocalExecutor
from .._system.json_files import read_json
from ..alignment import PAIR_S, label_log, observations
from ..datasets import Growing, GrowingImages, GrowingShards, SessionSamples
from ..errors import FileFormatError, InputError
from ..io import encode_image
from ..simulation import (
    FluoroSettings,
    SampleSet,
    SimulatedBench,
    Truth,
    collect_truth,
    require_same_settings,
    truth_path,
    write_truth,
)
from ..types import Actuation, Frame, IntArray, Observation

_BYTES_PER_PX = {False: 0.2, True: 2.6}
"""Bytes per pixel of an image, lossless or not, with a margin."""
_LARGE_BYTES = 1e9
"""Above this the size of a dataset is stated before it is written."""


def write_samples(
    folder: Path,
    wanted: SampleSet,
    *,
    shards: bool,
    masks: bool,
    lossless: bool,
    say: Callable[[str], None],
    progress: Callable[[str, float], None],
    executor: Executor | None = None,
) -> None:
    """Simulates samples into a dataset folder, their truth into its folder ``truth``; finished sessions are kept.

    Args:
        folder: the dataset folder.
        wanted: preset, seed and numbers of the samples.
        shards: Parquet files instead of a folder of images.
        masks: whether the true masks of the catheter are written, too.
        lossless: keep every pixel as it is rendered.
        say: called with a line for people, such as a warning about disk space.
        progress: called with the current step and the share that is done.
        executor: runs the sessions; None: as many processes as there are cores.

    Raises:
        InputError: the views are not of one instant, something else is in ``folder``, or the disk has too little room.
    """
    delay_s = wanted.settings.view_delay_s if isinstance(wanted.settings, FluoroSettings) else 0.0
    if delay_s > PAIR_S:
        raise InputError(
            f"view_delay_s={delay_s:g}: the images of a sample are of one instant, at most {PAIR_S:g} s apart; leave "
            "view_delay_s out, or simulate recordings in place of a dataset"
        )
    made = {**wanted.model_dump(mode="json"), "shards": shards, "masks": masks, "lossless": lossless}
    manifest = folder / "simulated.json"
    if manifest.exists():
        require_same_settings(folder, _read_made(manifest), made)
    elif folder.exists() and any(folder.iterdir()):
        raise InputError(f"{folder}: is there already and no set of simulated samples; choose another folder with -o")
    else:
        _check_room(folder, wanted, lossless, say)
    into = (
        GrowingShards(folder, wanted.sessions, wanted.per_session) if shards else GrowingImages(folder, wanted.sessions)
    )
    if into.whole:
        return
    todo = [number for number in range(wanted.sessions) if not into.has(number)]
    (folder / "truth").mkdir(parents=True, exist_ok=True)
    manifest.write_text(json.dumps(made, indent=1) + "\n", encoding="utf-8")
    work = partial(_write_session, wanted, into, masks, lossless)
    shown = partial(progress, f"simulating {len(todo)} sessions")
    (executor or LocalExecutor()).run(work, todo, steps=wanted.per_session, shared=folder, progress=shown)
    settings = wanted.settings
    into.finish(f"{settings.preset}, seed {wanted.seed}, {wanted.samples} simulated samples")


def _read_made(path: Path) -> dict[str, Any]:
    """Returns the arguments that a folder was made from, as ``simulated.json`` states them."""
    remedy = "choose another folder with -o or delete this one"
    values = read_json(path, remedy=remedy)
    if not isinstance(values, dict):
        raise FileFormatError(f"{path}: does not state the arguments of the samples; {remedy}")
    return values  # pyright: ignore[reportUnknownVariableType]


def _check_room(folder: Path, wanted: SampleSet, lossless: bool, say: Callable[[str], None]) -> None:
    """Checks that the disk has room for the samples, and states the size where it is large.

    Args:
        folder: the dataset folder; it need not exist.
        wanted: the samples.
        lossless: whether images are written lossless.
        say: called with a line for people.

    Raises:
        InputError: the disk has too little room.
    """
    settings = wanted.settings
    needed_bytes = wanted.samples * len(wanted.views) * settings.width * settings.height * _BYTES_PER_PX[lossless]
    existing = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    free_bytes = shutil.disk_usage(existing).free
    if needed_bytes > free_bytes:
        raise InputError(
            f"{folder}: some {needed_bytes / 1e9:.1f} GB are needed and {free_bytes / 1e9:.1f} GB are free; take fewer "
            "samples or another disk"
        )
    if needed_bytes > _LARGE_BYTES:
        say(f"some {needed_bytes / 1e9:.1f} GB will be written to {folder}")


def _write_session(
    wanted: SampleSet, into: Growing, masks: bool, lossless: bool, number: int, tick: Callable[[], None]
) -> None:
    """Simulates the samples of one session, and adds them and their truth to the dataset.

    Args:
        wanted: preset, seed and numbers of the samples.
        into: the dataset that grows.
        masks: whether the true masks of the catheter are written, too.
        lossless: keep every pixel as it is rendered.
        number: number of the session.
        tick: called for each sample.
    """
    cv2.setNumThreads(1)  # there is a process for every core
    bench = wanted.bench(number)
    frames = wanted.frames(bench, number)
    truth = collect_truth(bench, frames)
    write_truth(truth, truth_path(into.folder / "truth" / bench.name))
    true_masks = _masks(bench, truth) if masks else {}
    observed = _observed(bench, frames, tick)
    into.add(number, _labelled(bench, frames, observed, wanted.offset_ms(bench, number), true_masks, lossless))


def _masks(bench: SimulatedBench, truth: Truth) -> dict[str, list[bytes]]:
    """Returns the true masks of every view as PNGs, 255 where the catheter is."""
    truth_by_view = dict(zip(bench.views, (truth, *truth.others.values()), strict=True))
    return {
        view: [
            encode_image(view_truth.mask(k).astype(np.uint8) * np.uint8(255), lossless=True, jpeg_quality=0)[1]
            for k in range(len(truth.stamp_ns))
        ]
        for view, view_truth in truth_by_view.items()
    }


def _observed(bench: SimulatedBench, frames: IntArray, tick: Callable[[], None]) -> list[Observation]:
    """Returns the observations of an estimator at ``frames``."""
    readings, joints = bench.readings, bench.readings.joints
    rows = range(len(joints.stamp_ns) if bench.has_joints else 0)
    events: list[Actuation | Frame] = [readings.actuation(joints, row) for row in rows]
    for index in frames.tolist():
        events += [bench.frame(index, view) for view in bench.views]
        tick()
    return list(observations(sorted(events, key=lambda event: event.stamp_ns), bench.views))


def _labelled(
    bench: SimulatedBench,
    frames: IntArray,
    observed: Sequence[Observation],
    offset_ms: float,
    masks: Mapping[str, Sequence[bytes]],
    lossless: bool,
) -> SessionSamples:
    """Labels observations from the simulated force log, as an import of the session would.

    Args:
        bench: the session.
        frames: (n,) indices of the frames.
        observed: the n observations at these frames.
        offset_ms: camera clock minus force clock.
        masks: view -> n true masks as PNG; empty: none are written.
        lossless: images as PNG, else as JPEG.

    Returns:
        The samples with forces in N, base frame, and encoded images.

    Raises:
        InputError: a frame gets no force.
    """
    info, log = bench.session_info, bench.log
    labels = label_log(
        bench.stamp_ns[frames],
        (log.stamp_ns, log.force_n),
        bench.stage_log(),
        sensor=info.sensor,
        tare=info.sensor.no_contact_s or "none",
        offset_ms=offset_ms,
    )
    if not np.isfinite(labels.force_n[:, labels.known]).all():
        raise InputError(f"{bench.name}: the force sensor's readings are too rare to label its images")
    drives = dict.fromkeys(name for observation in observed for name in observation.actuation)
    quality = bench.imaging.jpeg_quality
    encoded = {
        view: [encode_image(each.views[view], lossless=lossless, jpeg_quality=quality)[1] for each in observed]  # type: ignore[arg-type]
        for view in observed[0].views
    }
    return SessionSamples(
        session_info=info,
        frame=frames,
        stamp_ns=labels.stamp_ns,
        actuation={name: np.array([each.actuation.get(name, np.nan) for each in observed]) for name in drives},
        force_n=labels.force_n,
        known=labels.known,
        images=encoded,
        suffix=".png" if lossless else ".jpg",
        masks=masks,
    )
