"""``tipforce annotate``: marks the catheter in some frames, and fine-tunes the detector on them."""

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ._common import JsonOption, check_outputs, progress_bar, say, write_json
from ._facts import BenchOption, FactOption, stated_info
from ._settings import SetOption, settings_from

if TYPE_CHECKING:
    from ..annotation import AnnotationServer
    from ..pipelines import AnnotationJob


def command(
    path: Annotated[
        Path, typer.Argument(metavar="RECORDING|VIDEO|FOLDER", help="Images; a folder holds images or recordings.")
    ],
    source: Annotated[
        Path | None,
        typer.Option(
            "--from",
            metavar="FILE|FOLDER",
            help="Take annotations of a file (image,u,v; COCO; SLEAP; DeepLabCut; Guide3D) or of masks. No page.",
        ),
    ] = None,
    export: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the annotations: .csv, or .json for COCO. No page.")
    ] = None,
    train: Annotated[bool, typer.Option("--train", help="Fine-tune the detector. No page.")] = False,
    frames: Annotated[
        int, typer.Option(min=2, max=20, help="Number of frames that are proposed; 8 to 20 are useful.")
    ] = 12,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="FOLDER", help="The fine-tuned detector; default detector/ beside the bench file."
        ),
    ] = None,
    host: Annotated[
        str, typer.Option(help="Address that the page listens on; another one than 127.0.0.1 asks for a token.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port of the page; 0 takes any that is free.")] = 8771,
    bench: BenchOption = None,
    fact: FactOption = None,
    settings: SetOption = None,
    json_file: JsonOption = None,
) -> None:
    """Mark the catheter in 8 to 20 frames on a page, and fine-tune the detector on them.

    The page proposes frames that differ and shows the detected line: correct it, press Done, and at the end Train.
    Every change is saved beside the recording (NAME.annotations.json); the same command goes on later. Training takes
    about three minutes and needs torch; marking does not.

    Without the page: --from takes the annotations of a file, --export writes them, --train fine-tunes. Points are in
    pixels, from base to tip; images are named by their files, frames of a recording or video by their numbers from 0.

    Example:
        tipforce annotate run.mcap --bench bench.toml

        tipforce annotate frames/ --from lines.csv --export lines.json

        tipforce annotate frames/ --bench bench.toml --train
    """
    from ..pipelines import AnnotateSettings, AnnotationJob, detector_beside

    check_outputs([path, *([] if source is None else [source])], export, json_file)
    job = AnnotationJob(
        path,
        output or detector_beside(path, bench),
        settings=settings_from(AnnotateSettings, settings),
        bench=stated_info(bench, fact),
        bench_file=bench,
    )
    figures: dict[str, Any] = {"path": str(path), "annotations": str(job.store.file)}
    if source is not None:
        report = job.import_from(source)
        for remark in report.remarks:
            say(f"{source}: {remark}", "yellow")
        say(f"took {report.taken} frames of {source}")
        figures["taken"] = report.taken
    if train:
        with progress_bar() as progress:
            result = job.train(progress)
        say(f"trained on {len(job.finished)} frames in {result.seconds:.0f} s; wrote {result.folder}")
        say(_use(result.folder, bench))
        figures["detector"], figures["seconds"] = str(result.folder), result.seconds
    if export is not None:
        say(f"wrote {export}: {job.export(export)} frames")
    if source is None and export is None and not train:
        _page(job, frames, host, port, bench)
    say(f"{len(job.finished)} of {len(job.store.frames)} frames are finished; saved in {job.store.file}")
    write_json({**figures, "finished": len(job.finished), "frames": len(job.store.frames)}, json_file)


def _use(folder: Path, bench: Path | None) -> str:
    """Returns the sentence that says how the other verbs use the detector in ``folder``."""
    if bench is not None:
        return f"{bench} names it: all verbs with --bench {bench} use it"
    return f"use it with --set vision.detector={folder}, or name it in bench.toml as views.camera.detector"


def _page(job: "AnnotationJob", frames: int, host: str, port: int, bench: Path | None) -> None:
    """Serves the page until the person presses "Finish"."""
    with ExitStack() as stack:
        with progress_bar() as progress:
            server = stack.enter_context(job.serve(frames, host=host, port=port, progress=progress))
        say(f"page: {server.address}")
        say("open it in a browser; the button Finish on it, or Ctrl-C, ends this program")
        _wait(server)
        trained = server.training.status
    if trained.state == "done":
        say(f"wrote {trained.message}")
        say(_use(job.detector, bench))


def _wait(server: "AnnotationServer") -> None:
    while not server.finished.wait(0.5):  # a short wait lets a signal through
        pass
