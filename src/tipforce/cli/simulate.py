"""``tipforce simulate``: sessions of a bench without the bench."""

import time
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import typer

from ._common import JsonOption, check_outputs, progress_bar, say, write_json
from ._settings import SetOption, settings_from

__all__ = ["command"]


def command(
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FOLDER", help="Where the sessions go.")],
    preset: Annotated[str, typer.Option(help="Which bench: bench-2021, generalise.")] = "bench-2021",
    form: Annotated[
        Literal["recording", "files"],
        typer.Option("--as", help="One recording a session; or a folder of video and logs, to be imported."),
    ] = "recording",
    sessions: Annotated[int, typer.Option(min=1, max=999, help="Number of sessions.")] = 8,
    seconds: Annotated[float | None, typer.Option(help="Length of each session; else the preset's.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same sessions.")] = 0,
    lossless: Annotated[bool, typer.Option("--lossless", help="Keep every pixel as it is drawn.")] = False,
    settings: SetOption = None,
    json_file: JsonOption = None,
) -> None:
    """Simulate a bench: sessions as real hardware leaves them, with the truth in a file beside each.

    A session is a recording (session_00.mcap) that holds what a bench would know, or with --as files a folder
    (session_00) of video.mp4, force.csv, stage.csv, bench.json and, where the knob moves, knob.csv; and
    session_00.truth.npz for evaluation only. Sessions that stand there already are kept. A preset that is changed by
    --set or --seconds is none any more: the sessions say so.

    Example:
        tipforce simulate --preset bench-2021 --sessions 8 --seed 0 -o runs/

        tipforce simulate --preset bench-2021 --set world.wall.friction=[0,0] --set scene.objects=[0,0] -o easy/

        tipforce simulate --as files --sessions 2 --seconds 30 -o bench/
    """
    from ..errors import InputError
    from ..twin import PRESETS, TwinSettings, read_truth, simulate
    from ._simulated import FORMS

    check_outputs([], json_file)
    if preset not in PRESETS:
        raise InputError(f"--preset {preset}: there is no such bench; there are {', '.join(PRESETS)}")
    started = time.monotonic()
    changes = [*([] if seconds is None else [f"world.seconds={seconds}"]), *(settings or [])]
    chosen = settings_from(TwinSettings, changes, PRESETS[preset])
    if chosen != PRESETS[preset] and chosen.preset == preset:
        chosen = chosen.model_copy(update={"preset": f"{preset} changed"})
    suffix, write = FORMS[form]
    with progress_bar() as report:
        paths = simulate(
            output,
            partial(write, lossless=lossless),
            chosen,
            suffix=suffix,
            sessions=sessions,
            seed=seed,
            progress=report,
        )
    frames = sum(len(read_truth(path).stamp_ns) for path in paths)
    took = time.monotonic() - started
    figures = {
        "folder": str(output),
        "sessions": [path.stem for path in paths],
        "frames": frames,
        "wall_time_s": round(took, 2),
    }
    say(f"{len(paths)} sessions, {frames} frames in {output} ({took:.0f} s)")
    first = paths[0]
    say(f"next: tipforce inspect {first}" if first.is_file() else f"next: tipforce import {first}/video.mp4 --help")
    write_json(figures, json_file)
