"""Errors and intervals of `rod-3d` on simulated recordings, against their ground truth, by force and by angle.

    .venv/bin/python -m bench.studies.space_sessions RECORDING... --method rod-3d --json FILE
    .venv/bin/python -m bench.studies.space_sessions RECORDING... --lose b --from-s 7

Each recording goes through the method as `tipforce estimate` does it. ``--lose`` leaves a view out from a time on.
Lateral is the error across the tip's axis in the plane of the first view, axial that along it. A frame is in contact
from 10 mN on; "wrong": the magnitude is off by more than 50 mN. The estimates of each recording are kept in the JSON
file as soon as they are done, and a recording in that file is not read again.
"""

import argparse
import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from tipforce.alignment import observations
from tipforce.estimators import create
from tipforce.io import images_beforehand, open_source
from tipforce.simulation import read_truth, truth_path
from tipforce.types import FloatArray, views_of

CONTACT_N, WRONG_N, HIGH_N = 0.01, 0.05, 0.3
LIMITS_N = (0.3, 0.2, 0.1, 0.05)
"""Values of `max_error_n`."""
FORCES_N = (0.01, 0.05, 0.15, 0.3, 2.0)
ANGLES_DEG = (0.0, 20.0, 40.0, 60.0, 180.0)
COLUMNS = "true (3), estimate (3), low and high of fx, fy, fz, |F| (8), tip's axis (3), number of views"


def rows_of(path: Path, method: str, lose: str, from_s: float) -> list[list[float]]:
    """Estimates one recording; each row has `COLUMNS`, with NaN where there is no estimate."""
    with open_source(path) as source:
        estimator = create(method).for_views(views_of(source))
        images = {view: images_beforehand(source, view) for view in estimator.views}
        seen = list(observations(source, estimator.views, apart=not estimator.needs_all_views))
        info = source.session_info
    truth = read_truth(truth_path(path))
    stream = estimator.start_on(info, images)
    rows: list[list[float]] = []
    for each in seen:
        if lose and each.stamp_ns - seen[0].stamp_ns >= from_s * 1e9:
            each = replace(each, views={view: image for view, image in each.views.items() if view != lose})
        found = stream.update(each)
        place = int(np.argmin(np.abs(truth.stamp_ns - each.stamp_ns)))
        axis = truth.centreline_m[place, -1] - truth.centreline_m[place, -3]
        ends = np.vstack([found.interval_n, found.magnitude_interval_n])
        views = 1.0 if "alone" in found.detail else float(len(estimator.views))
        row = [*truth.force_n[place], *found.force_n, *ends[:, 0], *ends[:, 1], *axis / np.linalg.norm(axis), views]
        rows.append([float(value) for value in row])
    return rows


def line(title: str, rows: FloatArray) -> str:
    """Returns one line of the table."""
    true, found = rows[:, :3], rows[:, 3:6]
    size, estimate = np.linalg.norm(true, axis=1), np.linalg.norm(found, axis=1)
    answered, touching = np.isfinite(estimate), size > CONTACT_N
    use = answered & touching
    if not use.any():
        return f"{title:>16}: no answer in contact"
    axis, error = rows[:, 14:17], found - true
    across = np.column_stack([-axis[:, 1], axis[:, 0], np.zeros(len(axis))])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    values, low, high = np.column_stack([true, size]), rows[:, 6:10], rows[:, 10:14]
    held = 100.0 * ((low <= values) & (values <= high))[use].mean(axis=0)
    off = np.abs(estimate - size)
    errors = [np.abs((error * across).sum(axis=1)), np.abs(error[:, 2]), np.abs((error * axis).sum(axis=1)), off]
    lateral, fz, axial, magnitude = (1e3 * float(each[use].mean()) for each in errors)
    width = 1e3 * (high - low)[use].mean(axis=0)
    return (
        f"{title:>16}: {use.sum():5d} in contact, answered {100.0 * answered[touching].mean():.0f} % | MAE lateral "
        f"{lateral:.1f} fz {fz:.1f} axial {axial:.1f} |F| {magnitude:.1f} mN | held fx {held[0]:.0f} fy {held[1]:.0f} "
        f"fz {held[2]:.0f} |F| {held[3]:.0f} % | width fz {width[2]:.0f} |F| {width[3]:.0f} mN | wrong in contact "
        f"{100.0 * (off[use] > WRONG_N).mean():.1f} all {100.0 * (off[answered] > WRONG_N).mean():.1f} %"
    )


def table(rows: FloatArray) -> list[str]:
    """Returns the lines of the table: all, by number of views, by force, by angle, by the limit of the interval."""
    size = np.linalg.norm(rows[:, :3], axis=1)
    cosine = -(rows[:, :3] * rows[:, 14:17]).sum(axis=1) / np.maximum(size, 1e-9)
    angle = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
    parts = [("all", np.ones(len(rows), np.bool_)), ("1 view", rows[:, 17] == 1), ("2 views", rows[:, 17] == 2)]
    for values, edges, unit in ((size, FORCES_N, "N"), (angle, ANGLES_DEG, "deg")):
        for low, high in pairwise(edges):
            parts.append((f"{low:g} to {high:g} {unit}", (values >= low) & (values < high) & (size > CONTACT_N)))
    return [*(line(title, rows[part]) for title, part in parts if part.any()), *_limits(rows, size)]


def _limits(rows: FloatArray, size: FloatArray) -> list[str]:
    """Returns the effect of `max_error_n` on the answers, and the upper ends of free tips; ``size`` (n,): true, N."""
    found = np.linalg.norm(rows[:, 3:6], axis=1)
    reach, off = np.maximum(rows[:, 13] - found, found - rows[:, 9]), np.abs(found - size)
    lines: list[str] = []
    for limit in (np.inf, *LIMITS_N):
        for title, use in (("in contact", size > CONTACT_N), ("all", np.ones(len(size), np.bool_))):
            kept = use & np.isfinite(found) & (reach <= limit)
            if kept.any():
                lines.append(
                    f"max_error_n {limit:g}, {title}: answered {100.0 * kept.sum() / use.sum():.1f} %, wrong "
                    f"{100.0 * (off[kept] > WRONG_N).mean():.1f} %, |F| MAE {1e3 * off[kept].mean():.1f} mN, RMS "
                    f"{1e3 * np.sqrt((off[kept] ** 2).mean()):.1f} mN"
                )
    free = np.isfinite(found) & (size <= CONTACT_N)
    if free.any():
        lines.append(f"free tip: upper end above {HIGH_N:g} N in {100.0 * (rows[free, 13] > HIGH_N).mean():.1f} %")
    return lines


def main() -> None:
    """Estimates the recordings and prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recordings", nargs="+", type=Path)
    parser.add_argument("--method", default="rod-3d")
    parser.add_argument("--lose", default="", help="view that is lost")
    parser.add_argument("--from-s", type=float, default=0.0, help="time from which it is lost")
    parser.add_argument("--json", type=Path, help="file of the estimates")
    options = parser.parse_args()
    kept: dict[str, Any] = {}
    if options.json and options.json.exists():
        kept = json.loads(options.json.read_text())
    for path in options.recordings:
        if str(path) not in kept:
            kept[str(path)] = rows_of(path, options.method, options.lose, options.from_s)
            if options.json:
                options.json.write_text(json.dumps(kept))
        print(line(path.parent.name[-8:] + path.stem[-3:], np.array(kept[str(path)])), flush=True)
    print("\n".join(table(np.concatenate([np.array(kept[str(path)]) for path in options.recordings]))))


if __name__ == "__main__":
    main()
