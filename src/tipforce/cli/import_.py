"""``tipforce import``."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from ._common import JsonOption, check_outputs, progress_bar, say, write_json
from ._facts import actuation_from, catheter_from, number_from, offset_from, scale_from, tare_from
from ._settings import SetOption, settings_from

__all__ = ["command"]


class TimeUnit(StrEnum):
    """Units of a log's time column."""

    S = "s"
    MS = "ms"
    US = "us"
    NS = "ns"


class ForceUnit(StrEnum):
    """Units of a log's force columns."""

    N = "N"
    MN = "mN"
    G = "g"
    COUNTS = "counts"


class Reads(StrEnum):
    """The two opposite forces at the contact."""

    TIP_ON_TISSUE = "tip-on-tissue"
    TISSUE_ON_TIP = "tissue-on-tip"


def command(
    inputs: Annotated[
        list[Path],
        typer.Argument(
            help="A video (or DICOM) or a folder of images, then its force log; or recordings (.mcap) for a dataset."
        ),
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", help="The recording (.mcap); a dataset folder for .mcap inputs.")
    ],
    knob_deg: Annotated[float | None, typer.Option(help="The steering knob's angle, where it does not change.")] = None,
    knob_column: Annotated[str | None, typer.Option(help="The force log's column with the knob's angle.")] = None,
    knob_log: Annotated[Path | None, typer.Option(help="A log of its own: time_s,knob_deg.")] = None,
    stage_log: Annotated[
        Path | None,
        typer.Option(help="Log time_s,NAME_mm of the stage that moves sensor and tissue, to take out their inertia."),
    ] = None,
    actuation: Annotated[
        list[str] | None, typer.Option(metavar="NAME_UNIT=VALUE", help="Another drive's constant; may be repeated.")
    ] = None,
    time: Annotated[
        str | None, typer.Option(help="The force log's time column; found by its name if it can be.")
    ] = None,
    fx: Annotated[str | None, typer.Option(help="Column of the sensor's x axis; --fx=-Fy turns an axis round.")] = None,
    fy: Annotated[str | None, typer.Option(help="Column of the sensor's y axis.")] = None,
    fz: Annotated[str | None, typer.Option(help="Column of the sensor's z axis (toward the camera), if any.")] = None,
    time_unit: Annotated[TimeUnit | None, typer.Option(help="Where the column's name does not tell.")] = None,
    force_unit: Annotated[ForceUnit | None, typer.Option(help="Where the columns' names do not tell.")] = None,
    counts_per_n: Annotated[
        float | None, typer.Option(help="The sensor's sensitivity, for --force-unit counts.")
    ] = None,
    sensor_angle_deg: Annotated[
        float, typer.Option(help="The sensor's x axis, counter-clockwise from the base x axis as seen in the picture.")
    ] = 0.0,
    reads: Annotated[
        Reads, typer.Option(help="What the log's force is; recordings yield what the tissue does to the tip.")
    ] = Reads.TIP_ON_TISSUE,
    tare: Annotated[
        str, typer.Option(help="Contact-free stretch START:END in seconds of the force log; auto: found; none.")
    ] = "auto",
    offset_ms: Annotated[
        str,
        typer.Option(
            "--offset-ms",
            "--offset",
            help="Camera clock minus force clock; auto: from the deflection; none: one clock.",
        ),
    ] = "auto",
    align_start: Annotated[
        bool, typer.Option("--align-start", help="The first row of the force log belongs to the first frame.")
    ] = False,
    session: Annotated[str | None, typer.Option(help="The session's name; else that of the output.")] = None,
    catheter: Annotated[
        str | None, typer.Option(metavar="NAME[,KEY=VALUE]", help="As in decapolar,diameter_m=0.002.")
    ] = None,
    metres_per_px: Annotated[float | None, typer.Option(help="The picture's scale.")] = None,
    lossless: Annotated[bool, typer.Option("--lossless", help="Keep pictures as PNG, about ten times larger.")] = False,
    jpeg_quality: Annotated[int, typer.Option(min=1, max=100, help="Quality of the pictures kept as JPEG.")] = 90,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace what is there already.")] = False,
    plot: Annotated[
        Path | None, typer.Option(help="Also draw force, a picture and frame intervals (.png, .svg).")
    ] = None,
    settings: SetOption = None,
    json: JsonOption = None,
) -> None:
    """Make a recording of a video (or folder of images) and a force log, or a dataset folder of recordings.

    Finds the offset between the two clocks from the catheter's own deflection, and the contact-free stretch that the
    sensor is tared on; both are shown, stored, and can be stated instead.

    Example: tipforce import video.mp4 force.csv --knob-deg 10 -o run.mcap

    Example: tipforce import frames/ log.tsv --time t --time-unit ms --fx Fx --fy Fy --force-unit g -o run.mcap

    Example: tipforce import runs/*.mcap -o dataset/
    """
    from ..errors import InputError
    from ..io import ForceColumns, SensorPose, check_image_target
    from ..pipelines import describe_recording, import_session, plot_summary
    from ..types import Context
    from ..vision import VisionSettings

    check_outputs([*inputs, *(log for log in (knob_log, stage_log) if log)], plot, json)
    if plot is not None:
        check_image_target(plot, plot=True)
    if all(path.suffix == ".mcap" for path in inputs):
        _dataset(inputs, output, overwrite=overwrite, json=json)
        return
    if len(inputs) > 2:
        raise InputError(f"expected a video and a force log, got {len(inputs)} files: {', '.join(map(str, inputs))}")
    frames, log = inputs[0], inputs[1] if len(inputs) == 2 else None
    with progress_bar() as report:
        done = import_session(
            frames,
            log,
            output,
            columns=ForceColumns(
                time,
                fx,
                fy,
                fz,
                None if time_unit is None else time_unit.value,
                None if force_unit is None else force_unit.value,
                counts_per_n,
            ),
            sensor=SensorPose(number_from(str(sensor_angle_deg), "--sensor-angle-deg", "degrees"), reads.value),
            actuation=actuation_from(knob_deg, actuation),
            knob_column=knob_column,
            knob_log=knob_log,
            stage_log=stage_log,
            tare=tare_from(tare),
            offset_ms=offset_from(offset_ms),
            align_start=align_start,
            context=Context(session or output.stem, catheter_from(catheter), scale_from(metres_per_px)),
            vision=settings_from(VisionSettings, settings),
            lossless=lossless,
            jpeg_quality=jpeg_quality,
            overwrite=overwrite,
            progress=report,
        )
    for line in (*done.remarks, *describe_recording(done.summary)):
        say(line)
    if plot is not None:
        plot_summary(done.summary, plot)
    write_json(done.summary.figures() | {"remarks": list(done.remarks)}, json)


def _dataset(inputs: list[Path], folder: Path, *, overwrite: bool, json: str | None) -> None:
    from ..datasets import open_recordings, write_dataset

    with progress_bar() as report:
        dataset = open_recordings(inputs, folder.name)
        write_dataset(dataset, folder, overwrite=overwrite, progress=report)
    say(f"{folder}: {len(dataset)} labelled images of {len(dataset.sessions)} sessions")
    write_json({"folder": str(folder), "samples": len(dataset), "sessions": list(dataset.sessions)}, json)
