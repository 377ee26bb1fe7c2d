"""The dataset folder: ``metadata.csv`` and images (the layout of Hugging Face's ImageFolder), ``dataset.json``.

``metadata.csv`` has the columns ``file_name`` (with several views ``VIEW_file_name`` for each; or columns
``shape_NAME`` with shape numbers), ``stamp_ns``, ``fx_n``, ``fy_n``, ``fz_n`` (at least one), ``session`` (default: the
folder is one session), and any ``NAME_UNIT`` as actuation (an empty cell: no reading); columns ``note`` and
``note_...`` are not read. ``dataset.json`` (optional): `FolderFacts`. ``masks/`` (optional): masks of the catheter for
each image, for training.
"""

import csv
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ..errors import InputError, TableError
from ..io import InFolder, Table, open_table, replacing_folder
from ..types import FloatArray, Image, IntArray, Observation, ShapeFeatures
from ._checks import crc_column, crc_text
from ._dataset import Dataset, RowStore
from ._facts import FACTS, facts_text, read_facts
from ._label_table import FORCES, dataset_of
from ._stores import ImageFiles, ShapeTable

METADATA = "metadata.csv"
FILE = "file_name"
MASKS = "masks"


def open_folder(folder: Path, table_name: str = METADATA) -> Dataset:
    """Opens a dataset folder.

    Args:
        folder: the folder.
        table_name: name of the table in it.

    Returns:
        The samples; images are read when they are used.

    Raises:
        FileFormatError: a file is missing or cannot be read.
        TableError: a column is missing, or a cell has a wrong value; the message names it.
        TimeError: two samples of a session have the same stamp.
    """
    table, facts = open_table(folder / table_name, comments=False), read_facts(folder / FACTS)
    files = [name for name in table.columns if name == FILE or name.endswith(f"_{FILE}")]
    shapes = [name for name in table.columns if name.startswith("shape_")]
    if bool(files) == bool(shapes):
        raise TableError(f"{table.path}: expected either a column {FILE} or columns shape_NAME")

    def stored(stamps: IntArray, actuation: Mapping[str, FloatArray]) -> tuple[RowStore, dict[str, list[str]]]:
        """Returns the store of the rows, and view -> name of each row's image; see `dataset_of`."""
        if shapes:
            values = np.column_stack([table.numbers(name) for name in shapes])
            names = tuple(name.removeprefix("shape_") for name in shapes)
            store = ShapeTable(stamps, actuation, names, values, view=facts.view)
            return store, {facts.view: [table.place(row) for row in range(len(table))]}
        paths = {facts.view if name == FILE else name.removesuffix(f"_{FILE}"): table.text(name) for name in files}
        crcs = {view: crc_column(view if len(paths) > 1 else "") for view in paths}
        stated = {view: table.text(column) for view, column in crcs.items() if column in table.columns}
        return ImageFiles(stamps, actuation, _images(folder, table, paths), _masks(folder, paths), stated), paths

    return dataset_of(table, facts, folder.resolve().name, [*files, *shapes], stored)


def _images(folder: Path, table: Table, files: Mapping[str, list[str]]) -> dict[str, tuple[Path, ...]]:
    """Returns view -> path of each row's image. Raises FileFormatError if one is missing or outside of ``folder``."""
    inside = InFolder(folder)
    return {
        view: tuple(inside.file(table, row, name) for row, name in enumerate(names)) for view, names in files.items()
    }


def _masks(folder: Path, files: Mapping[str, list[str]]) -> dict[str, tuple[Path, ...]]:
    """Returns the paths ``masks/SESSION/FRAME.png`` for ``images/SESSION/FRAME.jpg``, if there is that folder."""
    if not (folder / MASKS).is_dir():
        return {}
    return {
        view: tuple((folder / MASKS).joinpath(*Path(name).parts[1:]).with_suffix(".png") for name in names)
        for view, names in files.items()
    }


