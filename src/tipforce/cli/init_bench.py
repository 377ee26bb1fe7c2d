"""``tipforce init-bench``: a commented ``bench.toml``."""

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from ..errors import InputError
from ..types import SessionInfo, bench_text, merged_values
from ._common import check_new, check_outputs, say
from ._facts import BenchOption, FactOption, stated_info

_QUESTIONS: tuple[tuple[str, str, float | None], ...] = (
    ("catheter.name", "Name of the catheter", None),
    ("catheter.diameter_m", "Diameter of the shaft in mm", 1e-3),
    ("catheter.flexible_length_m", "Length from the clamp to the rigid tip in mm", 1e-3),
    ("catheter.rigid_length_m", "Length of the rigid tip in mm (0: none)", 1e-3),
    ("catheter.bending_stiffness_nm2", "Bending stiffness EI in N m^2", 1.0),
    ("views.camera.metres_per_px", "Scale of the image in mm per pixel", 1e-3),
    ("views.camera.base_side", "Side of the image that the catheter comes from (left, right, top, bottom)", None),
    ("sensor.angle_deg", "Angle of the force sensor's x axis from the catheter's base, counter-clockwise, in deg", 1.0),
    ("sensor.reads", "Sign of the readings (tip-on-tissue under the tissue, or tissue-on-tip)", None),
    ("actuation.constant.knob_deg", "Angle of the knob in deg, where it never changes", 1.0),
)
"""Key of ``bench.toml``, question, and the SI value of one unit of the answer; None for text."""


def command(
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FILE", help="The file to write.")] = Path(
        "bench.toml"
    ),
    bench: BenchOption = None,
    fact: FactOption = None,
    ask: Annotated[
        bool | None, typer.Option("--ask/--no-ask", help="Ask for the values; default: where a person can answer.")
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace a file that is there already.")] = False,
) -> None:
    """Write a bench.toml: one file that describes catheter, views, force sensor and drives for all other verbs.

    Every value has a comment; unknown values stay commented out. On a terminal it asks for the most used values;
    an empty input leaves a value open. --bench begins with the values of another file.

    Example:
        tipforce init-bench -o bench.toml

        tipforce init-bench --fact catheter.diameter_m=2.33e-3 --fact views.camera.base_side=right -o bench.toml
    """
    from ..io import write_atomic

    check_outputs([], output)
    check_new(output, overwrite=overwrite)
    info = stated_info(bench, fact)
    if ask if ask is not None else sys.stdin.isatty():
        info = _asked(info, lambda text: typer.prompt(text, default="", show_default=False, err=True))
    write_atomic(output, bench_text(replace(info, name="")))
    say(f"wrote {output}: {len(info.stated_keys())} values stated; the others are in it as comments")


def _asked(info: SessionInfo, prompt: Callable[[str], str]) -> SessionInfo:
    """Returns ``info`` with the user's replies to questions on its open values; a refused reply is asked for again."""
    for key, question, unit in _QUESTIONS:
        if key in info.stated_keys() or (key == "catheter.name" and info.catheter.name != "unnamed"):
            continue
        while answer := prompt(question).strip():
            try:
                info = SessionInfo.from_values(merged_values(info.values(), _nested(key, answer, unit)), "the answer")
                break
            except InputError as error:
                say(str(error), "yellow")
    return info


def _nested(key: str, answer: str, unit: float | None) -> dict[str, Any]:
    """Returns an answer as nested values, as {"catheter": {"diameter_m": 0.0023}}.

    Args:
        key: key of the value, as "catheter.diameter_m".
        answer: the typed text; a number may have a decimal comma.
        unit: factor from the unit of the question to SI; None: the answer is a text.

    Raises:
        InputError: the answer is no number.
    """
    value: Any = answer
    if unit is not None:
        try:
            value = float(f"{float(answer.replace(',', '.')) * unit:.12g}")
        except ValueError:
            raise InputError(f"expected a number, got {answer!r}") from None
    for part in reversed(key.split(".")):
        value = {part: value}
    return value
