"""Compares the quantities that `tipforce calibrate` finds on a simulated bench with the truth, session by session.

    python -m bench.studies.calibration RUNS [--sessions N] [--seconds] [--json FILE]

RUNS holds recordings of `tipforce simulate` with their truth beside them. Each is calibrated by itself, with the
stiffness stated to 10 %. Prints for each quantity the median and largest error, that of the stated value, and how many
errors are within one and two stated standard deviations. Sessions that FILE holds already are not done again.

With --seconds instead: the rod's error against the true force in the last 15 seconds of each session, in contact, after
calibration on a number of seconds from its beginning. The calibration does not use those 15 seconds, but they have the
same catheter and camera.
"""

import argparse
import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from tipforce.calibration import (
    CalibrationSession,
    calibrate_sessions,
    fit_rod,
    line_forces,
    read_session,
    scale_from_diameter,
)
from tipforce.simulation import Truth, read_truth

SECONDS = (0, 5, 10, 20, 40)
JUDGED_S, CONTACT_N = 15.0, 0.01
NAMES = {
    "clock offset": "ms",
    "sensor angle": "deg",
    "scale, by the shaft": "%",
    "bending stiffness": "%",
    "tissue stiffness": "%",
    "moving mass": "%",
    "knob gain": "%",
    "knob hysteresis": "deg",
    "pre-curvature": "1/m",
}


def truths(session: CalibrationSession, truth: Truth) -> dict[str, float]:
    """Returns the true values, in the units of the table."""
    values: Any = truth.values
    rotation = truth.sensor_from_base.rotation
    middle_s = 0.5 * float(session.stamp_ns[0] + session.stamp_ns[-1]) * 1e-9
    settings: Any = truth.settings
    actuation = settings["world"]["actuation"]
    return {
        "clock offset": 1e3 * (truth.clock_offset_s + truth.clock_drift * middle_s),
        "sensor angle": math.degrees(math.atan2(rotation[0, 1], rotation[0, 0])),
        "scale, by the shaft": values["lens"]["scale_m_per_px"],
        "bending stiffness": values["stiffness_nm2"],
        "tissue stiffness": values["wall_stiffness_n_per_m"],
        "moving mass": settings["world"]["sensor"]["moving_mass_kg"],
        "knob gain": actuation["gain_per_m_deg"] * values["knob_factor"],
        "knob hysteresis": actuation["play_deg"],
        "pre-curvature": float(np.mean(truth.curvature_per_m)),
    }


def one(path: Path) -> dict[str, Any]:
    """Returns errors, standard deviations and errors of the stated values, by quantity."""
    session = read_session(path)
    found = calibrate_sessions([session])
    true = truths(session, read_truth(path))
    quantities = [*found.quantities, *filter(None, [scale_from_diameter([session])])]
    row: dict[str, Any] = {"session": path.stem, "frames": len(session.stamp_ns), "read": session.frames}
    for each in quantities:
        name = next((name for name in NAMES if each.name.startswith(name)), None)
        if name is None or not each.known:
            continue
        per = 100.0 / true[name] if NAMES[name] == "%" else 1.0
        row[name] = {
            "error": per * (each.value - true[name]),
            "std": per * each.std,
            "before": None if each.before is None else per * (each.before - true[name]),
            "written": each.written,
            "doubt": each.doubt,
        }
    errors = found.sessions[0].errors_n
    if len(errors):
        row["rod_mn"] = (1e3 * np.sqrt(np.nanmean(errors**2, axis=0))).tolist()
    return row


