"""Parquet shards: the columns of ``metadata.csv``, with the images themselves in place of their files' names.

The images of ``file_name`` are in the column ``image``, those of ``VIEW_file_name`` in ``VIEW``: structs of ``bytes``
(PNG or JPEG) and ``path``, as Hugging Face's ``datasets`` writes and reads them. ``dataset.json`` lies beside.
"""

import importlib
import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import FileFormatError, MissingExtraError, TableError
from ..io import StreamDepth, decode_image
from ..types import FloatArray, IntArray, Observation
from ._checks import check_shards
from ._dataset import Dataset, RowStore
from ._facts import FACTS, read_facts
from ._label_table import dataset_of
from ._stores import Table

SUFFIX = ".parquet"
IMAGE = "image"


def arrow() -> tuple[Any, Any]:
    """The modules pyarrow and pyarrow.parquet. Raises MissingExtraError."""
    try:
        return importlib.import_module("pyarrow"), importlib.import_module("pyarrow.parquet")
    except ModuleNotFoundError:
        raise MissingExtraError("pyarrow", extra="parquet") from None


def open_shards(paths: Sequence[Path], name: str, *, whole: bool = False) -> Dataset:
    """The samples of ``paths``, sorted; labels are read now, images one row group at a time when they are used.

    ``whole``: these are all shards of their folder, so missing ones are looked for.
    Raises FileFormatError, TableError, TimeError, and MissingExtraError without pyarrow.
    """
    facts = read_facts(paths[0].parent / FACTS)
    check_shards(paths, facts.files, facts.path, whole=whole)
    table = ShardTable(paths)
    if not table.images:
        raise TableError(f"{paths[0]}: has no column of images (structs of bytes and path, such as {IMAGE!r})")

    def stored(stamps: IntArray, actuation: Mapping[str, FloatArray]) -> tuple[RowStore, dict[str, list[str]]]:
        views = {facts.view if column == IMAGE else column: column for column in table.images}
        return Shards(stamps, actuation, tuple(paths), table.ends, views), {
            view: table.names(column) for view, column in views.items()
        }

    return dataset_of(table, facts, name, table.images, stored)


class ShardTable:
    """All columns of the shards but the images, as `LabelTable`; ``ends`` (shards,): rows up to each one's end."""

    def __init__(self, paths: Sequence[Path]) -> None:
        self.path = paths[0]
        self._paths = tuple(paths)
        schemas = [_opened(path).schema_arrow for path in paths]
        self.columns: list[str] = schemas[0].names
        for path, schema in zip(paths, schemas, strict=True):
            if schema.names != self.columns:
                raise TableError(
                    f"{path}: has the columns {', '.join(schema.names)}, but {self.path.name} has "
                    f"{', '.join(self.columns)}; the shards of one folder have the same"
                )
        self.images = [name for name in self.columns if _is_image(schemas[0].field(name).type)]
        rest = [name for name in self.columns if name not in self.images]
        parts = [_read(path, rest) for path in paths]
        self.ends: IntArray = np.cumsum([part.num_rows for part in parts]).astype(np.int64)
        self._rest = arrow()[0].concat_tables(parts, promote_options="permissive")
        if not len(self):
            raise TableError(f"{self.path}: has no rows")

    def __len__(self) -> int:
        return int(self.ends[-1])

    def place(self, row: int) -> str:
        """Shard and row in it, from 0."""
        shard = int(np.searchsorted(self.ends, row, side="right"))
        return f"{self._paths[shard].name} row {row - (int(self.ends[shard - 1]) if shard else 0)}"

    def names(self, column: str) -> list[str]:
        """(n,): what each image of ``column`` is called."""
        leaf = f"{column}.path"
        found = [_read(path, [leaf]).column(0).combine_chunks().field("path").to_pylist() for path in self._paths]
        return [name or self.place(row) for row, name in enumerate(itertools.chain(*found))]

    def text(self, name: str) -> list[str]:
        """The cells of one column."""
        return ["" if cell is None else str(cell) for cell in self._rest.column(name).to_pylist()]

    def numbers(self, name: str, *, may_be_empty: bool = False) -> FloatArray:
        """(n,) of one column, NaN for an empty cell where that is allowed. Raises TableError."""
        column = self._rest.column(name)
        try:
            values = np.asarray(column.cast("float64").to_numpy(), np.float64)
        except arrow()[0].ArrowException:
            raise TableError(f"{self.path}, column {name}: expected numbers, got {column.type}") from None
        wrong = np.flatnonzero(~np.isfinite(values))
        if len(wrong) and not may_be_empty:
            raise TableError(
                f"{self.path}, {self.place(int(wrong[0]))}, column {name}: expected a finite number, "
                f"got {values[wrong[0]]:g}"
            )
        return values

    def time_columns(self) -> tuple[str, ...]:
        """``stamp_ns``, where it is there."""
        return ("stamp_ns",) if "stamp_ns" in self.columns else ()

    def stamps_ns(self) -> IntArray | None:
        """(n,) stamps; None where there is no column of them. Raises TableError."""
        if not self.time_columns():
            return None
        column = self._rest.column("stamp_ns")
        if not str(column.type).startswith(("int", "uint")) or column.null_count:
            raise TableError(f"{self.path}, column stamp_ns: expected whole numbers without gaps, got {column.type}")
        return np.asarray(column.to_numpy(), np.int64)


