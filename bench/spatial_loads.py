"""``python -m bench.spatial_loads``: random spatial loads on random rods, all from a cold start: do all converge?

A share of them is raised again in 400 small steps, each a warm start: is the reported branch confirmed?
"""

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

from tipforce.mechanics import Branch, SpatialRod, solve_static_spatial


def random_case(rng: np.random.Generator, largest: float) -> tuple[SpatialRod, np.ndarray]:
    """A rod of a catheter's measures, and a force of up to ``largest`` as |F| L^2 / EI in any direction."""
    length, ei = rng.uniform(0.035, 0.065), rng.uniform(3e-4, 9e-4)
    rigid = rng.choice([0.0, 0.008])
    profile = 1 + rng.uniform(-0.2, 0.2) * np.sin(np.linspace(0, np.pi, 51))
    rod = SpatialRod(
        length, ei, rigid, ei * rng.uniform(0.5, 1.5), rng.uniform(-1, 1, 3) * [3, 20, 20],
        float(rng.choice([np.inf, 40.0])), profile, 50,
    )  # fmt: skip
    way = rng.normal(size=3)
    return rod, way / np.linalg.norm(way) * rng.uniform(0, largest) * ei / rod.length_m**2


def crawl(rod: SpatialRod, force: np.ndarray, steps: int = 400) -> tuple[np.ndarray, bool]:
    """Returns orientations after many small steps of the load, and whether no step jumped or lost stability."""
    shape, smooth = solve_static_spatial(rod, 0 * force), True
    for share in np.arange(1, steps + 1) / steps:
        last = shape.quaternions
        shape = solve_static_spatial(rod, share * force, start=shape)
        turn = 2 * np.arccos(min(1.0, np.abs(np.sum(shape.quaternions * last, axis=1)).min()))
        smooth = smooth and shape.stable and turn < 0.2
    return shape.quaternions, smooth


def measure(count: int = 20_000, crawled: int = 300, largest: float = 8.0, seed: int = 0) -> dict[str, Any]:
    """Returns, for ``count`` loads: converged share, residuals, branches, and the check of branches in small steps."""
    rng = np.random.default_rng(seed)
    shapes = [solve_static_spatial(*random_case(rng, largest)) for _ in range(count)]
    agree = differ = jumped = 0
    for shape in shapes[:crawled]:
        end, smooth = crawl(shape.rod, shape.force_n)
        same = 1 - np.abs(np.sum(end * shape.quaternions, axis=1)).min() < 1e-8
        jumped += not smooth
        agree += smooth and same and shape.branch is Branch.UNLOADED
        differ += smooth and not (same and shape.branch is Branch.UNLOADED)
    steps = np.array([shape.iterations for shape in shapes])
    return {
        "count": count,
        "unconverged": sum(not shape.converged for shape in shapes),
        "worst_residual": max(shape.residual for shape in shapes),
        "stable": sum(shape.stable for shape in shapes),
        "unloaded_branch": sum(shape.branch is Branch.UNLOADED for shape in shapes),
        "fallen": sum(shape.branch is Branch.FALLEN for shape in shapes),
        "steps_median_99_max": [float(q) for q in np.quantile(steps, [0.5, 0.99, 1.0])],
        "crawled_and_agreed": agree,
        "crawled_and_differed": differ,
        "crawl_jumped": jumped,
    }


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m bench.spatial_loads", description=__doc__)
    parser.add_argument("--count", type=int, default=20_000)
    parser.add_argument("--crawled", type=int, default=300)
    parser.add_argument("--largest", type=float, default=8.0, help="|F| L^2 / EI")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", default="build/spatial_loads.json")
    chosen = parser.parse_args()
    figures = measure(chosen.count, chosen.crawled, chosen.largest, chosen.seed)
    target = Path(chosen.json)
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    print(json.dumps(figures, indent=2))


if __name__ == "__main__":
    main()
