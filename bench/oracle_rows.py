"""The rod models against published and exact solutions: one row a figure, each with its tolerance."""

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from importlib.util import find_spec

import numpy as np
from bench import spatial_loads
from bench.published import BEND_45, CANTILEVER, MOMENT_TIPS
from bench.settle_pyelastica import LOADS, apart
from bench.strains import density, rotation_vectors
from scipy.spatial.transform import Rotation

from tipforce.mechanics import (
    ConstantCurvature,
    LargeDeflection,
    LinearBeam,
    MassSpring,
    PlanarRod,
    PseudoRigidBody,
    RigidLinks,
    RodModel,
    SpatialRod,
    solve_static_spatial,
)


@dataclass(frozen=True, slots=True)
class Row:
    """``error`` is that of the worst number of the row, and must be at most ``tolerance``; both are absolute."""

    oracle: str
    model: str
    expected: float
    got: float
    error: float
    tolerance: float

    @property
    def holds(self) -> bool:
        return self.error <= self.tolerance


def row(oracle: str, model: str, expected: object, got: object, tolerance: float) -> Row:
    """A row of numbers: shows the worst of them."""
    want, have = np.ravel(np.asarray(expected, float)), np.ravel(np.asarray(got, float))
    away = np.abs(have - want)
    worst = int(np.argmax(np.where(np.isnan(away), np.inf, away)))
    error = math.inf if np.isnan(away).any() else float(away[worst])
    return Row(oracle, model, float(want[worst]), float(have[worst]), error, tolerance)


def spatial_tip(alpha: float, segments: int) -> np.ndarray:
    """Deflection, shortening, angle of a cantilever of unit length and EI, under a load in a slanted plane."""
    way = np.array([0.0, math.cos(0.7), math.sin(0.7)])
    shape = solve_static_spatial(SpatialRod(1.0, 1.0, segments=segments), alpha * way)
    return np.array([shape.tip_m @ way, 1 - shape.tip_m[0], math.acos(shape.frames[-1, 0, 0])])


def cantilever() -> Iterator[Row]:
    values = ("deflection / L", "shortening / L", "tip angle, rad")
    for alpha, want in CANTILEVER.items():
        meshes = {n: spatial_tip(alpha, n) for n in (25, 50, 400)}
        ways = {
            "50 segments, extrapolated": (4 * meshes[50] - meshes[25]) / 3,
            "400 segments": meshes[400],
        }
        for (way, got), (k, value) in itertools.product(ways.items(), enumerate(values)):
            yield row(f"cantilever, alpha {alpha:g}: {value}", f"spatial rod, {way}", want[k], got[k], 1e-4)


def wound(moment: np.ndarray, ei: float, length: float, tangent: np.ndarray) -> np.ndarray:
    """Tip of a rod that a tip moment winds to a helix: the integral of its tangent, turned about the moment."""
    size = float(np.linalg.norm(moment))
    axis, angle = moment / size, size * length / ei
    along = axis * (axis @ tangent)
    turned = math.sin(angle) * (tangent - along) + (1 - math.cos(angle)) * np.cross(axis, tangent)
    return length * (along + turned / angle)


def moment_in_space() -> Iterator[Row]:
    for tangent, order in (("x", [0, 1, 2]), ("z", [2, 0, 1])):  # along z: the axes renamed
        load = np.array([3.0, 0.0, 4.0])[order]
        exact = wound(load, 2.0, 2.0, np.array([1.0, 0.0, 0.0]))
        yield row(
            f"tip moment in space, t0 = {tangent}: published",
            "formula",
            np.array(MOMENT_TIPS[tangent])[order],
            exact,
            6e-9,
        )
        for torsion in (0.5, 1.0, 3.0):
            tips = [
                solve_static_spatial(SpatialRod(2.0, 2.0, 0.0, torsion, segments=n), np.zeros(3), load).tip_m
                for n in (100, 200, 400, 800)
            ]
            for level in range(1, 4):  # Romberg: the error is a series in the square of the segment's length
                tips = [fine + (fine - coarse) / (4**level - 1) for coarse, fine in itertools.pairwise(tips)]
            yield row(
                f"tip moment in space, t0 = {tangent}, GJ / EI {torsion / 2:g}", "spatial rod", exact, tips[0], 1e-8
            )


def bend_of_45_degrees() -> Iterator[Row]:
    for load, want in BEND_45.items():
        for segments in (100, 400):
            rod = SpatialRod(100 * math.pi / 4, 8.333e5, 0.0, 8.333e5, np.array([0, 0, 0.01]), segments=segments)
            x, y, z = solve_static_spatial(rod, np.array([0.0, 0.0, load])).tip_m
            yield row(f"45-degree bend, P = {load:g}", f"spatial rod, {segments} segments", want, [y, x, z], 0.02)


def deflection(make: Callable[[PlanarRod], RodModel], alpha: float) -> float:
    return float(make(PlanarRod(1.0, 1.0)).solve_static(np.array([0.0, alpha])).tip_m[1])


