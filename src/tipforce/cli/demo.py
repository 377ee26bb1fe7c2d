"""``tipforce demo``: a user's whole day, command by command."""

import os
import shlex
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Annotated

import typer

from ._common import JsonOption, say, write_json

__all__ = ["command"]


def command(
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FOLDER", help="Where everything goes.")] = Path(
        "demo"
    ),
    sessions: Annotated[int, typer.Option(min=3, max=99, help="Sessions on the simulated bench.")] = 8,
    seconds: Annotated[float, typer.Option(min=15, help="Length of each session.")] = 30.0,
    samples: Annotated[int, typer.Option(min=40, help="Labelled frames drawn for training; the thesis has 220.")] = 220,
    seed: Annotated[int, typer.Option(min=0, help="Of the bench and of all draws.")] = 0,
    json_file: JsonOption = None,
) -> None:
    """Run the whole job without hardware: record, import, train, judge, estimate. Every command is shown.

    A simulated bench leaves videos and logs; from there on the demo types what a user would type. The last session is
    kept from training, and the force in its video is estimated at the end.

    Example:
        tipforce demo -o demo
    """
    started = time.monotonic()
    marks: dict[str, float] = {}

    def step(title: str, name: str) -> None:
        marks[name] = round(time.monotonic() - started, 1)
        say(f"\n{title} ({marks[name]:.0f} s)", "bold")

    output.mkdir(parents=True, exist_ok=True)
    step("1. A bench in software: videos, logs of force and stage", "simulate")
    bench = output / "bench"
    _tipforce(
        "simulate", "--preset", "bench-2021", "--as", "files", "--sessions", sessions, "--seconds", seconds,
        "--seed", seed, "-o", bench,
    )  # fmt: skip

    step("2. Video and logs -> recording; clocks aligned, sensor tared, the mass it carries taken out", "import")
    folders = [bench / f"session_{number:02d}" for number in range(sessions)]
    runs = output / "runs"
    runs.mkdir(exist_ok=True)
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        list(pool.map(_import, folders, [runs / f"{folder.name}.mcap" for folder in folders]))
    _tipforce("inspect", runs / "session_00.mcap", "-o", output / "recording.png")
    _tipforce(
        "inspect",
        folders[0] / "video.mp4",
        "-o",
        output / "seen.png",
        "--figures",
        "--bench",
        folders[0] / "bench.toml",
    )

    step(f"3. Method 1, support vector regression, on 75 % of {samples} samples", "train")
    model = output / "models" / "svr"
    _tipforce(
        "train", runs, "--estimator", "svr", "--without", folders[-1].name, "--samples", round(0.75 * samples),
        "--seed", seed, "--set", "force=components", "--overwrite", "-o", model,
    )  # fmt: skip

    step("4. Judged: random, blocked and held-out sessions side by side", "evaluate")
    report = output / "report"
    _tipforce("evaluate", model, "--data", runs, "--truth", bench, "--samples", samples, "--seed", seed, "-o", report)
    marks["first report"] = round(time.monotonic() - started, 1)

    step("5. Used: the force in a video of a session never seen", "estimate")
    film = folders[-1] / "video.mp4"
    _tipforce(
        "estimate", model, film, "--bench", folders[-1] / "bench.toml", "-o", output / "forces.csv",
        "--overlay", output / "overlay.mp4", "--overwrite",
    )  # fmt: skip

    marks["total"] = round(time.monotonic() - started, 1)
    say(f"\nDone in {marks['total']:.0f} s. Look at:")
    for what, path in (
        ("the report", report / "report.html"),
        ("the force in the video", output / "overlay.mp4"),
        ("a row a frame", output / "forces.csv"),
        ("what is seen in a video", output / "seen.png"),
        ("what is in a recording", output / "recording.png"),
        ("the model and its card", model / "README.md"),
    ):
        say(f"  {what:<26} {path}")
    write_json({"seconds": marks}, json_file)
    if sys.stdout.isatty() and (os.environ.get("DISPLAY") or sys.platform != "linux"):
        typer.launch(str(report / "report.html"))


def _import(folder: Path, target: Path) -> None:
    """Import one session; of all that is said, the line about the clocks is repeated."""
    told = _tipforce(
        "import", folder / "video.mp4", folder / "force.csv", folder / "stage.csv", "--bench", folder / "bench.toml",
        "--overwrite", "-o", target, shown=False,
    )  # fmt: skip
    clock = next((line for line in told.splitlines() if line.startswith("clock offset")), "")
    say(f"  {target.name}  {clock.split(' (')[0]}", "dim")


def _tipforce(*words: object, shown: bool = True) -> str:
    """Type one command: it runs as a program of its own, and ends the demo where it fails. Returns what it said."""
    command = [str(word) for word in words]
    if shown or command[-1].endswith("00.mcap"):
        say(f"$ tipforce {shlex.join(command)}", "cyan")
    caught = None if shown else subprocess.PIPE
    done = subprocess.run([sys.executable, "-m", "tipforce", *command], stderr=caught, text=True, check=False)
    if done.returncode:
        say(done.stderr or "")
        raise typer.Exit(done.returncode)
    return done.stderr or ""
