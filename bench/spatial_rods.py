"""``python -m bench.spatial_rods``: the rod in space against solve_bvp and PyElastica, one thread.

The same random rods and loads go through all of them. `solve_bvp` (places, quaternions, moments) begins with 21 nodes
on the straight rod, at the coarsest tolerance at which its tips are as exact as the rod's; PyElastica is damped until
its tip stays within 1 % of the length of where it settles.
"""

from importlib.util import find_spec
from typing import Any

import numpy as np
from bench.parts import run_alone
from bench.settle_pyelastica import settle
from bench.timing import interleaved
from scipy.integrate import solve_bvp
from threadpoolctl import threadpool_limits

from tipforce.mechanics import (
    SpatialContact,
    SpatialContactSolver,
    SpatialRod,
    SpatialWall,
    damping_of_loss_factor,
    solve_static_spatial,
)

SEGMENTS = 50
LARGEST = 4.0
"""|F| L^2 / EI of the largest load."""
BEAT_HZ = 1.2


def cases(count: int, seed: int = 0) -> list[tuple[SpatialRod, np.ndarray]]:
    """Rods of length and EI one, GJ 2/3, with random pre-curvature, and random forces."""
    rng = np.random.default_rng(seed)
    out = []
    for _ in range(count):
        rod = SpatialRod(1.0, 1.0, precurvature_per_m=rng.uniform(-1, 1, 3) * [0.2, 1, 1], segments=SEGMENTS)
        way = rng.normal(size=3)
        out.append((rod, way / np.linalg.norm(way) * rng.uniform(0, LARGEST)))
    return out


def by_bvp(rod: SpatialRod, force: np.ndarray, tolerance: float) -> np.ndarray:
    """Tip by collocation: place, quaternion and moment along the rod, from the unloaded shape."""
    rest, stiffness = rod.precurvature_per_m[0], np.array([rod.gj_nm2, 1.0, 1.0])

    def slopes(_: np.ndarray, state: np.ndarray) -> np.ndarray:
        w, x, y, z = q = state[3:7]
        axes = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )
        u = np.einsum("ijs,is->js", axes, state[7:]) / stiffness[:, None] + rest[:, None]
        turn = 0.5 * np.array(
            [
                -x * u[0] - y * u[1] - z * u[2],
                w * u[0] + y * u[2] - z * u[1],
                w * u[1] + z * u[0] - x * u[2],
                w * u[2] + x * u[1] - y * u[0],
            ]
        )
        turn += q * (1 - np.sum(q * q, axis=0))  # keeps the quaternion's length
        return np.concatenate([axes[:, 0], turn, -np.cross(axes[:, 0].T, force).T])

    def ends(base: np.ndarray, tip: np.ndarray) -> np.ndarray:
        return np.concatenate([base[:3], base[3:7] - [1, 0, 0, 0], tip[7:]])

    s = np.linspace(0, 1, 21)
    start = np.zeros((10, 21))
    start[0], start[3] = s, 1.0
    out = solve_bvp(slopes, ends, s, start, tol=tolerance, max_nodes=5000)
    return out.y[:3, -1] if out.success else np.full(3, np.nan)


TOLERANCES = (0.1, 0.03, 0.01, 3e-3, 1e-3, 1e-4, 1e-5)


def extrapolated(rod: SpatialRod, force: np.ndarray) -> np.ndarray:
    """The tip with the error of second order taken out."""
    coarse, fine = (
        solve_static_spatial(
            SpatialRod(1.0, 1.0, precurvature_per_m=rod.precurvature_per_m[0], segments=n), force
        ).tip_m
        for n in (200, 400)
    )
    return (4 * fine - coarse) / 3


def against_bvp(count: int = 30, blocks: int = 5) -> dict[str, float]:
    """Returns microseconds a solve, including the share of Python in the call."""
    todo = cases(count)
    shapes = [solve_static_spatial(rod, force) for rod, force in todo]
    near = [solve_static_spatial(rod, 0.98 * force) for rod, force in todo]
    exact = [extrapolated(rod, force) for rod, force in todo]
    ours = [float(np.linalg.norm(s.tip_m - t)) for s, t in zip(shapes, exact, strict=True)]
    for tolerance in TOLERANCES:
        found = [by_bvp(rod, force, tolerance) for rod, force in todo]
        theirs = np.array([np.linalg.norm(a - b) for a, b in zip(found, exact, strict=True)])
        solved = theirs < 0.01  # the rest is on another branch, or did not converge
        if solved.sum() >= 0.9 * count and theirs[solved].max() <= max(ours):
            break
    else:
        raise RuntimeError("no tolerance is as exact as the rod")
    times = interleaved(
        {
            "rod, cold": lambda: [solve_static_spatial(rod, force) for rod, force in todo],
            "rod, warm, load 2 % off": lambda: [
                solve_static_spatial(r, f, start=s) for (r, f), s in zip(todo, near, strict=True)
            ],
            "rod, already there": lambda: [
                solve_static_spatial(r, f, start=s) for (r, f), s in zip(todo, shapes, strict=True)
            ],
            "solve_bvp, cold": lambda: [by_bvp(rod, force, tolerance) for rod, force in todo],
        },
        blocks,
    )
    return {
        "loads": count,
        "solve_bvp, tips on the same branch": int(solved.sum()),
        "solve_bvp, tolerance": tolerance,
        "solve_bvp, worst tip / L": float(theirs[solved].max()),
        "rod, worst tip / L": max(ours),
        "rod, cold, Newton steps": float(np.mean([s.iterations for s in shapes])),
        **{name: 1e6 * t / count for name, t in times.items()},
    }


