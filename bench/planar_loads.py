"""The planar rod under many random loads from a cold start, all in one call; does each know on which branch it lies?

``python -m bench.planar_loads``. Those that fell at a fold, and a part of the rest, are raised again in 500 equal steps
from shape to shape, without any look ahead.
"""

import argparse
import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from tipforce.mechanics import Branch, Rod, Shapes, solve_static_batch

LENGTH, STIFFNESS = 0.065, 4.3e-4
RODS = {
    "constant stiffness": (Rod(LENGTH - 0.008, STIFFNESS, 0.008), 0),
    "stiffening": (Rod(LENGTH - 0.008, STIFFNESS, 0.008, stiffening_curvature_per_m=40.0), 1),
}
"""With the seed of their loads."""
JUMP_RAD = 0.1
"""A step of 1/500 of the load turns no angle of a branch by more than this, but close to a fold."""


def loads(count: int, seed: int) -> dict[str, np.ndarray]:
    """|F| L^2 / EI to 12 in any direction, moments to 2 EI / L, pre-curvatures to the knob's full 48 1/m both ways."""
    rng = np.random.default_rng(seed)
    size, angle = rng.uniform(0, 12, count) * STIFFNESS / LENGTH**2, rng.uniform(0, 2 * math.pi, count)
    return {
        "force_n": size[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1),
        "moment_nm": rng.uniform(-2, 2, count) * STIFFNESS / LENGTH,
        "precurvature_per_m": rng.uniform(-48, 48, count),
    }


def unbalanced(shapes: Shapes) -> np.ndarray:
    """Largest moment that is missing on an element of each shape, over EI / length of the shaft; in plain NumPy."""
    rod, angles = shapes.rod, shapes.angles_rad
    k = rod.curvatures_per_m(angles)
    stiffer = 1 + (k / rod.stiffening_curvature_per_m) ** 2
    moment = rod.stiffnesses_nm2 * stiffer * (k - shapes.precurvature_per_m[:, None])  # type: ignore[index]
    after = np.append(moment[:, 1:], shapes.moment_nm[:, None], axis=1)
    arm = rod.element_lengths_m * np.stack([np.cos(angles), np.sin(angles)])
    couple = arm[0] * shapes.force_n[:, 1:] - arm[1] * shapes.force_n[:, :1]
    return np.abs(after + couple - moment).max(axis=1) / (rod.bending_stiffness_nm2 / rod.flexible_length_m)


def walked(rod: Rod, given: dict[str, np.ndarray], steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Angles after raising the loads in many equal steps, and the largest change of an angle in one of them."""
    curved = given["precurvature_per_m"]
    none = {"force_n": 0 * given["force_n"], "moment_nm": 0 * given["moment_nm"], "precurvature_per_m": curved}
    shapes, largest = solve_static_batch(rod, **none), np.zeros(len(curved))
    for share in np.arange(1, steps + 1) / steps:
        part = {"force_n": share * given["force_n"], "moment_nm": share * given["moment_nm"]}
        following = solve_static_batch(rod, **part, precurvature_per_m=curved, start=shapes)
        largest = np.maximum(largest, np.abs(following.angles_rad - shapes.angles_rad).max(axis=1))
        shapes = following
    return shapes.angles_rad, largest


def measure(rod: Rod, seed: int, count: int = 100_000, walked_too: int = 3000) -> dict[str, Any]:
    """Of ``count`` loads: how many converged, their residuals, branches, and what a walk says of the branches."""
    given = loads(count, seed)
    shapes = solve_static_batch(rod, **given)
    fallen = shapes.branch == Branch.FALLEN
    rows = np.append(np.flatnonzero(fallen), np.flatnonzero(~fallen)[:walked_too])
    angles, largest = walked(rod, {name: value[rows] for name, value in given.items()}, 500)
    away = np.abs(angles - shapes.angles_rad[rows]).max(axis=1)
    fell, plain = fallen[rows], largest < JUMP_RAD
    return {
        "count": count,
        "unconverged": int((~shapes.converged).sum()),
        "worst_residual": float(shapes.residual.max()),
        "worst_residual_by_numpy": float(unbalanced(shapes).max()),
        "stable": int(shapes.stable.sum()),
        "unloaded_branch": int((shapes.branch == Branch.UNLOADED).sum()),
        "fallen": int(fallen.sum()),
        "fallen_without_a_jump_in_the_walk": int((fell & plain).sum()),
        "walked": int((~fell).sum()),
        "walked_with_a_jump": int((~fell & ~plain).sum()),
        "walked_to_another_shape": int((~fell & plain & (away >= 1e-6)).sum()),
        "off_the_walk_rad": float(away[~fell & plain].max(initial=0.0)),
    }


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m bench.planar_loads", description=__doc__)
    parser.add_argument("--count", type=int, default=100_000)
    parser.add_argument("--json", default="build/planar_loads.json")
    chosen = parser.parse_args()
    figures = {name: measure(rod, seed, chosen.count) for name, (rod, seed) in RODS.items()}
    target = Path(chosen.json)
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    print(json.dumps(figures, indent=2))


if __name__ == "__main__":
    main()
