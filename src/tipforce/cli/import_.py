"""``tipforce import``."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from ..errors import InputError
from ..types import SessionInfo
from ._common import JsonOption, check_outputs, progress_bar, say, write_json
from ._facts import BenchOption, FactOption, KnobOption, offset_from, stated_info, tare_from

if TYPE_CHECKING:
    from ..datasets import Dataset


def command(
    inputs: Annotated[
        list[Path],
        typer.Argument(
            help="A video, DICOM file or folder of images, then its logs: force, and stage and knob if there are any, "
            "recognised by their columns; a ROS bag; recordings (.mcap) or a published data set, for a dataset; or a "
            "damaged recording, to recover it; or one, to state its clocks or its tare."
        ),
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", help="The recording (.mcap); a folder, where a dataset is made.")
    ],
    bench: BenchOption = None,
    fact: FactOption = None,
    knob_deg: KnobOption = None,
    tare: Annotated[
        str,
        typer.Option(
            help="Contact-free stretch START:END in seconds of the force log; auto: as bench.toml states, else found; "
            "none."
        ),
    ] = "auto",
    stage: Annotated[Path | None, typer.Option(help="The log of the stage, if its columns do not identify it.")] = None,
    knob: Annotated[Path | None, typer.Option(help="The log of the knob, if its columns do not identify it.")] = None,
    offset_ms: Annotated[
        str,
        typer.Option(
            help="Camera clock minus force clock at the log's first row; auto: from the deflection; none: one clock; "
            "start: the log's first row belongs to the first frame."
        ),
    ] = "auto",
    rate: Annotated[
        float | None,
        typer.Option(help="True over stated frame rate, as 0.8 if 24 images a second are stamped as 30; else found."),
    ] = None,
    lossless: Annotated[bool, typer.Option("--lossless", help="Keep images as PNG, about ten times larger.")] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace an existing output.")] = False,
    json: JsonOption = None,
) -> None:
    """Make a recording of a video (or folder of images) and its logs, or a dataset folder of recordings.

    Several views on one clock are several videos, each named after its view in bench.toml, as video_a.mp4.

    Finds how the two clocks map to each other (offset and rate) from the catheter's own deflection, and the
    contact-free stretch that the sensor is tared on; both are shown, stored, and can be stated instead. Where the clock
    map cannot be determined nothing is written. A log of force has columns Fx, Fy, Fz; one of the stage that moves the
    tissue has NAME_mm, one of the knob has knob_deg. Logs are text, .xlsx or .mat; sections sensor.log, actuation.log
    and stage.log of bench.toml state the facts that are not in them, section bag the topics of a ROS bag (.bag, .db3, .mcap
    of another program, or their folder).

    Example: tipforce import video.mp4 force.csv --bench bench.toml -o runs/monday.mcap

    Example: tipforce import frames/ log.tsv --offset-ms none --fact sensor.log.time_unit=ms --fact sensor.log.force_unit=g -o run.mcap

    Example: tipforce import video.mp4 force.csv stage.csv --knob-deg 10 -o run.mcap

    Example: tipforce import video_a.mp4 video_b.mp4 force.csv --offset-ms none -o biplane.mcap

    Example: tipforce import runs/*.mcap -o dataset/

    Example: tipforce import soft-arm-two-views/ -o set/

    Example: tipforce import damaged.mcap -o recovered.mcap
    """  # noqa: E501
    from ..datasets import is_published_layout, open_dataset, open_recordings
    from ..io import is_bag
    from ..pipelines import describe_recording, import_session

    check_outputs([*inputs, *filter(None, (stage, knob))], *([output] if output.suffix == ".mcap" else []), json)
    if all(path.suffix in (".mcap", ".part") for path in inputs) and not (len(inputs) == 1 and is_bag(inputs[0])):
        _refuse_options(inputs[0], stage=stage, knob=knob)
        if output.suffix == ".mcap":
            _copy(inputs, output, offset_from(offset_ms), rate, tare_from(tare), overwrite=overwrite, json=json)
            return
        if offset_ms != "auto" or rate is not None or tare != "auto":
            raise InputError(
                f"{output}: the recordings of a dataset have their own clock maps and tares; state --offset-ms, --rate "
                f"and --tare in a copy of a recording: tipforce import {inputs[0]} -o NEW.mcap --offset-ms MS"
            )
        _dataset(open_recordings(inputs, output.name), output, overwrite=overwrite, json=json)
        return
    if len(inputs) == 1 and is_published_layout(inputs[0]):
        if output.suffix == ".mcap":
            raise InputError(
                f"{inputs[0]}: is a published data set, which becomes a dataset folder; state its name without .mcap: "
                f"-o {output.with_suffix('')}"
            )
        if offset_ms != "auto" or rate is not None or tare != "auto" or stage or knob or knob_deg is not None:
            raise InputError(
                f"{inputs[0]}: the samples of a published data set are labelled already; leave out --offset-ms, "
                "--rate, --tare, --stage, --knob and --knob-deg"
            )
        dataset, stated = open_dataset(inputs[0]), stated_info(bench, fact, None)
        infos = {name: info.updated(stated) for name, info in dataset.session_info.items()}
        _dataset(replace(dataset, session_info=infos), output, overwrite=overwrite, json=json)
        return
    frames = [path for path in inputs if _shows_like(path, inputs[0])] if not is_bag(inputs[0]) else inputs[:1]
    others = [path for path in inputs if path not in frames]
    stated = {kind: path for kind, path in (("stage", stage), ("knob", knob)) if path is not None}
    info = stated_info(bench, fact, knob_deg)
    logs = _by_kind(others, stated, info) if stated else others
    with progress_bar() as report:
        done = import_session(
            frames,
            logs,
            output,
            bench=info,
            tare=tare_from(tare),
            offset_ms=offset_from(offset_ms),
            rate=rate,
            lossless=lossless,
            overwrite=overwrite,
            progress=report,
        )
    for line in (*done.remarks, *describe_recording(done.summary)):
        say(line)
    write_json(done.summary.figures() | {"remarks": list(done.remarks)}, json)


def _shows_like(path: Path, first: Path) -> bool:
    """Returns whether ``path`` holds images of another view: a file of the kind of ``first``, or a folder as it is."""
    return path == first or (path.is_dir() and first.is_dir()) or (bool(first.suffix) and path.suffix == first.suffix)


def _refuse_options(recording: Path, *, stage: Path | None, knob: Path | None) -> None:
    """Raises InputError for options that have no effect on a recording."""
    given = [name for name, stated in (("--stage", stage is not None), ("--knob", knob is not None)) if stated]
    if given:
        raise InputError(f"{recording}: {', '.join(given)} is for a video and its logs, and this is a recording")


def _by_kind(others: list[Path], stated: dict[str, Path], info: SessionInfo) -> dict[str, Path]:
    """Returns the logs, some of which have a stated kind; the only other one is that of the force."""
    from ..io import logs_by_kind

    written = {"force": info.sensor.log, "knob": info.actuation.log, "stage": info.stage.log}
    recognised = logs_by_kind(others, written) if others else {}
    clash = sorted(set(recognised) & set(stated))
    if clash:
        raise InputError(f"{recognised[clash[0]]}: is a log of the {clash[0]}, too; state it once")
    return {**recognised, **stated}


def _copy(
    inputs: list[Path],
    target: Path,
    offset_ms: Literal["auto", "none", "start"] | float,
    rate: float | None,
    tare: Literal["auto", "none"] | tuple[float, float],
    *,
    overwrite: bool,
    json: str | None,
) -> None:
    from ..pipelines import copy_recording

    if len(inputs) > 1:
        raise InputError(f"{target}: one recording at a time is recovered; for a dataset of several, name a folder")
    lines = copy_recording(inputs[0], target, offset_ms=offset_ms, rate=rate, tare=tare, overwrite=overwrite)
    for line in (*lines, f"wrote {target}"):
        say(line)
    write_json({"recording": str(target), "recovered": lines[0], "remarks": lines[1:]}, json)


def _dataset(dataset: "Dataset", folder: Path, *, overwrite: bool, json: str | None) -> None:
    from ..datasets import write_dataset

    with progress_bar() as report:
        write_dataset(dataset, folder, overwrite=overwrite, progress=report)
    say(f"{folder}: {len(dataset)} labelled images of {len(dataset.sessions)} sessions")
    write_json({"folder": str(folder), "samples": len(dataset), "sessions": list(dataset.sessions)}, json)
