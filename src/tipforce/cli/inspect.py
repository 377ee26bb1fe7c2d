"""``tipforce inspect``: what is seen in a picture or a video, and what a recording holds."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from ._common import JsonOption, check_outputs, progress_bar, say, write_json
from ._facts import BenchOption, FactOption, stated_info
from ._settings import SetOption, settings_from

__all__ = ["command"]


def command(
    file: Annotated[Path, typer.Argument(metavar="IMAGE|VIDEO|FOLDER|RUN.MCAP|DATASET", help="What to look at.")],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE.png", help="The drawing; default NAME-inspect.png.")
    ] = None,
    bench: BenchOption = None,
    fact: FactOption = None,
    every: Annotated[int, typer.Option(min=1, help="Of a video, look at every so many frames.")] = 1,
    sheet: Annotated[int, typer.Option(min=1, help="Of a video, draw so many frames on one sheet.")] = 12,
    frames: Annotated[
        bool, typer.Option("--frames", help="Of a recording, look at its pictures instead of its streams.")
    ] = False,
    figures: Annotated[
        bool, typer.Option("--figures", help="Also draw thesis figures 17 and 18 (of a video's first frame).")
    ] = False,
    settings: SetOption = None,
    json_file: JsonOption = None,
) -> None:
    """Draw what is seen of the catheter, or show what a recording holds.

    A picture: mask, centreline, base frame, fitted curve. A video: the share of frames in which the catheter is found,
    and a sheet of them. A recording: streams, rates, drops, clock offset, tare, ranges and a plot. A dataset of several
    sessions (a folder of images, Parquet shards): samples, ranges, the share found, and a sheet.

    Example:
        tipforce inspect frame.png --set vision.base_side=bottom --figures

        tipforce inspect video.mp4 --bench bench.toml --every 5

        tipforce inspect run.mcap
    """
    from ..datasets import dataset_at, describe_dataset, session_images
    from ..io import check_image_target, is_image, save_image
    from ..pipelines import (
        describe_recording,
        inspect_frames,
        inspect_image_file,
        inspect_sessions,
        plot_summary,
        summarise_recording,
    )
    from ..vision import InspectSettings

    target = output or Path(f"{file.stem}-inspect.png")
    check_outputs([file], target, json_file)
    if file.suffix in (".mcap", ".part") and not (frames or figures):
        check_image_target(target, plot=True)
        summary = summarise_recording(file)
        plot_summary(summary, target)
        for line in describe_recording(summary):
            say(line)
        say(f"wrote {target}")
        write_json(summary.figures(), json_file)
        return
    check_image_target(target)
    chosen = settings_from(InspectSettings, settings)
    vision, shape, stated = chosen.vision, chosen.features, stated_info(bench, fact)
    dataset = dataset_at(file)
    if dataset is not None:
        lines, facts = describe_dataset(dataset)
        with progress_bar() as progress:
            seen = ((info.updated(stated), shown) for info, shown in session_images(dataset, vision.view, every))
            total = -(-len(dataset) // every)
            look = inspect_sessions(seen, vision, shape, title=str(file), room=sheet, progress=progress, total=total)
        look = replace(look, text="\n".join([*lines, look.text]), figures={"file": str(file), **facts, **look.figures})
    elif is_image(file):
        look = inspect_image_file(file, vision, shape, stated)
    else:
        with progress_bar() as progress:
            look = inspect_frames(file, vision, shape, stated=stated, every=every, room=sheet, progress=progress)
    save_image(target, look.drawing)
    say(look.text)
    say(f"wrote {target}")
    if figures:
        for name, figure in look.thesis_figures().items():
            beside = target.with_name(f"{target.stem.removesuffix('-inspect')}-{name}.png")
            save_image(beside, figure)
            say(f"wrote {beside}")
    write_json(look.figures, json_file)