@dataclass(frozen=True, eq=False)
class Shards(Table):
    """``paths`` (s,), ``ends`` (s,): rows up to each one's end; ``columns``: view -> column of its images."""

    paths: tuple[Path, ...]
    ends: IntArray
    columns: Mapping[str, str]

    def read(self, rows: IntArray) -> Iterator[Observation]:
        """The observations of ``rows``, in the order given; one row group is in memory at a time."""
        file, current, groups = None, -1, np.empty(0, np.int64)
        group, images = -1, {}
        try:
            for row in rows.tolist():
                shard = int(np.searchsorted(self.ends, row, side="right"))
                if shard != current:
                    if file is not None:
                        file.close()
                    file, current, group = _opened(self.paths[shard]), shard, -1
                    counts = [file.metadata.row_group(k).num_rows for k in range(file.metadata.num_row_groups)]
                    groups = np.cumsum(counts)
                here = row - (int(self.ends[shard - 1]) if shard else 0)
                wanted = int(np.searchsorted(groups, here, side="right"))
                if wanted != group:
                    group, images = wanted, _images(file, wanted, self.columns, self.paths[shard])
                place = here - (int(groups[group - 1]) if group else 0)
                where = f"{self.paths[shard]}, row {here}"
                views = {
                    view: decode_image(cells[place].as_py() or b"", where, self._depths[view])
                    for view, cells in images.items()
                }
                yield self._observation(row, views)
        finally:
            if file is not None:
                file.close()

    @cached_property
    def _depths(self) -> dict[str, StreamDepth]:
        return {view: StreamDepth(partial(_all_images, self.paths, column)) for view, column in self.columns.items()}


def _all_images(paths: Sequence[Path], column: str) -> Iterator[bytes]:
    """The encoded images of one column, one row group in memory at a time."""
    for path in paths:
        with _opened(path) as file:
            for group in range(file.metadata.num_row_groups):
                for cell in _images(file, group, {column: column}, path)[column]:
                    yield cell.as_py() or b""


def _images(file: Any, group: int, columns: Mapping[str, str], path: Path) -> dict[str, Any]:
    """View -> the encoded images of one row group."""
    try:
        table = file.read_row_group(group, columns=[f"{column}.bytes" for column in columns.values()])
    except (OSError, arrow()[0].ArrowException) as error:
        raise FileFormatError(f"{path}: row group {group} cannot be read ({error})") from None
    stated = file.metadata.row_group(group).num_rows
    if table.num_rows != stated:
        raise FileFormatError(
            f"{path}: is damaged: row group {group} holds {table.num_rows} images, its index says {stated}"
        )
    return {view: table.column(column).combine_chunks().field("bytes") for view, column in columns.items()}


def _opened(path: Path) -> Any:
    pa, parquet = arrow()
    try:
        return parquet.ParquetFile(path, page_checksum_verification=True)
    except (OSError, pa.ArrowException) as error:
        raise FileFormatError(f"{path}: is no readable Parquet file ({error})") from None


def _read(path: Path, columns: list[str]) -> Any:
    with _opened(path) as file:
        try:
            return file.read(columns=columns)
        except (OSError, arrow()[0].ArrowException) as error:
            raise FileFormatError(f"{path}: cannot be read ({error})") from None


def _is_image(kind: Any) -> bool:
    """Whether a column is a struct with the bytes of images."""
    names = [kind.field(k).name for k in range(kind.num_fields)] if str(kind).startswith("struct") else []
    return "bytes" in names and "path" in names
