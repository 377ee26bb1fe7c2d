"""The command line: one verb a file. Verbs call the rooms and hold no logic; rooms are imported when a verb runs."""

import importlib
import os
import sys
import warnings
from typing import Annotated

import typer

from .. import __version__
from ..errors import TipforceError
from ._common import console

__all__ = ["VERBS", "app", "main"]

VERBS: dict[str, str] = {
    "demo": "demo",
    "simulate": "simulate",
    "init-bench": "init_bench",
    "import": "import_",
    "train": "train",
    "evaluate": "evaluate",
    "inspect": "inspect",
    "estimate": "estimate",
}
"""Verb -> module of this package that holds its ``command`` function, in the order of a working day."""

app = typer.Typer(
    name="tipforce",
    help="Reads the contact force at the tip of a steerable catheter from pictures of it. Research use only.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _tell_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"tipforce {__version__}")
        raise typer.Exit


@app.callback()
def _root(  # pyright: ignore[reportUnusedFunction]
    version: Annotated[
        bool, typer.Option("--version", callback=_tell_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    del version  # `_tell_version` has answered


for _verb, _module in VERBS.items():
    app.command(_verb)(importlib.import_module(f".{_module}", __name__).command)


def _say_warning(message: Warning | str, *_: object, **__: object) -> None:
    console.print(f"tipforce: {message}", style="yellow", soft_wrap=True)


def main() -> None:
    """Run the command line; a mistake in the input is one sentence and exit code 2."""
    warnings.showwarning = _say_warning
    # read when OpenCV is first imported: what it finds wrong with a picture is said by our own sentence
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    try:
        app()
    except TipforceError as error:
        console.print(f"tipforce: {error}", style="red", soft_wrap=True)
        sys.exit(2)
    except OSError as error:
        where = f" {error.filename}:" if error.filename else ""
        console.print(f"tipforce:{where} {error.strerror or error}", style="red", soft_wrap=True)
        sys.exit(2)
