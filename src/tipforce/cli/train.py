"""``tipforce train``: from labelled samples to a model folder."""

from pathlib import Path
from typing import Annotated

import typer

from ._common import ExecutorOption, JsonOption, check_outputs, progress_bar, say, write_json
from ._facts import BenchOption
from ._settings import SetOption, settings_from


def command(
    data: Annotated[
        list[Path], typer.Argument(help="Recordings, a dataset folder, or a published layout; several are joined.")
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the model.")],
    estimator: Annotated[
        str, typer.Option(help="Method to train: svr, dcfe, compact, stereo, or one that another package adds.")
    ] = "svr",
    bench: BenchOption = None,
    samples: Annotated[
        int | None, typer.Option(min=1, help="Number of samples to draw (the thesis has 220); default: all.")
    ] = None,
    holdout: Annotated[
        float, typer.Option(min=0.0, max=0.9, help="Share of the samples held out at random to measure errors on.")
    ] = 0.0,
    without: Annotated[
        list[str] | None, typer.Option(metavar="SESSION", help="A session to leave out, kept for judging; repeatable.")
    ] = None,
    calibrate: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="DATA",
            help="Sessions apart, on which the intervals are found, as a new session would need them; repeatable.",
        ),
    ] = None,
    start: Annotated[
        str | None,
        typer.Option(
            "--from",
            metavar="MODEL",
            help="Networks: begin with the weights of this model, not random ones: a folder, or `pretrained`, the one "
            "that comes with the program. Other settings then have the values for fine-tuning this method.",
        ),
    ] = None,
    resume: Annotated[
        bool,
        typer.Option("--resume", help="Networks: go on with a training that was cut off; state all as it was then."),
    ] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace a model that is there already.")] = False,
    onnx: Annotated[
        Path | None, typer.Option(help="Also write the regression, or the network, as an ONNX graph.")
    ] = None,
    executor: ExecutorOption = "local",
    settings: SetOption = None,
    json_file: JsonOption = None,
) -> None:
    """Train a method on labelled samples and save it as a model folder.

    A random share held out (--holdout 0.25, as in the thesis) has neighbours of every frame in the training part; for
    the error on sessions never seen use `tipforce evaluate`.

    A network writes a checkpoint after every epoch, to OUTPUT.training beside the model, and needs the extra "train".

    Example:
        tipforce train runs/ --estimator svr -o models/svr

        tipforce train runs/ -o models/svr --without session_07

        tipforce train runs/ -o models/svr --without session_07 --calibrate runs/session_07.mcap

        tipforce train runs/ -o models/svr --samples 220 --holdout 0.25 --set force=components --json -

        tipforce train bench/ other/ --estimator compact --from pretrained -o models/compact

        tipforce train runs/ --estimator dcfe -o models/dcfe --set minutes=60

        tipforce train runs/ --estimator dcfe -o models/dcfe --set minutes=60 --resume
    """
    from ..estimators import export_onnx, method
    from ..pipelines import train

    check_outputs([*data, *(calibrate or [])], onnx, json_file)
    with progress_bar() as report:
        done = train(
            data, output,
            estimator=estimator,
            settings=settings_from(method(estimator).settings_type, settings),
            bench=bench,
            init_from=start,
            without=without or (),
            calibrate=calibrate,
            samples=samples,
            holdout=holdout,
            resume=resume,
            overwrite=overwrite,
            executor=executor,
            progress=report,
        )  # fmt: skip
    figures = {"model": str(output), "facts": done.manifest["facts"], "metrics": done.metrics}
    if onnx is not None:
        figures["onnx"] = export_onnx(done.estimator, onnx)
    for line in done.lines:
        say(line)
    say(f"Saved: {output}" + (f" and {onnx}" if onnx is not None else ""))
    write_json(figures, json_file)
