"""Writing the folder layout: images (or shape columns), ``metadata.csv``, ``dataset.json``."""

import csv
import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

import cv2
import numpy as np

from ..errors import InputError
from ..types import Image, Observation, ShapeFeatures
from ._dataset import Dataset
from ._folder import FACTS, FORCES, METADATA
from ._replacing import replacing_folder

__all__ = ["write_dataset"]


def write_dataset(
    dataset: Dataset,
    folder: str | Path,
    *,
    overwrite: bool = False,
    progress: Callable[[str, float], None] | None = None,
) -> Path:
    """Write ``dataset`` as a dataset folder (images lossless, as PNG) that `open_dataset` reads back; returns it.

    Whole or not at all: everything is written beside ``folder`` and renamed at the end. Raises InputError where
    ``folder`` is there already (unless ``overwrite``, and then only a dataset folder is replaced) or the observations
    have more than one view.
    """
    folder = Path(folder)
    _refuse(folder, overwrite=overwrite)
    if not len(dataset):
        raise InputError(f"{dataset.title}: has no samples to write")
    with replacing_folder(folder) as part:
        view = _write_rows(dataset, part, progress)
        _write_facts(dataset, part / FACTS, view)
    return folder


def _refuse(folder: Path, *, overwrite: bool) -> None:
    if not folder.exists():
        return
    if not overwrite:
        raise InputError(f"{folder}: exists already; choose another name or state --overwrite")
    names = {item.name for item in folder.iterdir()} if folder.is_dir() else {folder.name}
    strange = sorted(names - {"images", METADATA, FACTS})
    if strange:
        raise InputError(
            f"{folder}: holds {strange[0]!r}, which is no part of a dataset folder, so --overwrite "
            "does not replace it; choose another name"
        )


def _write_rows(dataset: Dataset, part: Path, progress: Callable[[str, float], None] | None) -> str:
    forces = [axis for axis in range(3) if dataset.known[axis]]
    view_name = "camera"
    with (part / METADATA).open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        for row, observation in enumerate(dataset.observations()):
            view_name, view = _only_view(dataset, observation)
            if isinstance(view, ShapeFeatures):
                head, cells = [f"shape_{name}" for name in view.names], [repr(v) for v in view.values.tolist()]
            else:
                head, cells = ["file_name"], [_write_image(view, part, row)]
            if row == 0:
                writer.writerow([*head, "session", "stamp_ns", *dataset.actuation, *(FORCES[axis] for axis in forces)])
            writer.writerow(
                [
                    *cells,
                    str(dataset.session[row]),
                    int(dataset.stamp_ns[row]),
                    *(
                        "" if np.isnan(values[row]) else repr(float(values[row]))
                        for values in dataset.actuation.values()
                    ),
                    *(repr(float(dataset.force_n[row, axis])) for axis in forces),
                ]
            )
            if progress is not None:
                progress("writing samples", (row + 1) / len(dataset))
    return view_name


def _only_view(dataset: Dataset, observation: Observation) -> tuple[str, Image | ShapeFeatures]:
    if len(observation.views) != 1:
        raise InputError(
            f"{dataset.title}: a dataset folder holds one view a sample, these have {', '.join(observation.views)}"
        )
    return next(iter(observation.views.items()))


def _write_image(image: Image, part: Path, row: int) -> str:
    name = f"images/{row:06d}.png"
    (part / "images").mkdir(exist_ok=True)
    shown = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    (part / name).write_bytes(cv2.imencode(".png", shown)[1].tobytes())
    return name


def _write_facts(dataset: Dataset, path: Path, view: str) -> None:
    contexts = [dataset.contexts[name] for name in dataset.sessions]
    first = contexts[0]
    if any(c.catheter != first.catheter or c.metres_per_px != first.metres_per_px for c in contexts):
        raise InputError(
            f"{dataset.title}: its sessions differ in catheter or scale; a dataset folder has one of each: "
            "write the sessions into folders of their own"
        )
    notes = [dict(context.notes) for context in contexts]
    shared = {key: text for key, text in notes[0].items() if all(other.get(key) == text for other in notes)}
    facts = {
        "title": dataset.title,
        "frame": shared.pop("force_frame", "base"),
        "view": view,
        "metres_per_px": first.metres_per_px,
        "catheter": asdict(first.catheter),
        "notes": shared,
        "sessions": {
            name: {key: text for key, text in own.items() if key not in shared and key != "force_frame"}
            for name, own in zip(dataset.sessions, notes, strict=True)
        },
    }
    path.write_text(json.dumps(facts, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
