"""Finds the format of a table: position of its header, facts in the lines above it, separator and decimal sign."""

import codecs
import csv
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import IO

from ...errors import FileFormatError, TableError
from ...types import LogInfo
from ._dates import is_time_text

Rows = Sequence[tuple[int, list[str]]]
"""Number of each line, and its cells."""

CELLS = ""
"""Separator of a table of cells from a workbook."""

NUMBER = re.compile(r"^[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?$")
MISSING = frozenset(
    ("", "-", "--", "---", "nan", "-nan", "nan(ind)", "-nan(ind)", "1.#qnan", "-1.#ind", "na", "n/a", "#n/a", "null")
)
"""Cells that hold no reading, in small letters."""

_SEPARATORS = {"\t": "tab", ";": "semicolon", ",": "comma", " ": "blank"}
_SAMPLE_BYTES = 1 << 20
"""Size of the start of a file by which its encoding is determined; also the limit of a line."""
_SAMPLE_LINES = 200
_CHECKED_ROWS = 3
"""Number of rows below a header that must be rows of its table."""
_MAX_COLUMNS = 10_000
_BINARY_SAMPLE_BYTES, _MAX_HIGH_SHARE = 4096, 0.3
"""A file that is not UTF-8 is binary if more than this share of its first bytes is above 127 (not ASCII): words in a
Windows code page have few such bytes."""
_GZIP = b"\x1f\x8b"
_GROUPED = re.compile(r"^[+-]?\d{1,3}(?:([.,])\d{3})+(?:(?!\1)[.,]\d*)?$")
"""A number whose thousands are, or may be, grouped."""
_FACT = re.compile(r"^\s*([^\W\d_][^:=]*?)\s*[:=]\s*(\S.*?)\s*$")
_SEPARATOR_LINE = re.compile(r'^"?sep=(.)"?\s*$', re.IGNORECASE)
_UNIT = re.compile(
    r"^(?:\[[^\]]*\]|\([^)]*\)|m?s|[uµ]s|ns|sec|[kcmuµ]?n|k?gf?|lbf?|ozf?|counts?|deg|°|rad|[mcuµ]?m|n[ -]?m+|v|hz|%"
    r"|-|hh:mm:ss.*)$",
    re.IGNORECASE,
)


@dataclass(frozen=True, slots=True)
class Layout:
    """Format of one table.

    Attributes:
        header: names of all columns, "" for those without one.
        separator: sign between cells.
        above: number of the last line above the rows.
        decimal_comma: whether the decimal sign is a comma.
        thousands: sign between groups of thousands, "" if there is none.
        pairs: whether every number is in two cells, because its decimal comma also separates cells.
        comments: whether lines that begin with # are skipped.
        encoding: encoding of the text.
        units: column -> unit, from a row of units below the header.
        facts: names in small letters -> values, from the lines above the table and from cells of its header such as
            "Frequency = 1000".
    """

    header: tuple[str, ...]
    separator: str
    above: int
    decimal_comma: bool = False
    thousands: str = ""
    pairs: bool = False
    comments: bool = True
    encoding: str = "utf-8"
    units: Mapping[str, str] = field(default_factory=dict[str, str])
    facts: Mapping[str, str] = field(default_factory=dict[str, str])


def open_text(path: Path, encoding: str) -> IO[str]:
    """Opens a text file; bytes that the encoding does not have are replaced.

    Args:
        path: the file.
        encoding: name of the encoding, as Python names it.

    Returns:
        The open file; line ends of all systems are read.
    """
    return path.open(encoding=encoding, errors="replace", newline=None)


def encoding_of(path: Path) -> str:
    """Returns the encoding of ``path``: UTF-8, UTF-16 (Unicode for Excel), else the Windows code page.

    Raises FileFormatError for a file that is no text, or has a line that is too long for a table.
    """
    with path.open("rb") as stream:
        sample = stream.read(_SAMPLE_BYTES)
        wide = sample.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
        if sample.startswith(_GZIP):
            raise FileFormatError(f"{path}: is compressed (gzip); unpack it first")
        block, offset = sample, 0
        while block:  # the whole file: its damage or its binary part may come late
            if not wide and (zero := block.find(b"\0")) >= 0:
                raise FileFormatError(f"{path}: is no text table (byte {offset + zero} is 0); export it as CSV")
            if len(block) == _SAMPLE_BYTES and b"\n" not in block and b"\r" not in block:
                raise FileFormatError(
                    f"{path}: has a line of more than {_SAMPLE_BYTES >> 20} MiB (at byte {offset}), too long for a "
                    "table; export it as CSV"
                )
            offset += len(block)
            block = stream.read(_SAMPLE_BYTES)
    if wide:
        return "utf-16"
    try:
        codecs.getincrementaldecoder("utf-8")().decode(sample)
    except UnicodeDecodeError:
        first_bytes = sample[:_BINARY_SAMPLE_BYTES]
        if sum(byte > 127 for byte in first_bytes) > _MAX_HIGH_SHARE * len(first_bytes):
            raise FileFormatError(f"{path}: is no text table; export it as CSV") from None
        return "cp1252"
    return "utf-8-sig"


