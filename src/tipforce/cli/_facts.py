"""Values as they are typed: ``--bench``, ``--fact``, ``--knob-deg``, ``--tare``, ``--offset-ms``."""

import math
from pathlib import Path
from typing import Annotated, Literal

import typer

from ..errors import InputError
from ..types import SessionInfo, info_from_facts, read_bench

BenchOption = Annotated[
    Path | None, typer.Option("--bench", metavar="FILE", help="bench.toml of the bench; see `tipforce init-bench`.")
]
FactOption = Annotated[
    list[str] | None,
    typer.Option(
        "--fact",
        metavar="KEY=VALUE",
        help="One value in place of that of bench.toml, as in views.camera.base_side=left; may be repeated.",
    ),
]
KnobOption = Annotated[
    float | None, typer.Option(help="Angle of the steering knob, where it is constant and in no file.")
]

ViewOption = Annotated[
    str | None,
    typer.Option(
        "--view",
        metavar="NAME",
        help="The view that the method reads, of several; default: the model's own, or the first one.",
    ),
]


def stated_info(bench: Path | None, facts: list[str] | None, knob_deg: float | None = None) -> SessionInfo:
    """Merges the options of a session; each later one wins.

    Args:
        bench: the file of the option ``--bench``.
        facts: single facts, as "KEY=VALUE".
        knob_deg: constant angle of the knob, degrees.

    Returns:
        The stated metadata of the session.

    Raises:
        FileFormatError, InputError: a file, a key or a value is wrong; the message names it.
    """
    info = SessionInfo() if bench is None else read_bench(bench)
    if facts:
        info = info.updated(info_from_facts(facts))
    if knob_deg is not None:
        knob = number_from(str(knob_deg), "--knob-deg", "degrees")
        stated = SessionInfo.from_values({"actuation": {"constant": {"knob_deg": knob}}}, f"--knob-deg {knob:g}")
        info = info.updated(stated)
    return info


def number_from(text: str, option: str, expected: str) -> float:
    """Reads a number from an option.

    Args:
        text: the given text.
        option: name of the option, for the message.
        expected: the expected input, for the message.

    Returns:
        The finite number.

    Raises:
        InputError: the text is no finite number.
    """
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{option}: expected {expected}, got {text!r}")
    return value


def tare_from(text: str) -> Literal["auto", "none"] | tuple[float, float]:
    """Reads ``auto``, ``none`` or ``START:END`` in seconds.

    >>> tare_from("0:5")
    (0.0, 5.0)
    """
    if text == "auto":
        return "auto"
    if text == "none":
        return "none"
    start, colon, end = text.partition(":")
    if not colon:
        raise InputError(f"--tare {text}: expected START:END in seconds (0:5), auto or none")
    stretch = tuple(
        number_from(part, f"--tare {text}", "START:END in seconds (0:5), auto or none") for part in (start, end)
    )
    if not stretch[1] > stretch[0]:
        raise InputError(f"--tare {text}: the end is not behind the start")
    return stretch[0], stretch[1]


def offset_from(text: str) -> Literal["auto", "none", "start"] | float:
    """Reads the offset between the clocks of images and force log: ms, or ``auto``, ``none``, ``start``.

    >>> offset_from("-12.5")
    -12.5
    """
    if text == "auto":
        return "auto"
    if text == "none":
        return "none"
    if text == "start":
        return "start"
    value = number_from(text, f"--offset-ms {text}", "milliseconds, auto, none or start")
    if abs(value) > 2e12:  # the offset of a clock that began in 1970 is 1.7e12
        raise InputError(f"--offset-ms {text}: expected less than 2e12 ms; a clock that began in 1970 shows less")
    return value
