"""``tipforce simulate``: sessions of a bench without the bench."""

import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from ._common import JsonOption, check_outputs, progress_bar, say, write_json
from ._settings import SetOption, settings_from

if TYPE_CHECKING:
    from ..simulation import AnySimulationSettings

__all__ = ["command"]


def command(
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FOLDER", help="Where the sessions go.")],
    preset: Annotated[
        str,
        typer.Option(
            help="Which bench: bench-2021, generalise; under X-ray: fluoro, biplane; other devices: guidewire, "
            "catheter-5f."
        ),
    ] = "bench-2021",
    form: Annotated[
        Literal["recording", "files", "dicom"] | None,
        typer.Option(
            "--as",
            help="One recording a session (default); or a folder of video (or DICOM) and logs, to be imported.",
        ),
    ] = None,
    sessions: Annotated[int | None, typer.Option(min=1, max=999, help="Number of sessions; default 8.")] = None,
    seconds: Annotated[float | None, typer.Option(help="Length of each session; else the preset's.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same sessions.")] = 0,
    lossless: Annotated[bool, typer.Option("--lossless", help="Keep every pixel as it is drawn.")] = False,
    dataset: Annotated[
        bool, typer.Option("--dataset", help="Leave labelled pictures for training instead of sessions.")
    ] = False,
    samples: Annotated[
        int | None, typer.Option(min=1, help="With --dataset: number of pictures; default 1000.")
    ] = None,
    per_session: Annotated[
        int | None,
        typer.Option("--samples-per-session", min=1, help="With --dataset: pictures of each session; default 80."),
    ] = None,
    shards: Annotated[
        bool, typer.Option("--shards", help="With --dataset: Parquet files instead of a folder of images.")
    ] = False,
    masks: Annotated[bool, typer.Option("--masks", help="With --dataset: the true masks too, in masks/.")] = False,
    settings: SetOption = None,
    json_file: JsonOption = None,
) -> None:
    """Simulate a bench: sessions as real hardware leaves them, with the truth in a file beside each.

    A session is a recording (session_00.mcap) that holds what a bench would know, or with --as files a folder
    (session_00) of video.mp4, force.csv, stage.csv, bench.toml and, where the knob moves, knob.csv; and
    session_00.truth.npz for evaluation only. --as dicom, for X-ray, leaves run.dcm (XA, multi-frame) instead of the
    video. A biplane session has two views, a and b, and a file of each. Sessions that stand there already are kept. A
    preset that is changed by --set or --seconds is none any more: the sessions say so.

    With --dataset: pictures at random instants of as many short sessions as needed, labelled as the force sensor and
    an import would; the truth lies in truth/. What a kill interrupted goes on with the same command.

    Example:
        tipforce simulate --preset bench-2021 --sessions 8 --seed 0 -o runs/

        tipforce simulate --dataset --samples 10000 --seed 0 -o set/

        tipforce simulate --preset bench-2021 --set world.wall.friction=[0,0] --set scene.objects=[0,0] -o easy/

        tipforce simulate --as files --sessions 2 --seconds 30 -o bench/

        tipforce simulate --preset fluoro --as dicom --sessions 2 -o angio/
    """
    from ..errors import InputError
    from ..simulation import PRESETS, read_truth, sample_set, simulate
    from ._simulated import FORMS, refuse_form
    from ._simulated_samples import write_samples

    check_outputs([], json_file)
    if preset not in PRESETS:
        raise InputError(f"--preset {preset}: there is no such bench; there are {', '.join(PRESETS)}")
    started = time.monotonic()
    _refuse_strays(
        dataset,
        {"--as": form, "--sessions": sessions},
        {"--samples": samples, "--samples-per-session": per_session, "--shards": shards, "--masks": masks},
    )
    if dataset:
        samples = samples or 1000
        chosen = _chosen(preset, settings)
        wanted = sample_set(chosen, seed=seed, samples=samples, per_session=per_session or 80, seconds=seconds)
        with progress_bar() as report:
            write_samples(output, wanted, shards=shards, masks=masks, lossless=lossless, say=say, progress=report)
        took = time.monotonic() - started
        say(f"{samples} samples of {wanted.sessions} sessions in {output} ({took:.0f} s)")
        view = f" --set vision.view={wanted.views[0]}" if len(wanted.views) > 1 else ""
        say(f"next: tipforce train {output} -o models/svr{view}")
        figures = {"folder": str(output), "samples": samples, "sessions": wanted.sessions}
        write_json({**figures, "wall_time_s": round(took, 2)}, json_file)
        return
    chosen = _chosen(preset, [*([] if seconds is None else [f"world.seconds={seconds}"]), *(settings or [])])
    refuse_form(form or "recording", chosen)
    suffix, write = FORMS[form or "recording"]
    with progress_bar() as report:
        paths = simulate(
            output,
            partial(write, lossless=lossless),
            chosen,
            suffix=suffix,
            sessions=sessions or 8,
            seed=seed,
            progress=report,
        )
    frames = sum(len(read_truth(path).stamp_ns) for path in paths)
    took = time.monotonic() - started
    figures = {
        "folder": str(output),
        "sessions": [path.stem for path in paths],
        "frames": frames,
        "wall_time_s": round(took, 2),
    }
    say(f"{len(paths)} sessions, {frames} frames in {output} ({took:.0f} s)")
    first = paths[0]
    video = first if first.is_file() else sorted(path for path in first.iterdir() if path.suffix in (".mp4", ".dcm"))[0]
    say(f"next: tipforce inspect {video}" if first.is_file() else f"next: tipforce import {video} --help")
    write_json(figures, json_file)


def _refuse_strays(dataset: bool, of_sessions: dict[str, object], of_samples: dict[str, object]) -> None:
    """Raises InputError for an option that would do nothing."""
    from ..errors import InputError

    for option, value in (of_sessions if dataset else of_samples).items():
        if value:
            raise InputError(
                f"{option}: does not go with --dataset, which leaves single pictures"
                if dataset
                else f"{option}: goes with --dataset only; state that too"
            )
    if of_samples["--shards"] and of_samples["--masks"]:
        raise InputError(
            "--masks does not go with --shards: Parquet files hold no masks; leave out --shards for a folder of images "
            "with masks/, or leave out --masks and take them from truth/ with tipforce.simulation.read_truth"
        )


def _chosen(preset: str, changes: list[str] | None) -> "AnySimulationSettings":
    """The preset with ``changes``, and another name where there are any."""
    from ..simulation import PRESETS

    chosen = settings_from(type(PRESETS[preset]), changes, PRESETS[preset])
    if chosen != PRESETS[preset] and chosen.preset == preset:
        chosen = chosen.model_copy(update={"preset": f"{preset} changed"})
    return chosen
