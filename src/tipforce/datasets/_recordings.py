"""Recordings as a dataset: every labelled frame is a sample, every file is a session."""

import itertools
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..alignment import labels
from ..errors import InputError
from ..io import RecordingReader
from ..types import DEFAULT_VIEW, FloatArray, IntArray, SessionInfo
from ._dataset import Dataset
from ._stores import Recordings


def _free_name(name: str, path: Path, taken: Collection[str]) -> str:
    """Returns ``name``, or where another session has it, ``name`` with the file's stem, and a number if need be."""
    numbered = (f"{name} ({path.stem}, {number})" for number in itertools.count(2))
    names = itertools.chain((name, f"{name} ({path.stem})"), numbered)
    return next(each for each in names if each not in taken)


def open_recordings(paths: Sequence[Path], title: str, *, view: str | None = None, force: str = "force") -> Dataset:
    """Returns the frames of ``paths`` that have a force; frames outside the force log's time are left out.

    Args:
        paths: the recordings.
        title: name of the dataset.
        view: view whose frames are the samples, with the images of the other views at the same instants; the first
            view of the first recording where it is None or not there.
        force: stream of the forces.

    Raises:
        InputError: a recording has no images or forces, or no frame has a force.
    """
    stamps: list[IntArray] = []
    forces: list[FloatArray] = []
    frames: list[IntArray] = []
    actuation: list[dict[str, FloatArray]] = []
    infos: dict[str, SessionInfo] = {}
    remarks: list[str] = []
    known, known_in_some = np.ones(3, np.bool_), np.zeros(3, np.bool_)  # components of the force
    with RecordingReader(paths[0]) as reader:
        views = reader.views or (DEFAULT_VIEW,)
        views = tuple(sorted(views, key=lambda name: name != view))  # the other views stay in their order
        paths = [reader.path, *paths[1:]]  # if the given file was cut off, this is the recovered one
    opened: list[Path] = []
    for given in paths:
        with RecordingReader(given) as reader:
            path = reader.path
            opened.append(path)
            for stream in (*views, force):
                if stream not in reader.info.streams:
                    present = ", ".join(reader.info.streams) or "none"
                    raise InputError(f"{path}: to train on it, a recording needs a stream {stream!r}; it has {present}")
            session_labels = labels(reader, camera=views[0], force=force)
            session_stamps, force_known = session_labels.stamp_ns, session_labels.known
            has_force = np.isfinite(session_labels.force_n[:, force_known]).all(axis=1) & force_known.any()
            rows, count = np.flatnonzero(has_force), len(session_stamps)
            known, known_in_some = known & force_known, known_in_some | force_known
            if len(rows) < count:
                remarks.append(f"{path.name}: {count - len(rows)} of {count} frames have no force, and are left out")
            stamps.append(session_stamps[rows])
            forces.append(session_labels.force_n[rows])
            frames.append(rows)
            actuation.append(reader.actuation_at(session_stamps[rows]))
            info = reader.session_info
            name = _free_name(info.name, path, infos)
            infos[name] = replace(info, name=name)
    counts = [len(rows) for rows in frames]
    if not sum(counts):
        raise InputError(f"{title}: no frame has a force; see `tipforce inspect {paths[0]}` for the times of both")
    force_n = np.concatenate(forces)
    force_n[:, ~known] = np.nan
    remarks += [
        f"f{'xyz'[axis]} is left out, because it is known in some of the recordings only"
        for axis in np.flatnonzero(known_in_some & ~known).tolist()
    ]
    names = dict.fromkeys(name for values in actuation for name in values)
    gathered = {
        name: np.concatenate(
            [values.get(name, np.full(count, np.nan)) for values, count in zip(actuation, counts, strict=True)]
        )
        for name in names
    }
    for path, values, count in zip(opened, actuation, counts, strict=True):
        lacking = [name for name in names if np.isnan(values.get(name, np.array([np.nan]))).all()]
        if count and lacking:
            remarks.append(f"{path.name}: lacks the actuation {', '.join(lacking)}, which other recordings have")
    recording, frame = np.repeat(np.arange(len(opened)), counts), np.concatenate(frames)
    stamp_ns = np.concatenate(stamps)
    pairs = zip(recording.tolist(), frame.tolist(), strict=True)
    frame_names = [f"{opened[path_index].name} frame {number}" for path_index, number in pairs]
    return Dataset(
        store=Recordings(stamp_ns, gathered, tuple(opened), recording, frame, views[0], views[1:]),
        session=np.repeat(list(infos), counts),
        stamp_ns=stamp_ns,
        actuation=gathered,
        force_n=force_n,
        known=known,
        names=np.array(frame_names),
        session_info=infos,
        rows=np.arange(len(stamp_ns)),
        title=title,
        remarks=tuple(remarks),
        view_names={view: np.array([f"{name}, view {view} beside it" for name in frame_names]) for view in views[1:]},
    )
