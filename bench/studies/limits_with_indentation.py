"""Smallest possible error of the force for an estimator that also reads the indentation of the tissue.

    OMP_NUM_THREADS=1 python -m bench.studies.limits_with_indentation --sessions 40 --out build/indentation.json

The bound of `limits`, whose priors and noise it has, with one more reading in each frame: the depth of the
indentation. Its error and the prior of the tissue are assumed, not measured: the rows are these
assumptions. Frames in contact; median standard deviation of the magnitude in mN.
"""

import argparse
import json
import os
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np

from tipforce.clinical import CONTACT_N
from tipforce.limits import CONTACT_FORCE_PRIORS_N2, CramerRaoBound, IndentationReading
from tipforce.simulation import PRESETS, SimulatedBench

PRIORS = {"3 %": 0.03, "12 %, as bench-2021 draws it": 0.117, "unknown, 30 to 500 N/m": 0.812}
"""Standard deviation of the stiffness's logarithm; the last is that of a uniform logarithm, as `varied` draws it."""
READINGS = {"0.05 mm": (5e-5, 5e-5), "0.2 mm": (2e-4, 2e-4)}
"""Error of the depth in one frame, and of the position of the face: a quarter of a pixel, and one."""
WAYS = {"one frame": "single_frame", "all frames so far": "sequential"}


def one(preset: str, seed: int, number: int) -> dict[str, np.ndarray]:
    """(frames in contact,) of each assumption."""
    session = CramerRaoBound.of(SimulatedBench(PRESETS[preset], seed, number))
    chosen = session.touching & (np.linalg.norm(session.force_n, axis=1) > CONTACT_N) & session.stable
    models = {"the shape alone": session}
    for reading, (std_m, face_m) in READINGS.items():
        for prior, log_std in PRIORS.items():
            models[f"depth to {reading}, stiffness {prior}"] = session.with_indentation(
                IndentationReading(std_m, log_std, face_m)
            )
    return {
        f"{name}|{way}": 1e3 * getattr(model, WAYS[way])((), CONTACT_FORCE_PRIORS_N2[preset]).magnitude_std_n[chosen]
        for name, model in models.items()
        for way in WAYS
    }


def main() -> None:
    """Computes the bound, prints and writes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--preset", default="bench-2021", choices=list(CONTACT_FORCE_PRIORS_N2))
    parser.add_argument("--sessions", type=int, default=40)
    parser.add_argument("--first", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    with ProcessPoolExecutor(options.workers) as pool:
        numbers = range(options.first, options.first + options.sessions)
        rows = list(pool.map(partial(one, options.preset, options.seed), numbers))
    medians = {key: float(np.median(np.concatenate([row[key] for row in rows]))) for key in rows[0]}
    frames = sum(len(next(iter(row.values()))) for row in rows)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    figures = {**vars(options), "out": str(options.out), "frames_in_contact": frames, "median_mn": medians}
    options.out.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    print(f"| reading | {' | '.join(WAYS)} |")
    print("|---" * (1 + len(WAYS)) + "|")
    for name in dict.fromkeys(key.split("|")[0] for key in medians):
        cells = (f"{medians[name + '|' + way]:.1f}" for way in WAYS)
        print(f"| {name} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
