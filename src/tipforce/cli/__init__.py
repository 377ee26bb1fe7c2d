"""The command line: one verb a file. Verbs call the pipelines and hold no logic; they are imported when one runs."""

import importlib
import logging
import os
import re
import sys
import warnings
from typing import Annotated

import typer

from .. import __version__
from .._system.processes import Interrupted, signals_end_the_program
from ..errors import TipforceError
from ._common import in_one_line, say

__all__ = ["VERBS", "app", "main"]

VERBS: dict[str, str] = {
    "demo": "demo",
    "simulate": "simulate",
    "init-bench": "init_bench",
    "record": "record",
    "import": "import_",
    "calibrate": "calibrate",
    "train": "train",
    "evaluate": "evaluate",
    "inspect": "inspect",
    "annotate": "annotate",
    "estimate": "estimate",
    "live": "live",
    "control": "control",
}
"""Verb -> module of this package that holds its ``command`` function, in the order of a working day."""

app = typer.Typer(
    name="tipforce",
    help="Reads the contact force at the tip of a steerable catheter from images of it. Research use only.",
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


_OPTIONS = (
    (r"\b(overwrite|resume|partial)=True\b", r"--\1"),
    (r"\binit_from=(\S+)", r"--from \1"),
    (r"\binit_from\b", "--from"),
    (r'\bprotocol="(\w+)"', r"--protocol \1"),
    (r'\boffset_ms="(\w+)"', r"--offset-ms \1"),
    (r"\boffset_ms=MS\b", "--offset-ms MS"),
    (r"\brate=(RATE\b|[\d.e-]+)", r"--rate \1"),
    (r"\btare=\((\S+), (\S+)\)", r"--tare \1:\2"),
    (r'\btare="(\w+)"', r"--tare \1"),
    (r"\bto_the_letter\b", "--to-the-letter"),
    (r"\bview_poses=True\b", "--views"),
    (r"\bby_diameter=True\b", "--diameter"),
    (r"\bcontact_free=True\b", "--contact-free"),
    (r"\bwithout=(\S+)", r"--without \1"),
    (r"\bsamples_per_session=(\S+)", r"--samples-per-session \1"),
    (r"\bfact (\S+=)", r"--fact \1"),
    (r"\bstate view=(\S+)", r"state --view \1"),
    (r"(?<![-\w])(example|set) ((?:[a-z_]+\.)*[a-z_]+=)", r"\1 --set \2"),
    (r"\b(in|to) bench\.toml\b", r"\1 bench.toml (--bench FILE)"),
)
"""Parameters in messages of the library, and the options that set them."""


def as_options(message: str) -> str:
    """Returns a message of the library with options of the command line in place of parameters.

    >>> as_options("m: exists already; choose another name or state overwrite=True")
    'm: exists already; choose another name or state --overwrite'
    """
    for parameter, option in _OPTIONS:
        message = re.sub(parameter, option, message)
    return message


def _say_warning(message: Warning | str, *_: object, **__: object) -> None:
    say(f"tipforce: {in_one_line(as_options(str(message)))}", "yellow")


class _SayCompilation(logging.Handler):
    """Says that functions are compiled, which takes a while after an installation."""

    def emit(self, record: logging.LogRecord) -> None:
        say(record.getMessage(), "dim")


_KEPT = {
    "simulate": "; finished sessions are kept, and the same command goes on",
    "demo": "; its folder keeps the finished parts",
    "import": "; no recording was written, run the import again",
    "estimate": "; no table was written, run the command again",
    "inspect": "; nothing was written",
    "annotate": "; the annotations are saved, and the same command goes on",
}
"""The rest of an interrupted verb; train, evaluate and live state it themselves."""


def main() -> None:
    """Runs the command line; a mistake in the input is one sentence and exit code 2."""
    warnings.showwarning = _say_warning
    compilation = logging.getLogger("tipforce.compilation")
    compilation.setLevel(logging.INFO)
    compilation.addHandler(_SayCompilation())
    # read when OpenCV is first imported: our own sentence states the faults of an image
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # likewise for the messages of FFmpeg about a camera
    try:
        with signals_end_the_program():
            app()
    except Interrupted as stop:
        verb = next((word for word in sys.argv[1:] if word in VERBS), "")
        say(f"tipforce: stopped by {stop.signal.name}{_KEPT.get(verb, '')}", "red")
        sys.exit(128 + stop.signal)
    except TipforceError as error:
        say(f"tipforce: {in_one_line(as_options(str(error)))}", "red")
        sys.exit(2)
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        say(f"tipforce: {in_one_line(f'{where}{error.strerror or error}')}", "red")
        sys.exit(2)
