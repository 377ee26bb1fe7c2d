"""Checks whether the bound is reached: maximum a posteriori fits of the whole model to noisy lines of single frames.

    OMP_NUM_THREADS=1 .venv/bin/python -m bench.studies.limits_monte_carlo --preset bench-2021 --session 40 --draws 60

In each draw the true frame is seen with noise, everything that is known beforehand is known with an error as wide as
its prior, and all unknowns are fitted: Gauss-Newton on the rod and the camera themselves, the seen line held against
the predicted one point by point. ``--width`` scales priors and noise: with small ones all is linear, and the ratio of
the errors' variance to the bound must be 1; with 1 it shows the effect of the model's nonlinearity.
"""

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from bench.studies.line_noise import POINTS, line_errors, line_grid

from tipforce.limits import (
    CENTRELINE_NOISE,
    BoundInputs,
    bound_inputs,
    centreline_jacobian,
    perturb_lens,
    unknown_parameters,
)
from tipforce.mechanics import contact_derivatives, posterior_covariance
from tipforce.simulation import PRESETS, SimulatedBench

MAX_STEPS = 30
CONVERGED_SHARE = 0.1
"""A fit has converged where the next step is shorter than this share of the posterior standard deviation."""
NEARLY_CONVERGED_SHARE = 0.7
"""A fit has converged at this share, too, if no smaller error is found along the step."""
MIN_STEP_SHARE = 1e-3
"""Share of a step below which no smaller one is tried."""
MIN_CAMERA_DISTANCE_M = 0.1
"""Smallest plausible distance of the camera."""


def at(inputs: BoundInputs, frame: int) -> BoundInputs:
    """One frame of a session."""
    rows = ("stamp_ns", "force_n", "touch_m", "touching", "lines_m", "curvature_per_m", "knob_deg")
    return replace(inputs, **{name: getattr(inputs, name)[frame : frame + 1] for name in rows})


def moved(inputs: BoundInputs, change: dict[str, float]) -> BoundInputs:
    """The frame with its unknowns changed."""
    bench_model, lens, force = inputs.bench_model, inputs.lens, inputs.force_n.copy()
    rod, parameters = bench_model.rod, bench_model.parameters
    joints = np.linspace(0.0, 1.0, rod.segments + 1)
    curvature, touch = inputs.curvature_per_m, inputs.touch_m
    for name, value in change.items():
        match name:
            case "force along the base tangent":
                force[:, 0] += value
            case "force across it in the image":
                force[:, 1] += value
            case "force in depth":
                force[:, 2] += value
            case "place of the touch on the dome":
                true = inputs.force_n[0]
                arm = np.array([true[1], -true[0], 0.0]) * np.linalg.norm(true) / (true[0] ** 2 + true[1] ** 2)
                touch = touch + value * arm
            case "stiffness EI":
                rod = replace(rod, bending_stiffness_nm2=rod.bending_stiffness_nm2 * (1 + value),
                              torsional_stiffness_nm2=rod.gj_nm2 * (1 + value))  # fmt: skip
            case "proximal stiffening":
                rod = replace(rod, stiffness_profile=np.asarray(rod.stiffness_profile) * (1 + value * (joints < 1 / 3)))
            case "creep, relative":
                pass  # a frame by itself has not crept: nothing depends on it
            case "free length":
                rod = replace(rod, flexible_length_m=rod.flexible_length_m + value)
            case "knob factor" | "knob drift":
                curvature = curvature + value * inputs.curvature_per_m
            case "place in the backlash":
                curvature = curvature + value * inputs.settings.world.actuation.gain_per_m_deg * parameters.knob_factor
            case "bend out of the plane":
                rest = np.asarray(rod.precurvature_per_m) + np.array([0.0, value, 0.0])
                rod = replace(rod, precurvature_per_m=rest)
            case _:
                lens = perturb_lens(lens, name, value)
    return replace(
        inputs,
        bench_model=replace(bench_model, rod=rod),
        lens=lens,
        force_n=force,
        touch_m=touch,
        curvature_per_m=curvature,
    )


def line_px(inputs: BoundInputs) -> np.ndarray:
    """(97, 2): the line of a frame in the image."""
    rod, curvature, shaft = inputs.bench_model.rod, inputs.curvature_per_m, inputs.settings.world.shaft
    found = contact_derivatives(
        rod, inputs.lines_m, inputs.force_n, inputs.touch_m, 97, tip_radius_m=inputs.bench_model.radius_m,
        precurvature_change_per_m=np.stack([0 * curvature, 0 * curvature, curvature], axis=1),
        time_s=inputs.time_s, creep=shaft.creep_share, creep_time_s=shaft.creep_s,
    )  # fmt: skip
    return inputs.lens.camera(inputs.settings.width, inputs.settings.height).project(found.centreline_m[0])


def seen_px(line: np.ndarray, errors: np.ndarray, width: int, height: int) -> np.ndarray:
    """(POINTS, 2): the true ``line`` as it is seen with ``errors`` (POINTS + 1,) in px, see `line_errors`."""
    points, along, left = line_grid(line, width, height)[:3]
    seen = points + errors[:-1, None] * left
    seen[-1] += errors[-1] * along[-1]
    return seen


