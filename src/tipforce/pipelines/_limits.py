"""Which unknown limits the force: the session model over the frames of a file, a dataset or a calibration."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..alignment import observations
from ..calibration import CalibrationSession
from ..datasets import Dataset, calibration_images, open_source
from ..errors import InputError
from ..estimators import Progress, no_progress
from ..estimators.session import (
    ForceLimits,
    Knowledge,
    LimitsTally,
    RodTrack,
    RodTrackSettings,
    RodTrackStream,
    SessionFilter,
    StatedErrors,
    rod_model,
)  # fmt: skip
from ..io import frame_count
from ..types import Observation, SessionInfo
from ..vision import VisionSettings
from ._estimate import for_source, session_info_from, start_stream

MAX_FRAMES = 600
"""Largest number of frames of a dataset's session, or of a recording that was calibrated from, that are looked at."""


def limits_in(
    path: str | Path,
    *,
    settings: RodTrackSettings | Mapping[str, Any] | None = None,
    bench: SessionInfo | str | Path | None = None,
    actuation: Mapping[str, float] | None = None,
    progress: Progress | None = None,
) -> ForceLimits:
    """Finds which unknown makes most of the uncertainty of the force in a session.

    Args:
        path: a recording, or a video or folder of images. No force log is needed.
        settings: settings of `rod-track`.
        bench: metadata in place of those in the file.
        actuation: constant readings of drives that the file does not hold, as ``{"knob_deg": 10.0}``.
        progress: called with the current step and the share that is done.

    Returns:
        The contribution of each group of unknowns in the frames in contact.

    Raises:
        InputError: the file cannot be read, holds no frame, or metadata are missing; the message names them.
    """
    report = progress or no_progress
    with open_source(path, actuation=actuation or {}, stated=session_info_from(bench)) as source:
        estimator = for_source(RodTrack(RodTrackSettings.model_validate(settings or {})), source)
        view = estimator.views[0]
        total = frame_count(source, view)
        stream = start_stream(estimator, source)
        assert isinstance(stream, RodTrackStream)

        def counted() -> Iterator[Observation]:
            for number, observation in enumerate(observations(source, estimator.views)):
                yield observation
                report(f"frame {number}", min(1.0, number / total) if total else 0.0)

        return _limits(stream, counted(), view, str(path))


def limits_in_dataset(estimator: RodTrack, dataset: Dataset) -> tuple[str, ForceLimits] | None:
    """Finds the same in the session of a dataset that has the most frames.

    Args:
        estimator: the session model, for the views of the dataset.
        dataset: the frames.

    Returns:
        Name of the session, and its limits; None where the session lacks metadata that the model needs.
    """
    name = max(dataset.sessions, key=lambda session: int((dataset.session == session).sum()))
    rows = (dataset.session == name).nonzero()[0]
    view = estimator.views[0]
    stream = estimator.start(dataset.session_info[name], calibration_images(dataset, name, view))
    if not isinstance(stream, RodTrackStream):
        return None
    frames = dataset.subset(rows[:: -(-len(rows) // MAX_FRAMES)])  # every n-th one, n rounded up
    return name, _limits(stream, frames.observations(), view, name)


def _limits(stream: RodTrackStream, frames: Iterable[Observation], view: str, where: str) -> ForceLimits:
    """Runs the session model over frames, and collects its uncertainty after each frame that it could use.

    Args:
        stream: the started session model.
        frames: the frames in order.
        view: the view that the model reads.
        where: name of the data, for the message.

    Raises:
        InputError: there is no frame.
    """
    tally, count = LimitsTally(), 0
    for observation in frames:
        before = stream.filter.newest
        stream.update(observation)
        if stream.filter.newest is not before:
            tally.add(stream.filter)
        count += 1
    if not count:
        raise InputError(f"{where}: holds no frame of the view {view!r}; look with `tipforce inspect`")
    return tally.limits(view)


def limits_calibrated(sessions: Sequence[CalibrationSession], calibrated: SessionInfo) -> ForceLimits:
    """Finds which unknown limits the force in recordings, once the values that they gave are stated.

    Args:
        sessions: the detected lines of the recordings, all of one view.
        calibrated: the calibrated metadata.

    Returns:
        The limits in all recordings.
    """
    view, tally = sessions[0].view, LimitsTally()
    settings = RodTrackSettings(vision=VisionSettings(view=view))
    for session in sessions:
        info = session.info.updated(calibrated)
        model = SessionFilter(settings, Knowledge.stated(settings), rod_model(info, settings.segments), info)
        rows = np.arange(0, len(session.lines), -(-len(session.lines) // MAX_FRAMES))
        elapsed_s = np.diff(session.seconds[rows], prepend=session.seconds[0])
        for row, passed_s in zip(rows.tolist(), elapsed_s.tolist(), strict=True):
            model.step(
                session.lines[row], session.scale_m_per_px, float(session.knob_deg[row]), passed_s,
                stated=StatedErrors.of(session.shapes[row]),
            )  # fmt: skip
            tally.add(model)
    return tally.limits(view)
