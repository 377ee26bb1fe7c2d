"""Reads tables of annotations: ours, SLEAP's and DeepLabCut's."""

import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ...errors import TableError
from .._store import MarkedFrame
from ._cells import Rows, marked_points, point_from

MIN_LIKELIHOOD = 0.6
"""A predicted point with less likelihood is not used: the default ``pcutoff`` of DeepLabCut."""
OUR_COLUMNS = ("image", "u", "v")
TIP_HIDDEN = "tip_hidden"


@dataclass(frozen=True, slots=True)
class Marks:
    """Frames of a file of annotations.

    Attributes:
        frames: the marked frames; images have the names that the file gives them.
        left_out: name of an image -> the reason why its marks are not used.
        sizes_px: name of an image -> width and height, where the file states them.
    """

    frames: list[MarkedFrame]
    left_out: dict[str, str] = field(default_factory=dict[str, str])
    sizes_px: dict[str, tuple[int, int]] = field(default_factory=dict[str, tuple[int, int]])


def read_our_table(path: Path, rows: Rows) -> Marks:
    """Reads a table with the columns ``image``, ``u``, ``v`` and optionally ``tip_hidden``.

    The rows of an image are the points of its line in order from base to tip. A row without u and v: no catheter is in
    the image. ``tip_hidden`` is 1 in a row of an image whose tip is hidden.

    Args:
        path: the file, for messages.
        rows: its rows; the first is the header.

    Returns:
        The frames.

    Raises:
        TableError: a cell cannot be used.
    """
    header = [name.lower() for name in rows[0][1]]
    image, u, v = (header.index(name) for name in OUR_COLUMNS)
    hidden = header.index(TIP_HIDDEN) if TIP_HIDDEN in header else None
    points: dict[str, list[tuple[float, float]]] = {}  # image -> points of its line so far
    without_catheter: set[str] = set()
    with_hidden_tip: set[str] = set()
    for line, row in rows[1:]:
        place = f"{path}, line {line}"
        cells = [*row, *[""] * (len(header) - len(row))]
        name = cells[image]
        if not name:
            raise TableError(f"{place}: has no name in the column image; name the image in each row")
        point = point_from(cells[u], cells[v], place)
        line_points = points.setdefault(name, [])
        if point is None:
            without_catheter.add(name)
        else:
            line_points.append(point)
        if name in without_catheter and line_points:
            raise TableError(f"{place}: {name} has a row without u and v (no catheter) and rows with; remove one kind")
        if hidden is not None and cells[hidden] not in ("", "0", "1"):
            raise TableError(f"{place}, column {TIP_HIDDEN}: expected 0 or 1, got {cells[hidden][:40]!r}")
        if hidden is not None and cells[hidden] == "1":
            with_hidden_tip.add(name)
    frames: list[MarkedFrame] = []
    for name, line_points in points.items():
        if len(line_points) == 1:
            raise TableError(f"{path}: {name} has one row; a line needs at least two points, base and tip")
        array = np.array(line_points).reshape(-1, 2)
        frames.append(MarkedFrame(name, array, name in with_hidden_tip, bool(line_points), done=True))
    return Marks(frames)


def read_sleap(path: Path, rows: Rows) -> Marks:
    """Reads the analysis CSV of SLEAP: one row per instance with ``frame_idx`` and ``NODE.x``, ``NODE.y``.

    The nodes, in the order of their columns, are the points from base to tip.

    Args:
        path: the file, for messages.
        rows: its rows; the first is the header.

    Returns:
        The frames; an image is named by the number of its frame.

    Raises:
        TableError: a cell cannot be used, or a frame has two instances.
    """
    header = rows[0][1]
    nodes = [name[:-2] for name in header if name.endswith(".x") and f"{name[:-2]}.y" in header]
    if len(nodes) < 2:
        raise TableError(f"{path}: has {len(nodes)} nodes (columns NODE.x and NODE.y); a line needs at least two")
    frame = header.index("frame_idx")
    places = [(header.index(f"{node}.x"), header.index(f"{node}.y"), node) for node in nodes]
    marks, seen = Marks([]), dict[str, int]()
    for line, row in rows[1:]:
        cells = [*row, *[""] * (len(header) - len(row))]
        name = _frame_number(cells[frame], f"{path}, line {line}")
        points = [point_from(cells[x], cells[y], f"{path}, line {line}, node {node}") for x, y, node in places]
        if not any(points):
            continue
        if name in seen:
            raise TableError(
                f"{path}, line {line}: frame {name} has a second instance, the first is in line {seen[name]}; keep the "
                "rows of the catheter only"
            )
        seen[name] = line
        _add(marks, name, points)
    return marks


