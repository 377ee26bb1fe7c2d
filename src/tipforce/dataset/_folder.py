"""The dataset folder: ``metadata.csv`` beside images (the layout of Hugging Face's ImageFolder), ``dataset.json``.

``metadata.csv``: ``file_name`` (or columns ``shape_NAME`` with ready-made shape numbers), ``stamp_ns``, ``fx_n``,
``fy_n``, ``fz_n`` (at least one), ``session`` (default: the folder is one), any ``NAME_UNIT`` as actuation (an empty
cell: no reading); columns ``note`` and ``note_...`` are not read. ``dataset.json`` (optional): `FolderFacts`.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from ..errors import FileFormatError, TableError
from ..types import Catheter, Context, FloatArray
from ._dataset import Dataset, RowStore
from ._stores import ImageFiles, ShapeTable
from ._tables import CsvTable, check_stamps

__all__ = ["FACTS", "FORCES", "METADATA", "UNITS", "CatheterFacts", "FolderFacts", "open_folder"]

METADATA = "metadata.csv"
FACTS = "dataset.json"
FORCES = ("fx_n", "fy_n", "fz_n")
UNITS = ("deg", "rad", "mm", "um", "m", "px", "kpa", "pa", "bar", "v", "a", "ma", "n", "mn", "nmm", "count", "steps")
"""What the name of an actuation column may end in."""


_Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class CatheterFacts(BaseModel):
    """Nominal values of the catheter; see `tipforce.types.Catheter`."""

    model_config = ConfigDict(extra="forbid")

    name: str = "unnamed"
    diameter_m: _Positive | None = None
    flexible_length_m: _Positive | None = None
    rigid_length_m: _Positive | None = None
    bending_stiffness_nm2: _Positive | None = None


class FolderFacts(BaseModel):
    """What all samples of a dataset folder have in common."""

    model_config = ConfigDict(extra="forbid")

    title: str = ""
    frame: str = "base"
    """Axes of the forces; "base" is the convention of this program."""
    view: str = "camera"
    metres_per_px: _Positive | None = None
    catheter: CatheterFacts = CatheterFacts()
    notes: dict[str, str] = Field(default_factory=dict)
    sessions: dict[str, dict[str, str]] = Field(default_factory=dict)
    """Session -> notes of its own."""


def open_folder(folder: Path) -> Dataset:
    """The samples of a dataset folder; raises FileFormatError, TableError or TimeError."""
    table, facts = CsvTable(folder / METADATA), _facts(folder / FACTS)
    table.require(["stamp_ns"])
    measured = np.array([name in table.columns for name in FORCES])
    if not measured.any():
        raise TableError(f"{table.path}: has no force column; expected at least one of {', '.join(FORCES)}")
    shapes = [name for name in table.columns if name.startswith("shape_")]
    if ("file_name" in table.columns) == bool(shapes):
        raise TableError(f"{table.path}: expected either a column file_name or columns shape_NAME")
    session = np.array(table.text("session") if "session" in table.columns else [folder.resolve().name] * len(table))
    for row in np.flatnonzero(session == "").tolist():
        raise TableError(f"{table.path}, row {row + 2}, column session: is empty")
    stamps = table.integers("stamp_ns")
    place = {name: k for k, name in enumerate(dict.fromkeys(session.tolist()))}
    order = np.lexsort((stamps, np.array([place[name] for name in session.tolist()])))
    for name in place:
        check_stamps(str(table.path), name, np.sort(stamps[session == name]))
    force = np.full((len(table), 3), np.nan)
    for axis in np.flatnonzero(measured).tolist():
        force[:, axis] = table.numbers(FORCES[axis])
    actuation = {name: table.numbers(name, may_be_empty=True) for name in _actuation_columns(table, shapes)}
    store, names = _store(folder, table, stamps, actuation, shapes, facts.view)
    catheter = Catheter(**facts.catheter.model_dump())
    shared = facts.notes if facts.frame == "base" else {**facts.notes, "force_frame": facts.frame}
    return Dataset(
        store=store,
        session=session[order],
        stamp_ns=stamps[order],
        actuation={name: values[order] for name, values in actuation.items()},
        force_n=force[order],
        known=measured,
        names=np.array(names)[order],
        contexts={
            name: Context(name, catheter, facts.metres_per_px, {**shared, **facts.sessions.get(name, {})})
            for name in place
        },
        rows=order,
        title=facts.title or folder.resolve().name,
    )


def _facts(path: Path) -> FolderFacts:
    if not path.exists():
        return FolderFacts()
    try:
        return FolderFacts.model_validate(json.loads(path.read_text(encoding="utf-8")))
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise FileFormatError(f"{path}: is no JSON ({error})") from None
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise FileFormatError(
            f"{path}: {key or 'its content'}: {first['msg']}; it may hold {', '.join(FolderFacts.model_fields)}"
        ) from None


def _actuation_columns(table: CsvTable, shapes: list[str]) -> list[str]:
    taken = {"file_name", "session", "stamp_ns", *FORCES, *shapes}
    names = [name for name in table.columns if name not in taken and name.split("_")[0] != "note"]
    for name in names:
        if "_" not in name or name.rsplit("_", 1)[1].lower() not in UNITS:
            raise TableError(
                f"{table.path}: the column {name!r} does not say its unit; an actuation column ends in one of "
                f"_{', _'.join(UNITS)}, and a column that is not to be read starts with note_"
            )
    return names


def _store(
    folder: Path,
    table: CsvTable,
    stamps: np.ndarray[tuple[int], np.dtype[np.int64]],
    actuation: Mapping[str, FloatArray],
    shapes: list[str],
    view: str,
) -> tuple[RowStore, list[str]]:
    if shapes:
        values = np.column_stack([table.numbers(name) for name in shapes])
        names = tuple(name.removeprefix("shape_") for name in shapes)
        return ShapeTable(stamps, actuation, names, values, view=view), [f"row {k + 2}" for k in range(len(table))]
    files = table.text("file_name")
    paths = tuple(folder / name for name in files)
    for row, path in enumerate(paths, 2):
        if not path.is_file():
            raise FileFormatError(f"{table.path}, row {row}: there is no image {path}")
    return ImageFiles(stamps, actuation, paths, view=view), files
