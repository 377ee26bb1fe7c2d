"""The whole job on a simulated bench: the commands that a user would type, one after the other.

Each command runs as a program of its own, so the demo shows and tests the commands of users. This module computes no
force.
"""

import importlib.util
import itertools
import shlex
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from .._system.cores import cores
from .._system.json_files import read_json
from .._system.processes import run_child
from ..errors import TipforceError

Say = Callable[[str, str | None], None]
"""Called with a line for people and its style ("bold", "cyan", "dim" or None)."""

_HELD_OUT = 2
"""Sessions that no model sees in training: the last ones."""
_EPOCHS = 4
"""Epochs of fine-tuning; enough for a bench like the one of the pre-training, and short."""
_EVALUATED_EVERY = 2
"""Every second image of the held-out sessions is evaluated: 12 a second are more than enough for the figures."""
_SPLIT_FOLDS = 4
"""Folds of each split in the comparison of splits."""
_SPLIT_TUNING_SAMPLES = 100
"""Largest number of samples, of the 165 that train in each of these folds, to choose the method's settings with."""


@dataclass(frozen=True)
class DemoReport:
    """Result of the demo.

    Attributes:
        report: the page that compares the models on sessions never seen.
        best: the model with the smallest mean absolute error there.
        seconds: start of each step, and times of "first force", "first report" and "total".
    """

    report: Path
    best: str
    seconds: dict[str, float]


def demo(
    output: str | Path, *, sessions: int = 6, seconds: float = 30.0, samples: int = 400, seed: int = 0, say: Say
) -> DemoReport:
    """Simulates a bench, imports its files, trains, evaluates on sessions never seen, and estimates on one of them.

    The force in the video of the first session is estimated before anything else.

    Args:
        output: folder for everything; files of an earlier run are replaced, sessions in it are kept.
        sessions: number of sessions, at least 3; the last two train nothing.
        seconds: length of each session.
        samples: labelled frames that each model is trained on.
        seed: seed of the bench and of all draws.
        say: called with each line.

    Returns:
        The page of the evaluation, the best model on it, and the time of each step.

    Raises:
        TipforceError: a command failed.
    """
    output = Path(output)
    started, marks = time.monotonic(), dict[str, float]()

    steps = itertools.count(1)

    def step(title: str, name: str) -> None:
        marks[name] = round(time.monotonic() - started, 1)
        say(f"\n{next(steps)}. {title} ({marks[name]:.0f} s)", "bold")

    output.mkdir(parents=True, exist_ok=True)
    bench, runs = output / "bench", output / "runs"

    def simulate(count: int) -> None:
        _type(
            say, "simulate", "--preset", "bench-2021", "--as", "files", "--sessions", count, "--seconds", seconds,
            "--seed", seed, "-o", bench,
        )  # fmt: skip

    step("One session of a simulated bench, and the force in its video by the shipped network", "first session")
    simulate(1)
    first_overlay = output / "first-overlay.mp4"
    _estimate(say, "pretrained/compact", bench / "session_00", output / "first-forces.csv", first_overlay)
    marks["first force"] = round(time.monotonic() - started, 1)
    say(f"The force in the video after {marks['first force']:.0f} s: {first_overlay}", "bold")

    step("The other sessions: videos, logs of force and stage, bench.toml", "simulate")
    simulate(sessions)

    step("Video and logs -> recording: clocks aligned, sensor tared, inertia of its load removed", "import")
    folders = [bench / f"session_{number:02d}" for number in range(sessions)]
    runs.mkdir(exist_ok=True)
    with ThreadPoolExecutor(cores()) as pool:
        list(pool.map(partial(_import, say, runs), folders))
    first, last = folders[0], folders[-1]
    _type(say, "inspect", runs / f"{first.name}.mcap", "-o", output / "recording.png")
    _type(
        say, "inspect", first / "video.mp4", "--bench", first / "bench.toml", "--every", 5, "--figures",
        "-o", output / "detected.png",
    )  # fmt: skip

    step(f"Training without the last {_HELD_OUT} sessions: method 1, and the shipped network fine-tuned", "train")
    without = [word for folder in folders[-_HELD_OUT:] for word in ("--without", folder.name)]
    svr, compact = output / "models" / "svr", output / "models" / "compact"
    common = (*without, "--samples", samples, "--overwrite")
    _type(
        say, "train", runs, "--estimator", "svr", *common,
        "--set", "force=components", "--set", f"seed={seed}", "-o", svr,
    )  # fmt: skip
    models = ["pretrained/compact", str(svr)]
    if importlib.util.find_spec("torch") is None:
        say("Fine-tuning is skipped: torch is not installed (make setup, or pip install -e '.[train]').", "yellow")
    else:
        _type(
            say, "train", runs, "--estimator", "compact", "--from", "pretrained", *common,
            "--set", f"epochs={_EPOCHS}", "--set", f"seed={seed}", "-o", compact,
        )  # fmt: skip
        models.insert(1, str(compact))

    step(f"Evaluation on the {_HELD_OUT} sessions that no model has seen", "evaluate")
    report = output / "report"
    _type(
        say,
        "evaluate",
        *models,
        "--data",
        runs,
        "--protocol",
        "saved",
        "--truth",
        bench,
        "--every",
        _EVALUATED_EVERY,
        "-o",
        report,
    )
    marks["first report"] = round(time.monotonic() - started, 1)

    best = _best_of(models, report / "metrics.json")
    step("The force in the video of a session never seen, by the best of them", "estimate")
    _estimate(say, best, last, output / "forces.csv", output / "overlay.mp4")

    step("Why sessions are held out: the same method under a random split of the frames looks better", "splits")
    splits = output / "report-splits"
    _type(
        say, "evaluate", "svr", "--data", runs, "--samples", 220, "--folds", _SPLIT_FOLDS, "--seed", seed,
        "--set", "force=components", "--set", f"tuning_samples={_SPLIT_TUNING_SAMPLES}", "-o", splits,
    )  # fmt: skip

    marks["total"] = round(time.monotonic() - started, 1)
    say(f"\nDone in {marks['total']:.0f} s. Look at:", None)
    for content, path in (
        ("sessions never seen", report / "report.html"),
        ("random split beside sessions", splits / "report.html"),
        ("the force in the video", output / "overlay.mp4"),
        ("a row a frame", output / "forces.csv"),
        ("the detected catheter in a video", output / "detected.png"),
        ("the content of a recording", output / "recording.png"),
        ("a model and its card", svr / "README.md"),
    ):
        say(f"  {content:<32} {path}", None)
    return DemoReport(report / "report.html", best, marks)


