"""Distributions of the sessions of a preset: forces, contact, angles, stick and slip, impossible parameters.

    OMP_NUM_THREADS=1 .venv/bin/python -m bench.studies.simulation_distributions --sessions 80 --out DIR

Only the world is run, no image is drawn. Writes ``distributions.json`` and ``distributions.svg``.
"""

import argparse
import json
import os
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from tipforce.simulation import PRESETS
from tipforce.simulation.world import run_session


def force_edges_n(preset: str) -> np.ndarray:
    """Twenty bins up to just above the preset's largest peak; 20 mN wide for the standard protocol's presets."""
    most = 0.4 * PRESETS[preset].world.motion.peak_force_n[1] / 0.35
    return np.linspace(0.0, round(most, 3), 21)


def one(preset: str, seed: int, number: int) -> dict[str, Any]:
    """The figures of one session, at the camera's rate."""
    settings = PRESETS[preset].world
    session = run_session(settings, seed, number)
    trajectory, bench_model = session.trajectory, session.bench_model
    contact = trajectory.contact
    rows = np.flatnonzero(trajectory.time_s >= settings.tare_s + 1.5)[:: round(1000 / settings.clock.fps)]
    size = np.linalg.norm(contact.force_n[rows], axis=1)
    touching = contact.touching[rows]
    axis = contact.tip_axes(rows)[touching]
    angle = np.degrees(np.arccos(np.clip(axis @ bench_model.wall.normal, -1.0, 1.0)))
    force = contact.force_n[rows][touching]
    axial = np.abs(np.sum(force * axis, axis=1)) / np.linalg.norm(force, axis=1)
    line = contact.nodes_m()[rows]
    return {
        "number": number,
        "force_n": size[touching].tolist(),
        "contact_angle_deg": angle.tolist(),
        "axial_share": axial.tolist(),
        "free_share": float(1 - touching.mean()),
        "slip_share": float(contact.slipping[rows][touching].mean()),
        "peak_n": float(np.linalg.norm(contact.force_n, axis=1).max()),
        "amplitude_m": session.motion.amplitude_m,
        "drawn_angle_deg": bench_model.parameters.contact_angle_deg,
        "wave": bench_model.parameters.wave,
        "tip_way_m": float(np.linalg.norm(np.ptp(line[:, -1], axis=0))),
        "unstable": int((~contact.stable).sum()),
        "redraws": session.redraws,
    }


def spread(values: Any) -> dict[str, float]:
    """Quartiles and range."""
    low, first, middle, third, high = np.quantile(values, [0, 0.25, 0.5, 0.75, 1]).tolist()
    return {"min": low, "25 %": first, "median": middle, "75 %": third, "max": high}


def parameters(rows: list[dict[str, Any]], preset: str, path: Path) -> None:
    """Draws histograms of the main quantities."""
    together = {key: np.concatenate([row[key] for row in rows]) for key in ("force_n", "contact_angle_deg")}
    panels = [
        (together["force_n"], force_edges_n(preset), "force in contact, N", "frames"),
        (together["contact_angle_deg"], np.arange(0, 91, 5), "angle between tip and wall's normal, degrees", "frames"),
        ([100 * row["free_share"] for row in rows], np.arange(4, 22, 1), "time without contact, %", "sessions"),
        ([100 * row["slip_share"] for row in rows], np.arange(0, 101, 5), "of contact: slipping, %", "sessions"),
        ([1e3 * row["amplitude_m"] for row in rows], np.arange(0, 10.5, 0.5), "amplitude of the stage, mm", "sessions"),
        ([row["drawn_angle_deg"] for row in rows], np.arange(-80, 81, 5), "contact angle drawn, degrees", "sessions"),
    ]
    figure, axes = plt.subplots(2, 3, figsize=(12, 6.5), layout="constrained")
    for place, (values, edges, what, count) in zip(axes.ravel(), panels, strict=True):
        place.hist(values, bins=edges, color="#34607f")
        place.set(xlabel=what, ylabel=count)
    figure.suptitle(f"{preset}: {len(rows)} sessions")
    figure.savefig(path)


def main() -> None:
    """Runs the sessions, prints and writes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--preset", default="bench-2021", choices=list(PRESETS))
    parser.add_argument("--sessions", type=int, default=80)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        rows = list(pool.map(partial(one, options.preset, options.seed), range(options.sessions)))
    force = np.concatenate([row["force_n"] for row in rows])
    redraws: Counter[str] = Counter()
    for row in rows:
        redraws.update(row["redraws"])
    figures = {
        "preset": options.preset,
        "seed": options.seed,
        "sessions": len(rows),
        "force_n": spread(force),
        "force_histogram": np.histogram(force, force_edges_n(options.preset))[0].tolist(),
        "force_std_n": float(force.std()),
        "peak_n": spread([row["peak_n"] for row in rows]),
        "free_share": spread([row["free_share"] for row in rows]),
        "slip_share": spread([row["slip_share"] for row in rows]),
        "drawn_angle_deg": spread([abs(row["drawn_angle_deg"]) for row in rows]),
        "contact_angle_deg": spread(np.concatenate([row["contact_angle_deg"] for row in rows])),
        "axial_share": spread(np.concatenate([row["axial_share"] for row in rows])),
        "amplitude_m": spread([row["amplitude_m"] for row in rows]),
        "tip_way_m": spread([row["tip_way_m"] for row in rows]),
        "half_waves": sum(row["wave"] != "sine" for row in rows),
        "sessions_with_unstable_instants": sum(row["unstable"] > 0 for row in rows),
        "redraws": dict(redraws),
        "sessions_redrawn": sum(bool(row["redraws"]) for row in rows),
    }
    (options.out / "distributions.json").write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    parameters(rows, options.preset, options.out / "distributions.svg")
    print(json.dumps(figures, indent=2))


if __name__ == "__main__":
    main()
