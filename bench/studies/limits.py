"""Smallest possible error of the force: the posterior Cramer-Rao bound of a preset's sessions, frame by frame.

    OMP_NUM_THREADS=1 .venv/bin/python -m bench.studies.limits --preset bench-2021 --sessions 40 --out DIR

No image is drawn: the world is run, and the detected line has the error that `python -m bench.studies.line_noise`
measured. Frames in contact only. Writes ``bound-PRESET.json`` and ``bound-PRESET.svg``; prints the tables of
docs/limits.md.
"""

import argparse
import json
import os
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from tipforce.clinical import CONTACT_N
from tipforce.evaluation import CONTACT_ANGLE_BINS_DEG, FORCE_BOUND_BINS_N
from tipforce.limits import CENTRELINE_NOISE, CONTACT_FORCE_PRIORS_N2, SESSION_NOISE, CramerRaoBound
from tipforce.simulation import PRESETS, SimulatedBench

QUANTITIES = ("fx", "fy", "magnitude")
WAYS = {"each": "one frame", "along": "all frames until then"}
COLOURS = {"each": "#d55e00", "along": "#0072b2"}


def groups_of(session: CramerRaoBound) -> list[str]:
    """All groups of unknowns but the force itself."""
    return [*dict.fromkeys(unknown.group for unknown in session.parameters if unknown.group != "force"), SESSION_NOISE]


def one(preset: str, seed: int, broken_down: int, number: int) -> dict[str, Any]:
    """The bounds of a session's frames in contact, standard deviations in mN of `QUANTITIES`; (n, 3) each."""
    session = CramerRaoBound.of(SimulatedBench(PRESETS[preset], seed, number))
    size = np.linalg.norm(session.force_n, axis=1)
    chosen = session.touching & (size > CONTACT_N) & session.stable

    def both(known: Sequence[str], force_n2: np.ndarray | None = None) -> dict[str, np.ndarray]:
        return {way: 1e3 * getattr(session, way)(known, force_n2).fx_fy_magnitude_n[chosen] for way in WAYS}

    found = {
        "number": number,
        "frames": len(chosen),
        "unstable": int((~session.stable).sum()),
        "angle_deg": session.contact_angle_deg[chosen],
        "force_n": size[chosen],
        "vector_n": session.force_n[chosen],
        "bound_mn": both(()),
        "learnt_mn": both((), CONTACT_FORCE_PRIORS_N2[preset]),
        "unknowns": [asdict(unknown) for unknown in session.parameters],
        "tare_only_mn": 1e3 * session.sequential(free_known="tare").fx_fy_magnitude_n[chosen],
    }
    if number < broken_down:
        groups = groups_of(session)
        found["known_mn"] = {group: both([group]) for group in groups}
        found["alone_mn"] = {group: both([other for other in groups if other != group]) for group in groups}
        found["nothing_mn"] = both(groups)
    return found


def spread(values: np.ndarray) -> list[float]:
    """10 %, median, 90 %."""
    return np.quantile(values, [0.1, 0.5, 0.9]).tolist() if len(values) else [float("nan")] * 3


def binned(
    rows: list[dict[str, Any]], key: str, edges: Sequence[float], which: str = "bound_mn"
) -> list[dict[str, Any]]:
    """Spread of both bounds in each bin of ``key``."""
    by = np.concatenate([row[key] for row in rows])
    bins = []
    for low, high in pairwise(edges):
        inside = (by >= low) & (by < high)
        here: dict[str, Any] = {"from": low, "below": high, "frames": int(inside.sum())}
        here["sessions"] = sum(bool(((row[key] >= low) & (row[key] < high)).any()) for row in rows)
        for way in WAYS:
            values = np.concatenate([row[which][way] for row in rows])[inside]
            here[way] = {name: spread(values[:, k]) for k, name in enumerate(QUANTITIES)}
        bins.append(here)
    return bins


