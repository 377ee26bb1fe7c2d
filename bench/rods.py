"""Speed of the rod solvers against SciPy's boundary value solver, in one process on one thread.

``python bench/rods.py``: microseconds a solve and the ratios. Blocks are short and many, and the quickest one counts:
what else the machine does hits the others.
"""

import argparse
import json
import math
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_bvp
from threadpoolctl import threadpool_limits

from tipforce.mechanics import CentrelineNoise, Rod, bend, bend_many, derivatives, fisher_information

SHAFT, TIP, STIFFNESS, CURVATURE = 0.057, 0.008, 4.3e-4, 10.0
LENGTH = SHAFT + TIP


def random_loads(count: int, largest: float, seed: int = 0) -> np.ndarray:
    """(count, 2) in N: |F| L^2 / EI to ``largest``, in any direction."""
    rng = np.random.default_rng(seed)
    size, angle = rng.uniform(0, largest, count) * STIFFNESS / LENGTH**2, rng.uniform(0, 2 * math.pi, count)
    return size[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def by_boundary_value_solver(
    force: np.ndarray, guess: Any = None, tolerance: float = 1e-3, jacobian_given: bool = True
) -> Any:
    """The same rod as a boundary value problem in angle, curvature and place."""
    fx, fy = force

    def slopes(_: np.ndarray, y: np.ndarray) -> np.ndarray:
        c, s = np.cos(y[0]), np.sin(y[0])
        return np.stack([y[1], (fx * s - fy * c) / STIFFNESS, c, s])

    def slopes_of(_: np.ndarray, y: np.ndarray) -> np.ndarray:
        c, s = np.cos(y[0]), np.sin(y[0])
        jacobian = np.zeros((4, 4, y.shape[1]))
        jacobian[0, 1] = 1.0
        jacobian[1, 0] = (fx * c + fy * s) / STIFFNESS
        jacobian[2, 0], jacobian[3, 0] = -s, c
        return jacobian

    def ends(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        lever = TIP * (math.cos(b[0]) * fy - math.sin(b[0]) * fx)
        return np.array([a[0], a[2], a[3], b[1] - CURVATURE - lever / STIFFNESS])

    if guess is None:
        mesh = np.linspace(0, SHAFT, 11)
        start = np.stack([CURVATURE * mesh, np.full(11, CURVATURE), mesh, CURVATURE * mesh**2 / 2])
    else:
        mesh, start = guess.x, guess.y
    return solve_bvp(slopes, ends, mesh, start, fun_jac=slopes_of if jacobian_given else None, tol=tolerance)


def tip_of(solution: Any) -> np.ndarray:
    angle, _, x, y = solution.y[:, -1]
    return np.array([x + TIP * math.cos(angle), y + TIP * math.sin(angle)])


def best_us(works: list[Callable[[], Any]], solves: int, blocks: int) -> float:
    """Microseconds a solve, of ``solves`` in all: of each piece of work the quickest of ``blocks`` runs counts."""
    total = 0.0
    for work in works:
        times = []
        for _ in range(blocks):
            before = time.perf_counter()
            work()
            times.append(time.perf_counter() - before)
        total += min(times)
    return 1e6 * total / solves


def planar(blocks: int, segments: int) -> dict[str, float]:
    """Figures of the planar rod; alpha is |F| L^2 / EI."""
    rod = Rod(SHAFT, STIFFNESS, TIP, CURVATURE, segments=segments)
    figures: dict[str, float] = {"segments": segments}
    for largest in (5, 12):
        loads = random_loads(1000, largest).reshape(10, 100, 2)
        starts = [bend_many(rod, block) for block in loads]
        assert all(shapes.converged.all() for shapes in starts)
        figures[f"rod, cold, alpha to {largest}"] = best_us([partial(bend_many, rod, b) for b in loads], 1000, blocks)
        for change in (0.02, 0.1):
            works = [partial(bend_many, rod, b * (1 + change), start=s) for b, s in zip(loads, starts, strict=True)]
            figures[f"rod, warm, alpha to {largest}, load {change:.0%} off"] = best_us(works, 1000, blocks)

    loads = random_loads(60, 5.0)
    first = [bend(rod, load) for load in loads]
    seen, noise = derivatives(first[0], 20), CentrelineNoise(2e-4)
    for name, works in {
        "one call of bend, cold": [partial(bend, rod, load) for load in loads],
        "one call of bend, warm, load 2% off": [
            partial(bend, rod, 1.02 * load, start=shape) for load, shape in zip(loads, first, strict=True)
        ],
        "derivatives at 20 points": [partial(derivatives, shape, 20) for shape in first],
        "Fisher information": [partial(fisher_information, seen, noise)],
    }.items():
        figures[name] = best_us(works, len(works), blocks)

    solved = [by_boundary_value_solver(load) for load in loads]
    ok = [k for k, s in enumerate(solved) if s.success]
    exact = {k: tip_of(by_boundary_value_solver(loads[k], solved[k], 1e-10)) for k in ok}
    same = [k for k in ok if np.linalg.norm(exact[k] - first[k].tip_m) < 1e-3 * LENGTH]
    figures["solve_bvp, solved, of 60 with alpha to 5"] = len(ok)
    figures["solve_bvp, of these on the same branch"] = len(same)
    figures["rod, largest error of the tip / L"] = max(np.linalg.norm(first[k].tip_m - exact[k]) for k in same) / LENGTH
    figures["solve_bvp, largest error of the tip / L"] = (
        max(np.linalg.norm(tip_of(solved[k]) - exact[k]) for k in same) / LENGTH
    )
    for name, works in {
        "cold": [partial(by_boundary_value_solver, loads[k], jacobian_given=False) for k in same],
        "cold, Jacobian given": [partial(by_boundary_value_solver, loads[k]) for k in same],
        "warm, Jacobian given, load 2% off": [
            partial(by_boundary_value_solver, 1.02 * loads[k], solved[k]) for k in same
        ],
    }.items():
        figures[f"solve_bvp, {name}"] = best_us(works, len(same), max(3, blocks // 10))
    cold, warm = figures["rod, cold, alpha to 5"], figures["rod, warm, alpha to 5, load 2% off"]
    figures["times faster, cold"] = figures["solve_bvp, cold"] / cold
    figures["times faster, cold, Jacobian given"] = figures["solve_bvp, cold, Jacobian given"] / cold
    figures["times faster, warm, Jacobian given"] = figures["solve_bvp, warm, Jacobian given, load 2% off"] / warm
    return figures


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--blocks", type=int, default=100, help="how often a piece of work is timed")
    parser.add_argument("--segments", type=int, default=50)
    parser.add_argument("--json", type=Path, help="where the figures go")
    chosen = parser.parse_args()
    with threadpool_limits(1):
        figures = {"planar": planar(chosen.blocks, chosen.segments)}
    for part, rows in figures.items():
        print(f"{part}, in microseconds a solve where nothing else is said")
        for name, value in rows.items():
            print(f"  {name:42} {value:12.4g}")
    if chosen.json is not None:
        chosen.json.parent.mkdir(parents=True, exist_ok=True)
        chosen.json.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