def read_deeplabcut(path: Path, rows: Rows) -> Marks:
    """Reads a CSV of DeepLabCut: the header rows ``scorer``, ``bodyparts`` and ``coords``, then one row per image.

    The body parts, in the order of their columns, are the points from base to tip. Rows begin with the path of the
    image in one column or three (labels), or with the number of the frame (predictions).

    Args:
        path: the file, for messages.
        rows: its rows.

    Returns:
        The frames.

    Raises:
        TableError: a header row is missing, a cell cannot be used, or several individuals are marked.
    """
    headers = {row[0].lower(): row for _, row in rows[:4] if row[0]}
    if not {"bodyparts", "coords"} <= headers.keys():
        raise TableError(f"{path}: begins as a CSV of DeepLabCut, but has no header rows bodyparts and coords")
    coords = headers["coords"]
    start = next((k for k, cell in enumerate(coords) if k and cell), len(coords))
    columns = _columns_of_parts(path, headers, start)
    marks, seen = Marks([]), dict[str, int]()
    below = next(k for k, (_, row) in enumerate(rows) if row[0].lower() == "coords") + 1
    for line, row in rows[below:]:
        cells = [*row, *[""] * (len(coords) - len(row))]
        name = "/".join(cell for cell in cells[:start] if cell)
        points = [_point_of_part(cells, part, at, f"{path}, line {line}") for part, at in columns.items()]
        if not any(points):
            continue
        if name in seen:
            raise TableError(f"{path}, line {line}: {name} has a row already, line {seen[name]}; keep one of them")
        seen[name] = line
        _add(marks, name, points)
    return marks


def _columns_of_parts(path: Path, headers: dict[str, list[str]], start: int) -> dict[str, dict[str, int]]:
    """Returns body part -> coordinate ("x", "y", "likelihood") -> its column, from the header rows of DeepLabCut.

    Args:
        path: the file, for messages.
        headers: name of each header row -> its cells.
        start: first column of the body parts; those before name the image.

    Raises:
        TableError: there are several individuals, fewer than two body parts, or a part has no x or y.
    """
    individuals = sorted({cell for cell in headers.get("individuals", [])[start:] if cell and cell != "single"})
    if len(individuals) > 1:
        raise TableError(
            f"{path}: holds the individuals {', '.join(individuals[:5])}; keep the columns of the catheter only"
        )
    columns: dict[str, dict[str, int]] = {}
    for k, (part, coord) in enumerate(zip(headers["bodyparts"], headers["coords"], strict=False)):
        if k >= start:
            columns.setdefault(part, {})[coord.lower()] = k
    lacking = [part for part, at in columns.items() if not {"x", "y"} <= at.keys()]
    if lacking or len(columns) < 2:
        fault = f"{lacking[0]} lacks x or y" if lacking else f"has {len(columns)} body parts"
        raise TableError(f"{path}: {fault}; a line needs at least two body parts, each with x and y")
    return columns


def _point_of_part(cells: list[str], part: str, column: dict[str, int], place: str) -> tuple[float, float] | None:
    """Returns the point of a body part in a row; None if it is not marked, or less likely than `MIN_LIKELIHOOD`."""
    point = point_from(cells[column["x"]], cells[column["y"]], f"{place}, body part {part}")
    if point is None or "likelihood" not in column or not cells[column["likelihood"]]:
        return point
    try:
        likelihood = float(cells[column["likelihood"]])
    except ValueError:
        got = cells[column["likelihood"]][:40]
        raise TableError(f"{place}, body part {part}: expected a likelihood from 0 to 1, got {got!r}") from None
    return point if likelihood >= MIN_LIKELIHOOD else None


def _frame_number(cell: str, place: str) -> str:
    """Returns the number of a frame in a cell, without decimals: SLEAP may write 12 as 12.0. Raises TableError."""
    try:
        number = float(cell)
    except ValueError:
        number = -1.0
    if not (math.isfinite(number) and number >= 0 and number == round(number)):
        raise TableError(f"{place}, column frame_idx: expected the number of a frame, got {cell[:40]!r}")
    return str(round(number))


def _add(marks: Marks, name: str, points: list[tuple[float, float] | None]) -> None:
    line, reason = marked_points(points)
    if line is None or len(line) < 2:
        marks.left_out[name] = reason or "only one point is marked"
    else:
        marks.frames.append(MarkedFrame(name, line, done=True))
