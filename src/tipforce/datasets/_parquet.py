"""Parquet shards: the columns of ``metadata.csv``, with the images themselves in place of their file names.

The images of ``file_name`` are in the column ``image``, those of ``VIEW_file_name`` in ``VIEW``: structs of ``bytes``
(PNG or JPEG) and ``path``, as Hugging Face's ``datasets`` writes and reads them. ``dataset.json`` is in the same
folder.
"""

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from .._system.extras import import_extra
from ..errors import FileFormatError, TableError
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
    """Returns the modules pyarrow and pyarrow.parquet. Raises MissingExtraError."""
    return import_extra("pyarrow", "parquet"), import_extra("pyarrow.parquet", "parquet")


def open_shards(paths: Sequence[Path], name: str, *, whole: bool = False) -> Dataset:
    """Returns the samples of ``paths`` in order; labels are read now, images later, one row group at a time.

    Args:
        paths: sorted paths of the shards.
        name: name of the dataset if ``dataset.json`` states none.
        whole: whether these are all shards of their folder, so that missing ones are reported.

    Raises:
        FileFormatError: a shard is missing, damaged or not readable.
        TableError: a column is missing or not valid.
        TimeError: two samples of a session have the same stamp.
        MissingExtraError: pyarrow is not installed.
    """
    facts = read_facts(paths[0].parent / FACTS)
    check_shards(paths, facts.files, facts.path, whole=whole)
    table = ShardTable(paths)
    if not table.images:
        raise TableError(f"{paths[0]}: has no column of images (structs of bytes and path, such as {IMAGE!r})")

    def stored(stamps: IntArray, actuation: Mapping[str, FloatArray]) -> tuple[RowStore, dict[str, list[str]]]:
        """Returns the store of the rows, and view -> name of each row's image; see `dataset_of`."""
        views = {facts.view if column == IMAGE else column: column for column in table.images}
        return Shards(stamps, actuation, tuple(paths), table.ends, views), {
            view: table.names(column) for view, column in views.items()
        }

    return dataset_of(table, facts, name, table.images, stored)


class ShardTable:
    """All columns of the shards except the images, as `LabelTable`; ``ends`` (shards,): rows up to each end."""

    def __init__(self, paths: Sequence[Path]) -> None:
        """Reads all columns but the images of the shards; raises TableError where their columns differ."""
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
        """Returns the shard and the row in it, counted from 0."""
        shard = int(np.searchsorted(self.ends, row, side="right"))
        return f"{self._paths[shard].name} row {row - (int(self.ends[shard - 1]) if shard else 0)}"

    def names(self, column: str) -> list[str]:
        """Returns the (n,) names of the images of ``column``."""
        tables = [_read(path, [f"{column}.path"]) for path in self._paths]
        names = itertools.chain(*(t.column(0).combine_chunks().field("path").to_pylist() for t in tables))
        return [name or self.place(row) for row, name in enumerate(names)]

    def text(self, name: str) -> list[str]:
        """Returns the cells of one column."""
        return ["" if cell is None else str(cell) for cell in self._rest.column(name).to_pylist()]

    def numbers(self, name: str, *, may_be_empty: bool = False) -> FloatArray:
        """Returns the (n,) numbers of one column.

        Args:
            name: the column's name.
            may_be_empty: whether an empty cell is allowed; it is NaN then.

        Raises:
            TableError: a cell holds no finite number; the message names row and column.
        """
        column = self._rest.column(name)
        try:
            values = np.asarray(column.cast("float64").to_numpy(), np.float64)
        except arrow()[0].ArrowException:
            raise TableError(f"{self.path}, column {name}: expected numbers, got {column.type}") from None
        wrong = np.flatnonzero(np.isinf(values) if may_be_empty else ~np.isfinite(values))
        if len(wrong):
            raise TableError(
                f"{self.path}, {self.place(int(wrong[0]))}, column {name}: expected a finite number, "
                f"got {values[wrong[0]]:g}"
            )
        return values

    def time_columns(self) -> tuple[str, ...]:
        """Returns ``stamp_ns`` if the column exists."""
        return ("stamp_ns",) if "stamp_ns" in self.columns else ()

    def stamps_ns(self) -> IntArray | None:
        """Returns the (n,) stamps; None without such a column. Raises TableError."""
        if not self.time_columns():
            return None
        column = self._rest.column("stamp_ns")
        if not str(column.type).startswith(("int", "uint")) or column.null_count:
            raise TableError(f"{self.path}, column stamp_ns: expected whole numbers without gaps, got {column.type}")
        return np.asarray(column.to_numpy(), np.int64)


@dataclass(frozen=True, eq=False)
class Shards(Table):
    """Images in shards.

    Attributes:
        paths: (s,) paths of the shards.
        ends: (s,) number of rows up to the end of each shard.
        columns: view -> column of its images.
    """

    paths: tuple[Path, ...]
    ends: IntArray
    columns: Mapping[str, str]

    @property
    def view_names(self) -> Iterable[str]:
        """Names of the views."""
        return self.columns

    def read(self, rows: IntArray) -> Iterator[Observation]:
        """Yields the observations of ``rows``, in the given order; one row group is in memory at a time."""
        # the open shard, the numbers of its rows up to the end of each row group, and the group in memory
        file, open_shard, group_ends = None, -1, np.empty(0, np.int64)
        group, images = -1, {}
        try:
            for row in rows.tolist():
                shard = int(np.searchsorted(self.ends, row, side="right"))
                if shard != open_shard:
                    if file is not None:
                        file.close()
                    file, open_shard, group = _opened(self.paths[shard]), shard, -1
                    counts = [file.metadata.row_group(k).num_rows for k in range(file.metadata.num_row_groups)]
                    group_ends = np.cumsum(counts)
                shard_row = row - (int(self.ends[shard - 1]) if shard else 0)
                needed_group = int(np.searchsorted(group_ends, shard_row, side="right"))
                if needed_group != group:
                    group, images = needed_group, _images(file, needed_group, self.columns, self.paths[shard])
                group_row = shard_row - (int(group_ends[group - 1]) if group else 0)
                where = f"{self.paths[shard]}, row {shard_row}"
                views = {
                    view: decode_image(cells[group_row].as_py() or b"", where, self._depths[view])
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
    """Yields the encoded images of one column; one row group is in memory at a time."""
    for path in paths:
        with _opened(path) as file:
            for group in range(file.metadata.num_row_groups):
                for cell in _images(file, group, {column: column}, path)[column]:
                    yield cell.as_py() or b""


def _images(file: Any, group: int, columns: Mapping[str, str], path: Path) -> dict[str, Any]:
    """Returns view -> the encoded images of one row group."""
    try:
        table = file.read_row_group(group, columns=[f"{column}.bytes" for column in columns.values()])
    except (OSError, arrow()[0].ArrowException) as error:
        raise FileFormatError(f"{path}: row group {group} cannot be read ({error})") from None
    stated = file.metadata.row_group(group).num_rows
    if table.num_rows != stated:
        raise FileFormatError(
            f"{path}: is damaged: row group {group} holds {table.num_rows} images, its index states {stated}"
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
    """Returns whether a column is a struct with the bytes of images."""
    names = [kind.field(k).name for k in range(kind.num_fields)] if str(kind).startswith("struct") else []
    return "bytes" in names and "path" in names
