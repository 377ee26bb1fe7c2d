"""Writing the folder layout: images (or shape columns), ``metadata.csv``, ``dataset.json``."""

import csv
from collections.abc import Callable
from pathlib import Path

import cv2

from ..errors import InputError
from ..io import replacing_folder
from ..types import Image, Observation, ShapeFeatures
from ._dataset import Dataset
from ._facts import FACTS, facts_text
from ._folder import FILE, METADATA
from ._growing_images import cell
from ._rows import FORCES

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
    ``folder`` is there already (unless ``overwrite``, and then only a dataset folder is replaced).
    """
    folder = Path(folder)
    _refuse(folder, overwrite=overwrite)
    if not len(dataset):
        raise InputError(f"{dataset.title}: has no samples to write")
    with replacing_folder(folder) as part:
        view = _write_rows(dataset, part, progress)
        contexts = [dataset.contexts[name] for name in dataset.sessions]
        (part / FACTS).write_text(facts_text(dataset.title, contexts, view), encoding="utf-8")
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
    """Pictures and ``metadata.csv``; returns the only view's name, "camera" where there are several."""
    forces = [axis for axis in range(3) if dataset.known[axis]]
    view_name = "camera"
    with (part / METADATA).open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        for row, observation in enumerate(dataset.observations()):
            seen = _seen(dataset, observation, part, row)
            if row == 0:
                view_name = next(iter(observation.views)) if len(observation.views) == 1 else view_name
                names = [*seen, "session", "stamp_ns", *dataset.actuation, *(FORCES[axis] for axis in forces)]
                writer.writerow(names)
            values = [*seen.values(), str(dataset.session[row]), int(dataset.stamp_ns[row])]
            values += [float(column[row]) for column in dataset.actuation.values()]
            values += [float(dataset.force_n[row, axis]) for axis in forces]
            writer.writerow([cell(value) for value in values])
            if progress is not None:
                progress("writing samples", (row + 1) / len(dataset))
    return view_name


def _seen(dataset: Dataset, observation: Observation, part: Path, row: int) -> dict[str, str | float]:
    """Column -> cell of what is seen; pictures are written."""
    found: dict[str, str | float] = {}
    several = len(observation.views) > 1
    for name, view in observation.views.items():
        if not isinstance(view, ShapeFeatures):
            found[f"{name}_{FILE}" if several else FILE] = _write_image(view, part, row, name if several else "")
        elif several:
            raise InputError(f"{dataset.title}: a dataset folder holds shape numbers of one view only")
        else:
            found |= zip([f"shape_{number}" for number in view.names], view.values.tolist(), strict=True)
    return found


def _write_image(image: Image, part: Path, row: int, view: str) -> str:
    name = f"images/{row:06d}{view and f'-{view}'}.png"
    (part / "images").mkdir(exist_ok=True)
    shown = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    (part / name).write_bytes(cv2.imencode(".png", shown)[1].tobytes())
    return name
