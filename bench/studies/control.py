"""A force held on a moving wall: no control, PI, PI with rejection of heart and breath; with the truth and estimators.

    OMP_NUM_THREADS=1 python -m bench.studies.control [--feedback truth pretrained/compact ...] [--sessions N]
        [--seconds S] [--regimes perpendicular oblique lateral] [--controllers none pi periodic] [--preset bench-2021]
        [--tissue own|stated|varied] [--out FILE]

Each line of FILE (JSON) is one run; a run that is in FILE already is not run again. ``end_*`` are of the last S seconds
of a run: wanted and true force in the mean, and the rms between them. Without control the catheter rests where the mean
force is the target, and the limit is lifted, so that it is never drawn back. The table at the end has medians and worst
values of the sessions.
"""

import argparse
import json
import pathlib
import time
from functools import lru_cache

import numpy as np

from tipforce.control import LIFTED_LIMIT_N, ControlSettings, SafetySettings
from tipforce.estimators import Estimator, load_model
from tipforce.pipelines import REGIMES, bench_of_regime, live_bench, run_control
from tipforce.simulation import PRESETS, AnySimulationSettings, LiveSimulation

DRIVES = {"perpendicular": "advance", "oblique": "both", "lateral": "both"}


@lru_cache(maxsize=1)
def feedback_of(name: str) -> Estimator | str:
    """Returns an estimator, or ``truth``."""
    return name if name == "truth" else load_model(pathlib.Path(name))


_OF_TISSUE = ("stiffness_n_per_m", "log_stiffness", "laws", "loss_factors", "faces")


def with_tissue(settings: AnySimulationSettings, tissue: str) -> AnySimulationSettings:
    """The same bench with another tissue, or with one that is known.

    ``own``: as the preset has it; ``stated``: the same, and the session metadata state its stiffness, as of somebody
    who pressed on it; ``varied``: stiffness, laws, losses and faces of the preset ``varied``, stated by nobody.
    """
    wall, other = settings.world.wall, PRESETS["varied"].world.wall
    changes = {
        "own": {},
        "stated": {"stated_within": 0.05},
        "varied": {name: getattr(other, name) for name in _OF_TISSUE},
    }
    world = settings.world.model_copy(update={"wall": wall.model_copy(update=changes[tissue])})
    return settings.model_copy(update={"world": world})


@lru_cache(maxsize=1)
def bench_of(
    preset: str, tissue: str, regime: str, seconds: float, seed: int, session: int, feedback: str
) -> LiveSimulation:
    """The session, planned once for all controllers."""
    settings = bench_of_regime(with_tissue(PRESETS[preset], tissue), regime, seconds)  # type: ignore[arg-type]
    return live_bench(feedback_of(feedback), settings, seed, session)  # type: ignore[arg-type]


def one(job: dict[str, object], seconds: float) -> dict[str, object]:
    """The figures of one run."""
    controller, regime = str(job["controller"]), str(job["regime"])
    settings = ControlSettings(controller=controller)  # type: ignore[arg-type]
    if controller == "none":
        settings = settings.model_copy(update={"safety": SafetySettings(limit_n=LIFTED_LIMIT_N)})
    named = str(job["preset"]), str(job["tissue"]), regime
    where = (*named, seconds, int(job["seed"]), int(job["session"]), str(job["feedback"]))  # type: ignore[call-overload]
    begun = time.process_time()
    run = run_control(
        feedback_of(str(job["feedback"])),  # type: ignore[arg-type]
        bench_of(*where),
        settings,
        job["drives"],  # type: ignore[arg-type]
        seconds=seconds,
    )
    about = {name: round(float(run.values[name]), 3) for name in ("contact_angle_deg", "wall_stiffness_n_per_m")}
    last = run.time_s > run.time_s[-1] - seconds
    wanted_n = np.array([tick.target_n for tick in run.ticks])[last]
    end = {
        "end_wanted_n": round(float(np.mean(wanted_n)), 4),
        "end_force_n": round(float(np.mean(run.true_n[last])), 4),
        "end_rms_n": round(float(np.sqrt(np.mean((run.true_n[last] - wanted_n) ** 2))), 4),
    }
    gain = {"gain_n_per_mm": run.ticks[-1].gain_n_per_mm, "heart_hz": run.ticks[-1].heart_hz}
    return {**job, **about, **gain, **end, **run.figures(seconds), "cpu_s": round(time.process_time() - begun, 1)}


def table(rows: list[dict[str, object]]) -> str:
    """Markdown: a line for each feedback, regime and controller."""
    lines = [
        "| tissue | feedback | contact | drives | controller | runs | RMS mN (worst) | 20 mN | peak N | none | again |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    names = ("tissue", "feedback", "regime", "drives", "controller")
    for key in dict.fromkeys(tuple(row[name] for name in names) for row in rows):
        own = [row for row in rows if tuple(row[name] for name in names) == key]
        held = [row for row in own if "rms_n" in row]
        if not held:
            lines.append(f"| {' | '.join(map(str, key))} | {len(own)} | never held | | | | |")
            continue
        rms = 1e3 * np.array([row["rms_n"] for row in held], float)
        within, peak, invalid, again = (
            np.array([row[name] for row in held], float)
            for name in ("within_20_mn", "peak_whole_run_n", "not_valid_share", "restarts")
        )
        count = str(len(own)) if len(held) == len(own) else f"{len(own)}, {len(own) - len(held)} never held"
        lines.append(
            f"| {' | '.join(map(str, key))} | {count} | {np.median(rms):.0f} ({rms.max():.0f}) | "
            f"{100 * np.median(within):.0f} % | {peak.max():.2f} | {100 * invalid.mean():.1f} % | {again.sum():.0f} |"
        )
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--feedback", nargs="+", default=["truth"])
    parser.add_argument("--regimes", nargs="+", default=list(REGIMES))
    parser.add_argument("--controllers", nargs="+", default=["periodic", "none", "pi"])
    parser.add_argument("--drives", help="for all regimes; else the advance, and with it the knob where it is oblique")
    parser.add_argument("--sessions", type=int, default=2)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--preset", default="bench-2021")
    parser.add_argument("--tissue", default="own", choices=("own", "stated", "varied"))
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("control.jsonl"))
    chosen = parser.parse_args()
    rows = [json.loads(line) for line in chosen.out.read_text().splitlines()] if chosen.out.exists() else []
    keys = ("preset", "tissue", "feedback", "regime", "drives", "controller", "seed", "session")
    done = {tuple(row[key] for key in keys) for row in rows}
    for session in range(chosen.first, chosen.first + chosen.sessions):
        for feedback in chosen.feedback:
            for regime in chosen.regimes:
                for controller in chosen.controllers:
                    values = (
                        chosen.preset,
                        chosen.tissue,
                        feedback,
                        regime,
                        chosen.drives or DRIVES[regime],
                        controller,
                    )
                    job = dict(zip(keys, (*values, chosen.seed, session), strict=True))
                    if tuple(job.values()) in done:
                        continue
                    row = one(job, chosen.seconds)
                    rows.append(row)
                    with chosen.out.open("a") as file:
                        file.write(json.dumps(row) + "\n")
                    print(json.dumps(row), flush=True)
    print(table(rows))


if __name__ == "__main__":
    main()
