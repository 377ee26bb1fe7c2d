"""Measures the error of the clock map between camera and force log (offset, rate) on the simulated bench.

    python -m bench.studies.clock_map FOLDER [--sessions 40] [--seed 3131] [--json FILE]

Sessions of 30 to 60 s of `bench-2021` are simulated, the catheter is detected in each image once, and the detections
are kept in FOLDER. Then the clocks get errors: offsets within +-2 s, rates within +-25 % (every fifth session: equal
rates), in four cases that take turns: with the stage's log, where the video's frame rate is wrong; with it, where the
log's clock is; without it, where the sensor is at rest; without it, where 50 g move with the sensor.
"""

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

from tipforce.alignment import (
    ClockChoice,
    DetectedShapes,
    ForceCorrections,
    StageMotion,
    find_clock,
    find_tare_and_inertia,
)
from tipforce.pipelines import preset_settings
from tipforce.simulation import SimulatedBench
from tipforce.types import BasePose, Catheter, CentrelinePx, FloatArray, SensorInfo, SessionInfo, Status, ViewInfo
from tipforce.vision import DetectedShape, ShapeDetector, VisionSettings, auto_calibrate

SECONDS = (30.0, 40.0, 50.0, 60.0)
CASES = ("stage, video wrong", "stage, log wrong", "no stage, sensor still", "no stage, 50 g move")
MAX_OFFSET_S, MAX_RATE_ERROR = 2.0, 0.25
POINTS = 64
START_NS = 10_000_000_000


def collect(path: Path, seed: int, number: int) -> None:
    """Simulates a session, detects the catheter in its images, and keeps the inputs of an import, with the truth."""
    bench = SimulatedBench(preset_settings("bench-2021", SECONDS[number % 4]), seed, number)
    info, kept = bench.session_info, bench.arrived("camera")
    spread = kept[np.linspace(0, len(kept) - 1, 16).astype(int)]
    images = [bench.frame(int(index)).image for index in spread]
    detector = ShapeDetector(auto_calibrate(VisionSettings(), images, info))
    points = np.full((len(kept), POINTS, 2), np.nan, np.float32)
    base, diameter = np.full((len(kept), 3), np.nan), np.full(len(kept), np.nan)
    even = np.linspace(0.0, 1.0, POINTS)
    for row, index in enumerate(kept.tolist()):
        shape = detector.detect(bench.frame(index).image)
        if shape.centreline is None or shape.base is None:
            continue
        line = shape.centreline.points
        points[row] = np.stack([np.interp(even, np.linspace(0.0, 1.0, len(line)), column) for column in line.T], 1)
        base[row] = *shape.base.origin_px, shape.base.angle_rad
        diameter[row] = shape.diameter_px
    log, (stage_ns, stage) = bench.log, bench.stage_log()
    trajectory = bench.trajectory
    moved = np.stack([np.interp(log.true_s, trajectory.time_s, a) for a in trajectory.acceleration_m_per_s2.T], axis=1)
    np.savez_compressed(
        path,
        stamp_ns=bench.stamp_ns[kept],
        points=points,
        base=base,
        diameter=diameter,
        force_true=bench.interpolator.at(trajectory.contact.force_n, bench.frame_s[kept]),
        log_ns=log.stamp_ns,
        log_n=log.force_n.astype(np.float32),
        carried=(bench.settings.world.sensor.moving_mass_kg * -moved @ log.rotation.T).astype(np.float32),
        angle=log.nominal_angle_deg,
        offset=log.offset_s,
        drift=log.drift,
        stage_ns=stage_ns,
        stage=np.stack(list(stage.values())),
        stage_names=list(stage),
        scale=info.view("camera").metres_per_px or 0.0,
        catheter=[info.catheter.flexible_length_m or 0.0, info.catheter.rigid_length_m or 0.0],
        no_contact=info.sensor.no_contact_s or (0.0, 0.0),
    )


