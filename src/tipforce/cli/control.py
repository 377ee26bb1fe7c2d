"""``tipforce control``: hold a target force on a moving wall, in simulation."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from ._common import JsonOption, check_outputs, progress_bar, say, write_json
from ._facts import ViewOption
from ._settings import SetOption, settings_from


def command(
    model: Annotated[str, typer.Argument(help="A model folder or pretrained/NAME; or truth, to compare.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FOLDER", help="Where the run goes.")],
    simulated: Annotated[str, typer.Option(metavar="PRESET", help="Which simulated bench.")] = "bench-2021",
    target_n: Annotated[float, typer.Option(min=0.01, help="Force to hold, in N.")] = 0.2,
    controller: Annotated[
        Literal["periodic", "pi", "admittance", "none"],
        typer.Option(help="periodic: rejects heart and breath; none: stays where the mean force is the target."),
    ] = "periodic",
    contact: Annotated[
        Literal["perpendicular", "oblique", "lateral"], typer.Option(help="How the tip meets the tissue.")
    ] = "perpendicular",
    drives: Annotated[
        Literal["advance", "knob", "both"],
        typer.Option(help="The drive that moves the tip: in lateral contact the advance has little effect."),
    ] = "advance",
    session: Annotated[int, typer.Option(min=0, max=999, help="Which session of the bench.")] = 0,
    seconds: Annotated[float, typer.Option(min=1.0, max=600.0, help="So long the force is held.")] = 30.0,
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same run, to the byte.")] = 0,
    no_limit: Annotated[bool, typer.Option("--no-limit", help="Lift the limit of the force, for a baseline.")] = False,
    view: ViewOption = None,
    settings: SetOption = None,
    json_file: JsonOption = None,
) -> None:
    """Hold a target force on a beating wall, with an estimator in the loop; on simulated time.

    The run goes from the marked start toward the marked goal, touches, learns how the wall moves, and holds the force.
    A layer between controller and drives draws the catheter back before the upper end of the estimate passes 0.4 N
    (the loop's limit; the thesis's safe limit is 0.3 N) and without a valid estimate. The wall moves 4 mm at 1.2 Hz and
    2 mm with the breath; the advance makes at most 30 mm/s, 20 ms late; the camera 30 Hz, a fluoroscope its own rate,
    40 ms late. The folder gets recording.mcap, control.csv, control.json, control.svg and report.html.

    The verdict states the peak of the true force and the time above both limits. --no-limit with --controller none is
    the baseline: the effect of the wall on a catheter that does not move.

    --set changes a setting of the control: safety.limit_n=0.35, learn_s=8, observer.harmonics=4.

    Example:
        tipforce control truth --simulated bench-2021 --target-n 0.2 --seconds 5 -o held/

        tipforce control pretrained/compact --simulated bench-2021 --contact oblique --drives both -o run/

        tipforce control truth --controller none --no-limit --seconds 5 -o baseline/
    """
    from ..control import LIFTED_LIMIT_N, ControlSettings
    from ..errors import InputError
    from ..estimators import load_model
    from ..pipelines import ControlSession, bench_of_regime, live_bench, preset_settings, verdict
    from ..pipelines import control as run_and_report

    check_outputs([], json_file)
    if no_limit and any(each.partition("=")[0].strip() == "safety.limit_n" for each in settings or ()):
        raise InputError("--no-limit lifts the limit that --set safety.limit_n states; leave one of both out")
    lifted = [f"safety.limit_n={LIFTED_LIMIT_N}"] if no_limit else []
    stated = [f"target_n={target_n}", f"controller={controller}", *lifted, *(settings or [])]
    chosen = settings_from(ControlSettings, stated)
    bench = bench_of_regime(preset_settings(simulated), contact, seconds)
    estimator = "truth" if model == "truth" else load_model(Path(model), view)
    loop = ControlSession(estimator, live_bench(estimator, bench, seed, session), chosen, drives, seconds=seconds)
    title = f"{model}, {controller}, {contact} contact, {simulated} session {session} of seed {seed}, drives: {drives}"
    command_line = (
        f"tipforce control {model} --simulated {simulated} --target-n {target_n:g} --controller {controller} --contact "
        f"{contact} --drives {drives} --session {session} --seconds {seconds:g} --seed {seed}"
        f"{'' if view is None else f' --view {view}'}{' --no-limit' * no_limit}"
        f"{''.join(f' --set {each}' for each in settings or ())} -o {output}"
    )
    with progress_bar() as report:
        figures = run_and_report(loop, output, seconds, title=title, command=command_line, progress=report)
    say(verdict(figures))
    say(f"wrote {output}: look at {output / 'report.html'}")
    write_json(figures, json_file)
