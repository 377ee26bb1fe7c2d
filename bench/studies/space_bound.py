"""The error of `rod-3d` over the bound of the shape, on true lines of simulated `biplane` sessions with measured noise.

    .venv/bin/python -m bench.studies.space_bound --seed 109000 --sessions 20

Sessions, lines and noise are those of case "base" of `space_sensitivity`. The bound is the posterior Cramer-Rao bound
of the force by all lines until then (Tichavsky, Muravchik and Nehorai, 1998). Constants and noise are those of
`rod-3d`, but base and shaft do not drift (`STILL`); contact is known. The equations are linearised where the constants
explain the lines best under the true force. Along a straight tip the shape answers a force in second order: there the
bound is large, and the prior of the force helps.
"""

import argparse
from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise

import numpy as np
from bench.studies.space_sensitivity import CASES, rows_of, true_session
from bench.studies.space_sessions import ANGLES_DEG, CONTACT_N, FORCES_N

from tipforce.estimators.space import SpaceSettings
from tipforce.estimators.space._constants import FORCE, Constants
from tipforce.estimators.space._filter import SpaceFilter, SpaceResult, ViewShape
from tipforce.estimators.space._posterior import Problem, hold, linearise
from tipforce.types import FloatArray, SessionInfo

SETTINGS = SpaceSettings(views=("a", "b"))
STILL = SETTINGS.model_copy(update={"base_walk_m": 0.0, "base_walk_deg": 0.0, "curvature_walk_per_m": 0.0})
"""As in the simulation: the base does not move, and the unloaded shaft changes by knob, play and drift only."""
STEPS = 8
"""Gauss-Newton steps to the constants under the true force."""
MAX_BOUND_N = 0.1
"""Frames in which the bound allows this standard deviation at most are also counted alone."""


class Recorded(SpaceFilter):
    """The model, which keeps the lines of each instant with their noise, a shape, the elapsed time and the knob."""

    def __init__(self, info: SessionInfo) -> None:
        super().__init__(SETTINGS, 0.5, info)
        self.kept: list[tuple[Problem, FloatArray, float, float]] = []

    def step(self, seen: Mapping[str, ViewShape], knob_deg: float, elapsed_s: float, advance_m: float) -> SpaceResult:
        """Adds the instant to ``kept``; see `SpaceFilter.step`."""
        self._newest: Problem | None = None
        result = super().step(seen, knob_deg, elapsed_s, advance_m)
        assert self._newest is not None
        self.kept.append((self._newest, self._last["free"][1].copy(), elapsed_s, knob_deg))
        return result

    def _solve(self, problem: Problem, log_odds: float):
        self._newest = self._newest or problem
        return super()._solve(problem, log_odds)


def bounds_n(info: SessionInfo, kept: list[tuple[Problem, FloatArray, float, float]], truth: FloatArray) -> FloatArray:
    """Returns (n,): the least standard deviation of the magnitude at each instant; NaN without contact.

    Args:
        info: the session metadata.
        kept: lines, shape, elapsed time and knob of each instant.
        truth: (n, 3) true forces, N.
    """
    constants = Constants(STILL, info, STILL.views, kept[0][3], several=True)
    found = np.full(len(truth), np.nan)
    for k, (problem, quaternions, elapsed_s, knob_deg) in enumerate(kept):
        constants.predict(elapsed_s, knob_deg)
        information = np.zeros_like(constants.covariance)
        information[FORCE:, FORCE:] = np.linalg.inv(constants.covariance[FORCE:, FORCE:])
        own = replace(problem, mean=constants.mean.copy(), information=information)
        q, shape = constants.mean.copy(), quaternions[None].copy()
        q[:FORCE] = truth[k]
        for _ in range(STEPS):
            linear = linearise(own, q[None], shape)
            matrix, side = linear.matrix[0].copy(), linear.side[0].copy()
            hold(matrix, side, 0, FORCE)
            q += np.linalg.solve(matrix, side)
        matrix = linearise(own, q[None], shape).matrix[0]
        size_n = float(np.linalg.norm(truth[k]))
        if size_n <= CONTACT_N:
            hold(matrix, np.zeros(len(q)), 0, FORCE)
        covariance = np.linalg.inv(matrix)
        if size_n > CONTACT_N:
            direction = truth[k] / size_n
            found[k] = np.sqrt(direction @ covariance[:FORCE, :FORCE] @ direction)
        q[:FORCE] = covariance[:FORCE] = covariance[:, :FORCE] = 0.0
        constants.mean, constants.covariance = q, covariance
    return found


def line(title: str, off: FloatArray, bound: FloatArray) -> str:
    """Returns the errors (n,) of the magnitude beside their bounds (n,), in mN."""
    rms, least = (1e3 * float(np.sqrt((values**2).mean())) for values in (off, bound))
    small = bound <= MAX_BOUND_N
    part = f"{rms:6.1f} over {least:6.1f} mN rms = {rms / least:.2f}, median bound {1e3 * np.median(bound):.1f}"
    if small.any():
        rms, least = (1e3 * float(np.sqrt((values[small] ** 2).mean())) for values in (off, bound))
        part += f"; bound up to 100 mN ({100.0 * small.mean():.0f} %): {rms:.1f} over {least:.1f} = {rms / least:.2f}"
    return f"{title:>16}: {len(off):5d} | {part}"


def main() -> None:
    """Prints the errors over their bounds."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=109000)
    parser.add_argument("--sessions", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=10.0)
    options = parser.parse_args()
    parts: list[FloatArray] = []
    for number in range(options.sessions):
        session = true_session(options.seed, number, options.seconds, None)
        model = Recorded(session.info)
        rows = np.array(rows_of(session, CASES["base"], (options.seed, number), by=model))
        bound = bounds_n(session.info, model.kept, rows[:, :3])
        size, said = np.linalg.norm(rows[:, :3], axis=1), np.linalg.norm(rows[:, 3:6], axis=1)
        angle = np.degrees(
            np.arccos(np.clip(-(rows[:, :3] * rows[:, 14:17]).sum(axis=1) / np.maximum(size, 1e-9), -1, 1))
        )
        use = np.isfinite(said) & np.isfinite(bound)
        parts.append(np.column_stack([said - size, bound, size, angle])[use])
        print(line(str(number), parts[-1][:, 0], parts[-1][:, 1]), flush=True)
    off, bound, size, angle = np.concatenate(parts).T
    for values, edges, unit in ((size, FORCES_N, "N"), (angle, ANGLES_DEG, "deg")):
        for low, high in pairwise(edges):
            part = (values >= low) & (values < high)
            if part.any():
                print(line(f"{low:g} to {high:g} {unit}", off[part], bound[part]))
    print(line("all", off, bound))


if __name__ == "__main__":
    main()