def _estimate(say: Say, model: str, session: Path, forces: Path, overlay: Path) -> None:
    """Estimates the force in the video of ``session``: a table in ``forces``, and drawn into ``overlay``."""
    _type(
        say, "estimate", model, session / "video.mp4", "--bench", session / "bench.toml", "--overwrite",
        "-o", forces, "--overlay", overlay,
    )  # fmt: skip


def _import(say: Say, runs: Path, folder: Path) -> None:
    """Imports the session in ``folder`` and repeats the printed line about the clocks."""
    target = runs / f"{folder.name}.mcap"
    printed = _type(
        say, "import", folder / "video.mp4", folder / "force.csv", folder / "stage.csv",
        "--bench", folder / "bench.toml", "--overwrite", "-o", target, side_by_side=True,
    )  # fmt: skip
    clock = next((line for line in printed.splitlines() if line.startswith("clock map")), "")
    say(f"  {target.name}  {clock.split(' (')[0]}", "dim")


def _best_of(models: list[str], metrics: Path) -> str:
    """Returns the model with the smallest mean absolute error in ``metrics``."""
    results = read_json(metrics)["results"]
    labels = {model if model.startswith("pretrained/") else Path(model).name: model for model in models}
    errors = {
        labels[result["method"]]: result["against_sensor"]["quantities"]["magnitude"]["mae_n"]
        for result in results
        if result["method"] in labels
    }
    return min(errors, key=lambda model: errors[model])


def _type(say: Say, *words: object, side_by_side: bool = False) -> str:
    """Types one command of the program and waits for it.

    Args:
        say: called with the command.
        words: verb, arguments and options.
        side_by_side: others run at the same time: it gets one core, and its messages are returned, not shown.

    Raises:
        TipforceError: the command failed.
    """
    command = [str(word) for word in words]
    say(f"$ tipforce {shlex.join(command)}", "cyan")
    threads = 1 if side_by_side else None
    done = run_child([sys.executable, "-m", "tipforce", *command], capture=side_by_side, threads=threads)
    if done.returncode:
        reason = f": {done.stderr.strip()}" if side_by_side else ""
        raise TipforceError(f"`tipforce {shlex.join(command)}` ended with exit code {done.returncode}{reason}")
    return done.stderr or ""
