"""``tipforce inspect``: the catheter in an image or a video, and the content of a recording."""

from pathlib import Path
from typing import Annotated

import typer

from ..errors import InputError
from ..types import SessionInfo
from ._common import JsonOption, check_new, check_outputs, progress_bar, say, write_json
from ._facts import BenchOption, FactOption, stated_info
from ._settings import SetOption, settings_from

_THESIS_FIGURES = ("figure17", "figure18")
_DRAWN = 12


def command(
    file: Annotated[Path, typer.Argument(metavar="IMAGE|VIDEO|FOLDER|RUN.MCAP|DATASET", help="The file to inspect.")],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE.png", help="The drawing; default NAME-inspect.png.")
    ] = None,
    bench: BenchOption = None,
    fact: FactOption = None,
    every: Annotated[int, typer.Option(min=1, help="Examine every n-th frame of a video.")] = 1,
    drawn: Annotated[int, typer.Option(min=1, help="Number of frames of a video on one contact sheet.")] = _DRAWN,
    frames: Annotated[
        bool, typer.Option("--frames", help="Of a recording, look at its images instead of its streams.")
    ] = False,
    figures: Annotated[
        bool, typer.Option("--figures", help="Also draw thesis figures 17 and 18 (of a video's first frame).")
    ] = False,
    limits: Annotated[
        bool,
        typer.Option(
            "--limits", help="Which unknown limits the force, in mN, and how to measure it; nothing is drawn."
        ),
    ] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace drawings that are there already.")] = False,
    settings: SetOption = None,
    json_file: JsonOption = None,
) -> None:
    """Draw the detected catheter, or show the content of a recording.

    An image: mask, centreline, base frame, fitted curve. A video: the share of frames in which the catheter is found,
    and a contact sheet. A recording: streams, rates, drops, clock map, tare, ranges and a plot. A dataset of several
    sessions (a folder of images, Parquet shards): samples, ranges, the share found, and a contact sheet.

    Example:
        tipforce inspect frame.png --set vision.base_side=bottom --figures

        tipforce inspect video.mp4 --bench bench.toml --every 5

        tipforce inspect run.mcap

        tipforce inspect run.mcap --limits

    --limits runs the session model over all frames, so the catheter's length and stiffness and the scale must be
    stated; --set changes its settings.
    """
    if limits:
        if output is not None or every != 1 or drawn != _DRAWN or frames or figures:
            raise InputError("--limits draws nothing and reads every frame; leave out -o, --every, --drawn, --frames "
                             "and --figures")  # fmt: skip
        _say_limits(file, stated_info(bench, fact), settings, json_file)
        return
    from ..io import check_image_target, save_image
    from ..pipelines import describe_recording, inspect, plot_summary, summarise_recording
    from ..vision import InspectSettings

    target = output or Path(f"{file.stem}-inspect.png")
    stem = target.stem.removesuffix("-inspect")
    more = {name: target.with_name(f"{stem}-{name}.png") for name in _THESIS_FIGURES if figures}
    check_outputs([file], target, *more.values(), json_file)
    check_new(target, *more.values(), overwrite=overwrite)
    if file.suffix in (".mcap", ".part") and not (frames or figures):
        if settings or bench or fact or every != 1 or drawn != _DRAWN:
            raise InputError(f"{file}: how images are looked at plays no part in a recording's streams; add --frames")
        check_image_target(target, plot=True)
        summary = summarise_recording(file)
        plot_summary(summary, target)
        for line in describe_recording(summary):
            say(line)
        say(f"wrote {target}")
        write_json(summary.figures(), json_file)
        return
    check_image_target(target)
    with progress_bar() as progress:
        result = inspect(
            file, settings=settings_from(InspectSettings, settings), bench=stated_info(bench, fact), every=every,
            drawn=drawn, progress=progress,
        )  # fmt: skip
    save_image(target, result.drawing)
    say(result.text)
    say(f"wrote {target}")
    if figures:
        for name, figure in result.thesis_figures().items():
            save_image(more[name], figure)
            say(f"wrote {more[name]}")
    write_json(result.figures, json_file)


def _say_limits(file: Path, stated: SessionInfo, settings: list[str] | None, json_file: str | None) -> None:
    """Prints which unknown limits the force in a file; see `limits_in`."""
    from ..estimators.session import RodTrackSettings
    from ..pipelines import limits_in

    check_outputs([file], json_file)
    with progress_bar() as progress:
        limits = limits_in(file, settings=settings_from(RodTrackSettings, settings), bench=stated, progress=progress)
    for line in limits.lines():
        say(line)
    write_json(limits.figures(), json_file)