def pyelastica_times(count: int) -> list[float]:
    """Seconds until PyElastica's tip (20 elements) stays within 1 % of the length of where it ends."""
    out = []
    for rod, force in cases(count):
        course = list(settle(rod.precurvature_per_m[0], force))
        away = [np.linalg.norm(tip - course[-1][0]) > 0.01 for tip, *_ in course]
        out.append(course[len(away) - away[::-1].index(True) if True in away else 0][1])
    return out


def press_time(segments: int, seconds: float = 20.0) -> dict[str, float]:
    """Microseconds an instant at 1 kHz: a beating, breathing wall with friction and damping, a creeping shaft."""
    rod = SpatialRod(
        0.04, 4.3e-4, 0.008, precurvature_per_m=np.array([0, 1.0, 5.33]), stiffening_curvature_per_m=40.0,
        stiffness_profile=np.where(np.arange(segments + 1) < segments / 3, 1.05, 1.0), segments=segments,
    )  # fmt: skip
    wall = SpatialWall(np.array([0.75, 0.65, 0.05]), 120.0, damping_of_loss_factor(120.0, 0.175, BEAT_HZ), 0.2)
    t = np.arange(round(seconds * 1e3)) * 1e-3
    tip = solve_static_spatial(rod, np.zeros(3)).tip_m
    push = 4e-3 - 6e-3 * np.cos(2 * np.pi * BEAT_HZ * t) + 1e-3 * np.sin(2 * np.pi * 0.25 * t)
    side = 3e-3 * np.sin(2 * np.pi * BEAT_HZ * t + 1)
    way = tip - push[:, None] * wall.normal + side[:, None] * wall.axes[1] + 0.5 * side[:, None] * wall.axes[2]
    change = np.zeros((t.size, 3))
    change[:, 2] = 0.3 * np.sin(0.3 * t)

    def run() -> SpatialContact:
        return SpatialContactSolver(rod, wall, 1e-3, 0.00116, creep=0.03, creep_time_s=2).run(way, change)

    contact = run()
    return {
        "us": interleaved({"contact": run}, 3)["contact"] / t.size * 1e6,
        "touching": float(contact.touching.mean()),
        "slipping": float(contact.slipping.mean()),
        "unconverged": float((~contact.converged).sum()),
        "peak_n": float(np.linalg.norm(contact.force_n, axis=1).max()),
    }


def measure() -> dict[str, Any]:
    with threadpool_limits(1):
        figures: dict[str, Any] = {"against": against_bvp()}
        if find_spec("elastica"):
            pyelastica_times(1)  # compiles
            figures["pyelastica_s"] = pyelastica_times(3)
        figures["contact"] = {str(segments): press_time(segments) for segments in (40, 60)}
    return figures


def show(figures: dict[str, Any]) -> None:
    row = figures["against"]
    cold, bvp = row["rod, cold"], row["solve_bvp, cold"]
    print(
        f"rod in space, {SEGMENTS} segments, {row['loads']} loads to {LARGEST:g} EI / L^2, from Python; tips within "
        f"{row['rod, worst tip / L']:.1e} L, solve_bvp at tolerance {row['solve_bvp, tolerance']:g} within "
        f"{row['solve_bvp, worst tip / L']:.1e} L on {row['solve_bvp, tips on the same branch']} of them"
    )
    print(
        f"  cold {cold:.0f} us ({row['rod, cold, Newton steps']:.1f} Newton steps), warm "
        f"{row['rod, warm, load 2 % off']:.0f} us, already there {row['rod, already there']:.0f} us; solve_bvp "
        f"{bvp:.0f} us: {bvp / cold:.0f} x"
    )
    if "pyelastica_s" in figures:
        least, most = min(figures["pyelastica_s"]), max(figures["pyelastica_s"])
        print(
            f"  PyElastica, 20 elements, to 1 % of its settled tip: {least:.2f} to {most:.2f} s: "
            f"{1e6 * least / cold:.0f} x at least"
        )
    for segments, solved in figures["contact"].items():
        print(
            f"contact, {segments} segments, 20,000 instants of 1 ms: {solved['us']:.1f} us an instant; touching "
            f"{solved['touching']:.0%}, slipping {solved['slipping']:.0%}, peak {solved['peak_n']:.2f} N, "
            f"{solved['unconverged']:.0f} unconverged"
        )


if __name__ == "__main__":
    run_alone("spatial", measure, show, __doc__)
