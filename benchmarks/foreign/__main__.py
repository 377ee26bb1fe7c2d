"""``python -m benchmarks.foreign``: makes the sessions, judges models on them, checks the engine against theory."""

import argparse
import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np

from tipforce.io import atomic_text, replacing_folder, save_image
from tipforce.types import read_bench

__all__ = ["main"]

SESSIONS = 20
SECONDS = 4.2
SAMPLES = 4
"""Number of light paths for each pixel: their noise is like that of a camera in a dim room."""
GREY_SHARE = 0.35
FULL_AT = 0.98
"""The share of the first frame's pixels that the exposure leaves below full."""


def generate(output: Path, seeds: range, seconds: float, samples: int, variant: str | None) -> None:
    """Makes the sessions that are not there yet, and their recordings, whose clocks differ."""
    from .scene import use_mitsuba

    mitsuba = None
    for seed in seeds:
        folder = output / f"session_{seed:02d}"
        if not folder.exists():
            mitsuba = mitsuba or use_mitsuba(variant)
            with replacing_folder(folder) as part:
                _make_session(mitsuba, seed, part, output / f"{folder.name}.truth.npz", seconds, samples)
        _import(folder, output / f"{folder.name}.mcap", "--offset-ms", "none")


def mark(data: Path, output: Path) -> None:
    """Imports the sessions of ``data`` once more, as a person helps: base marked in the first frame, clocks known.

    The sessions are too short to find the clocks on them: their offset is stated, as a trigger line measures it.
    """
    output.mkdir(parents=True, exist_ok=True)
    for truth in sorted(data.glob("session_*.truth.npz")):
        folder = data / truth.name.removesuffix(".truth.npz")
        info = read_bench(folder / "bench.toml").view("camera")
        with np.load(truth) as found:
            base, plan = found["line_px"][0, 0], json.loads(str(found["plan"]))
        wide = 2.33e-3 / (info.metres_per_px or 2e-4)
        along = {"left": (1, 0), "right": (-1, 0), "top": (0, 1), "bottom": (0, -1)}[info.base_side or "left"]
        near, far = base + 2.0 * np.array(along), base + 3.0 * wide * np.array(along)
        aside = 2.5 * wide * np.abs(along[::-1])
        corners = np.round([np.minimum(near, far) - aside, np.maximum(near, far) + aside]).astype(int)
        shutil.copy2(truth, output / truth.name)
        region = f"views.camera.base_region={corners.ravel().tolist()}"
        offset_ms = f"{1e3 * plan['clock_offset_s']:.1f}"
        _import(folder, output / f"{folder.name}.mcap", "--fact", region, f"--offset-ms={offset_ms}")


def _import(folder: Path, recording: Path, *options: str) -> None:
    """``tipforce import`` of a session's files, as a laboratory does it; kept where it is there already.

    The stage's log stays out: nothing that moves with the sensor has a mass here.
    """
    if recording.exists():
        return
    logs = [str(folder / name) for name in ("force.csv", "knob.csv") if (folder / name).exists()]
    command = [sys.executable, "-m", "tipforce", "import", str(folder / "frames"), *logs]
    command += ["--bench", str(folder / "bench.toml"), "-o", str(recording), *options]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    said = [line for line in (done.stdout + done.stderr).splitlines() if "clock offset" in line or done.returncode]
    print(f"{recording.name}: {said[-1] if said else 'imported'}", flush=True)


def _make_session(mitsuba: object, seed: int, folder: Path, truth: Path, seconds: float, samples: int) -> None:
    from .camera import draw_camera, expose
    from .scene import Scene
    from .session import draw_plan, frame_stamps, simulate, write_bench, write_logs, write_truth

    plan = draw_plan(seed)
    run = simulate(plan, seconds)
    camera = draw_camera(plan, run)
    scene = Scene(mitsuba, plan, run, camera)
    rng = np.random.default_rng((seed, 6))
    grey, noise = bool(rng.uniform() < GREY_SHARE), rng.uniform(0.004, 0.015)
    lines, walls, dents = (run.at_frames(name) for name in ("line_m", "wall_m", "dent_m"))
    gain, rows = 0.0, list[str]()
    for index, stamp in enumerate(frame_stamps(run).tolist()):
        light = scene.render(lines[index], walls[index], float(dents[index]), index, samples)
        if index == 0:
            gain = rng.uniform(0.75, 1.0) / float(np.quantile(light, FULL_AT))
        name = f"{index:04d}.png"
        save_image(folder / "frames" / name, expose(light, gain, noise, grey, rng))
        rows.append(f"{name},{stamp}\n")
        print(f"\r{folder.name.split('.')[0]}: frame {index + 1} of {len(lines)}", end="", flush=True)
    print(flush=True)
    with atomic_text(folder / "frames" / "stamps.csv") as out:
        out.write("file_name,stamp_ns\n" + "".join(rows))
    write_logs(plan, run, folder)
    write_bench(plan, folder, camera.metres_per_px * (1 + rng.uniform(-0.02, 0.02)), camera.base_side)
    write_truth(plan, run, camera.project(1e3 * lines), truth)


def main() -> None:
    """Parses the command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.foreign", description=__doc__)
    verbs = parser.add_subparsers(dest="verb", required=True)
    made = verbs.add_parser("generate", help="make sessions; those that are there already are kept")
    made.add_argument("-o", "--output", type=Path, required=True)
    made.add_argument("--sessions", type=int, default=SESSIONS)
    made.add_argument("--first", type=int, default=0, help="seed of the first session")
    made.add_argument("--seconds", type=float, default=SECONDS, help="length of a session")
    made.add_argument("--samples", type=int, default=SAMPLES, help="light paths a pixel")
    made.add_argument("--variant", help="of Mitsuba, such as scalar_rgb; by default the fastest that works")
    marked = verbs.add_parser("mark", help="import the sessions once more, the base marked")
    marked.add_argument("--data", type=Path, required=True)
    marked.add_argument("-o", "--output", type=Path, required=True)
    judged = verbs.add_parser("judge", help="errors of models on the sessions")
    judged.add_argument(
        "models", nargs="+", help="model folders, pretrained/NAME, or svr:half to train on every other session"
    )
    judged.add_argument("--data", type=Path, required=True)
    judged.add_argument("--json", type=Path, help="where the figures go too")
    checked = verbs.add_parser("check", help="MuJoCo's cable and contact against theory")
    checked.add_argument("-o", "--output", type=Path, help="folder for a drawing of it")
    sheet = verbs.add_parser("sheet", help="one image of each session in one picture")
    sheet.add_argument("--data", type=Path, required=True)
    sheet.add_argument("-o", "--output", type=Path, required=True)
    chosen = parser.parse_args()
    if chosen.verb == "generate":
        seeds = range(chosen.first, chosen.first + chosen.sessions)
        generate(chosen.output, seeds, chosen.seconds, chosen.samples, chosen.variant)
    elif chosen.verb == "mark":
        mark(chosen.data, chosen.output)
    elif chosen.verb == "judge":
        from .judge import judge

        judge(chosen.models, chosen.data, chosen.json)
    elif chosen.verb == "check":
        from .check import check

        check(chosen.output)
    else:
        from .judge import draw_sheet

        draw_sheet(chosen.data, chosen.output)


if __name__ == "__main__":
    main()
