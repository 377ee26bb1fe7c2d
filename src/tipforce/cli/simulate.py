"""``tipforce simulate``: sessions of a bench without the bench."""

from pathlib import Path
from typing import Annotated

import typer

from ._common import JsonOption, check_outputs, progress_bar, say, write_json
from ._settings import SetOption, settings_from

__all__ = ["command"]


def command(
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FOLDER", help="Where the sessions go.")],
    preset: Annotated[str, typer.Option(help="Which bench: demo, the small one.")] = "demo",
    sessions: Annotated[int, typer.Option(min=1, max=999, help="Number of sessions.")] = 8,
    seconds: Annotated[float, typer.Option(help="Length of each session.")] = 30.0,
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same sessions.")] = 0,
    settings: SetOption = None,
    json_file: JsonOption = None,
) -> None:
    """Simulate a bench: sessions with a video, a force log and a sheet of facts, as real hardware leaves them.

    Each session is a folder with video.mp4, force.csv (time_s, fx_n, fy_n, fz_n in the sensor's frame and on its own
    clock), bench.json (what a person would have written down) and truth.npz (for evaluation only). Sessions that stand
    in the folder already are kept.

    Example:
        tipforce simulate --sessions 8 --seconds 30 --seed 0 -o sessions/
    """
    import time
    from functools import partial

    from ..errors import InputError
    from ..recording import write_video
    from ..twin import PRESETS, read_truth, simulate

    check_outputs([], json_file)
    if preset not in PRESETS:
        raise InputError(f"--preset {preset}: there is no such bench; there are {', '.join(PRESETS)}")
    chosen = settings_from(PRESETS[preset], [f"seconds={seconds}", *(settings or [])])
    started = time.monotonic()
    with progress_bar() as report:
        # Drawing and encoding share the time: a faster preset pays with larger files, not with quality; one thread, for
        # there is a process for every core, and the same bytes however many there are.
        folders = simulate(
            output,
            partial(write_video, preset="ultrafast", threads=1),
            chosen,
            sessions=sessions,
            seed=seed,
            progress=report,
        )
    took = time.monotonic() - started
    truths = [read_truth(folder) for folder in folders]
    figures = {
        "folder": str(output),
        "sessions": [truth.session for truth in truths],
        "frames": sum(len(truth.stamp_ns) for truth in truths),
        "wall_time_s": round(took, 2),
    }
    say(f"{len(folders)} sessions, {figures['frames']} frames in {output} ({took:.0f} s)")
    say(f"next: tipforce import {folders[0] / 'video.mp4'} {folders[0] / 'force.csv'} --help")
    write_json(figures, json_file)
