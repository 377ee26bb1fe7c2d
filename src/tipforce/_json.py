"""JSON and small texts from outside: of a stated size, not deeper than a stated depth, or one sentence."""

import json
from pathlib import Path
from typing import Any

from .errors import FileFormatError

__all__ = ["MAX_BYTES", "MAX_DEPTH", "check_depth", "parse_json", "read_json", "read_small_text", "too_deep"]

MAX_BYTES = 16 << 20
"""Longest file that is read as one JSON value."""
MAX_DEPTH = 64
"""Deepest nesting of lists and objects."""


def read_json(path: Path, *, max_bytes: int = MAX_BYTES) -> Any:
    """The JSON value in ``path``.

    Args:
        path: a regular file.
        max_bytes: what a longer file is refused for.

    Raises:
        FileFormatError: it is missing, no regular file, too long, too deeply nested, or no JSON.
    """
    return parse_json(read_small_text(path, max_bytes=max_bytes), str(path))


def parse_json(text: str, where: str) -> Any:
    """The JSON value that ``text`` states; ``where`` it is from begins the message.

    Raises:
        FileFormatError: it is no JSON, or nested deeper than `MAX_DEPTH`.
    """
    try:
        value = json.loads(text)
    except RecursionError:
        raise too_deep(where) from None
    except ValueError as error:  # also a number of thousands of digits
        raise FileFormatError(f"{where}: is no JSON ({error})") from None
    check_depth(value, where)
    return value


def read_small_text(path: Path, *, max_bytes: int = MAX_BYTES) -> str:
    """The text of ``path``, in UTF-8.

    Raises:
        FileFormatError: it is missing, no regular file, longer than ``max_bytes``, or no text.
    """
    if not path.exists():
        raise FileFormatError(f"{path}: there is no such file")
    if not path.is_file():
        raise FileFormatError(f"{path}: is no regular file")
    with path.open("rb") as stream:
        data = stream.read(max_bytes + 1)
    if len(data) > max_bytes:
        raise FileFormatError(f"{path}: is longer than {max_bytes / 2**20:g} MiB, which such a file never is")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileFormatError(f"{path}: is no text in UTF-8 (byte {error.start})") from None


def check_depth(value: Any, where: str) -> None:
    """Raises FileFormatError where lists and objects are nested deeper than `MAX_DEPTH`."""
    level = [value]
    for _ in range(MAX_DEPTH + 1):
        level = [inner for each in level for inner in _inside(each)]
        if not level:
            return
    raise too_deep(where)


def too_deep(where: str) -> FileFormatError:
    """The error for what is nested too deeply."""
    return FileFormatError(f"{where}: lists or tables are nested more than {MAX_DEPTH} deep, expected a few levels")


def _inside(value: Any) -> list[Any]:
    if isinstance(value, dict):
        return list(value.values())  # pyright: ignore[reportUnknownVariableType, reportUnknownArgumentType]
    return value if isinstance(value, list) else []  # pyright: ignore[reportUnknownVariableType]
