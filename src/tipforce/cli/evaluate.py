"""``tipforce evaluate``: an honest report."""

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from ._bounds import bounds_from
from ._common import JsonOption, check_outputs, progress_bar, say, write_json
from ._settings import SetOption, settings_from

if TYPE_CHECKING:
    from ..types import FloatArray, IntArray

__all__ = ["command"]

PERTURBED_FRAMES = 500
"""At most so many test samples are perturbed, unless stated otherwise."""


def command(
    models: Annotated[
        list[str],
        typer.Argument(
            metavar="MODEL...", help="Folders of saved models, pretrained/NAME, or names of methods such as svr."
        ),
    ],
    data: Annotated[Path, typer.Option("--data", help="Recordings, a dataset folder, or a published layout.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for report.html, metrics.json and figures.")],
    protocol: Annotated[
        Literal["random", "blocked", "session", "all", "thesis", "standard", "catheter", "saved"],
        typer.Option(
            help="What is held out for testing; all: the first three. thesis: as many frames as it has for the method "
            "(svr 220, dcfe 615; or --samples) of the first eight sessions, at random. standard: a quarter of the "
            "sessions trains, a quarter calibrates, half tests. catheter: each catheter's first session trains, its "
            "others test. saved: models as they are, nothing is trained."
        ),
    ] = "all",
    samples: Annotated[
        int | None, typer.Option(min=1, help="Draw so many samples first (the thesis has 220); default: all.")
    ] = None,
    every: Annotated[int, typer.Option(min=1, help="Take every so many-th frame of each session.")] = 1,
    folds: Annotated[int | None, typer.Option(min=2, help="Cross-validate with so many folds.")] = None,
    seed: Annotated[int, typer.Option(help="Of the drawn samples and splits.")] = 0,
    truth: Annotated[
        Path | None, typer.Option(help="Folder that simulate wrote: score against its hidden truth too.")
    ] = None,
    bound: Annotated[
        bool | None,
        typer.Option(
            "--bound/--no-bound",
            help="With --truth: also tell how close each error comes to the smallest possible one (posterior "
            "Cramer-Rao bound); half a second of a core for a minute's session. Default: yes.",
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
        bool,
        typer.Option(
            "--perturb", help="Also score images that are shifted, turned, zoomed, lit otherwise, blurred and so on."
        ),
    ] = False,
    perturb_frames: Annotated[
        int | None, typer.Option(min=1, help="With --perturb: so many samples, spread over all (500).")
    ] = None,
    settings: SetOption = None,
    json_file: JsonOption = None,
) -> None:
    """Judge methods on held-out data and write a report.

    A method's recipe is trained anew for every split; a saved model is also scored as it is, on sessions it never saw.

    Example:
        tipforce evaluate svr --data runs/ -o report/

        tipforce evaluate models/svr --data runs/ --protocol session --truth runs/ -o report/ --json -

        tipforce evaluate svr --data runs/ --truth runs/ --protocol standard --every 4 -o report/

        tipforce evaluate models/svr --data runs/ --perturb -o report/

        tipforce evaluate compact --from pretrained --data runs/ --protocol catheter -o report/
    """
    from ..datasets import open_dataset
    from ..errors import InputError
    from ..estimators import ESTIMATORS
    from ..evaluation import (
        EvaluationSettings,
        check_report_folder,
        evaluate,
        methods_from,
        report_lines,
        truth_at,
        write_report,
    )

    check_report_folder(output)
    check_outputs([data], json_file)
    named = [model for model in models if model in ESTIMATORS and not Path(model).is_dir()]
    if settings and not named:
        raise InputError("--set changes the settings of a method that is named, such as svr; a saved model has its own")
    if bound is not None and truth is None:
        raise InputError(
            f"--{'' if bound else 'no-'}bound goes with --truth only: give --truth the folder that `tipforce simulate` "
            "wrote, or leave it out"
        )
    if start is not None and not named:
        raise InputError("--from goes with a method that is named, such as compact; a saved model has its own weights")
    if perturb_frames is not None and not perturb:
        raise InputError("--perturb-frames goes with --perturb only: state that too, or leave it out")
    methods = methods_from(
        models, {name: settings_from(ESTIMATORS[name].settings_type, settings) for name in named}, start
    )
    dataset = open_dataset(data)
    true_n = None
    if truth is not None:
        true_n = truth_at(dataset, _truths(truth))
    with progress_bar() as report:
        bounds = bounds_from(dataset, truth, report) if truth is not None and bound is not False else None
        result = evaluate(
            dataset,
            methods,
            EvaluationSettings(
                protocols=None if protocol in ("all", "saved") else [protocol],
                as_saved=protocol == "saved",
                samples=samples,
                folds=folds,
                every=every,
                seed=seed,
                perturbed_frames=(perturb_frames or PERTURBED_FRAMES) if perturb else None,
            ),
            truth_n=true_n,
            bounds=bounds,
            progress=report,
        )
        report("report", 1.0)
        figures = write_report(result, output, shlex.join(["tipforce", *sys.argv[1:]]))
    for line in report_lines(figures):
        say(line)
    say(f"Report: {output / 'report.html'}")
    write_json(figures, json_file)


def _truths(folder: Path) -> "dict[str, tuple[IntArray, FloatArray]]":
    """Stamps (n,) and true forces (n, 3) by session, of all that simulate wrote under ``folder``."""
    from ..errors import InputError
    from ..simulation import read_truth

    found: dict[str, tuple[IntArray, FloatArray]] = {}
    for path in sorted(folder.rglob("*.truth.npz")):
        truth = read_truth(path)  # of which little is kept: a set at scale has thousands
        found[truth.session] = truth.stamp_ns, truth.force_n
    if not found:
        raise InputError(f"--truth {folder}: there is no truth in it; only what `tipforce simulate` wrote has one")
    return found
