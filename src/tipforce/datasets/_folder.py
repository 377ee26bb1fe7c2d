"""The dataset folder: ``metadata.csv`` beside images (the layout of Hugging Face's ImageFolder), ``dataset.json``.

``metadata.csv``: ``file_name`` (with several views ``VIEW_file_name`` for each; or columns ``shape_NAME`` with
ready-made shape numbers), ``stamp_ns``, ``fx_n``, ``fy_n``, ``fz_n`` (at least one), ``session`` (default: the folder
is one), any ``NAME_UNIT`` as actuation (an empty cell: no reading); columns ``note`` and ``note_...`` are not read.
``dataset.json`` (optional): `FolderFacts`. ``masks/`` (optional): where the catheter is in each picture, to train
on.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ..errors import FileFormatError, TableError
from ..types import FloatArray, IntArray
from ._dataset import Dataset, RowStore
from ._facts import FACTS, read_facts
from ._rows import dataset_of
from ._stores import ImageFiles, ShapeTable
from ._tables import CsvTable

__all__ = ["FILE", "METADATA", "open_folder"]

METADATA = "metadata.csv"
FILE = "file_name"
MASKS = "masks"


def open_folder(folder: Path) -> Dataset:
    """The samples of a dataset folder; raises FileFormatError, TableError or TimeError."""
    table, facts = CsvTable(folder / METADATA), read_facts(folder / FACTS)
    files = [name for name in table.columns if name == FILE or name.endswith(f"_{FILE}")]
    shapes = [name for name in table.columns if name.startswith("shape_")]
    table.require(["stamp_ns"])
    if bool(files) == bool(shapes):
        raise TableError(f"{table.path}: expected either a column {FILE} or columns shape_NAME")

    def stored(stamps: IntArray, actuation: Mapping[str, FloatArray]) -> tuple[RowStore, dict[str, list[str]]]:
        if shapes:
            values = np.column_stack([table.numbers(name) for name in shapes])
            names = tuple(name.removeprefix("shape_") for name in shapes)
            store = ShapeTable(stamps, actuation, names, values, view=facts.view)
            return store, {facts.view: [table.place(row) for row in range(len(table))]}
        paths = {facts.view if name == FILE else name.removesuffix(f"_{FILE}"): table.text(name) for name in files}
        return ImageFiles(stamps, actuation, _found(folder, table, paths), _masks(folder, paths)), paths

    return dataset_of(table, facts, folder.resolve().name, [*files, *shapes], stored)


def _found(folder: Path, table: CsvTable, files: Mapping[str, list[str]]) -> dict[str, tuple[Path, ...]]:
    paths = {view: tuple(folder / name for name in names) for view, names in files.items()}
    for images in paths.values():
        for row, path in enumerate(images):
            if not path.is_file():
                raise FileFormatError(f"{table.path}, {table.place(row)}: there is no image {path}")
    return paths


def _masks(folder: Path, files: Mapping[str, list[str]]) -> dict[str, tuple[Path, ...]]:
    """``masks/SESSION/FRAME.png`` for ``images/SESSION/FRAME.jpg``, where there is a folder of that name."""
    if not (folder / MASKS).is_dir():
        return {}
    return {
        view: tuple((folder / MASKS).joinpath(*Path(name).parts[1:]).with_suffix(".png") for name in names)
        for view, names in files.items()
    }
