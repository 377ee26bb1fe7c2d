"""``tipforce evaluate``: an honest report."""

import shlex
import sys
from pathlib import Path
from typing import Annotated, Literal

import typer

from ._common import ExecutorOption, JsonOption, check_outputs, progress_bar, say, write_json
from ._facts import BenchOption
from ._settings import SetOption, settings_from


def command(
    models: Annotated[
        list[str],
        typer.Argument(
            metavar="MODEL...", help="Folders of saved models, pretrained/NAME, or names of methods such as svr."
        ),
    ],
    data: Annotated[Path, typer.Option("--data", help="Recordings, a dataset folder, or a published layout.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for report.html, metrics.json and figures.")],
    bench: BenchOption = None,
    protocol: Annotated[
        Literal["random", "blocked", "session", "all", "thesis", "standard", "catheter", "saved"],
        typer.Option(
            help="The samples held out for testing; all: the first three. thesis: its number of frames for the method "
            "(svr 220, dcfe 615; or --samples) of the first eight sessions, at random. standard: a quarter of the "
            "sessions trains, a quarter calibrates, half tests. catheter: each catheter's first session trains, its "
            "others test. saved: models as they are, nothing is trained."
        ),
    ] = "all",
    to_the_letter: Annotated[
        bool,
        typer.Option(
            "--to-the-letter",
            help="svr and dcfe with the thesis's own settings. svr: algorithm 1, five coefficients and the knob alone. "
            "dcfe: all training images, 10,000 epochs, no early stop. --set changes them.",
        ),
    ] = False,
    samples: Annotated[
        int | None, typer.Option(min=1, help="Number of samples to draw first (the thesis has 220); default: all.")
    ] = None,
    every: Annotated[int, typer.Option(min=1, help="Take every n-th frame of each session.")] = 1,
    folds: Annotated[int | None, typer.Option(min=2, help="Number of folds of cross-validation.")] = None,
    seed: Annotated[int, typer.Option(help="Seed of the drawn samples and splits.")] = 0,
    truth: Annotated[
        Path | None,
        typer.Option(
            help="Folder that simulate wrote: score against its truth too, and hold errors "
            "against the smallest possible ones (Cramer-Rao bound)."
        ),
    ] = None,
    start: Annotated[
        str | None,
        typer.Option(
            "--from",
            metavar="MODEL",
            help="Networks that are named: begin each split with this model's weights: a folder, or `pretrained`.",
        ),
    ] = None,
    perturb: Annotated[
        int,
        typer.Option(
            min=0,
            metavar="N",
            help="Also ask for N samples with images shifted, rotated, zoomed, lit otherwise, blurred.",
        ),
    ] = 0,
    compare: Annotated[
        bool,
        typer.Option(
            "--compare", help="Also print and draw the methods side by side over the load, beside sensors in the tip."
        ),
    ] = False,
    executor: ExecutorOption = "local",
    settings: SetOption = None,
    json_file: JsonOption = None,
) -> None:
    """Judge methods on held-out data and write a report.

    A method is trained anew for every split; a saved model is also scored as it is, on sessions it never saw.
    Trained models are kept in OUTPUT.evaluating until the report is written: the same command goes on with an
    evaluation that was cut off.

    Example:
        tipforce evaluate svr --data runs/ -o report/

        tipforce evaluate models/svr --data runs/ --protocol session --truth runs/ -o report/ --json -

        tipforce evaluate svr --data runs/ --truth runs/ --protocol standard --every 4 -o report/

        tipforce evaluate models/svr --data runs/ --perturb 500 -o report/

        tipforce evaluate --compare beam arcs --data runs/ --protocol standard --every 8 -o report/

        tipforce evaluate compact --from pretrained --data runs/ --protocol catheter -o report/

        tipforce evaluate svr --data runs/ --protocol thesis --to-the-letter -o report/
    """
    from ..errors import InputError
    from ..estimators import ESTIMATORS
    from ..pipelines import evaluate, thesis_settings

    check_outputs([data], json_file)
    named = [model for model in models if model in ESTIMATORS and not Path(model).is_dir()]
    if settings and not named:
        raise InputError("--set changes the settings of a method that is named, such as svr; a saved model has its own")
    chosen = None
    for name in named if settings else ():  # settings must be valid for each method that is named
        kind = ESTIMATORS[name].settings_type
        base = kind.model_validate(thesis_settings(name)) if to_the_letter else None
        changed = settings_from(kind, settings, base)
        stated = {pair.partition("=")[0].split(".")[0] for pair in settings or ()}
        chosen = changed.model_dump(include=stated, exclude_unset=True)
    with progress_bar() as report:
        done = evaluate(
            models, data, output,
            protocol=protocol,
            settings=chosen,
            to_the_letter=to_the_letter,
            bench=bench,
            init_from=start,
            truth=truth,
            samples=samples,
            every=every,
            folds=folds,
            perturb=perturb,
            compare=compare,
            seed=seed,
            command=shlex.join(["tipforce", *sys.argv[1:]]),
            executor=executor,
            progress=report,
        )  # fmt: skip
    for line in done.lines:
        say(line)
    say(f"Report: {done.report}")
    write_json(dict(done.metrics), json_file)
