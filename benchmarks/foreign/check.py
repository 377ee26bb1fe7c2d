"""MuJoCo's cable against the exact elastica, and its contact force against the reaction of the clamp."""

import math
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from scipy.integrate import solve_bvp

from tipforce.io import atomic_path
from tipforce.types import FloatArray

from .rod import CableWorld, Rod, Tissue

__all__ = ["check"]

LOADS = (0.5, 1.0, 2.0, 5.0)
"""P L^2 / EI of a dead load across the tip."""
SETTLED_S = 0.6


def elastica(alpha: float, points: int = 200) -> FloatArray:
    """(n, 2): the cantilever of length one under the load ``alpha``, by theta'' = -alpha cos(theta)."""

    def rates(_: FloatArray, state: FloatArray) -> FloatArray:
        theta, bend = state[:2]
        return np.vstack([bend, -alpha * np.cos(theta), np.cos(theta), np.sin(theta)])

    def ends(base: FloatArray, tip: FloatArray) -> FloatArray:
        return np.array([base[0], tip[1], base[2], base[3]])

    s = np.linspace(0.0, 1.0, points)
    guess = np.vstack([alpha * s / 3, alpha * (1 - s) / 3, s, 0 * s])
    return solve_bvp(rates, ends, s, guess, tol=1e-8).sol(s)[2:].T


def check(output: Path | None) -> None:
    """Prints both comparisons; draws the first into ``output``/foreign-check.svg."""
    mpl.rcParams["svg.hashsalt"] = "foreign"
    figure = Figure(figsize=(8, 3.2), layout="constrained")
    shapes, forces = figure.subplots(1, 2)
    print("dead load across the tip, P L^2 / EI: deflection and shortening over length; MuJoCo, exact")
    for alpha in LOADS:
        rod = Rod(rigid_m=1e-9)
        world = CableWorld(rod)
        load = alpha * rod.stiffness_nm2 / rod.length_m**2
        world.advance(SETTLED_S, dead_load_n=np.array([0.0, load, 0.0]))
        line, exact = world.joints_m[:-1, :2] / rod.length_m, elastica(alpha)
        print(f"  {alpha:3.1f}: {line[-1, 1]:.4f} {exact[-1, 1]:.4f}, {1 - line[-1, 0]:.4f} {1 - exact[-1, 0]:.4f}")
        shapes.plot(*exact.T, color="0.7", lw=4)
        shapes.plot(*line.T, "k.", ms=3)
    shapes.set(xlabel="x / L", ylabel="y / L", title="cable (points), elastica (line)", aspect="equal")
    print("pressed by a wall of 120 N/m: contact force and reaction of the clamp, mN")
    tissue = Tissue(120.0, "linear", 0.2, math.radians(250.0), 0.03)
    world = CableWorld(Rod(), tissue)
    world.advance(SETTLED_S, curvature_per_m=5.0, wall_m=np.array([1.0, 0.0, 0.0]))
    start, rows = world.end_m - 1e-3 * tissue.normal, []
    for depth in np.linspace(0.0, 14e-3, 141):
        world.advance(0.02, curvature_per_m=5.0, wall_m=start + depth * tissue.normal)
        rows.append([depth, *world.tip_force_n, *world.base_reaction_n])
    series = 1e3 * np.array(rows)
    print(
        f"  largest difference {np.abs(series[:, 1:4] - series[:, 4:]).max():.2f} of {np.abs(series[:, 1:4]).max():.0f}"
    )
    for axis, name in enumerate("xy"):
        forces.plot(series[:, 0], series[:, 4 + axis], color="0.7", lw=4)
        forces.plot(series[::5, 0], series[::5, 1 + axis], "k.", ms=3)
        forces.annotate(f"f{name}", series[-1, [0, 1 + axis]])
    forces.set(xlabel="way of the wall, mm", ylabel="mN", title="contact (points), clamp (line)")
    if output is not None:
        output.mkdir(parents=True, exist_ok=True)
        with atomic_path(output / "foreign-check.svg") as part:
            figure.savefig(part, format="svg", metadata={"Date": None})
