"""Reads JSON and small texts from files: size and depth are limited, each fault is one sentence.

All JSON of the library is read here, except for values on the command line (``--set``).
"""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..errors import FileFormatError

MAX_BYTES = 16 << 20
"""Longest file that is read as one JSON value."""
MAX_DEPTH = 64
"""Deepest nesting of lists and objects."""


def read_json(path: Path, *, max_bytes: int = MAX_BYTES, remedy: str = "") -> Any:
    """Returns the JSON value in ``path``.

    Args:
        path: a regular file.
        max_bytes: longest permitted file.
        remedy: end of the error messages.

    Raises:
        FileFormatError: the file is missing, no regular file, too long, too deeply nested, or no JSON.
    """
    return parse_json(read_small_text(path, max_bytes=max_bytes, remedy=remedy), str(path), remedy, max_bytes)


def parse_json(text: str | bytes, where: str, remedy: str = "", max_bytes: int = MAX_BYTES) -> Any:
    """Returns the JSON value of ``text``.

    Args:
        text: the JSON.
        where: its source, the beginning of the error messages.
        remedy: end of the error messages.
        max_bytes: longest permitted text.

    Raises:
        FileFormatError: the text is longer than ``max_bytes``, no JSON, or nested deeper than `MAX_DEPTH`.
    """
    end = f"; {remedy}" if remedy else ""
    if len(text) > max_bytes:
        raise FileFormatError(f"{where}: is longer than {max_bytes / 2**20:g} MiB, which such a value never is{end}")
    try:
        value = json.loads(text)
    except RecursionError:
        raise too_deep(where, remedy) from None
    except ValueError as error:  # also a number of thousands of digits, or no UTF-8
        raise FileFormatError(f"{where}: is no JSON ({error}){end}") from None
    check_depth(value, where, remedy)
    return value


def parse_json_lines(text: str, where: str, remedy: str = "") -> list[dict[str, Any]]:
    """Returns the JSON objects of ``text``, one in each line.

    Args:
        text: the lines.
        where: their source, the beginning of the error messages.
        remedy: end of the error messages.

    Raises:
        FileFormatError: as `parse_json`, with the number of the line; also where a line has no object.
    """
    values: list[dict[str, Any]] = []
    for number, line in enumerate(text.splitlines(), 1):
        value = parse_json(line, f"{where}, line {number}", remedy)
        if not isinstance(value, dict):
            end = f"; {remedy}" if remedy else ""
            raise FileFormatError(f"{where}, line {number}: expected an object in curly brackets{end}")
        values.append(value)  # pyright: ignore[reportUnknownArgumentType]
    return values


def read_small_text(path: Path, *, max_bytes: int = MAX_BYTES, remedy: str = "") -> str:
    """Returns the text of a file in UTF-8.

    Args:
        path: a regular file.
        max_bytes: longest permitted file.
        remedy: end of the error messages.

    Raises:
        FileFormatError: the file is missing, no regular file, longer than ``max_bytes``, or no text.
    """
    end = f"; {remedy}" if remedy else ""
    if not path.exists():
        raise FileFormatError(f"{path}: there is no such file{end}")
    if not path.is_file():
        raise FileFormatError(f"{path}: is no regular file{end}")
    with path.open("rb") as stream:
        data = stream.read(max_bytes + 1)
    if len(data) > max_bytes:
        raise FileFormatError(f"{path}: is longer than {max_bytes / 2**20:g} MiB, which such a file never is{end}")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileFormatError(f"{path}: is no text in UTF-8 (byte {error.start}){end}") from None


def check_depth(value: Any, where: str, remedy: str = "") -> None:
    """Checks the nesting of a value that was read.

    Args:
        value: the value.
        where: its source, the beginning of the error message.
        remedy: end of the error message.

    Raises:
        FileFormatError: lists and objects are nested deeper than `MAX_DEPTH`.
    """
    level = [value]
    for _ in range(MAX_DEPTH + 1):
        level = [inner for each in level for inner in _inside(each)]
        if not level:
            return
    raise too_deep(where, remedy)


def too_deep(where: str, remedy: str = "") -> FileFormatError:
    """Returns the error for a value that is nested too deeply.

    Args:
        where: the file or the key, for the message.
        remedy: the advice at the end of the message.
    """
    end = f"; {remedy}" if remedy else ""
    return FileFormatError(
        f"{where}: lists or tables are nested more than {MAX_DEPTH} deep, expected a few levels{end}"
    )


def _inside(value: Any) -> list[Any]:
    if isinstance(value, dict):
        return list(value.values())  # pyright: ignore[reportUnknownVariableType, reportUnknownArgumentType]
    return value if isinstance(value, list) else []  # pyright: ignore[reportUnknownVariableType]


def finite_values(value: Any) -> Any:
    """Returns a JSON value in which each number that JSON does not have (NaN, infinite) is None, also inside."""
    if isinstance(value, Mapping):
        return {str(key): finite_values(inner) for key, inner in value.items()}  # pyright: ignore[reportUnknownArgumentType]
    if isinstance(value, list | tuple):
        return [finite_values(inner) for inner in value]  # pyright: ignore[reportUnknownVariableType]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def flat_values(values: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    """Returns nested values by their full keys.

    Args:
        values: nested mappings.
        before: beginning of every key.

    >>> flat_values({"views": {"camera": {"fps": 30}}})
    {'views.camera.fps': 30}
    """
    flat: dict[str, Any] = {}
    for key, value in values.items():
        flat |= flat_values(value, f"{before}{key}.") if isinstance(value, dict) else {f"{before}{key}": value}
    return flat