def write_dataset(
    dataset: Dataset,
    folder: str | Path,
    *,
    overwrite: bool = False,
    progress: Callable[[str, float], None] | None = None,
) -> Path:
    """Writes a dataset folder that `open_dataset` reads, and returns its path; images are written lossless, as PNG.

    Either all of it is written or nothing: the new folder is written beside ``folder`` and renamed at the end.

    Args:
        dataset: the samples.
        folder: the new folder.
        overwrite: whether ``folder`` may be replaced; only a dataset folder is.
        progress: gets a text and the share that is done, 0 to 1.

    Raises:
        InputError: ``folder`` exists already and is not replaced, or there are no samples.
    """
    folder = Path(folder)
    _refuse(folder, overwrite=overwrite)
    if not len(dataset):
        raise InputError(f"{dataset.title}: has no samples to write")
    with replacing_folder(folder) as part:
        view = _write_rows(dataset, part, progress)
        infos = [dataset.session_info[name] for name in dataset.sessions]
        (part / FACTS).write_text(facts_text(dataset.title, infos, view), encoding="utf-8")
    return folder


def cell(value: Any) -> str:
    """Returns a value as ``metadata.csv`` states it: "" for NaN, otherwise the exact value."""
    if isinstance(value, float):
        return "" if math.isnan(value) else repr(value)
    return str(value)


def _refuse(folder: Path, *, overwrite: bool) -> None:
    """Raises InputError where ``folder`` exists and may not be replaced, or is no dataset folder."""
    if not folder.exists():
        return
    if not overwrite:
        raise InputError(f"{folder}: exists already; choose another name or state overwrite=True")
    names = {item.name for item in folder.iterdir()} if folder.is_dir() else {folder.name}
    unexpected = sorted(names - {"images", METADATA, FACTS})
    if unexpected:
        raise InputError(
            f"{folder}: holds {unexpected[0]!r}, which is no part of a dataset folder, so overwrite=True "
            "does not replace it; choose another name"
        )


def _write_rows(dataset: Dataset, part: Path, progress: Callable[[str, float], None] | None) -> str:
    """Writes images and ``metadata.csv``; returns the name of the only view, "camera" if there are several."""
    forces = [axis for axis in range(3) if dataset.known[axis]]
    view_name = "camera"
    with (part / METADATA).open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        for row, observation in enumerate(dataset.observations()):
            cells = _write_views(dataset, observation, part, row)
            if row == 0:
                view_name = next(iter(observation.views)) if len(observation.views) == 1 else view_name
                names = [*cells, "session", "stamp_ns", *dataset.actuation, *(FORCES[axis] for axis in forces)]
                writer.writerow(names)
            values = [*cells.values(), str(dataset.session[row]), int(dataset.stamp_ns[row])]
            values += [float(column[row]) for column in dataset.actuation.values()]
            values += [float(dataset.force_n[row, axis]) for axis in forces]
            writer.writerow([cell(value) for value in values])
            if progress is not None:
                progress("writing samples", (row + 1) / len(dataset))
    return view_name


def _write_views(dataset: Dataset, observation: Observation, part: Path, row: int) -> dict[str, str | float]:
    """Writes the images of one row; returns column -> cell for them, or for the shape numbers."""
    cells: dict[str, str | float] = {}
    several = len(observation.views) > 1
    for name, view in observation.views.items():
        if not isinstance(view, ShapeFeatures):
            suffix = name if several else ""
            file_name, crc = _write_image(view, part, row, suffix)
            cells |= {f"{name}_{FILE}" if several else FILE: file_name, crc_column(suffix): crc}
        elif several:
            raise InputError(f"{dataset.title}: a dataset folder holds shape numbers of one view only")
        else:
            cells |= zip([f"shape_{number}" for number in view.names], view.values.tolist(), strict=True)
    return cells


def _write_image(image: Image, part: Path, row: int, view: str) -> tuple[str, str]:
    """Writes one image; returns its name and checksum."""
    name = f"images/{row:06d}{view and f'-{view}'}.png"
    (part / "images").mkdir(exist_ok=True)
    shown = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    data = cv2.imencode(".png", shown)[1].tobytes()
    (part / name).write_bytes(data)
    return name, crc_text(data)