def other_models() -> Iterator[Row]:
    for alpha in CANTILEVER:
        yield row(
            f"deflection alpha / 3, alpha {alpha:g}", "linear beam", alpha / 3, deflection(LinearBeam, alpha), 1e-9
        )
    over = deflection(LinearBeam, 2.0) / CANTILEVER[2.0][0] - 1
    yield row("its known failure at alpha 2: share too much", "linear beam", 0.35, over, 0.005)
    for alpha in (2.0, 5.0, 10.0):
        got = deflection(PseudoRigidBody, alpha) / CANTILEVER[alpha][0]
        yield row(f"deflection / that of the elastica, alpha {alpha:g}", "pseudo-rigid body", 1.0, got, 0.01)
    models: dict[str, tuple[Callable[[PlanarRod], RodModel], float]] = {
        "large deflection": (partial(LargeDeflection, steps=200), 1e-4),
        "rigid links, 100": (partial(RigidLinks, joints=100), 1e-4),
        "mass-spring, 200": (partial(MassSpring, pieces=200, diameter_m=0.02), 1e-3),
        "constant curvature, 40 arcs": (partial(ConstantCurvature, arcs=40), 1e-3),
    }
    for (name, (make, tolerance)), alpha in itertools.product(models.items(), CANTILEVER):
        got = deflection(make, alpha)
        yield row(f"cantilever, alpha {alpha:g}: deflection / L", name, CANTILEVER[alpha][0], got, tolerance)


def order() -> Iterator[Row]:
    """Order of the error in the segment's length: tips with 20, 40 and 80 segments against the extrapolated one."""

    def twisted(n: int) -> np.ndarray:
        rod = SpatialRod(1.0, 1.0, 0.1, 0.6, np.array([0.5, 1.0, 0.4]), 4.0, np.linspace(1.3, 0.8, n + 1), n)
        return solve_static_spatial(
            rod, np.array([-0.5, 1.0, 2.0]), np.array([0.2, 0.1, -0.3]), np.array([0, 1, -0.5])
        ).tip_m

    exact = (4 * twisted(400) - twisted(200)) / 3
    errors = [np.abs(twisted(n) - exact).max() for n in (20, 40, 80)]
    got = [math.log2(a / b) for a, b in itertools.pairwise(errors)]
    yield row("order of convergence", "spatial rod, with all features", [2.0, 2.0], got, 0.03)


ROD = SpatialRod(0.057, 4.3e-4, 0.008, 3.5e-4, np.array([2.0, 6.0, 8.0]), 40.0, segments=60)
FORCE, MOMENT = np.array([-0.05, 0.08, 0.06]), np.array([5e-4, -1e-3, 8e-4])


def invariance() -> Iterator[Row]:
    here = solve_static_spatial(ROD, FORCE, MOMENT).tip_m
    for angle in (0.5, 2.0, 3.1):
        turn = Rotation.from_rotvec([angle, 0, 0]).as_matrix()
        turned = replace(ROD, precurvature_per_m=np.asarray(ROD.precurvature_per_m) @ turn.T)
        there = solve_static_spatial(turned, turn @ FORCE, turn @ MOMENT).tip_m
        yield row(f"bench turned by {angle:g} rad, tip in m", "spatial rod", turn @ here, there, 1e-9)


def work_along_the_path() -> Iterator[Row]:
    """Integral of the force over the motion of the tip as the load is raised, against the stored energy; by parts."""
    nodes, weights = np.polynomial.legendre.leggauss(24)
    shares = (nodes + 1) / 2

    def stored(force: np.ndarray) -> tuple[float, np.ndarray]:
        shape = solve_static_spatial(ROD, force)
        strain = rotation_vectors(shape.quaternions) / ROD.joint_spans_m[:, None]
        energy = np.sum(density(ROD, strain, np.asarray(ROD.precurvature_per_m)) * ROD.joint_spans_m)
        return float(energy), shape.tip_m

    tips = [FORCE @ stored(share * FORCE)[1] for share in shares]
    (last, tip), (first, _) = stored(FORCE), stored(0 * FORCE)
    work = FORCE @ tip - weights @ np.array(tips) / 2
    yield row("work of the load / energy stored", "spatial rod", 1.0, work / (last - first), 1e-8)


def pyelastica() -> Iterator[Row]:
    if find_spec("elastica") is None:
        return
    for name, (strain, force) in LOADS.items():
        theirs, ours = apart(np.array(strain), np.array(force))
        yield row(f"PyElastica settled, {name}: tip / L", "spatial rod", theirs, ours, 1.5e-3)


def random_spatial_loads(count: int = 20_000) -> Iterator[Row]:
    found = spatial_loads.measure(count)
    yield from _random(f"{count} random loads to 8 EI / L^2, cold", "spatial rod", found)
    yield row("  branches that a crawl in 400 steps denies", "spatial rod", 0, found["crawled_and_differed"], 0)


def _random(oracle: str, model: str, found: dict) -> Iterator[Row]:
    count = found["count"]
    yield row(f"{oracle}: not converged", model, 0, found["unconverged"], 0)
    yield row("  largest residual, of EI / length", model, 0, found["worst_residual"], 1e-9)
    yield row("  stable", model, count, found["stable"], 0.0005 * count)
    named = found["unloaded_branch"] + found["fallen"]
    yield row("  on the unloaded shape's branch, or fallen from its end", model, count, named, 0)
    yield row("  of these fallen, at most 1 in 100", model, 0, found["fallen"], 0.01 * count)


QUICK: dict[str, Callable[[], Iterator[Row]]] = {
    "cantilever": cantilever,
    "moment": moment_in_space,
    "bend45": bend_of_45_degrees,
    "models": other_models,
    "order": order,
    "invariance": invariance,
    "work": work_along_the_path,
}
SLOW: dict[str, Callable[[], Iterator[Row]]] = {
    "pyelastica": pyelastica,
    "spatial-loads": random_spatial_loads,
}
