"""Reads workbooks (.xlsx) as tables."""

import datetime
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ..._system.extras import import_extra
from ...errors import FileFormatError, TableError
from ...types import LogInfo
from ._cells import CellTable
from ._columns import listed


def open_workbook(path: Path, log: LogInfo, key: str) -> CellTable:
    """Reads the table on one sheet of a workbook.

    Args:
        path: the workbook.
        log: description of the log; ``sheet`` names the sheet, by default the only one with cells.
        key: section of ``log`` in ``bench.toml``, for messages.

    Raises:
        FileFormatError: the file is no workbook.
        TableError: several sheets have cells, or the table has no header.
        MissingExtraError: openpyxl is not installed.
    """
    openpyxl = import_extra("openpyxl", "tables")
    try:
        book = openpyxl.load_workbook(path, read_only=True, data_only=True)
        try:
            names: list[str] = [sheet.title for sheet in book.worksheets]
            chosen = names if log.sheet is None else [name for name in names if name == log.sheet]
            filled = {name: rows for name in chosen if (rows := list(_rows(book[name])))}
        finally:
            book.close()
    except Exception as error:  # a damaged workbook raises errors of many kinds in the library and below it
        raise FileFormatError(f"{path}: is no workbook that can be read ({error}); export it as CSV") from None
    if log.sheet is not None and not chosen:
        raise TableError(f"{path}: has no sheet {log.sheet!r}, as {key}.sheet states; it has {listed(names)}")
    if not filled:
        raise FileFormatError(f"{path}: is empty, not a table")
    if len(filled) > 1:
        raise TableError(
            f"{path}: has several sheets ({listed(list(filled))}); state one in bench.toml: "
            f'{key}.sheet = "{next(iter(filled))}"'
        )
    return CellTable(path, next(iter(filled.values())), log, key)


def _rows(sheet: Any) -> Iterator[tuple[int, list[str]]]:
    """Yields number and texts of the rows that are not empty."""
    for number, row in enumerate(sheet.iter_rows(values_only=True), start=1):
        cells = [_text(value) for value in row]
        if any(cells):
            yield number, cells


def _text(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, datetime.datetime):
        return value.isoformat(" ")
    if isinstance(value, datetime.timedelta):
        return repr(value.total_seconds())
    if isinstance(value, datetime.date | datetime.time):
        return value.isoformat()
    return repr(value) if isinstance(value, float) else str(value).strip()
