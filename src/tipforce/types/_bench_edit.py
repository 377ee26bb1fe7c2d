"""Writes values into a ``bench.toml`` of a person, line by line, so that comments and order stay."""

import tomllib
from collections.abc import Mapping
from typing import Any

from ..errors import InputError
from ._bench_file import toml_key, toml_value
from ._session import merged_values


def edited_bench(text: str, values: Mapping[str, tuple[Any, str]], where: str = "bench.toml") -> str:
    r"""Returns the text of a ``bench.toml`` with some of its values set.

    A line that is replaced stays as a comment above the new one. A new value replaces the comment of its line where the
    file has one, as `bench_text` writes them; otherwise it is added at the end of its section.

    Args:
        text: text of the file; may be empty.
        values: key, as ``catheter.diameter_m`` -> JSON value, and a comment.
        where: the file, for the message.

    Raises:
        InputError: the file is no TOML, or it states a value in a form that is not edited (an inline table).

    >>> print(edited_bench("[catheter]\ndiameter_m = 2e-3 # mine", {"catheter.diameter_m": (0.00233, "+- 1 %")}))
    [catheter]
    # before: diameter_m = 2e-3 # mine
    diameter_m = 0.00233  # +- 1 %
    <BLANKLINE>
    """
    try:
        expected: dict[str, Any] = tomllib.loads(text)
    except ValueError as error:
        raise InputError(f"{where}: is no TOML: {error}") from None
    lines = text.splitlines()
    for key, (value, comment) in values.items():
        *section, name = key.split(".")
        written = f"{toml_key(name)} = {toml_value(value)}" + (f"  # {comment}" if comment else "")
        lines = _set(lines, tuple(section), name, written)
        nested: Any = value
        for part in reversed((*section, name)):
            nested = {part: nested}
        expected = merged_values(expected, nested)
    edited = "\n".join(lines) + "\n"
    try:
        as_wanted = tomllib.loads(edited) == expected
    except ValueError:
        as_wanted = False
    if not as_wanted:
        raise InputError(
            f"{where}: {', '.join(values)} cannot be written into it line by line; write each section as a table of "
            "its own, as in [catheter], or name another output"
        )
    return edited


def _set(lines: list[str], section: tuple[str, ...], name: str, written: str) -> list[str]:
    """Returns ``lines`` with ``written`` as the line of ``name`` in ``section``.

    It replaces the present value, which stays as a comment above it, else the comment of this name ("#name = ..."), or
    is added at the end of the section.
    """
    start, end = _section(lines, section)
    if start is None:
        header = "[" + ".".join(toml_key(part) for part in section) + "]"
        return [*lines, *([""] if lines else []), header, written]
    names = (name, f'"{name}"')
    for row in range(start, end):
        before, equals, _ = lines[row].partition("=")
        if equals and before.strip() in names:
            last = _end_of_value(lines, row, end)
            old = [f"# before: {lines[row]}", *(f"#         {line}" for line in lines[row + 1 : last])]
            return [*lines[:row], *old, written, *lines[last:]]
    for row in range(start, end):
        before, equals, _ = lines[row].partition("=")
        if equals and before.strip().lstrip("#").strip() == name and before.strip().startswith("#"):
            return [*lines[:row], written, *lines[row + 1 :]]
    while end > start and not lines[end - 1].strip():
        end -= 1
    while end > start and lines[end - 1].lstrip().startswith("#") and end < len(lines):
        end -= 1  # a comment on the next section is above its header
    return [*lines[:end], written, *lines[end:]]


def _section(lines: list[str], section: tuple[str, ...]) -> tuple[int | None, int]:
    """Returns the first line of a table after its header (None without the table), and the line after its last one."""
    start: int | None = None
    for row, line in enumerate(lines):
        if not line.lstrip().startswith("["):
            continue
        header = _header(line)
        if header is None:
            continue
        if start is not None:
            return start, row
        if header == section:
            start = row + 1
    return start, len(lines)


def _header(line: str) -> tuple[str, ...] | None:
    """Returns the path of the header of a table; None for a line that is no header, as of an array."""
    try:
        table: Any = tomllib.loads(line)
    except ValueError:
        return None
    path: list[str] = []
    while isinstance(table, dict) and table:  # [a.b] is {"a": {"b": {}}}
        (key,) = table
        path.append(key)
        table = table[key]
    return tuple(path)


def _end_of_value(lines: list[str], row: int, end: int) -> int:
    """Returns the line after the last line of a value that may take several lines."""
    for last in range(row + 1, end + 1):
        try:
            tomllib.loads("\n".join(lines[row:last]))
        except ValueError:
            continue
        return last
    return row + 1
