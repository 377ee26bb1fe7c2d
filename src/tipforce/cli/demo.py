"""``tipforce demo``: a user's whole day, command by command."""

import os
import sys
from pathlib import Path
from typing import Annotated

import typer

from ._common import JsonOption, check_outputs, say, write_json


def command(
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FOLDER", help="Where everything goes.")] = Path(
        "demo"
    ),
    sessions: Annotated[
        int, typer.Option(min=3, max=99, help="Sessions on the simulated bench; the last two are held out.")
    ] = 6,
    seconds: Annotated[float, typer.Option(min=15, help="Length of each session.")] = 30.0,
    samples: Annotated[int, typer.Option(min=40, help="Labelled frames that each model is trained on.")] = 400,
    seed: Annotated[int, typer.Option(min=0, help="Of the bench and of all draws.")] = 0,
    json_file: JsonOption = None,
) -> None:
    """Run the whole job without hardware: simulate, import, train, evaluate, estimate. Every command is shown.

    A simulated bench leaves videos and logs; from there on the demo types the commands of a user. The shipped network
    as it comes, the same fine-tuned, and method 1 are compared on the last two sessions, which none of them has seen.
    Then the force in the video of one of these sessions is estimated, and a random split is shown beside held-out
    sessions. Fine-tuning needs torch and is skipped without it.

    Example:
        tipforce demo -o demo
    """
    from ..pipelines import demo

    check_outputs([], json_file)
    done = demo(output, sessions=sessions, seconds=seconds, samples=samples, seed=seed, say=say)
    write_json({"seconds": done.seconds, "best": done.best}, json_file)
    if sys.stdout.isatty() and (os.environ.get("DISPLAY") or sys.platform != "linux"):
        typer.launch(str(done.report))
