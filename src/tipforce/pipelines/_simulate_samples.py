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
_LARGE = 1e9


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
    what = f"simulating {len(todo)} sessions"
    chosen = executor or LocalExecutor()
    chosen.run(work, todo, steps=wanted.per_session, shared=folder, progress=partial(progress, what))
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
    settings = wanted.settings
    need = wanted.samples * len(wanted.views) * settings.width * settings.height * _BYTES_PER_PX[lossless]
    place = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    free = shutil.disk_usage(place).free
    if need > free:
        raise InputError(
            f"{folder}: some {need / 1e9:.1f} GB are needed and {free / 1e9:.1f} GB are free; take fewer samples or "
            "another disk"
        )
    if need > _LARGE:
        say(f"some {need / 1e9:.1f} GB will be written to {folder}")


def _write_session(
    wanted: SampleSet, into: Growing, masks: bool, lossless: bool, number: int, tick: Callable[[], None]
) -> None:
    cv2.setNumThreads(1)  # there is a process for every core
    bench = wanted.bench(number)
    frames = wanted.frames(bench, number)
    truth = collect_truth(bench, frames)
    write_truth(truth, truth_path(into.folder / "truth" / bench.name))
    hidden = _masks(bench, truth) if masks else {}
    seen = _observed(bench, frames, tick)
    into.add(number, _labelled(bench, frames, seen, wanted.offset_ms(bench, number), hidden, lossless))


def _masks(bench: SimulatedBench, truth: Truth) -> dict[str, list[bytes]]:
    """Returns the true masks of every view as PNGs, 255 where the catheter is."""
    shown = dict(zip(bench.views, (truth, *truth.others.values()), strict=True))
    return {
        view: [
            encode_image(each.mask(k).astype(np.uint8) * np.uint8(255), lossless=True, jpeg_quality=0)[1]
            for k in range(len(truth.stamp_ns))
        ]
        for view, each in shown.items()
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
    seen: Sequence[Observation],
    offset_ms: float,
    masks: Mapping[str, Sequence[bytes]],
    lossless: bool,
) -> SessionSamples:
    info, log = bench.session_info, bench.log
    found = label_log(
        bench.stamp_ns[frames],
        (log.stamp_ns, log.force_n),
        bench.stage_log(),
        sensor=info.sensor,
        tare=info.sensor.no_contact_s or "none",
        offset_ms=offset_ms,
    )
    if not np.isfinite(found.force_n[:, found.known]).all():
        raise InputError(f"{bench.name}: the force sensor's readings are too rare to label its images")
    names = dict.fromkeys(name for observation in seen for name in observation.actuation)
    quality = bench.imaging.jpeg_quality
    encoded = {
        view: [encode_image(each.views[view], lossless=lossless, jpeg_quality=quality)[1] for each in seen]  # type: ignore[arg-type]
        for view in seen[0].views
    }
    return SessionSamples(
        session_info=info,
        frame=frames,
        stamp_ns=found.stamp_ns,
        actuation={name: np.array([each.actuation.get(name, np.nan) for each in seen]) for name in names},
        force_n=found.force_n,
        known=found.known,
        images=encoded,
        suffix=".png" if lossless else ".jpg",
        masks=masks,
    )
