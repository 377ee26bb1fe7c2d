"""How well the offset between force log and camera is found in recordings of the simulated bench, over +-80 ms.

    python -m bench.clock_offset RUNS [--truth FOLDER] [--stored] [--json FILE]

RUNS holds recordings: what `tipforce simulate` wrote, or what was imported from its files; then --truth names the
folder that the files lie in. Each session's images are detected once. Then the whole of it, its first and its last 20
seconds are each aligned with the force log, shifted so that the true offset takes three values. With --stored only
what the recordings say is held against the truth.
"""

import argparse
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tipforce.alignment import StageMotion, estimate_offset, shape_coordinates
from tipforce.io import RecordingReader, spread_images
from tipforce.simulation import Truth, read_truth
from tipforce.types import FloatArray, Frame, IntArray
from tipforce.vision import ShapeDetector, VisionSettings, auto_calibrate

OFFSETS_MS = (-80, 0, 80)
CUT_S = 20.0
TARGET_MS = 3.0


@dataclass(frozen=True)
class Session:
    """What the estimate is made from: frames' stamps and shape coordinates; force after tare and inertia."""

    name: str
    frame_ns: IntArray
    shape: FloatArray
    force_ns: IntArray
    force_n: FloatArray
    truth: Truth


def load(path: Path, truth: Truth) -> Session:
    """Detect the catheter in all images of a recording, and read its force as an import does."""
    with RecordingReader(path) as reader:
        vision = ShapeDetector(auto_calibrate(VisionSettings(), spread_images(reader), reader.session_info))
        seen = [vision.detect(event.image) for event in reader.events("camera") if isinstance(event, Frame)]
        stamps, force, _ = reader.wrenches()
        info, catheter = reader.info, reader.session_info.catheter
        carried = (
            StageMotion.of(reader.stage_readings()).acceleration(stamps + info.inertia.lag_ns, info.inertia.axes)
            @ info.inertia.gain_kg
        )
        assert info.sensor is not None
        tared = np.nan_to_num(force - info.tare.force_n - carried) @ info.sensor.matrix.T
        flexible, rigid = catheter.flexible_length_m or 1.0, catheter.rigid_length_m or 0.0
        length_px = (flexible + rigid) / (reader.session_info.view("camera").metres_per_px or 1.0)
        shape = shape_coordinates(seen, flexible_share=flexible / (flexible + rigid), length_px=length_px)
        return Session(path.stem, reader.stamps(), shape, stamps, tared, truth)


def errors_of(session: Session) -> dict[str, list[tuple[float, float, str]]]:
    """By part of the session, for each of `OFFSETS_MS`: error and stated standard error in ms, why it was refused."""
    seconds, end = session.frame_ns * 1e-9, float(session.frame_ns[-1]) * 1e-9
    parts = {"whole": (0.0, end), "first 20 s": (0.0, CUT_S), "last 20 s": (end - CUT_S, end)}
    found: dict[str, list[tuple[float, float, str]]] = {}
    for name, (start, stop) in parts.items():
        frames = (seconds >= start) & (seconds <= stop)
        own = (session.force_ns * 1e-9 >= start - 0.5) & (session.force_ns * 1e-9 <= stop + 0.5)
        stamps = session.force_ns[own]
        middle_s = 0.5e-9 * float(stamps[0] + stamps[-1])
        true_ms = 1e3 * (session.truth.clock_offset_s + session.truth.clock_drift * middle_s)
        found[name] = []
        for offset_ms in OFFSETS_MS:
            shifted = stamps + round(1e6 * (true_ms - offset_ms))
            answer = estimate_offset(session.frame_ns[frames], session.shape[frames], shifted, session.force_n[own])
            error = answer.offset_ms - offset_ms if answer.how == "estimated" else float("nan")
            found[name].append((error, answer.stderr_ms, answer.detail))
    return found


def stored(paths: list[Path], truths: Path) -> None:
    """What was found when the sessions were recorded, against the truth: by how it was found."""
    errors: dict[str, list[float]] = {}
    for path in paths:
        with RecordingReader(path) as reader:
            found = reader.info.clock_offset
        error = found.offset_ms - 1e3 * read_truth(truths / path.name).clock_offset_s
        errors.setdefault(found.how, []).append(error)
        print(f"{path.stem} {found.how} {error:+.2f} ms (stated {found.stderr_ms:.1f})")
    for how, values in errors.items():
        print(f"{how}: {summary(np.array(values))}")


def summary(errors: np.ndarray) -> str:
    """Number, mean, scatter, worst of errors (n,) in ms."""
    return (
        f"{len(errors)}: mean {errors.mean():+.2f}, rms {np.sqrt((errors**2).mean()):.2f}, "
        f"worst {np.abs(errors).max():.2f} ms, {np.sum(np.abs(errors) <= TARGET_MS)} within {TARGET_MS:g} ms"
    )


def main() -> None:
    """Read the command line, print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path)
    parser.add_argument("--truth", type=Path)
    parser.add_argument("--stored", action="store_true", help="what the recordings say")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    paths = sorted(options.runs.glob("*.mcap"))
    if not paths:
        parser.error(f"{options.runs}: no recording; write some with `tipforce simulate`")
    if options.stored:
        stored(paths, options.truth or options.runs)
        return
    print("error in ms of the offset found (stated standard error), for true offsets of -80, 0 and 80 ms")
    every: dict[str, list[float]] = {}
    rows = []
    for path in paths:
        session = load(path, read_truth((options.truth or options.runs) / path.name))
        seen = 100.0 * np.isfinite(session.shape).all(axis=1).mean()
        for part, cells in errors_of(session).items():
            every.setdefault(part, []).extend(error for error, _, _ in cells)
            rows.append({"session": path.stem, "part": part, "errors_ms": [None if e != e else e for e, _, _ in cells]})
            cell = "  ".join(f"{error:+6.2f} ({stderr:3.1f})" for error, stderr, _ in cells)
            print(f"{path.stem} {part:<10}  {cell}  seen {seen:.0f} %  {cells[1][2]}", flush=True)
    for part, values in every.items():
        found = np.array(values)
        known = found[~np.isnan(found)]
        print(f"{part}: {np.isnan(found).sum()} of {len(found)} refused; of the rest {summary(known)}")
    if options.json:
        options.json.write_text(json.dumps(rows, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
