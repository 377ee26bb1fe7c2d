"""Tables in memory: the cells of a workbook, or the variables of a file of MATLAB."""

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path

import numpy as np

from ...types import FloatArray, IntArray, LogInfo
from ._layout import Layout, cells_layout
from ._table import Table

_HEAD_ROWS = 200


class CellTable(Table):
    """Rows of cells as text.

    Args:
        path: the file, for messages.
        rows: number from 1, and cells, of each row.
        log: description of the log.
        key: section of ``log`` in ``bench.toml``, for messages.
    """

    unit_of_place = "row"

    def __init__(self, path: Path, rows: Sequence[tuple[int, list[str]]], log: LogInfo, key: str) -> None:
        super().__init__(path, cells_layout(path, rows[:_HEAD_ROWS], log, key), log, key)
        self._cells = rows

    def lines(self) -> Iterator[tuple[int, list[str]]]:
        """Yields number and cells of every row of data."""
        for number, row in self._cells:
            if number > self._layout.above and self._lines[0] <= number <= self._lines[1] and any(row):
                yield number, row

    def _fast(self, columns: list[int], kind: type[np.float64] | type[np.int64]) -> "np.ndarray | None":  # type: ignore[type-arg]
        try:
            return np.array([[kind(row[column]) for column in columns] for _, row in self.lines()], kind)
        except (ValueError, IndexError):
            return None


class ColumnTable(Table):
    """Columns (n,) of numbers or texts: one array for each name. Rows are counted from 1."""

    unit_of_place = "row"

    def __init__(self, path: Path, arrays: "Mapping[str, np.ndarray]", log: LogInfo, key: str) -> None:  # type: ignore[type-arg]
        """Takes the rows of the arrays that ``log`` states, all where it states none.

        Args:
            path: the file, for messages.
            arrays: name of a column -> its (n,) values.
            log: metadata of the log; ``lines`` are its first and last row, counted from 1.
            key: section of ``bench.toml`` with this metadata, for messages.
        """
        super().__init__(path, Layout(header=tuple(arrays), separator="", above=0), log, key)
        first, last = self._lines
        rows = slice(first - 1, None if last == math.inf else int(last))
        self._first = first
        self._arrays = [array[rows] for array in arrays.values()]

    def __len__(self) -> int:
        return len(self._arrays[0])

    def place(self, row: int) -> str:
        """Returns the position of row ``row``, for messages."""
        return f"row {row + self._first}"

    def lines(self) -> Iterator[tuple[int, list[str]]]:
        """Yields number and cells of every row."""
        for row in range(len(self)):
            yield row + self._first, [_text(array[row]) for array in self._arrays]

    def text(self, name: str) -> list[str]:
        """Returns a column as text."""
        return [_text(value) for value in self._arrays[self.column(name)]]

    def first(self, name: str) -> str:
        """Returns the first cell of a column that is not empty."""
        return next(islice((text for text in self.text(name) if text), 1), "")

    def cells(self, name: str) -> list[str]:
        """Returns a column as text."""
        return self.text(name)

    def _fast(self, columns: list[int], kind: type[np.float64] | type[np.int64]) -> "np.ndarray | None":  # type: ignore[type-arg]
        chosen = [self._arrays[column] for column in columns]
        if any(array.dtype.kind not in "fiub" for array in chosen):
            return None
        if kind is np.int64 and not all(_is_whole(array) for array in chosen):
            return None
        return np.stack([array.astype(kind) for array in chosen], axis=1)


def _is_whole(array: "np.ndarray") -> bool:  # type: ignore[type-arg]
    """Returns whether all values are whole numbers that a float holds exactly: MATLAB stores floats by default."""
    values: FloatArray | IntArray = array
    return values.dtype.kind in "iub" or bool(np.all(np.isfinite(values)) and np.all(values == np.rint(values)))


def _text(value: object) -> str:
    return repr(float(value)) if isinstance(value, np.floating) else str(value)
