"""Tip error of the models of thesis chapter 2 against the elastica, and their time.

    OMP_NUM_THREADS=1 python -m bench.studies.baselines [--json FILE]

Rods of bench-2021's size (40 mm shaft, 8 mm electrode). alpha = P L^2 / EI with L = 48 mm: 0.19 N at alpha = 1.
"Across": the force is perpendicular to the axis of the unloaded tip. "Pushing": it pushes back
along that axis, 15 degrees off.
The reference is the elastica with 400 segments (a plain solver of the tests), on the branch that is reached by raising
the load from nothing.
"""

import argparse
import json
import math
import pathlib
import time
from collections.abc import Callable

import numpy as np
from tests.oracles.planar_rod import solve_static

from tipforce.mechanics import (
    ConstantCurvature,
    LargeDeflection,
    LinearBeam,
    MassSpring,
    PlanarRod,
    PseudoRigidBody,
    RigidLinks,
    RodModel,
)

STIFFNESS_NM2 = 4.3e-4
ALPHAS = (0.1, 0.5, 1.0, 2.0, 5.0, 10.0)
RODS = {
    "straight": {},
    "pre-curved, 20 per m": {"precurvature_per_m": 20.0},
    "pre-curved and stiffening (k_s = 40 per m)": {"precurvature_per_m": 20.0, "stiffening_curvature_per_m": 40.0},
}
LOADS = {"across": 90.0, "pushing": 165.0}
"""Angle of the force against the unloaded tip's axis, degrees."""
MODELS: dict[str, Callable[[PlanarRod], RodModel]] = {
    "linear beam, 20 elements": LinearBeam,
    "rigid links, 10": RigidLinks,
    "mass-spring, 20": MassSpring,
    "large deflection, 40 steps": LargeDeflection,
    "one arc": ConstantCurvature,
    "four arcs": lambda rod: ConstantCurvature(rod, 4),
    "pseudo-rigid body": PseudoRigidBody,
}


def rod_of(settings: dict[str, float], segments: int = 50) -> PlanarRod:
    return PlanarRod(0.040, STIFFNESS_NM2, 0.008, segments=segments, **settings)


def force_of(rod: PlanarRod, alpha: float, degrees: float) -> np.ndarray:
    angle = float(solve_static(rod, np.zeros(2)).tip_angle_rad) + math.radians(degrees)
    return alpha * rod.bending_stiffness_nm2 / rod.length_m**2 * np.array([math.cos(angle), math.sin(angle)])


def tip_errors(settings: dict[str, float], degrees: float) -> dict[str, list[float]]:
    """Model -> tip error in percent of the length, one for each alpha; NaN where it does not converge."""
    exact, coarse = rod_of(settings, 400), rod_of(settings)
    errors = {}
    for name, make in MODELS.items():
        model = make(coarse)
        errors[name] = []
        for alpha in ALPHAS:
            force = force_of(coarse, alpha, degrees)
            here, there = model.solve_static(force), solve_static(exact, force)
            off = float(np.linalg.norm(here.tip_m - there.tip_m)) / coarse.length_m * 100
            errors[name].append(off if here.converged and there.converged else math.nan)
    return errors


def microseconds(model: RodModel, force: np.ndarray, blocks: int = 30, times: int = 100) -> float:
    best = math.inf
    for _ in range(blocks):
        start = time.perf_counter()
        for _ in range(times):
            model.solve_static(force)
        best = min(best, (time.perf_counter() - start) / times)
    return best * 1e6


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m bench.studies.baselines", description=__doc__)
    parser.add_argument("--json", type=pathlib.Path, help="where the figures go")
    chosen = parser.parse_args()
    figures: dict[str, dict[str, list[float]]] = {}
    print("| rod, load | model |", " | ".join(f"alpha {a:g}" for a in ALPHAS), "|")
    print("|---|---|" + "---|" * len(ALPHAS))
    for rod_name, settings in RODS.items():
        for load_name, degrees in LOADS.items():
            case = f"{rod_name}, {load_name}"
            figures[case] = tip_errors(settings, degrees)
            for name, row in figures[case].items():
                print(f"| {case} | {name} |", " | ".join(f"{e:.2g}" for e in row), "|")
    print("\n| model |", " | ".join(f"alpha {a:g}, us" for a in ALPHAS[::2]), "|\n|---|" + "---|" * len(ALPHAS[::2]))
    rod = rod_of(RODS["pre-curved, 20 per m"])
    times = {}
    for name, make in MODELS.items():
        model = make(rod)
        times[name] = [microseconds(model, force_of(rod, alpha, 90.0)) for alpha in ALPHAS[::2]]
        print(f"| {name} |", " | ".join(f"{t:.1f}" for t in times[name]), "|")
    if chosen.json:
        chosen.json.write_text(
            json.dumps({"tip_error_percent": figures, "us": times}, indent=2) + "\n", encoding="utf-8"
        )


if __name__ == "__main__":
    main()
