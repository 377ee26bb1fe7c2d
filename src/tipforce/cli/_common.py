"""Common parts of all verbs: progress, figures as JSON, and errors as one sentence."""

import json
import os
import sys
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

from .._system.json_files import finite_values
from ..errors import InputError

console = Console(stderr=True, highlight=False, markup=False, emoji=False)
"""Everything meant for people goes to standard error, so that standard output can carry figures.

Text in brackets or between colons is printed as it is: columns are called "Time [s]", files anything.
"""

JsonOption = Annotated[
    str | None, typer.Option("--json", metavar="FILE", help="Also write the figures as JSON; - is standard output.")
]


ExecutorOption = Annotated[
    Literal["local", "ray"],
    typer.Option(
        "--executor",
        help="Where it is done: local, on all cores of this machine; ray, on the nodes of the cluster at RAY_ADDRESS.",
    ),
]


_LINE_EVERY_S = 60.0


MAX_MESSAGE, MESSAGE_TAIL = 580, 150
"""Largest number of characters of a message; of a longer one the beginning is shown, and this part of its end, with
the remedy."""


def shown(text: str) -> str:
    r"""Returns ``text`` as it can be shown to a person: control codes of a terminal are replaced by their numbers.

    >>> shown("no column \x1b[2J")
    'no column \\x1b[2J'
    """
    return "".join(
        letter if letter.isprintable() or letter == "\n" else letter.encode("unicode_escape").decode()
        for letter in text
    )


def in_one_line(message: str) -> str:
    """Returns a message of the library, with text from files in it, as one line of at most `MAX_MESSAGE` characters."""
    text = shown(" ".join(message.split()) if "\n" in message or "\r" in message else message)
    return text if len(text) <= MAX_MESSAGE else f"{text[: MAX_MESSAGE - MESSAGE_TAIL - 5]} ... {text[-MESSAGE_TAIL:]}"


def say(text: str, style: str | None = None) -> None:
    """Prints one line for the person at the terminal.

    Args:
        text: the line.
        style: its style, as rich names it.
    """
    console.print(shown(text), style=style, soft_wrap=True)


def check_outputs(inputs: Sequence[Path], *outputs: Path | str | None) -> None:
    """Checks, before any work, that each output can be written and replaces neither an input nor another output.

    Args:
        inputs: files that are read.
        *outputs: files that are to be written. None and "-" (standard output) are not checked.

    Raises:
        InputError: an output is an input, or is stated twice.
        OutputError: an output cannot be written.
    """
    from ..io import check_output_file

    taken = {os.path.realpath(path): f"{path} is the input" for path in inputs}
    for output in outputs:
        if output is None or str(output) == "-":
            continue
        path = Path(output)
        check_output_file(path)
        place = os.path.realpath(path)  # of a link that leads round it says something, too
        if place in taken:
            raise InputError(f"{path}: cannot be written, for {taken[place]}; choose another name")
        taken[place] = "it is to be written twice"


def check_new(*outputs: Path | str | None, overwrite: bool) -> None:
    """Checks that no output exists already.

    Args:
        *outputs: files that are to be written. None and "-" (standard output) are not checked.
        overwrite: whether files may be replaced; nothing is checked then.

    Raises:
        InputError: an output exists.
    """
    for output in outputs:
        if output is not None and str(output) != "-" and Path(output).exists() and not overwrite:
            raise InputError(f"{output}: exists already; choose another name or state --overwrite")


@contextmanager
def progress_bar() -> Generator[Callable[[str, float], None]]:
    """Yields ``report(step, share)``: a bar with percentage and time left, that vanishes at the end.

    Where nobody looks at a terminal, as in a log, it is a line a minute.
    """
    if not console.is_terminal:
        yield _line_a_minute()
        return
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as bars:
        task = bars.add_task("", total=1.0)

        def report(step: str, share: float) -> None:
            bars.update(task, description=step, completed=share)

        yield report


def _line_a_minute() -> Callable[[str, float], None]:
    """Returns a progress that prints a line at most every `_LINE_EVERY_S`, for a log."""
    last_s = time.monotonic()

    def report(step: str, share: float) -> None:
        nonlocal last_s
        now_s = time.monotonic()
        if now_s - last_s >= _LINE_EVERY_S:
            last_s = now_s
            say(f"{step}: {share:.0%}")

    return report


def write_json(figures: dict[str, Any], target: str | None) -> None:
    """Writes figures as JSON. A number that is not finite is written as null: JSON has no such numbers.

    Args:
        figures: values by key, nested.
        target: the file; "-" for standard output; None: nothing is written.
    """
    if target is None:
        return
    from ..io import write_atomic

    # not every terminal can show every letter, a file can hold them all
    text = json.dumps(finite_values(figures), indent=2, allow_nan=False, ensure_ascii=target == "-") + "\n"
    if target == "-":
        sys.stdout.write(text)
    else:
        write_atomic(Path(target), text)