def holds_data(line: str, comments: bool) -> bool:
    """Returns whether a line is neither blank nor a comment.

    Args:
        line: the line.
        comments: whether a line that begins with # is a comment.
    """
    return bool(line.strip()) and not (comments and line.lstrip().startswith("#"))


def parsed(
    lines: Iterable[tuple[int, str]], separator: str, above: int, comments: bool
) -> Iterator[tuple[int, list[str]]]:
    """Yields number and cells of the lines below line ``above``; skips blank lines and comments (#).

    Args:
        lines: number and text of each line.
        separator: sign between cells.
        above: number of the last line that is skipped.
        comments: whether lines that begin with # are comments.

    Raises:
        csv.Error: a cell never ends.
    """
    number = 0  # of the line that was read last: a quoted cell with line ends has several

    def data_lines() -> Iterator[str]:
        nonlocal number
        for number, line in lines:
            if number > above and holds_data(line, comments):
                yield line

    if separator == " ":
        for line in data_lines():
            yield number, line.split()
    else:
        for cells in csv.reader(data_lines(), delimiter=separator, skipinitialspace=True):
            yield number, [cell.strip() for cell in cells]


def text_layout(path: Path, *, comments: bool, log: LogInfo | None, key: str) -> Layout:
    """Finds the format of the text table at ``path`` by its first lines.

    Args:
        path: the file.
        comments: whether lines that begin with # are skipped.
        log: description of a log, which may have lines above its header; None for a table that begins with its header.
        key: section of ``log`` in ``bench.toml``, for messages.

    Returns:
        Header, separator, decimal sign, encoding and the lines above the header.

    Raises:
        FileFormatError: the file is no text.
        TableError: header or decimal sign cannot be determined.
    """
    encoding = encoding_of(path)
    with open_text(path, encoding) as stream:
        head = [(number, line) for number, line in zip(range(1, _SAMPLE_LINES), stream, strict=False)]
    lines = [(number, line) for number, line in head if holds_data(line, comments)]
    if not lines:
        raise FileFormatError(f"{path}: the file is empty, not a table")
    stated = _SEPARATOR_LINE.match(lines[0][1].rstrip("\n"))
    if stated:
        lines = lines[1:]
    candidates = (stated[1],) if stated else tuple(_SEPARATORS)
    first = lines[0][1] if lines else ""
    default = next((sign for sign in candidates if sign in first.strip()), stated[1] if stated else ",")
    if first.count(default) >= _MAX_COLUMNS:
        raise TableError(
            f"{path}, line {lines[0][0]}: has {first.count(default) + 1} columns, at most {_MAX_COLUMNS} are read; "
            "export the columns that are needed"
        )
    layout = _layout(path, _alternatives(path, lines, candidates, default, comments), default, log, key)
    return replace(layout, comments=comments, encoding=encoding)


def _alternatives(
    path: Path, lines: Sequence[tuple[int, str]], candidates: Sequence[str], default: str, comments: bool
) -> dict[str, Rows]:
    """Returns separator -> rows of the numbered ``lines``, for each candidate that can split them.

    Raises TableError where the default separator cannot.
    """
    alternatives: dict[str, Rows] = {}
    for separator in candidates:
        try:
            alternatives[separator] = list(parsed(lines, separator, 0, comments))
        except csv.Error as error:
            if separator == default:
                raise TableError(f"{path}: is no table that can be read ({error}); export it as CSV") from None
    return alternatives


def cells_layout(path: Path, rows: Rows, log: LogInfo | None, key: str) -> Layout:
    """Finds the header of a table of cells.

    Args:
        path: the file, for messages.
        rows: its first rows.
        log: see `text_layout`.
        key: see `text_layout`.

    Returns:
        Header and the rows above it.

    Raises:
        FileFormatError: there is no row.
        TableError: the header cannot be determined.
    """
    if not rows:
        raise FileFormatError(f"{path}: holds no table")
    return _layout(path, {CELLS: list(rows)}, CELLS, log, key)