def breakdown(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Median of the magnitude with each group known, and with all others known, by contact angle."""
    angle = np.concatenate([row["angle_deg"] for row in rows])
    ranges = {"all": angle >= 0, "0-15": angle < 15, "15-45": (angle >= 15) & (angle < 45), "45-90": angle >= 45}

    def medians(pick: Any) -> dict[str, dict[str, float]]:
        out = {}
        for way in WAYS:
            values = np.concatenate([pick(row)[way][:, 2] for row in rows])
            out[way] = {name: float(np.median(values[inside])) for name, inside in ranges.items() if inside.any()}
        return out

    groups = list(rows[0]["known_mn"])
    return {
        "sessions": len(rows),
        "bound": medians(lambda row: row["bound_mn"]),
        "noise only": medians(lambda row: row["nothing_mn"]),
        "known": {group: medians(lambda row, group=group: row["known_mn"][group]) for group in groups},
        "alone": {group: medians(lambda row, group=group: row["alone_mn"][group]) for group in groups},
    }


def cell(values: Sequence[float]) -> str:
    """Median (10 % - 90 %)."""
    low, middle, high = (f"{value:.0f}" if value >= 10 else f"{value:.1f}" for value in values)
    return f"{middle} ({low}-{high})"


def table(bins: list[dict[str, Any]], quantity: str, factor: float, unit: str) -> str:
    """The bins as rows in Markdown."""
    heads = [f"{name}, {label}" for label in WAYS.values() for name in QUANTITIES]
    lines = [f"| {quantity} | frames | " + " | ".join(heads) + " |", "|---" * (2 + len(heads)) + "|"]
    for row in bins:
        cells = [cell(row[way][name]) for way in WAYS for name in QUANTITIES]
        place = f"{factor * row['from']:g}-{factor * row['below']:g} {unit}"
        lines.append(f"| {place} | {row['frames']} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def breakdown_table(found: dict[str, Any]) -> str:
    """The breakdown as rows in Markdown: medians of the magnitude in mN."""
    ranges = list(found["bound"]["each"])
    heads = [f"{label}, {name}" for label in WAYS.values() for name in ranges]

    def line(name: str, row: dict[str, dict[str, float]]) -> str:
        return f"| {name} | " + " | ".join(f"{row[way][r]:.1f}" for way in WAYS for r in ranges) + " |"

    lines = ["| unknown | " + " | ".join(heads) + " |", "|---" * (1 + len(heads)) + "|", line("all", found["bound"])]
    lines += [line(f"all but {group}", row) for group, row in found["known"].items()]
    lines += [line(f"{group} alone", row) for group, row in found["alone"].items()]
    return "\n".join([*lines, line("the line's fresh error alone", found["noise only"])])


def unknowns_table(unknowns: list[dict[str, Any]]) -> str:
    """The unknowns of one session with their widths, in Markdown."""
    lines = ["| unknown | group | standard deviation | memory | from |", "|---" * 5 + "|"]
    for row in unknowns:
        memory = {0.0: "none", float("inf"): "session"}.get(row["memory_s"], f"{row['memory_s']:g} s")
        unit = "" if row["unit"] == "1" else f" {row['unit']}"
        lines.append(f"| {row['name']} | {row['group']} | {row['std']:.3g}{unit} | {memory} | {row['why']} |")
    return "\n".join(lines)


def parameters(figures: dict[str, Any], path: Path) -> None:
    """Medians with their spread: the magnitude above, the components below; by contact angle and by force."""
    figure, axes = plt.subplots(2, 2, figsize=(11.5, 8), layout="constrained", sharey="row")
    shown = [
        ("by_contact_angle", 1.0, "angle between the tip's axis and the wall's normal, degrees"),
        ("by_force", 1e3, "force, mN"),
    ]
    for column, (key, factor, quantity) in enumerate(shown):
        bins = [row for row in figures[key] if row["frames"]]
        middle = np.array([0.5 * factor * (row["from"] + row["below"]) for row in bins])
        for way, label in WAYS.items():
            low, median, high = np.array([row[way]["magnitude"] for row in bins]).T
            axes[0, column].fill_between(middle, low, high, color=COLOURS[way], alpha=0.18, linewidth=0)
            axes[0, column].plot(middle, median, "o-", color=COLOURS[way], label=f"{label}: median, 10 to 90 %")
            for name, style in (("fx", "o-"), ("fy", "s--")):
                values = [row[way][name][1] for row in bins]
                axes[1, column].plot(middle, values, style, color=COLOURS[way], label=f"{name}, {label}")
        for row, title in enumerate(
            ("bound on the magnitude, mN", "median bound on fx (along the base) and fy (across), mN")
        ):
            edges = [factor * bins[0]["from"], *(factor * each["below"] for each in bins)]
            axes[row, column].set(xlabel=quantity, yscale="log", xticks=edges)
            axes[row, column].grid(alpha=0.25, which="both")
            ticks = [1, 2, 5, 10, 20, 50, 100, 200]
            axes[row, column].set_yticks(ticks, [str(tick) for tick in ticks])
            axes[row, column].minorticks_off()
            if column == 0:
                axes[row, column].set_ylabel(title)
    axes[0, 0].legend(frameon=False, loc="lower left")
    axes[1, 0].set_ylim(bottom=0.6)
    axes[1, 0].legend(frameon=False, ncols=2, loc="lower left")
    title = "posterior Cramer-Rao bound (standard deviation), frames in contact"
    figure.suptitle(f"{figures['preset']}, {figures['sessions']} sessions: {title}")
    figure.savefig(path)


def main() -> None:
    """Computes the bound, prints and writes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--preset", default="bench-2021", choices=list(PRESETS))
    parser.add_argument("--sessions", type=int, default=40)
    parser.add_argument("--first", type=int, default=40, help="the standard protocol's test sessions begin at 40")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--breakdown", type=int, default=8, help="sessions of which each unknown is looked at alone")
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    work = partial(one, options.preset, options.seed, options.first + options.breakdown)
    with ProcessPoolExecutor(options.workers) as pool:
        rows = list(pool.map(work, range(options.first, options.first + options.sessions)))
    size = np.concatenate([row["force_n"] for row in rows])
    vector = np.concatenate([row["vector_n"] for row in rows])
    figures: dict[str, Any] = {
        "preset": options.preset,
        "seed": options.seed,
        "first": options.first,
        "sessions": len(rows),
        "frames_in_contact": len(size),
        "frames_without_a_shape": sum(row["unstable"] for row in rows),
        "noise_m": asdict(CENTRELINE_NOISE[options.preset]),
        "unknowns": rows[0]["unknowns"],
        "forces": {"std_n": vector.std(axis=0).tolist(), "correlation": np.corrcoef(vector.T).tolist()},
        "all": binned(rows, "force_n", (CONTACT_N, np.inf))[0],
        "all_learnt": binned(rows, "force_n", (CONTACT_N, np.inf), "learnt_mn")[0],
        "only_the_tare_known_free_mn": {
            name: spread(np.concatenate([row["tare_only_mn"][:, k] for row in rows]))
            for k, name in enumerate(QUANTITIES)
        },
        "by_contact_angle": binned(rows, "angle_deg", CONTACT_ANGLE_BINS_DEG),
        "by_contact_angle_learnt": binned(rows, "angle_deg", CONTACT_ANGLE_BINS_DEG, "learnt_mn"),
        "by_force": binned(rows, "force_n", FORCE_BOUND_BINS_N),
        "by_force_learnt": binned(rows, "force_n", FORCE_BOUND_BINS_N, "learnt_mn"),
        "by_session_mn": [
            {
                "number": row["number"],
                "angle_deg": float(np.median(row["angle_deg"])),
                **{way: float(np.median(row["bound_mn"][way][:, 2])) for way in WAYS},
            }
            for row in rows
        ],
    }
    known = [row for row in rows if "known_mn" in row]
    if known:
        figures["breakdown_of_magnitude_mn"] = breakdown(known)
    place = options.out / f"bound-{options.preset}"
    place.with_suffix(".json").write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    parameters(figures, place.with_suffix(".svg"))
    print(unknowns_table(figures["unknowns"]), end="\n\n")
    for suffix, prior in (("", "broad"), ("_learnt", "as forces are")):
        print(f"force beforehand: {prior}\n")
        print(table(figures[f"by_contact_angle{suffix}"], "contact angle", 1.0, "deg"))
        print("\n".join(table([figures[f"all{suffix}"]], "", 1e3, "mN").splitlines()[2:]), end="\n\n")
        print(table(figures[f"by_force{suffix}"], "force", 1e3, "mN"), end="\n\n")
    print("tare only:", {name: cell(value) for name, value in figures["only_the_tare_known_free_mn"].items()})
    if known:
        print("\n" + breakdown_table(figures["breakdown_of_magnitude_mn"]))


if __name__ == "__main__":
    main()
