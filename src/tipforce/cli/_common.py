"""What all verbs share: progress, figures as JSON, and errors as one sentence."""

import json
import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

__all__ = ["JsonOption", "console", "progress_bar", "say", "write_json"]

console = Console(stderr=True, highlight=False)
"""Everything meant for people goes to standard error, so that standard output can carry figures."""

JsonOption = Annotated[
    str | None, typer.Option("--json", metavar="FILE", help="Also write the figures as JSON; - is standard output.")
]


def say(text: str) -> None:
    """One line for the person at the terminal."""
    console.print(text, soft_wrap=True)


@contextmanager
def progress_bar() -> Generator[Callable[[str, float], None]]:
    """Yields ``report(what, share)``: a bar with percentage and time left, that vanishes at the end."""
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as bars:
        task = bars.add_task("", total=1.0)

        def report(what: str, share: float) -> None:
            bars.update(task, description=what, completed=share)

        yield report


def write_json(figures: dict[str, Any], target: str | None) -> None:
    """``figures`` to the file ``target``, to standard output for ``-``, nowhere for None."""
    if target is None:
        return
    text = json.dumps(figures, indent=2, allow_nan=False, ensure_ascii=False) + "\n"
    if target == "-":
        sys.stdout.write(text)
    else:
        Path(target).write_text(text, encoding="utf-8")