def judge(path: Path, seed: int, number: int) -> dict[str, Any]:
    """Adds errors to the clocks of a session, finds their map as an import does, and compares it with the truth."""
    rng = np.random.default_rng([seed, number, 31])
    error = rng.uniform(-MAX_RATE_ERROR, MAX_RATE_ERROR) * (number % 5 != 4)
    added_s = rng.uniform(-MAX_OFFSET_S, MAX_OFFSET_S)
    case = CASES[number % 4]
    kept = np.load(path)
    info = _info(kept, moving=number % 4 != 2)
    frame_ns, log_ns, stage_ns = (kept[name].copy() for name in ("stamp_ns", "log_ns", "stage_ns"))
    video, log_rate = (1.0 + error, 1.0) if number % 4 != 1 else (1.0, 1.0 + error)
    frame_ns = np.rint(frame_ns * video).astype(np.int64) + START_NS
    log_ns = np.rint(log_ns * log_rate).astype(np.int64) + START_NS + round(added_s * 1e9)
    force = kept["log_n"].astype(np.float64) - (kept["carried"] if number % 4 == 2 else 0.0)
    stage = StageMotion.of([])
    if number % 4 < 2:
        stage = StageMotion(stage_ns + START_NS, dict(zip(kept["stage_names"].tolist(), kept["stage"], strict=True)))
    remarks: list[str] = []
    stretch = tuple(log_rate * kept["no_contact"])
    mass_kg = info.sensor.moving_mass_kg
    tare, inertia = find_tare_and_inertia(log_ns, force, stage, (stretch[0], stretch[1]), remarks, mass_kg)
    facts = ForceCorrections(info.sensor, tare, inertia, stage)
    detections = DetectedShapes(frame_ns, _shapes(kept))
    clock, inertia = find_clock(detections, info, log_ns, force, facts, ClockChoice(), remarks)
    row: dict[str, Any] = {"session": number, "case": case, "seconds": SECONDS[number % 4], "how": clock.how}
    true_rate = video * (1.0 + float(kept["drift"])) / log_rate
    row |= {"true_rate": true_rate, "added_ms": 1e3 * added_s}
    if clock.how == "refused":
        return row | {"detail": clock.detail}
    facts = ForceCorrections(info.sensor, tare, inertia, stage)
    own_s = 1e-9 * float(clock.reference_ns - log_ns[0]) / log_rate  # since the log's start, on its true clock
    true_s = video * (own_s * (1.0 + float(kept["drift"])) + float(kept["offset"]))
    found_s = 1e-9 * float(clock.reference_ns + clock.offset_ns - START_NS)
    truth = kept["force_true"]
    when = ((frame_ns - START_NS) / video * 1e-9 - float(kept["offset"])) / (1.0 + float(kept["drift"]))
    true_when = np.rint(when * log_rate * 1e9).astype(np.int64) + log_ns[0]
    labelled = _labels(clock.force_ns(frame_ns), log_ns, force, facts)
    ideal = _labels(true_when, log_ns, force, facts)
    return row | {
        "offset_error_ms": 1e3 * (found_s - true_s),
        "offset_stderr_ms": clock.stderr_ms,
        "rate_error": clock.rate - true_rate,
        "rate_stderr": clock.rate_stderr,
        "explained": clock.explained,
        "label_rms_mn": 1e3 * _rms(labelled - truth),
        "label_rms_true_clock_mn": 1e3 * _rms(ideal - truth),
        "label_rms_by_clock_mn": 1e3 * _rms(labelled - ideal),
        "detail": clock.detail,
    }


def _info(kept: Any, *, moving: bool) -> SessionInfo:
    flexible, rigid = kept["catheter"].tolist()
    return SessionInfo(
        catheter=Catheter(flexible_length_m=flexible, rigid_length_m=rigid),
        views={"camera": ViewInfo(metres_per_px=float(kept["scale"]))},
        sensor=SensorInfo(float(kept["angle"]), "tip-on-tissue", moving_mass_kg=0.05 if moving else None),
    )


def _shapes(kept: Any) -> list[DetectedShape]:
    shapes: list[DetectedShape] = []
    for line, (u, v, angle), diameter in zip(
        kept["points"].astype(np.float64), kept["base"], kept["diameter"], strict=True
    ):
        if np.isnan(diameter):
            shapes.append(DetectedShape(Status.NO_CATHETER))
            continue
        base = BasePose(np.array([u, v]), float(angle))
        shapes.append(
            DetectedShape(Status.VALID, centreline=CentrelinePx(line), base=base, diameter_px=float(diameter))
        )
    return shapes


def _labels(when_ns: Any, log_ns: Any, force: FloatArray, facts: ForceCorrections) -> FloatArray:
    """(n, 3): as `tipforce.alignment.labels` makes them, at ``when_ns`` (n,) on the log's clock; NaN outside of it."""
    assert facts.sensor is not None
    base = (force - facts.tare.force_n - facts.carried(log_ns)) @ facts.sensor.matrix.T
    return np.stack([np.interp(when_ns, log_ns, column, np.nan, np.nan) for column in base.T], axis=1)


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.nanmean(values**2)))


def summarise(rows: list[dict[str, Any]]) -> list[str]:
    """Returns lines by case and for all: shares refused and covered by two standard errors, and the labels' errors."""
    lines: list[str] = []
    for case in (*CASES, "all"):
        own = [row for row in rows if case in (row["case"], "all")]
        taken = [row for row in own if row["how"] != "refused"]
        if not taken:
            lines.append(f"{case}: {len(own)} of {len(own)} refused")
            continue
        offset = np.array([abs(row["offset_error_ms"]) <= 2.0 * row["offset_stderr_ms"] for row in taken])
        rate = np.array([not abs(row["rate_error"]) > 2.0 * row["rate_stderr"] for row in taken])
        labels = np.array([row["label_rms_mn"] for row in taken])
        clock = np.array([row["label_rms_by_clock_mn"] for row in taken])
        lines.append(
            f"{case}: {len(own) - len(taken)} of {len(own)} refused; within two standard errors: offset "
            f"{offset.sum()}, rate {rate.sum()}, both {(offset & rate).sum()} of {len(taken)}; labels rms median "
            f"{np.median(labels):.1f}, worst {labels.max():.1f} mN; of the clock alone worst {clock.max():.1f} mN"
        )
    return lines


def main() -> None:
    """Reads the command line, simulates missing sessions, and prints a line for each session and the summary."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--sessions", type=int, default=40)
    parser.add_argument("--seed", type=int, default=3131)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    rows: list[dict[str, Any]] = []
    for number in range(options.sessions):
        path = options.folder / f"s{options.seed}_{number:02d}.npz"
        if not path.exists():
            collect(path, options.seed, number)
        rows.append(judge(path, options.seed, number))
        shown = {key: round(value, 6) if isinstance(value, float) else value for key, value in rows[-1].items()}
        print(json.dumps(shown), flush=True)
        if options.json:
            options.json.write_text(json.dumps(rows, indent=2) + "\n", encoding="utf-8")
    print("\n".join(summarise(rows)))


if __name__ == "__main__":
    main()
