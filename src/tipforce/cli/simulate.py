"""``tipforce simulate``: sessions of a bench without the bench."""

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
        bool, typer.Option("--dataset", help="Leave labelled images for training instead of sessions.")
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
    from ..pipelines import preset_settings, simulate, simulate_dataset

    check_outputs([], json_file)
    _refuse_strays(
        dataset,
        {"--as": form, "--sessions": sessions},
        {"--samples": samples, "--samples-per-session": per_session, "--shards": shards, "--masks": masks},
    )
    chosen = preset_settings(preset)
    if settings:
        changed = settings_from(type(chosen), settings, chosen)
        renamed = changed != chosen and changed.preset == chosen.preset
        chosen = changed.model_copy(update={"preset": f"{preset} changed"}) if renamed else changed
    if dataset:
        with progress_bar() as report:
            done = simulate_dataset(
                output, chosen, samples=samples or 1000, samples_per_session=per_session or 80, seconds=seconds,
                seed=seed, shards=shards, masks=masks, lossless=lossless, say=say, progress=report,
            )  # fmt: skip
        say(f"{done.frames} samples of {done.sessions} sessions in {output} ({done.seconds:.0f} s)")
        view = f" --set vision.view={done.views[0]}" if len(done.views) > 1 else ""
        say(f"next: tipforce train {output} -o models/svr{view}")
        figures = {"folder": str(output), "samples": done.frames, "sessions": done.sessions}
        write_json({**figures, "wall_time_s": round(done.seconds, 2)}, json_file)
        return
    with progress_bar() as report:
        done = simulate(
            output, _of_seconds(chosen, seconds), sessions=sessions or 8, seed=seed, form=form or "recording",
            lossless=lossless, progress=report,
        )  # fmt: skip
    say(f"{done.sessions} sessions, {done.frames} frames in {output} ({done.seconds:.0f} s)")
    first = done.paths[0]
    if first.is_file():
        say(f"next: tipforce inspect {first}")
    else:
        inputs = sorted(path for path in first.iterdir() if path.suffix in (".mp4", ".dcm"))[:1]
        logs = [path for name in ("force.csv", "stage.csv", "knob.csv") if (path := first / name).is_file()]
        words = " ".join(str(path) for path in (*inputs, *logs))
        say(f"next: tipforce import {words} --bench {first / 'bench.toml'} -o {first.name}.mcap")
    figures = {
        "folder": str(output),
        "sessions": [path.stem for path in done.paths],
        "frames": done.frames,
        "wall_time_s": round(done.seconds, 2),
    }
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


def _of_seconds(settings: "AnySimulationSettings", seconds: float | None) -> "AnySimulationSettings":
    """``settings`` with sessions of another length; the preset is none any more then."""
    if seconds is None:
        return settings
    changed = settings_from(type(settings), [f"world.seconds={seconds}"], settings)
    if changed != settings and not settings.preset.endswith(" changed"):
        changed = changed.model_copy(update={"preset": f"{settings.preset} changed"})
    return changed