def _layout(path: Path, alternatives: Mapping[str, Rows], default: str, log: LogInfo | None, key: str) -> Layout:
    """Returns the format of a table, by its rows.

    The header is ``log.columns``, else the first row of names above rows of numbers. Without a log it is the first row.

    Args:
        path: the file, for messages.
        alternatives: separator -> first rows of the file, split by it. The first that gives a header is used.
        default: separator that is used where none gives a header.
        log: see `text_layout`.
        key: see `text_layout`.
    """
    if log is not None and log.columns:
        separator, start = _rows_of_width(path, alternatives, log.columns, key)
        rows = alternatives[separator]
        header, unit_row, fact_rows = tuple(log.columns), None, rows[:start]
        header_line = rows[start - 1][0] if start else 1
    else:
        header_place = None if log is None else _header_row(alternatives)
        separator, at = header_place or (default, 0)
        rows = alternatives[separator]
        if not rows:
            raise TableError(f"{path}: holds no table; a log has a header row such as time_s,fx_n,fy_n")
        header = tuple(rows[at][1])
        if any(NUMBER.match(cell) for cell in header):
            raise TableError(
                f"{path}, line {rows[at][0]}: expected the names of the columns, got "
                f"{separator.join(header).strip()[:60]!r}; {_columns_remedy(log, key, len(header))}"
            )
        unit_row = rows[at + 1][1] if log is not None and _is_unit_row(rows, at) else None
        start = at + (1 if unit_row is None else 2)
        header_line, fact_rows = rows[at][0], rows[:at]
    facts = _facts(cells for _, cells in fact_rows)
    header = tuple("" if _states(cell, facts) else cell for cell in header) if log is not None else header
    doubled = {name for name, count in Counter(header).items() if name and count > 1}
    if doubled:
        raise TableError(
            f"{path}, line {header_line}: the column {min(doubled)!r} appears twice; "
            + ("rename one" if log is None else _columns_remedy(log, key, len(header)))
        )
    units = {} if unit_row is None else {name: unit for name, unit in zip(header, unit_row, strict=False) if name}
    last_above = rows[start - 1][0] if start else 0
    body = rows[start:]
    decimal_comma, thousands, pairs = _signs(path, separator, header, body, log, key)
    return Layout(header, separator, last_above, decimal_comma, thousands, pairs, units=units, facts=facts)


def _columns_remedy(log: LogInfo | None, key: str, count: int) -> str:
    if log is None:
        return "write a header row, for example time_s,fx_n,fy_n"
    example = ", ".join(['"time_s"', '"fx_n"', '"fy_n"', '"fz_n"'][:count] + ['""'] * min(count - 4, 1))
    return f"state the names of all {count} columns, from left to right, in bench.toml: {key}.columns = [{example}]"


def _header_row(alternatives: Mapping[str, Rows]) -> tuple[str, int] | None:
    """Returns separator and index of the header: the first row of two names or more above rows of numbers."""
    for at in range(max(len(rows) for rows in alternatives.values())):
        for separator, rows in alternatives.items():
            if at >= len(rows) or len([cell for cell in rows[at][1] if cell]) < 2:
                continue
            names = rows[at][1]
            start = at + (2 if _is_unit_row(rows, at) else 1)
            if not any(NUMBER.match(cell) for cell in names) and _are_rows(rows, start, len(names)):
                return separator, at
    return None


def _rows_of_width(path: Path, alternatives: Mapping[str, Rows], columns: Sequence[str], key: str) -> tuple[str, int]:
    """Returns separator and index of the first row of numbers with as many cells as ``columns``.

    Raises:
        TableError: no row of numbers has as many cells; the message states how many cells the widest rows have.
    """
    widest = 0
    for separator, rows in alternatives.items():
        for at, (_, cells) in enumerate(rows):
            if len(cells) == len(columns) and _are_rows(rows, at, len(columns)):
                return separator, at
            if _are_rows(rows, at, len(cells)):
                widest = max(widest, len(cells))
    raise TableError(
        f"{path}: {key}.columns in bench.toml names {len(columns)} columns, the rows have {widest} cells; name all of "
        'them from left to right, "" for a column that is not read'
    )


def _are_rows(rows: Rows, start: int, width: int) -> bool:
    """Returns whether the next rows hold numbers or times in their first ``width`` cells, and none in further cells."""
    below = rows[start : start + _CHECKED_ROWS]
    return bool(below) and all(_is_row(cells, width) for _, cells in below)


