"""``tipforce estimate``: the force on every frame of a video, a folder of images or a recording."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from ._common import JsonOption, check_new, check_outputs, progress_bar, say, write_json
from ._facts import BenchOption, FactOption, KnobOption, ViewOption, number_from, stated_info
from ._settings import SetOption, settings_from


def command(
    model: Annotated[Path, typer.Argument(help="A model folder of `tipforce train`, pretrained/NAME, or rod.")],
    frames: Annotated[Path, typer.Argument(metavar="VIDEO|FOLDER|RUN.MCAP|DATASET", help="The images.")],
    output: Annotated[
        str, typer.Option("-o", "--output", metavar="FILE", help="The table; - is standard output.")
    ] = "forces.csv",
    overlay: Annotated[
        Path | None, typer.Option(metavar="FILE.mp4", help="Also a video with shape, force and status in it.")
    ] = None,
    arrow_n: Annotated[
        float, typer.Option(min=1e-3, help="Force in N whose arrow is a quarter of the image long.")
    ] = 0.3,
    bench: BenchOption = None,
    fact: FactOption = None,
    knob_deg: KnobOption = None,
    view: ViewOption = None,
    session: Annotated[str | None, typer.Option(metavar="NAME", help="Which one, of data with several.")] = None,
    settings: SetOption = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace files that are there already.")] = False,
    json_file: JsonOption = None,
) -> None:
    """Estimate the force on every frame: a row per frame with value, 90 % interval, status and reason.

    Cells are empty where a value is unknown; a frame without an answer has a status and a reason, never an old number.

    pretrained/NAME is a model that comes with this program; a wrong NAME lists them.

    Each row also states contact state and class, the probability of a force above the limit, and since the first frame
    the seconds in the force window, above the limit and without a valid force, and the force-time integral. --set
    changes the thresholds: window_n=[0.1,0.4], limit_n=0.35, contact_n, swing_n, class_s. The window of 0.1 to 0.3 N is
    the thesis's, the limit of 0.4 N this program's.

    Example:
        tipforce estimate models/svr video.mp4 --knob-deg 10 -o forces.csv --overlay out.mp4

        tipforce estimate pretrained/compact video.mp4 --bench bench.toml -o forces.csv

    bench.toml replaces the metadata of a recording.
    """
    from ..clinical import ContactSettings
    from ..datasets import open_source
    from ..estimators import load_model
    from ..pipelines import write_estimates

    target = sys.stdout if output == "-" else Path(output)
    check_outputs([frames], output, overlay, json_file)
    check_new(output, overlay, overwrite=overwrite)
    contact = settings_from(ContactSettings, settings)
    estimator = load_model(model, view)
    knob = {} if knob_deg is None else {"knob_deg": number_from(str(knob_deg), "--knob-deg", "degrees")}
    with (
        open_source(frames, session=session, actuation=knob, stated=stated_info(bench, fact)) as source,
        progress_bar() as progress,
    ):
        report = write_estimates(
            estimator, source, target, overlay=overlay, full_scale_n=arrow_n, contact=contact, progress=progress
        )
    say(report.text())
    if output != "-":
        say(f"wrote {output}")
    if overlay:
        say(f"wrote {overlay}")
    write_json(report.figures(), json_file)
