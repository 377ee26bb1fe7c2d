"""Cells of a CSV file, with the line of each row for messages."""

import csv
import math
from pathlib import Path

import numpy as np

from ..._system.json_files import read_small_text
from ...errors import TableError
from ...types import FloatArray

MAX_TABLE_BYTES = 256 << 20
"""Longest table that is read: a network's predictions for an hour of video."""
Rows = list[tuple[int, list[str]]]
"""Line number and cells of each row that is not empty."""


def read_rows(path: Path) -> Rows:
    """Returns the rows of a CSV file; separator: comma, or semicolon if the first line has one and no comma.

    Raises:
        FileFormatError: there is no such file, or it is no text.
        TableError: it has no rows, or is no CSV.
    """
    text = read_small_text(path, max_bytes=MAX_TABLE_BYTES)
    first = text.partition("\n")[0]
    separator = ";" if ";" in first and "," not in first else ","
    reader = csv.reader(text.splitlines(), delimiter=separator)
    try:
        rows = [(reader.line_num, [cell.strip() for cell in row]) for row in reader if any(map(str.strip, row))]
    except csv.Error as error:
        raise TableError(f"{path}, line {reader.line_num}: is no CSV ({error}); export it again") from None
    if not rows:
        raise TableError(f"{path}: has no rows; expected a header and rows, as `image,u,v`")
    return rows


def point_from(u: str, v: str, place: str) -> tuple[float, float] | None:
    """Returns the point in two cells, px; None if both are empty or not a number by name ("nan").

    Args:
        u: cell of the horizontal coordinate.
        v: cell of the vertical coordinate.
        place: file, line and point, for the message.

    Raises:
        TableError: a cell holds another text, or only one of them is empty.
    """
    values = [math.nan if cell.lower() in ("", "nan") else _number(cell, place) for cell in (u, v)]
    if math.isnan(values[0]) != math.isnan(values[1]):
        raise TableError(f"{place}: has one coordinate of two, {u!r} and {v!r}; state both or none")
    return None if math.isnan(values[0]) else (values[0], values[1])


def _number(cell: str, place: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = math.inf
    if not math.isfinite(value):
        raise TableError(f"{place}: expected a pixel coordinate, got {cell[:40]!r}; write numbers with decimal points")
    return value


def marked_points(points: list[tuple[float, float] | None]) -> tuple[FloatArray | None, str]:
    """Returns the line through points of which some are not marked.

    Args:
        points: the points from base to tip; None: not marked.

    Returns:
        (k, 2) points, and ""; or None and the reason why there is no line ("" if no point is marked).
    """
    marked = [point for point in points if point is not None]
    if not marked:
        return None, ""
    if points[0] is None or points[-1] is None:
        return None, "the base is not marked" if points[0] is None else "the tip is not marked"
    return np.array(marked), ""
