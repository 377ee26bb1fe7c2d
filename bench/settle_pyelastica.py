"""A clamped rod in PyElastica, loaded at its tip and damped until it rests: another program's answer to a dead load."""

import time
import warnings
from collections.abc import Iterator

import numpy as np

from tipforce.mechanics import SpatialRod, solve_static_spatial

LOADS = {
    "across": ((0.0, 0.0, 0.0), (0.0, 2.0, 1.0)),
    "against a bent and twisted shaft": ((0.0, 1.0, 0.5), (-1.0, 1.5, 2.0)),
    "along and across": ((0.7, 1.2, -0.6), (1.0, -2.0, 2.0)),
}
"""Strain without load and force, as `settle` takes them."""


def settle(rest: np.ndarray, force: np.ndarray, elements: int = 20) -> Iterator[tuple[np.ndarray, float, float, float]]:
    """Yields, from time to time until it rests: the tip (3,), CPU seconds, GJ / EI, length that is clamped.

    Rod of length and EI one along x, its strain without load ``rest`` = (twist, about y, about z), ``force`` (3,) dead.
    PyElastica's rod stretches and shears a little, by parts in ten thousand here. Its first element is held, so that
    the flexible length begins in the middle of it.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import elastica

    class Simulator(elastica.BaseSystemCollection, elastica.Constraints, elastica.Forcing, elastica.Damping):
        pass

    radius, density = 0.02, 1.0
    modulus = 4 / (np.pi * radius**4)
    simulator = Simulator()
    rod = elastica.CosseratRod.straight_rod(
        elements, np.zeros(3), np.array([1.0, 0, 0]), np.array([0.0, 1, 0]), 1.0, radius, density,
        youngs_modulus=modulus, shear_modulus=modulus / 3,
    )  # fmt: skip
    rod.rest_kappa[:] = np.array([rest[1], rest[2], rest[0]])[:, None]
    simulator.append(rod)
    simulator.constrain(rod).using(elastica.OneEndFixedBC, constrained_position_idx=(0,), constrained_director_idx=(0,))
    slowest = 3.516 / np.sqrt(density * np.pi * radius**2)  # first bending frequency, rad / s
    step = 0.25 / elements / np.sqrt(modulus / density)
    simulator.add_forcing_to(rod).using(
        elastica.EndpointForces, np.zeros(3), np.asarray(force, float), ramp_up_time=1.0 / slowest
    )
    simulator.dampen(rod).using(elastica.AnalyticalLinearDamper, uniform_damping_constant=2 * slowest, time_step=step)
    simulator.finalize()
    stepper, now, busy = elastica.PositionVerlet(), 0.0, 0.0
    torsion = rod.bend_matrix[2, 2, 0] / rod.bend_matrix[0, 0, 0]
    last = np.zeros(3)
    while True:
        began = time.process_time()
        until = now + 0.5 / slowest
        while now < until:
            now = stepper.step(simulator, now, step)
        busy += time.process_time() - began
        tip = rod.position_collection[:, -1].copy()
        yield tip, busy, torsion, 0.5 / elements
        if now > 4 / slowest and np.linalg.norm(tip - last) < 1e-5:
            return
        last = tip


def apart(strain: np.ndarray, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Tip where PyElastica's rod settles, and that of ours under the same load, (3,) each."""
    tip, _, torsion, held = list(settle(strain, force))[-1]
    shape = solve_static_spatial(SpatialRod(1 - 2 * held, 1.0, held, torsion, strain, segments=100), force)
    return tip - [held, 0, 0], shape.tip_m
