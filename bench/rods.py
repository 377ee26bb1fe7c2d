"""``python -m bench.rods``: the planar rod against SciPy's boundary value solver, one thread.

Both solve the same rods under the same loads. `solve_bvp` begins with 11 nodes at the unloaded shape, with and without
its Jacobian given, at the coarsest tolerance at which its tips are as exact as the rod's; only loads count where it
finds the shape of the rod's branch. "batched": all loads in one call of `solve_static_batch`; "singly": the same
solver, one load after the other; "from Python": one call of `solve_static` each.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from bench.parts import run_alone
from bench.timing import interleaved
from numba import njit
from scipy.integrate import solve_bvp
from threadpoolctl import threadpool_limits

from tipforce.mechanics import CentrelineNoise, Rod, derivatives, fisher_information, solve_static, solve_static_batch
from tipforce.mechanics.planar._batch import ONE, Results, make_results, solve_batch
from tipforce.mechanics.planar._newton import elastic_of
from tipforce.mechanics.planar._statics import carried_n

SHAFT, TIP, STIFFNESS, CURVATURE = 0.057, 0.008, 4.3e-4, 10.0
LENGTH = SHAFT + TIP
TOLERANCES = (1.0, 0.3, 0.1, 0.03, 0.01, 3e-3, 1e-3, 1e-4, 1e-5)


def rod_of(segments: int) -> Rod:
    return Rod(SHAFT, STIFFNESS, TIP, CURVATURE, segments=segments)


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


@njit
def _singly(angles, warm, rod, k0, force, moment, carried, results):
    for row in range(angles.shape[0]):
        part = slice(row, row + 1)
        now = Results(
            results.energy[part],
            results.residual[part],
            results.converged[part],
            results.stable[part],
            results.branch[part],
            results.iterations[part],
        )
        solve_batch(angles[part], warm, rod, k0, force[part], moment[part], carried, now, ONE)


def singly(rod: Rod, loads: np.ndarray, start: np.ndarray | None = None) -> Callable[[], None]:
    """All ``loads`` one after the other, by the solver of `solve_static`; warm where ``start`` (m, n) is given."""
    rows = len(loads)
    angles = np.empty((rows, rod.segments + 1)) if start is None else start.copy()
    results = make_results(rows)
    elastic, k0 = elastic_of(rod, rod.rigid_length_m), rod.precurvatures_per_m[None]
    carried, moment = carried_n(rod, None), np.zeros(rows)

    def run() -> None:
        if start is not None:
            angles[:] = start
        _singly(angles, start is not None, elastic, k0, loads, moment, carried, results)

    return run


def as_exact(loads: np.ndarray, exact: np.ndarray, error: float) -> tuple[float, float]:
    """Coarsest tolerance at which no tip of `solve_bvp` is off by more than ``error``, and by how much one is."""
    for tolerance in TOLERANCES:
        found = [by_boundary_value_solver(load, tolerance=tolerance) for load in loads]
        off = max(
            np.linalg.norm(tip_of(s) - tip) if s.success else math.inf for s, tip in zip(found, exact, strict=True)
        )
        if off <= error:
            return tolerance, float(off)
    raise RuntimeError("no tolerance is as exact as the rod")


def against_bvp(segments: int, loads: np.ndarray, blocks: int = 12) -> dict[str, float]:
    """Microseconds a solve, |F| L^2 / EI to 5."""
    rod = rod_of(segments)
    tips = solve_static_batch(rod, loads).tip_m
    usual = [by_boundary_value_solver(load) for load in loads]
    same = [s.success and np.linalg.norm(tip_of(s) - t) < 1e-3 * LENGTH for s, t in zip(usual, tips, strict=True)]
    loads, tips, usual = loads[same], tips[same], [s for s, kept in zip(usual, same, strict=True) if kept]
    exact = np.array([tip_of(by_boundary_value_solver(f, s, 1e-9)) for f, s in zip(loads, usual, strict=True)])
    error = float(np.linalg.norm(tips - exact, axis=1).max())
    tolerance, theirs = as_exact(loads, exact, error)
    near = solve_static_batch(rod, loads / 1.02)
    found = [by_boundary_value_solver(load / 1.02, tolerance=tolerance) for load in loads]
    ways: dict[str, Callable[[], Any]] = {
        "rod, cold, batched": lambda: solve_static_batch(rod, loads),
        "rod, cold, singly": singly(rod, loads),
        "rod, warm, batched": lambda: solve_static_batch(rod, loads, start=near),
        "rod, warm, singly": singly(rod, loads, near.angles_rad),
        "solve_bvp, cold": lambda: [
            by_boundary_value_solver(load, tolerance=tolerance, jacobian_given=False) for load in loads
        ],
        "solve_bvp, cold, Jacobian given": lambda: [
            by_boundary_value_solver(load, tolerance=tolerance) for load in loads
        ],
        "solve_bvp, warm, Jacobian given": lambda: [
            by_boundary_value_solver(load, s, tolerance) for load, s in zip(loads, found, strict=True)
        ],
    }
    times = {name: 1e6 * t / len(loads) for name, t in interleaved(ways, blocks).items()}
    return {
        "loads": len(loads),
        "of": len(same),
        "rod, worst tip / L": error / LENGTH,
        "solve_bvp, worst tip / L": theirs / LENGTH,
        "solve_bvp, tolerance": tolerance,
        **times,
    }


def beyond(segments: int = 50, blocks: int = 20) -> dict[str, float]:
    """Microseconds a solve: loads to 12 EI / L^2, and what a call from Python costs."""
    rod, loads = rod_of(segments), random_loads(400, 12.0)
    near = solve_static_batch(rod, loads)
    few = loads[:60]
    shapes = [solve_static(rod, load) for load in few]
    seen, noise = derivatives(shapes[0], 20), CentrelineNoise(2e-4)
    times = interleaved(
        {
            "cold, batched": lambda: solve_static_batch(rod, loads),
            "warm, load 2 % off, batched": lambda: solve_static_batch(rod, 1.02 * loads, start=near),
            "warm, load 10 % off, batched": lambda: solve_static_batch(rod, 1.1 * loads, start=near),
            "cold, singly": singly(rod, loads),
            "cold, from Python": lambda: [solve_static(rod, load) for load in few],
            "warm, from Python": lambda: [
                solve_static(rod, 1.02 * f, start=s) for f, s in zip(few, shapes, strict=True)
            ],
            "derivatives at 20 points": lambda: [derivatives(s, 20) for s in shapes],
            "Fisher information": lambda: [fisher_information(seen, noise) for _ in few],
        },
        blocks,
    )
    many = ("batched", "singly")
    return {name: 1e6 * t / (400 if name.endswith(many) else 60) for name, t in times.items()}


def measure() -> dict[str, Any]:
    with threadpool_limits(1):
        loads = random_loads(60, 5.0)
        return {"against": {str(n): against_bvp(n, loads) for n in (50, 64)}, "to 12 EI / L^2": beyond()}


def show(figures: dict[str, Any]) -> None:
    for segments, row in figures["against"].items():
        print(
            f"planar rod, {segments} segments, {row['loads']} of {row['of']} loads to 5 EI / L^2; tips within "
            f"{row['rod, worst tip / L']:.1e} L, solve_bvp at tolerance {row['solve_bvp, tolerance']:g} within "
            f"{row['solve_bvp, worst tip / L']:.1e} L; us a solve, and how many times that solve_bvp takes:"
        )
        plain, given, warm = (
            row[f"solve_bvp, {way}"] for way in ("cold", "cold, Jacobian given", "warm, Jacobian given")
        )
        print(f"  solve_bvp: cold {plain:.0f}, with its Jacobian {given:.0f}; warm, with its Jacobian {warm:.0f}")
        for way in ("batched", "singly"):
            t = row[f"rod, cold, {way}"]
            print(f"  cold, {way:8} {t:6.2f}: {plain / t:5.0f} x, Jacobian given {given / t:5.0f} x", end="")
            t = row[f"rod, warm, {way}"]
            print(f";  warm, {way:8} {t:6.2f}: {warm / t:5.0f} x")
    print("planar rod, 50 segments, loads to 12 EI / L^2, us:")
    print("  " + ", ".join(f"{name} {value:.1f}" for name, value in figures["to 12 EI / L^2"].items()))


if __name__ == "__main__":
    run_alone("planar", measure, show, __doc__)