def _is_row(cells: Sequence[str], width: int) -> bool:
    """Returns whether at least half of the filled cells are numbers or times, and none beyond ``width`` is."""
    filled = [cell for cell in cells[:width] if cell]
    values = sum(_is_value(cell) for cell in filled)
    return 0 < len(filled) <= 2 * values and not any(cell and _is_value(cell) for cell in cells[width:])


def _is_value(cell: str) -> bool:
    if NUMBER.match(cell) or cell.lower() in MISSING or _GROUPED.match(cell):
        return True
    return cell[:2].lower() == "0x" or (any(map(str.isdigit, cell)) and is_time_text(cell))


def _is_unit_row(rows: Rows, at: int) -> bool:
    """Returns whether the row below the header at ``at`` holds units, unlike the rows below it."""
    if at + 2 >= len(rows):
        return False
    cells = rows[at + 1][1]
    filled = [cell for cell in cells if cell]
    return len(filled) > 1 and len(cells) <= len(rows[at][1]) and all(_UNIT.match(cell) for cell in filled)


def _facts(rows: Iterable[Sequence[str]]) -> dict[str, str]:
    """Returns name in small letters -> value, from lines such as "Force Units: N" and from pairs of cells."""
    facts: dict[str, str] = {}
    for cells in rows:
        filled = [cell for cell in cells if cell]
        if not filled:
            continue
        if match := _FACT.match(filled[0]):
            facts.setdefault(match[1].lower(), match[2])
        elif len(filled) > 1:
            facts.setdefault(filled[0].rstrip(":= ").lower(), filled[1])
    return facts


def _states(cell: str, facts: dict[str, str]) -> bool:
    """Returns whether a cell of the header states a value instead of a name; the value is added to ``facts``."""
    found = _FACT.match(cell) if "=" in cell else None
    if found:
        facts[found[1].lower()] = found[2]
    return found is not None


def _signs(
    path: Path, separator: str, header: Sequence[str], body: Rows, log: LogInfo | None, key: str
) -> tuple[bool, str, bool]:
    """Determines the signs in the numbers of a table.

    Args:
        path: the file, for messages.
        separator: sign between cells.
        header: names of the columns.
        body: first rows below the header.
        log: its ``decimal_sign`` is used where it states one.
        key: section of ``log`` in ``bench.toml``, for messages.

    Returns:
        Whether the decimal sign is a comma; the sign between thousands, or ""; whether each number is in two cells.

    Raises:
        TableError: the rows do not show the signs, and ``log`` does not state them.
    """
    stated = None if log is None else log.decimal_sign
    remedy = f'state {key}.decimal_sign = "," or "." in bench.toml' if log is not None else "export with decimal points"
    first_line, first_cells = body[0] if body else (0, list[str]())
    if separator == "," and any(first_cells[len(header) :]):  # "0,5,1,2" has four cells for two numbers
        pairs = all(len(cells) == 2 * len(header) for _, cells in body)
        if pairs and stated == ",":
            return True, "", True
        if pairs or log is None:
            raise TableError(
                f"{path}, line {first_line}: has {len(first_cells)} cells for {len(header)} columns: commas seem to be "
                "both decimal sign and separator; "
                + (remedy if pairs and log is not None else "export with semicolons or with decimal points")
            )
    cells = [(line, cell) for line, row in body for cell in row if _GROUPED.match(cell) or NUMBER.match(cell)]
    grouped = next(((line, cell) for line, cell in cells if _is_grouped(cell)), None)
    if stated is not None:  # the other of the two signs, where it occurs, groups thousands
        thousands = "." if stated == "," else ","
        return stated == ",", thousands if any(thousands in cell for _, cell in cells) else "", False
    if grouped:
        raise TableError(f"{path}, line {grouped[0]}: {grouped[1]!r} has grouped thousands; {remedy}")
    commas = [(line, cell) for line, cell in cells if "," in cell]
    points = any("." in cell for _, cell in cells)
    if commas and not points and separator == "," and all(re.match(r"^[+-]?[1-9]\d{0,2},\d{3}$", c) for _, c in commas):
        line, cell = commas[0]
        raise TableError(f"{path}, line {line}: {cell!r} may have a decimal comma or grouped thousands; {remedy}")
    return bool(commas) and not points, "", False


def _is_grouped(cell: str) -> bool:
    """Returns whether the thousands of a number are certainly grouped: it has two groups, or both signs."""
    digits = cell.lstrip("+-")
    return bool(_GROUPED.match(cell)) and (len(re.findall(r"[.,]", digits)) > 1)
