"""``tipforce simulate``: sessions of a bench without the bench."""

import time
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from ._common import JsonOption, check_outputs, progress_bar, say, write_json
from ._settings import SetOption, settings_from

__all__ = ["command"]


def command(
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FOLDER", help="Where the sessions go.")],
    preset: Annotated[
        str, typer.Option(help="Which bench: bench-2021, generalise; demo is the small one.")
    ] = "bench-2021",
    sessions: Annotated[int, typer.Option(min=1, max=999, help="Number of sessions.")] = 8,
    seconds: Annotated[float | None, typer.Option(help="Length of each session; else the preset's.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same sessions.")] = 0,
    lossless: Annotated[bool, typer.Option("--lossless", help="Keep pictures as PNG instead of JPEG.")] = False,
    settings: SetOption = None,
    json_file: JsonOption = None,
) -> None:
    """Simulate a bench: sessions as real hardware leaves them, with the truth in a file beside each.

    A session is a recording (session_00.mcap) that holds what a bench would know, and session_00.truth.npz for
    evaluation only. The preset demo is a smaller bench that leaves folders with video.mp4, force.csv, bench.json and
    truth.npz instead, to be imported. Sessions that stand in the folder already are kept. A preset that is changed by
    --set or --seconds is none any more: the recordings say so.

    Example:
        tipforce simulate --preset bench-2021 --sessions 8 --seed 0 -o runs/

        tipforce simulate --preset bench-2021 --set world.wall.friction=[0,0] --set scene.objects=[0,0] -o easy/
    """
    from ..errors import InputError
    from ..twin import PRESETS

    check_outputs([], json_file)
    known = [*PRESETS, "demo"]
    if preset not in known:
        raise InputError(f"--preset {preset}: there is no such bench; there are {', '.join(known)}")
    started = time.monotonic()
    changes = list(settings or [])
    if preset == "demo":
        if lossless:
            raise InputError("--lossless: the demo's bench writes videos; choose another --preset")
        paths, frames = _small(output, [f"seconds={seconds or 30.0}", *changes], sessions, seed)
    else:
        changes += [] if seconds is None else [f"world.seconds={seconds}"]
        paths, frames = _twin(output, preset, changes, sessions, seed, lossless)
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


def _twin(
    output: Path, preset: str, changes: list[str], sessions: int, seed: int, lossless: bool
) -> tuple[list[Path], int]:
    from ..twin import PRESETS, TwinSettings, read_truth, simulate
    from ._simulated import record_session

    chosen = settings_from(TwinSettings, changes, PRESETS[preset])
    if chosen != PRESETS[preset] and chosen.preset == preset:
        chosen = chosen.model_copy(update={"preset": f"{preset} changed"})
    with progress_bar() as report:
        write = partial(record_session, lossless=lossless)
        paths = simulate(output, write, chosen, sessions=sessions, seed=seed, progress=report)
    return paths, sum(len(read_truth(path).stamp_ns) for path in paths)


def _small(output: Path, changes: list[str], sessions: int, seed: int) -> tuple[list[Path], int]:
    from ..recording import write_video
    from ..twin.small import SmallBenchSettings, read_truth, simulate

    with progress_bar() as report:
        # Drawing and encoding share the time: a faster preset pays with larger files, not with quality; one thread, for
        # there is a process for every core, and the same bytes however many there are.
        folders = simulate(
            output,
            partial(write_video, preset="ultrafast", threads=1),
            settings_from(SmallBenchSettings, changes),
            sessions=sessions,
            seed=seed,
            progress=report,
        )
    return folders, sum(len(read_truth(folder).stamp_ns) for folder in folders)
