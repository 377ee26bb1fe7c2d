"""``OMP_NUM_THREADS=1 python -m bench.spatial_rods``: the rod in space against solve_bvp and PyElastica, one thread.

Times are CPU times of the least disturbed block. The same random rods and loads go through all of them.
"""

import json
import time
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from bench.settle_pyelastica import settle
from scipy.integrate import solve_bvp

from tipforce.mechanics import (
    SpatialContact,
    SpatialRod,
    SpatialWall,
    bend_spatial,
    damping_of_loss_factor,
    press_spatial,
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


def best(work: Callable[[], object], blocks: int = 10) -> float:
    """CPU seconds of the least disturbed block."""
    times = []
    for _ in range(blocks):
        began = time.process_time()
        work()
        times.append(time.process_time() - began)
    return min(times)


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


def rod_times(count: int) -> dict[str, float]:
    """Microseconds a solve, cold and from a load that is 2 % smaller, with what the caller pays."""
    todo = cases(count)
    shapes = [bend_spatial(rod, force) for rod, force in todo]
    near = [bend_spatial(rod, 0.98 * force) for rod, force in todo]
    cold = best(lambda: [bend_spatial(rod, force) for rod, force in todo])
    warm = best(lambda: [bend_spatial(r, f, start=s) for (r, f), s in zip(todo, near, strict=True)])
    still = best(lambda: [bend_spatial(r, f, start=s) for (r, f), s in zip(todo, shapes, strict=True)])
    steps = [s.iterations for s in shapes]
    warm_steps = [bend_spatial(r, f, start=s).iterations for (r, f), s in zip(todo, near, strict=True)]
    return {
        "cold_us": cold / count * 1e6,
        "warm_us": warm / count * 1e6,
        "checked_only_us": still / count * 1e6,
        "cold_steps": float(np.mean(steps)),
        "warm_steps": float(np.mean(warm_steps)),
    }


def bvp_times(count: int) -> dict[str, float]:
    """Seconds a solve of solve_bvp, at the tolerance that meets the tip as well as the rod of N segments does."""
    todo = cases(count)
    fine = []
    for rod, force in todo:
        tips = [
            bend_spatial(SpatialRod(1.0, 1.0, precurvature_per_m=rod.precurvature_per_m[0], segments=n), force).tip_m
            for n in (200, 400)
        ]
        fine.append((4 * tips[1] - tips[0]) / 3)
    ours = [np.linalg.norm(bend_spatial(r, f).tip_m - t) for (r, f), t in zip(todo, fine, strict=True)]
    tips = [by_bvp(rod, force, 1e-3) for rod, force in todo]
    errors = np.array([np.linalg.norm(a - b) for a, b in zip(tips, fine, strict=True)])
    met = errors < 0.01
    return {
        "ms": best(lambda: [by_bvp(rod, force, 1e-3) for rod, force in todo], 3) / count * 1e3,
        "met": float(met.sum()),
        "of": float(count),
        "median_error": float(np.median(errors[met])),
        "our_median_error": float(np.median(ours)),
    }


def pyelastica_times(count: int) -> list[float]:
    """Seconds until PyElastica's tip (20 elements) stays within 1 % of the length of where it ends."""
    out = []
    for rod, force in cases(count):
        course = list(settle(rod.precurvature_per_m[0], force))
        away = [np.linalg.norm(tip - course[-1][0]) > 0.01 for tip, *_ in course]
        out.append(course[len(away) - away[::-1].index(True) if True in away else 0][1])
    return out


def press_time(segments: int, seconds: float = 60.0) -> dict[str, float]:
    """Microseconds an instant at 1 kHz: a beating, breathing wall with friction and damping, a creeping shaft."""
    rod = SpatialRod(
        0.04, 4.3e-4, 0.008, precurvature_per_m=np.array([0, 1.0, 5.33]), stiffening_curvature_per_m=40.0,
        stiffness_profile=np.where(np.arange(segments + 1) < segments / 3, 1.05, 1.0), segments=segments,
    )  # fmt: skip
    wall = SpatialWall(np.array([0.75, 0.65, 0.05]), 120.0, damping_of_loss_factor(120.0, 0.175, BEAT_HZ), 0.2)
    t = np.arange(round(seconds * 1e3)) * 1e-3
    tip = bend_spatial(rod, np.zeros(3)).tip_m
    push = 4e-3 - 6e-3 * np.cos(2 * np.pi * BEAT_HZ * t) + 1e-3 * np.sin(2 * np.pi * 0.25 * t)
    side = 3e-3 * np.sin(2 * np.pi * BEAT_HZ * t + 1)
    way = tip - push[:, None] * wall.normal + side[:, None] * wall.axes[1] + 0.5 * side[:, None] * wall.axes[2]
    change = np.zeros((t.size, 3))
    change[:, 2] = 0.3 * np.sin(0.3 * t)

    def run() -> SpatialContact:
        return press_spatial(
            rod, wall, way, 1e-3, 0.00116, precurvature_change_per_m=change, creep=0.03, creep_time_s=2
        )

    contact = run()
    return {
        "us": best(run, 4) / t.size * 1e6,
        "touching": float(contact.touching.mean()),
        "slipping": float(contact.slipping.mean()),
        "unconverged": float((~contact.converged).sum()),
        "peak_n": float(np.linalg.norm(contact.force_n, axis=1).max()),
    }


def main() -> None:
    figures: dict[str, object] = {"rod": (rod := rod_times(300))}
    print(f"N = {SEGMENTS}: cold {rod['cold_us']:.0f} us ({rod['cold_steps']:.1f} Newton steps), ", end="")
    print(f"warm {rod['warm_us']:.0f} us ({rod['warm_steps']:.1f}), already there {rod['checked_only_us']:.0f} us")
    figures["bvp"] = bvp = bvp_times(30)
    print(f"solve_bvp: {bvp['ms']:.0f} ms, tip within 1 % in {bvp['met']:.0f} of {bvp['of']:.0f}, ", end="")
    print(f"median error {bvp['median_error']:.1e} of the length (ours {bvp['our_median_error']:.1e})")
    if find_spec("elastica"):
        pyelastica_times(1)  # compiles
        figures["pyelastica_s"] = times = pyelastica_times(5)
        print(f"PyElastica, 20 elements, to 1 % of its settled tip: {min(times):.2f} to {max(times):.2f} s")
    for segments in (40, 60):
        figures[f"press_{segments}"] = press = press_time(segments)
        print(
            f"contact, N = {segments}, 60,000 instants: {press['us']:.1f} us an instant; touching "
            f"{press['touching']:.0%}, slipping {press['slipping']:.0%}, peak {press['peak_n']:.2f} N, "
            f"{press['unconverged']:.0f} unconverged"
        )
    target = Path("build/spatial_rods.json")
    target.parent.mkdir(exist_ok=True)
    target.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
