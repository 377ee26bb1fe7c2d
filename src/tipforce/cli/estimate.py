"""``tipforce estimate``: the force on every frame of a video, a folder of images or a recording."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from ._common import JsonOption, check_outputs, progress_bar, say, write_json
from ._facts import actuation_from, context_from

__all__ = ["command"]


def command(
    model: Annotated[Path, typer.Argument(help="A model folder, as `tipforce train` writes it, or pretrained/NAME.")],
    frames: Annotated[Path, typer.Argument(metavar="VIDEO|FOLDER|RUN.MCAP", help="The pictures.")],
    output: Annotated[
        str, typer.Option("-o", "--output", metavar="FILE", help="The table; - is standard output.")
    ] = "forces.csv",
    overlay: Annotated[
        Path | None, typer.Option(metavar="FILE.mp4", help="Also a video with shape, force and status in it.")
    ] = None,
    arrow_n: Annotated[
        float, typer.Option(min=1e-3, help="Force in N whose arrow is a quarter of the picture long.")
    ] = 0.3,
    knob_deg: Annotated[float | None, typer.Option(help="The knob's angle, for files that do not carry it.")] = None,
    actuation: Annotated[
        list[str] | None, typer.Option(metavar="NAME_UNIT=VALUE", help="Another drive's constant; may be repeated.")
    ] = None,
    catheter: Annotated[
        str | None, typer.Option(metavar="NAME[,KEY=VALUE]", help="Its sheet, as in ablation,flexible_length_m=0.04.")
    ] = None,
    metres_per_px: Annotated[float | None, typer.Option(help="The picture's scale.")] = None,
    note: Annotated[
        list[str] | None,
        typer.Option(metavar="KEY=VALUE", help="Another fact of the sheet, as in base_side=left; may be repeated."),
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace files that are there already.")] = False,
    json_file: JsonOption = None,
) -> None:
    """Estimate the force on every frame: a row per frame with value, 90 % interval, status and reason.

    Cells are empty where a value is unknown; a frame without an answer has a status and a reason, never an old number.

    pretrained/NAME is a model that comes with this program; a name that is none tells which there are.

    Example:
        tipforce estimate models/svr video.mp4 --knob-deg 10 -o forces.csv --overlay out.mp4

        tipforce estimate pretrained/compact run.mcap -o forces.csv

    Facts that are stated stand for those that a recording knows itself.
    """
    from ..errors import InputError
    from ..estimators import load_model, write_estimates
    from ..io import open_source

    target = sys.stdout if output == "-" else Path(output)
    check_outputs([frames], output, overlay, json_file)
    for path in (target, overlay):
        if isinstance(path, Path) and path.exists() and not overwrite:
            raise InputError(f"{path}: exists already; choose another name or state --overwrite")
    estimator = load_model(model)
    drives, stated = actuation_from(knob_deg, actuation), context_from(catheter, metres_per_px, note)
    with (
        open_source(frames, actuation=drives, stated=stated) as source,
        progress_bar() as progress,
    ):
        report = write_estimates(estimator, source, target, overlay=overlay, full_scale_n=arrow_n, progress=progress)
    say(report.text())
    if output != "-":
        say(f"wrote {output}")
    if overlay:
        say(f"wrote {overlay}")
    write_json(report.figures(), json_file)