def errors_of(inputs: BoundInputs, seen: np.ndarray, found: np.ndarray, names: list[str]) -> np.ndarray | None:
    """Returns the distance of ``seen`` from the line that the unknowns ``found`` predict, in m; None without a line."""
    settings = inputs.settings
    try:
        now = moved(inputs, dict(zip(names, found.tolist(), strict=True)))
        line = line_px(now)
    except ValueError:  # a rod bent beyond the limit of its law: too long a step
        return None
    if now.lens.distance_m < MIN_CAMERA_DISTANCE_M:
        return None
    scale = inputs.lens.scale_m_per_px * 640.0 / settings.width
    errors = scale * line_errors(seen, line, settings.width, settings.height)[0]
    return errors if np.isfinite(errors).all() else None


def fit(
    inputs: BoundInputs, seen: np.ndarray, means: np.ndarray, stds: np.ndarray, names: list[str], whiten: np.ndarray
) -> tuple[np.ndarray, bool]:
    """The most probable change of the unknowns, and whether the fit has converged."""
    found = means.copy()
    errors = errors_of(inputs, seen, found, names)
    if errors is None:
        return found, False
    for _ in range(MAX_STEPS):
        rows, _, stable = centreline_jacobian(moved(inputs, dict(zip(names, found.tolist(), strict=True))))
        if not stable[0]:
            return found, False
        slopes = whiten @ np.stack([rows[name][0] for name in names], axis=1)
        left = np.concatenate([whiten @ errors, (means - found) / stds])
        whole = np.vstack([slopes * stds, np.eye(len(names))])
        step = np.linalg.lstsq(whole, left)[0]
        if np.linalg.norm(whole @ step) < CONVERGED_SHARE:
            return found + stds * step, True
        share = 1.0
        while share > MIN_STEP_SHARE:
            tried = found + share * stds * step
            there = errors_of(inputs, seen, tried, names)
            if (
                there is not None
                and np.sum((whiten @ there) ** 2) + np.sum(((means - tried) / stds) ** 2) < left @ left
            ):
                break
            share *= 0.5
        else:
            # Nothing better near: the slopes, at points a little apart from those compared, aim a little beside.
            return found, bool(np.linalg.norm(whole @ step) < NEARLY_CONVERGED_SHARE)
        found, errors = tried, there
    return found, False


def main() -> None:
    """Draws, fits and prints."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--preset", default="bench-2021", choices=list(PRESETS))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--session", type=int, default=40)
    parser.add_argument("--frames", type=int, default=3, help="of those in contact, evenly by force")
    parser.add_argument("--draws", type=int, default=60)
    parser.add_argument("--width", type=float, default=1.0, help="scale of priors and noise")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    inputs = bound_inputs(SimulatedBench(PRESETS[options.preset], options.seed, options.session))
    size = np.linalg.norm(inputs.force_n, axis=1)
    order = np.flatnonzero(inputs.touching & (size > 0.02))
    order = order[np.argsort(size[order])]
    chosen = order[np.linspace(0, len(order) - 1, options.frames + 2).astype(int)[1:-1]]
    rng = np.random.default_rng(1)
    every = unknown_parameters(inputs.settings, inputs.bench_model.parameters)
    unknowns = [unknown for unknown in every if not unknown.name.startswith("creep")]
    names = [unknown.name for unknown in unknowns]
    stds = options.width * np.array([unknown.std for unknown in unknowns])
    noise, width, height = CENTRELINE_NOISE[options.preset], inputs.settings.width, inputs.settings.height
    scale = inputs.lens.scale_m_per_px * 640.0 / width
    results: list[dict[str, Any]] = []
    for frame in chosen.tolist():
        here = at(inputs, frame)
        rows, arc, _ = centreline_jacobian(here)
        root = options.width * np.linalg.cholesky(noise.fresh.covariance_m2(arc) + noise.lasting.covariance_m2(arc))
        whiten = np.linalg.inv(root)
        slopes = whiten @ np.stack([rows[name][0] for name in names], axis=1)
        bound = posterior_covariance(slopes[None], np.diag(stds**2), 3)[0, :2, :2]
        line, errors, lost = line_px(here), [], 0
        for _ in range(options.draws):
            seen = seen_px(line, root @ rng.standard_normal(POINTS + 1) / scale, width, height)
            found, converged = fit(here, seen, stds * rng.standard_normal(len(stds)), stds, names, whiten)
            lost += not converged
            if converged:
                errors.append(found[:2])
        if not errors:
            print(f"frame {frame}: no fit has converged", flush=True)
            continue
        covariance = np.array(errors).T @ np.array(errors) / len(errors)
        results.append({
            "frame": frame,
            "force_mn": (1e3 * here.force_n[0]).round(1).tolist(),
            "converged": len(errors),
            "not_converged": lost,
            "bound_fx_fy_mn": (1e3 * np.sqrt(np.diag(bound))).round(3).tolist(),
            "errors_fx_fy_mn": (1e3 * np.sqrt(np.diag(covariance))).round(3).tolist(),
            "variance_over_bound": float(np.trace(np.linalg.solve(bound, covariance)) / 2),
        })  # fmt: skip
        print(json.dumps(results[-1]), flush=True)
    mean = float(np.mean([row["variance_over_bound"] for row in results]))
    print(f"variance over bound, mean of {len(results)} frames: {mean:.3f}")
    if options.json:
        options.json.write_text(json.dumps({"frames": results, "mean": mean}, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
