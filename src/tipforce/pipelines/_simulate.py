"""Sessions or labelled samples of a simulated bench."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

from .._system.executor import Executor, ExecutorName, executor_of
from ..errors import InputError
from ..estimators import Progress, no_progress
from ..simulation import PRESETS, AnySimulationSettings, read_truth, sample_set
from ..simulation import simulate as simulate_sessions
from ._simulate_samples import write_samples
from ._simulate_sessions import FORMS, refuse_form


@dataclass(frozen=True)
class SimulateReport:
    """Result of a simulation.

    Attributes:
        paths: the sessions or the dataset.
        frames: number of frames.
        sessions: number of sessions.
        views: names of the views of a dataset.
        seconds: time that it took.
    """

    paths: tuple[Path, ...]
    frames: int
    sessions: int
    views: tuple[str, ...]
    seconds: float


def preset_settings(
    preset: str | AnySimulationSettings, seconds: float | None = None, changes: Mapping[str, Any] | None = None
) -> AnySimulationSettings:
    """Returns a preset's settings with changes; changed settings get the name "PRESET changed".

    Args:
        preset: its name; settings are returned as they are.
        seconds: length of each session in s; None: the preset's.
        changes: nested values, as ``{"world": {"wall": {"friction": [0, 0]}}}``. A changed size, rate or base side
            holds for all sessions, also where the preset draws one for each.

    Raises:
        InputError: there is no such preset.
        pydantic.ValidationError: a change is refused.
    """
    if not isinstance(preset, str):
        return preset
    if preset not in PRESETS:
        raise InputError(f"{preset}: there is no such preset; there are {', '.join(PRESETS)}")
    base = PRESETS[preset]
    values: dict[str, Any] = base.model_dump()
    for change in (changes or {}, {} if seconds is None else {"world": {"seconds": seconds}}):
        _merge(values, change)
    _keep_stated(values, changes or {})
    chosen = type(base).model_validate(values)
    if chosen != base and chosen.preset == preset:
        chosen = chosen.model_copy(update={"preset": f"{preset} changed"})
    return chosen


def simulate(
    output: str | Path,
    preset: str | AnySimulationSettings = "bench-2021",
    *,
    sessions: int = 8,
    seconds: float | None = None,
    seed: int = 0,
    form: Literal["recording", "files", "dicom"] = "recording",
    lossless: bool = False,
    executor: Executor | ExecutorName = "local",
    progress: Progress | None = None,
) -> SimulateReport:
    """Simulates sessions as a real bench leaves them, with the truth in a file beside each.

    Args:
        output: folder of the result; sessions that exist there are kept.
        preset: bench-2021, generalise, varied, thesis-2021-plain, thesis-2021, fluoro, biplane,
            fluoro-varied, biplane-varied, guidewire, catheter-5f, or settings of one's own.
        sessions: number of sessions.
        seconds: length of each in s; None: the preset's.
        seed: the same seed gives the same sessions.
        form: "recording": one a session; "files", "dicom": a folder of video or DICOM, logs and bench.toml.
        lossless: keep every pixel as it is rendered.
        executor: "local": all cores of this machine; "ray": the nodes of the cluster at RAY_ADDRESS.
        progress: called with the current step and the share that is done.

    Returns:
        The paths of the sessions, their number of frames and the time taken.

    Raises:
        InputError: no such preset, or sessions of other settings in ``output``.
        MissingExtraError: DICOM without pydicom, the cluster without Ray.
    """
    started, chosen = time.monotonic(), preset_settings(preset, seconds)
    refuse_form(form, chosen)
    suffix, write = FORMS[form]
    paths = simulate_sessions(
        Path(output),
        partial(write, lossless=lossless),
        chosen,
        suffix=suffix,
        sessions=sessions,
        seed=seed,
        executor=executor_of(executor),
        progress=progress,
    )
    frames = sum(len(read_truth(path).stamp_ns) for path in paths)
    return SimulateReport(tuple(paths), frames, len(paths), (), time.monotonic() - started)


def simulate_dataset(
    output: str | Path,
    preset: str | AnySimulationSettings = "bench-2021",
    *,
    samples: int = 1000,
    samples_per_session: int = 80,
    seconds: float | None = None,
    seed: int = 0,
    shards: bool = False,
    masks: bool = False,
    lossless: bool = False,
    executor: Executor | ExecutorName = "local",
    say: Callable[[str], None] | None = None,
    progress: Progress | None = None,
) -> SimulateReport:
    """Simulates labelled images at random instants of as many short sessions as needed: a dataset for training.

    Args:
        output: the dataset folder; an interrupted run goes on with the same arguments.
        preset: see `simulate`.
        samples: number of images.
        samples_per_session: images of each session.
        seconds: length of each session in s; None: as long as the samples need.
        seed: the same seed gives the same samples.
        shards: Parquet files instead of a folder of images.
        masks: the true masks of the catheter, too, in masks/.
        lossless: keep every pixel as it is rendered.
        executor: "local": all cores of this machine; "ray": the nodes of the cluster at RAY_ADDRESS.
        say: called with a line for people, such as a warning about disk space.
        progress: called with the current step and the share that is done.

    Returns:
        The folder, the numbers of samples and sessions, the views and the time taken.

    Raises:
        InputError: no such preset, other samples in ``output``, too little disk.
        MissingExtraError: the cluster without Ray.
    """
    started, chosen = time.monotonic(), preset_settings(preset)
    wanted = sample_set(chosen, seed=seed, samples=samples, per_session=samples_per_session, seconds=seconds)
    write_samples(
        Path(output), wanted, shards=shards, masks=masks, lossless=lossless,
        say=say or _silent, progress=progress or no_progress, executor=executor_of(executor),
    )  # fmt: skip
    return SimulateReport((Path(output),), samples, wanted.sessions, tuple(wanted.views), time.monotonic() - started)


def _merge(values: dict[str, Any], changes: Mapping[str, Any]) -> None:
    """Writes ``changes`` into ``values``; nested tables are merged, other values replaced."""
    for key, value in changes.items():
        if isinstance(value, Mapping) and isinstance(values.get(key), dict):
            _merge(values[key], value)
        else:
            values[key] = value


def _keep_stated(values: dict[str, Any], changes: Mapping[str, Any]) -> None:
    """Replaces the lists from which a preset draws camera or detector by the stated size, rate and base side."""
    for choice in (values[key] for key in ("cameras", "detectors") if values.get(key)):
        if changes.keys() & {"width", "height"}:
            choice["sizes"] = [(values["width"], values["height"])]
        if "fps" in changes.get("world", {}).get("clock", {}):
            choice["fps"] = [values["world"]["clock"]["fps"]]
        if "base_side" in changes.get("scene", {}):
            choice["base_sides"] = [values["scene"]["base_side"]]


def _silent(line: str) -> None:
    del line