def after_seconds(path: Path) -> dict[str, Any]:
    """RMS error of the rod's force in mN, x and y, by the seconds of calibration."""
    session, truth = read_session(path), read_truth(path)
    end = float(session.seconds[-1]) - JUDGED_S
    true = truth.force_n[np.searchsorted(truth.stamp_ns, session.stamp_ns), :2]
    rows = np.flatnonzero((session.seconds > end) & (np.linalg.norm(true, axis=1) > CONTACT_N))
    rows = rows[np.unique(np.linspace(0, len(rows) - 1, 100).astype(np.int64))]
    lines = [session.lines[k] for k in rows.tolist()]
    gain = session.info.actuation.knob_gain_per_m_deg or 0.0
    row: dict[str, Any] = {"session": path.stem}
    for seconds in SECONDS:
        some = np.flatnonzero(np.isfinite(session.force_n).all(axis=1) & (session.seconds < min(seconds, end)))
        some = some[np.unique(np.linspace(0, len(some) - 1, 60).astype(np.int64))] if len(some) else some
        part = session.subset(some)
        fit = fit_rod(
            session.info, part.lines, session.scale_m_per_px, part.force_n, gain * part.knob_deg, past_n=part.past_n,
            rate_n_per_s=part.rate_n_per_s,
        )  # fmt: skip
        told = line_forces(session.info, lines, session.scale_m_per_px, gain * session.knob_deg[rows], fit)
        row[str(seconds)] = (1e3 * np.sqrt(np.nanmean((told - true[rows]) ** 2, axis=0))).tolist()
    return row


def show_seconds(rows: list[dict[str, Any]]) -> None:
    """A row for each number of seconds: medians over the sessions."""
    print("| seconds of calibration | x: median, worst RMS error, mN | y: median, worst |")
    print("|---|---|---|")
    for seconds in SECONDS:
        x, y = np.array([row[str(seconds)] for row in rows]).T
        print(f"| {seconds} | {np.median(x):.0f}, {x.max():.0f} | {np.median(y):.1f}, {y.max():.0f} |")
    print(f"{len(rows)} sessions")


def line(name: str, rows: list[dict[str, Any]]) -> str:
    """A row of the table: of all sessions that have a value, and of those whose value was good enough to be written."""
    cells = [row[name] for row in rows if name in row]
    if not cells:
        return f"| {name} | - | | | | |"
    error = np.abs([cell["error"] for cell in cells])
    std = np.array([cell["std"] for cell in cells], np.float64)
    known = np.isfinite(std)
    within = [int((error[known] <= k * std[known]).sum()) for k in (1, 2)]
    before = [abs(cell["before"]) for cell in cells if cell["before"] is not None]
    good = np.abs([cell["error"] for cell in cells if cell["written"]])
    stated = f"{np.median(before):.2g}, {max(before):.2g}" if before else "-"
    kept = f"{len(good)}: {np.median(good):.2g}, {good.max():.2g}" if len(good) else "-"
    return (
        f"| {name}, {NAMES[name]} | {len(cells)}: {np.median(error):.2g}, {error.max():.2g} | {kept} | {stated} | "
        f"{np.median(std[known]) if known.any() else math.nan:.2g} | {within[0]}, {within[1]} of {int(known.sum())} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m bench.studies.calibration", description=__doc__)
    parser.add_argument("runs", type=Path)
    parser.add_argument("--sessions", type=int, default=20)
    parser.add_argument("--seconds", action="store_true")
    parser.add_argument("--json", type=Path, default=Path("build/calibration.json"))
    chosen = parser.parse_args()
    chosen.json.parent.mkdir(parents=True, exist_ok=True)
    rows: list[dict[str, Any]] = json.loads(chosen.json.read_text()) if chosen.json.is_file() else []
    done = {row["session"] for row in rows}
    for path in sorted(chosen.runs.glob("*.mcap"))[: chosen.sessions]:
        if path.stem in done:
            continue
        rows.append(after_seconds(path) if chosen.seconds else one(path))
        chosen.json.write_text(json.dumps(rows, indent=1))
        print(rows[-1], flush=True)
    if chosen.seconds:
        show_seconds(rows)
        return
    print(
        "| quantity | all: median, largest error | written: median, largest | as stated | stated sd | within 1, 2 sd |"
    )
    print("|---|---|---|---|---|---|")
    for name in NAMES:
        print(line(name, rows))
    lost = [row["session"] for row in rows if row["frames"] < 0.9 * row["read"]]
    print(
        f"{len(rows)} sessions; the catheter is lost in more than 10 % of the frames of {len(lost)}: {', '.join(lost)}"
    )


if __name__ == "__main__":
    main()
