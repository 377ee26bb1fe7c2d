"""Facts of a run as they are typed: ``NAME_UNIT=VALUE``, ``START:END``, a catheter's sheet."""

import math
from typing import Literal

from ..errors import InputError
from ..types import BASE_SIDE, BASE_SIDES, CATHETER_FACTS, KNOB_GAIN, Catheter, Context

__all__ = ["actuation_from", "catheter_from", "context_from", "number_from", "offset_from", "scale_from", "tare_from"]


def number_from(text: str, option: str, expected: str, above: float = -math.inf) -> float:
    """``text`` as a finite number ``above`` a bound; raises InputError naming ``option`` and what was ``expected``."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value > above):
        raise InputError(f"{option}: expected {expected}, got {text!r}")
    return value


def actuation_from(knob_deg: float | None, pairs: list[str] | None) -> dict[str, float]:
    """``--knob-deg`` and ``--actuation NAME_UNIT=VALUE`` as name -> value.

    >>> actuation_from(10, ["wire_0_mm=1.5"])
    {'knob_deg': 10.0, 'wire_0_mm': 1.5}
    """
    values = {} if knob_deg is None else {"knob_deg": number_from(str(knob_deg), "--knob-deg", "degrees")}
    for pair in pairs or []:
        name, _, text = pair.partition("=")
        if not name.rpartition("_")[0] or not text:
            raise InputError(f"--actuation {pair}: expected NAME_UNIT=VALUE, for example --actuation wire_mm=1.5")
        if name in values:
            raise InputError(f"--actuation {pair}: {name} is stated twice")
        values[name] = number_from(text, f"--actuation {pair}", "a number after the =")
    return values


def tare_from(text: str) -> Literal["auto", "none"] | tuple[float, float]:
    """``auto``, ``none`` or ``START:END`` in seconds.

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
        raise InputError(f"--tare {text}: the end does not lie behind the start")
    return stretch[0], stretch[1]


def offset_from(text: str) -> Literal["auto", "none"] | float:
    """``auto``, ``none`` or milliseconds.

    >>> offset_from("-12.5")
    -12.5
    """
    if text == "auto":
        return "auto"
    if text == "none":
        return "none"
    value = number_from(text, f"--offset-ms {text}", "milliseconds, auto or none")
    if abs(value) > 2e12:  # what brings a clock that began in 1970 to zero is 1.7e12
        raise InputError(f"--offset-ms {text}: expected less than 2e12 ms, which is all the time since 1970")
    return value


def context_from(catheter: str | None, metres_per_px: float | None, notes: list[str] | None) -> Context:
    """A session's facts as they are stated.

    >>> context_from(None, 2e-4, ["base_side=left"]).notes
    {'base_side': 'left'}
    """
    stated: dict[str, str] = {}
    for note in notes or []:
        key, _, value = note.partition("=")
        if not (key and value):
            raise InputError(f"--note {note}: expected KEY=VALUE, for example --note base_side=left")
        if key == BASE_SIDE and value not in BASE_SIDES:
            raise InputError(f"--note {note}: expected one of {', '.join(BASE_SIDES)}")
        if key == KNOB_GAIN:
            number_from(value, f"--note {note}", "a number after the =")
        stated[key] = value
    return Context("", catheter_from(catheter), scale_from(metres_per_px), stated)


def scale_from(metres_per_px: float | None) -> float | None:
    """``--metres-per-px``, above zero; None where it is not stated."""
    if metres_per_px is None:
        return None
    return number_from(str(metres_per_px), "--metres-per-px", "a number above zero", 0.0)


def catheter_from(text: str | None) -> Catheter:
    """A name, and after it what is known: ``decapolar,diameter_m=0.002``.

    >>> catheter_from("decapolar,diameter_m=0.002").diameter_m
    0.002
    """
    if text is None:
        return Catheter()
    name, *facts = [part.strip() for part in text.split(",")]
    values: dict[str, float] = {}
    for fact in facts:
        key, _, value = fact.partition("=")
        if key not in CATHETER_FACTS:
            raise InputError(f"--catheter {text}: there is no fact {key!r}; there are {', '.join(CATHETER_FACTS)}")
        values[key] = number_from(value, f"--catheter {text}", f"a number above zero for {key}", 0.0)
    return Catheter(name or "unnamed", **values)
