"""``tipforce simulate``: sessions of a bench without the bench."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from ..errors import InputError
from ._common import ExecutorOption, JsonOption, check_outputs, progress_bar, say, write_json
from ._settings import SetOption, settings_from

if TYPE_CHECKING:
    from ..simulation import AnySimulationSettings


def command(
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FOLDER", help="Where the sessions go.")],
    preset: Annotated[
        str,
        typer.Option(
            help="Which bench: bench-2021, generalise, varied (as other people's benches), thesis-2021-plain (the "
            "thesis's image), thesis-2021 (its forces too, on one bench); under X-ray: fluoro, biplane, "
            "fluoro-varied, biplane-varied (as other people's laboratories); other devices: guidewire, catheter-5f."
        ),
    ] = "bench-2021",
    form: Annotated[
        Literal["recording", "files", "dicom", "dataset", "parquet"],
        typer.Option(
            "--as",
            help="recording: one .mcap a session; files or dicom: a folder a session, of video (or DICOM), logs and "
            "bench.toml, to be imported; dataset or parquet: labelled images for training.",
        ),
    ] = "recording",
    sessions: Annotated[int | None, typer.Option(min=1, max=999, help="Number of sessions; default 8.")] = None,
    seconds: Annotated[float | None, typer.Option(help="Length of each session; else the preset's.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same sessions.")] = 0,
    lossless: Annotated[bool, typer.Option("--lossless", help="Keep every pixel as it is drawn.")] = False,
    samples: Annotated[int | None, typer.Option(min=1, help="Of a dataset: number of images; default 1000.")] = None,
    per_session: Annotated[
        int | None,
        typer.Option("--samples-per-session", min=1, help="Of a dataset: images of each session; default 80."),
    ] = None,
    masks: Annotated[bool, typer.Option("--masks", help="Of a dataset: the true masks too, in masks/.")] = False,
    executor: ExecutorOption = "local",
    settings: SetOption = None,
    json_file: JsonOption = None,
) -> None:
    """Simulate a bench: sessions as real hardware leaves them, with the truth in a file beside each.

    A session is a recording (session_00.mcap) with a bench's data, or with --as files a folder
    (session_00) of video.mp4, force.csv, stage.csv, bench.toml and, where the knob moves, knob.csv; and
    session_00.truth.npz for evaluation only. --as dicom, for X-ray, leaves run.dcm (XA, multi-frame) instead of the
    video. A biplane session has two views, a and b, and a file of each. Existing sessions are kept. A
    preset that is changed by --set or --seconds is no preset any more: the sessions state it.

    With --as dataset (or parquet): images at random instants of as many short sessions as needed, labelled as the force
    sensor and an import would; the truth is in truth/. An interrupted run goes on with the same command.

    Example:
        tipforce simulate --preset bench-2021 --sessions 8 --seed 0 -o runs/

        tipforce simulate --as dataset --samples 10000 --seed 0 -o set/

        tipforce simulate --preset bench-2021 --set world.wall.friction=[0,0] --set scene.objects=[0,0] -o easy/

        tipforce simulate --as files --sessions 2 --seconds 30 -o bench/

        tipforce simulate --preset fluoro --as dicom --sessions 2 -o angio/
    """
    from ..pipelines import preset_settings, simulate, simulate_dataset

    check_outputs([], json_file)
    dataset = form in ("dataset", "parquet")
    _refuse_strays(
        form,
        {"--sessions": sessions} if dataset else {},
        {} if dataset else {"--samples": samples, "--samples-per-session": per_session, "--masks": masks},
    )
    if form == "parquet" and masks:
        raise InputError(
            "--masks does not go with --as parquet: its files hold no masks; state --as dataset for a folder of images "
            "with masks/, or take them from truth/ with tipforce.simulation.read_truth"
        )
    chosen = preset_settings(preset)
    if settings:
        changed = settings_from(type(chosen), settings, chosen)
        renamed = changed != chosen and changed.preset == chosen.preset
        chosen = changed.model_copy(update={"preset": f"{preset} changed"}) if renamed else changed
    if form in ("dataset", "parquet"):
        with progress_bar() as report:
            done = simulate_dataset(
                output, chosen, samples=samples or 1000, samples_per_session=per_session or 80, seconds=seconds,
                seed=seed, shards=form == "parquet", masks=masks, lossless=lossless, executor=executor, say=say,
                progress=report,
            )  # fmt: skip
        say(f"{done.frames} samples of {done.sessions} sessions in {output} ({done.seconds:.0f} s)")
        view = f" --set vision.view={done.views[0]}" if len(done.views) > 1 else ""
        say(f"next: tipforce train {output} -o models/svr{view}")
        figures = {"folder": str(output), "samples": done.frames, "sessions": done.sessions}
        write_json({**figures, "wall_time_s": round(done.seconds, 2)}, json_file)
        return
    with progress_bar() as report:
        done = simulate(
            output, _of_seconds(chosen, seconds), sessions=sessions or 8, seed=seed, form=form,
            lossless=lossless, executor=executor, progress=report,
        )  # fmt: skip
    say(f"{done.sessions} sessions, {done.frames} frames in {output} ({done.seconds:.0f} s)")
    first = done.paths[0]
    if first.is_file():
        say(f"next: tipforce inspect {first}")
    else:
        inputs = sorted(path for path in first.iterdir() if path.suffix in (".mp4", ".dcm"))
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


def _refuse_strays(form: str, of_sessions: dict[str, object], of_samples: dict[str, object]) -> None:
    """Raises InputError for an option that would do nothing."""
    for option, value in of_sessions.items():
        if value:
            raise InputError(f"{option}: does not go with --as {form}, which leaves single images; state --samples")
    for option, value in of_samples.items():
        if value:
            raise InputError(f"{option}: goes with --as dataset or --as parquet only; state one of them too")


def _of_seconds(settings: "AnySimulationSettings", seconds: float | None) -> "AnySimulationSettings":
    """Returns ``settings`` with sessions of another length; the name of the preset changes with them."""
    if seconds is None:
        return settings
    changed = settings_from(type(settings), [f"world.seconds={seconds}"], settings)
    if changed != settings and not settings.preset.endswith(" changed"):
        changed = changed.model_copy(update={"preset": f"{settings.preset} changed"})
    return changed
