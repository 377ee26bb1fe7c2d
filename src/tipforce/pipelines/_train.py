"""From labelled samples to a model folder."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from ..datasets import Dataset, join, open_dataset, without_sessions
from ..estimators import (
    Estimator,
    Progress,
    check_target,
    create,
    load_initial_model,
    read_manifest,
    run_directory,
    save_model,
    training_lines,
)
from ..estimators import train as fit
from ..types import SessionInfo
from ._estimate import session_info_from

__all__ = ["Data", "TrainReport", "data_of", "train"]

Data = str | Path | Dataset | Sequence[str | Path | Dataset]
"""Labelled samples: a dataset, or recordings, a dataset folder, Parquet shards or a published layout; or several."""


@dataclass(frozen=True, eq=False)
class TrainReport:
    """What a training came to.

    ``model``: the folder; ``estimator``: the fitted method; ``manifest``: content of its model.json; ``metrics``:
    errors in newtons on the samples held out, empty without any; ``lines``: the same for people.
    """

    model: Path
    estimator: Estimator
    manifest: Mapping[str, Any]
    metrics: Mapping[str, Any]
    lines: tuple[str, ...]


def train(
    data: Data,
    output: str | Path,
    *,
    estimator: str = "svr",
    settings: BaseModel | Mapping[str, Any] | None = None,
    bench: SessionInfo | str | Path | None = None,
    init_from: str | Path | None = None,
    without: Sequence[str] = (),
    calibrate: Data | None = None,
    samples: int | None = None,
    holdout: float = 0.0,
    seed: int | None = None,
    resume: bool = False,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> TrainReport:
    """Trains a method on labelled samples and saves it as a model folder.

    Args:
        data: labelled samples; several datasets are joined.
        output: the model folder to write.
        estimator: name of the method: svr, dcfe, compact, rod or rod-track.
        settings: the method's settings, or some of their values.
        bench: metadata in place of what the data hold.
        init_from: networks only: a model to be fine-tuned, or "pretrained" for the shipped one of this method.
        without: names of sessions that are left out.
        calibrate: other sessions, on which the intervals are found.
        samples: draw so many samples; all by default.
        holdout: share of the samples, 0..1, held out at random to measure errors on.
        seed: of drawing, holding out, cross-validation and training; by default that of the settings.
        resume: networks only: go on with a training that was cut off.
        overwrite: replace a model that is there already.
        progress: called with what is done and its share.

    Raises:
        InputError: the data or settings cannot be used, or ``output`` is there already.
        MissingExtraError: a network without torch.
        ModelError: the exported model answers otherwise than the trained one.
    """
    output, stated = Path(output), session_info_from(bench)
    method = create(estimator, settings)
    check_target(output, overwrite=overwrite)
    start = load_initial_model(method, None if init_from is None else str(init_from), resume=resume)
    dataset = without_sessions(data_of(data, stated), without)
    apart = None if calibrate is None else data_of(calibrate, stated)
    with run_directory(method, output, resume=resume) as folder:
        done = fit(
            method, dataset, samples=samples, holdout=holdout,
            seed=getattr(method.settings, "seed", 0) if seed is None else seed,
            start=start, folder=folder, resume=resume, calibrate=apart, progress=progress,
        )  # fmt: skip
        save_model(
            done.estimator, output, done.dataset, done.metrics, calibration=done.calibration, overwrite=overwrite
        )
    manifest = read_manifest(output)
    return TrainReport(output, done.estimator, manifest, done.metrics, (*dataset.remarks, *training_lines(manifest)))


def data_of(data: Data, stated: SessionInfo | None = None) -> Dataset:
    """``data`` as one dataset, with ``stated`` metadata in place of its own."""
    parts = [data] if isinstance(data, str | Path | Dataset) else list(data)
    dataset = join([part if isinstance(part, Dataset) else open_dataset(part) for part in parts])
    if stated is None or stated == SessionInfo():
        return dataset
    shared = replace(stated, name="")
    return replace(dataset, session_info={name: info.updated(shared) for name, info in dataset.session_info.items()})
