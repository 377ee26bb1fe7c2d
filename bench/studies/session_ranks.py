"""Checks the session model on sessions that are drawn from the model itself (simulation-based calibration).

    .venv/bin/python -m bench.studies.session_ranks [--preset varied] [--seed 78000] [--sessions 40] [--out ranks.json]

The metadata are those of a preset's sessions. Constants, slow states, force and line of each frame are drawn from the
model's own priors, so that nothing but the inference can be wrong. A rank is the posterior probability of a smaller
magnitude than the true one: in each tenth of the range there should be a tenth of the frames. Ranks come from the
posterior, the intervals are those that `SessionFilter` returns, widened to all forces that explain the line.
Forces for which the rod has no stable shape are drawn again. Each frame has a direction of its own, so none is
remembered. Source: Talts et al., Validating Bayesian inference
algorithms with simulation-based calibration, 2018.
"""

import argparse
import json
import math
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from tipforce.estimators.session import (
    MODES,
    POINTS,
    Knowledge,
    LineError,
    Mixed,
    RodTrackSettings,
    SessionFilter,
    noise_unit_m,
    rod_model,
)  # fmt: skip
from tipforce.estimators.session._mixture import _ACROSS, _ACROSS_SHARE, _NEAR_NOTHING, is_possible
from tipforce.estimators.session._state import (
    COUNT,
    GAIN,
    K0,
    LEVER,
    PLAY,
    ROD,
    SessionState,
    fill_camera_modes,
    line_modes,
)  # fmt: skip
from tipforce.estimators.session._walk import Session, make_scratch, predict
from tipforce.mechanics.planar import FORCE, UNKNOWNS, Line, make_work
from tipforce.simulation import PRESETS, SimulatedBench
from tipforce.simulation.world import FAST
from tipforce.types import FloatArray, SessionInfo

FRAME_S, FRAMES = 0.2, 100
KNOB_TURN_DEG, KNOB_TURN_S = 6.0, 12.0
"""The knob turns to and fro."""
LINE_STEPS, LINE_ERROR_M = 12, 1e-8
STRATA_N = (0.0, 0.1, 0.2, 0.3, 0.8)
CHECKED = ("stiffness", "length", "base_angle_rad", "tilt_x_per_m")
GAUSS_90 = 1.6448536


class World:
    """One session that is drawn from the model: its truth, and the lines of its frames.

    Args:
        settings: settings of the model.
        info: the session metadata.
        rng: source of randomness.
    """

    def __init__(self, settings: RodTrackSettings, info: SessionInfo, rng: np.random.Generator) -> None:
        self._settings, self._rng, prior = settings, rng, settings.prior
        self.model = rod_model(info, settings.segments)
        scale = info.view(settings.vision.view).metres_per_px
        assert scale is not None
        self.scale = scale
        self._has_knob = info.actuation.knob_gain_per_m_deg is not None
        self._phase = rng.uniform(0.0, 2.0 * math.pi)
        state = SessionState(settings, Knowledge.stated(settings), info, self.knob_deg(0))
        self._half_play_deg = 0.5 * (
            prior.knob_play_deg if info.actuation.knob_play_deg is None else info.actuation.knob_play_deg
        )
        self.q = np.zeros(COUNT)
        self.q[FORCE:] = rng.multivariate_normal(state.mean[FORCE:], state.covariance[FORCE:, FORCE:])
        self.q[PLAY] = rng.uniform(-1.0, 1.0) * self._half_play_deg
        unit_m = noise_unit_m(self.model, scale)
        error = LineError.of(settings.noise, MODES)
        self._modes, whiten = line_modes(error, unit_m), error.whiten / unit_m
        self._unwhiten = np.linalg.inv(whiten)
        self._gain = state.gain_per_m_deg
        self._session = Session(
            self.model, self._modes, whiten, self._gain, self.knob_deg(0),
            prior.friction * self.model.dome_m / self.model.stiffness_nm2, settings.huber, prior.largest_force_n,
        )  # fmt: skip
        self._scratch = make_scratch(make_work(self.model, POINTS, COUNT), COUNT)
        self._crept = np.zeros(self.model.segments + 1)
        self._touches = rng.random() < prior.contact_share

    def knob_deg(self, frame: int) -> float:
        """Returns the reading of the knob; NaN: there is none."""
        if not self._has_knob:
            return math.nan
        return KNOB_TURN_DEG * math.sin(self._phase + 2.0 * math.pi * FRAME_S * frame / KNOB_TURN_S)

    def advance(self, frame: int) -> None:
        """Draws the slow states and the contact of the next frame."""
        settings, rng, q = self._settings, self._rng, self.q
        before, knob = self._session.knob_deg, self.knob_deg(frame)
        if self._gain:
            drift = settings.knob_drift * self._gain * abs(before) * math.sqrt(2.0 * FRAME_S / settings.knob_drift_s)
            q[K0] += rng.normal(0.0, drift)
            q[PLAY] = np.clip(q[PLAY] - (knob - before), -self._half_play_deg, self._half_play_deg)
            self._session = self._session._replace(knob_deg=knob)
        for name, walk in (
            ("base_x_m", settings.base_walk_m), ("base_y_m", settings.base_walk_m),
            ("base_angle_rad", math.radians(settings.base_walk_deg)),
        ):  # fmt: skip
            q[UNKNOWNS.index(name)] += rng.normal(0.0, walk * math.sqrt(FRAME_S))
        for part, lasts_s in (
            (slice(ROD, ROD + MODES), settings.line_error_s),
            (slice(LEVER, COUNT), settings.friction_s),
        ):
            keeps = math.exp(-FRAME_S / lasts_s)
            q[part] = keeps * q[part] + math.sqrt(1.0 - keeps**2) * rng.standard_normal(q[part].shape)
        change = 1.0 - math.exp(-FRAME_S / settings.contact_s)
        self._touches ^= rng.random() < change

    def line(self) -> Line | None:
        """Draws a force and the line of this frame; None: the session's constants have no stable rod."""
        for _ in range(60):
            size = self._rng.uniform(0.0, self._settings.prior.largest_force_n) if self._touches else 0.0
            way = self._rng.uniform(-math.pi, math.pi)
            self.q[:FORCE] = size * math.cos(way), size * math.sin(way)
            line = self._drawn()
            if line is not None:
                return line
        return None

    def _drawn(self) -> Line | None:
        scratch, model, q = self._scratch, self.model, self.q
        along = np.linspace(0.0, model.flexible_m, POINTS)
        straight = np.column_stack([along, np.zeros(POINTS)])
        middle = np.array([0.5 * model.flexible_m, 0.0])
        line = Line(
            straight, np.tile([0.0, 1.0], (POINTS, 1)), along[::-1].copy(), middle, np.zeros(2), False, self._crept
        )
        force = q[:FORCE].copy()
        scratch.rod.theta[:] = 0.0
        for share in np.linspace(0.0, 1.0, 13):  # from the unloaded rod on: the same branch as a catheter's
            q[:FORCE] = share * force
            if not predict(q, self._session, line, scratch):
                return None
        size, theta = math.hypot(*force), scratch.rod.theta
        largest_n = self._settings.prior.largest_force_n
        if size > 0.0 and not is_possible(*force, size, math.cos(theta[-1]), math.sin(theta[-1]), largest_n):
            return None
        points = self._projected(scratch.rod.nodes, middle)
        error = self._unwhiten @ self._rng.standard_normal(POINTS + 1)
        left = np.full(POINTS + 1, np.inf)
        for _ in range(LINE_STEPS):
            chord = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
            curve = CubicSpline(chord, points)
            tangents = curve(chord, 1)
            tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
            normals = np.column_stack([-tangents[:, 1], tangents[:, 0]])
            fine = np.linspace(0.0, chord[-1], 40 * POINTS)
            arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve(fine), axis=0), axis=1))])
            from_tip = arc[-1] - np.interp(chord, fine, arc)
            line = line._replace(points=points, normals=normals, from_tip=from_tip)
            if np.abs(left).max() < LINE_ERROR_M:
                break
            fill_camera_modes(self._modes, line, model, self._settings)
            if not predict(q, self._session, line, scratch):
                return None
            left = error - scratch.rod.residual
            points = points + left[:-1, None] * normals
            points[-1] += left[-1] * tangents[-1]
        self._creep(theta)
        return line

    def _projected(self, nodes: FloatArray, middle: FloatArray) -> FloatArray:
        q = dict(zip(UNKNOWNS, self.q[:ROD].tolist(), strict=True))
        arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(nodes, axis=1), axis=0))])
        at = np.linspace(0.0, arc[-1], POINTS)
        x, y = (np.interp(at, arc, each) for each in nodes)
        c, s, larger = math.cos(q["base_angle_rad"]), math.sin(q["base_angle_rad"]), 1.0 + q["scale"]
        from_middle = np.column_stack([c * x - s * y, s * x + c * y]) / larger + (q["base_x_m"], q["base_y_m"]) - middle
        tilt = from_middle @ (q["tilt_x_per_m"], q["tilt_y_per_m"])
        grow = 1.0 + tilt + q["distortion_per_m2"] * (from_middle**2).sum(axis=1)
        return middle + grow[:, None] * from_middle

    def _creep(self, theta: FloatArray) -> None:
        keeps = math.exp(-FRAME_S / self._settings.creep_s)
        bend = np.diff(theta, prepend=0.0) * self.model.segments / self.model.flexible_m - self.curvature_per_m()
        bend[[0, -1]] = bend[[1, -2]]
        self._crept = keeps * self._crept + (1.0 - keeps) * bend

    def curvature_per_m(self) -> float:
        """Returns the curvature of the unloaded rod."""
        knob = self._session.knob_deg if self._gain else 0.0
        return float(self.q[K0] + self._gain * (knob * (1.0 + self.q[GAIN]) + self.q[PLAY]))


class RankedFilter(SessionFilter):
    """The filter, which also gives ranks from the nodes of its last walk."""

    def _force(self, fits: Any, line: Any, share: float, reading: Any) -> Mixed:
        self._last = fits, float(self._shapes["touch" if fits.found else "free"][-1])
        return super()._force(fits, line, share, reading)

    def rank(self, true_n: float, contact: float, rng: np.random.Generator) -> float:
        """Returns the posterior probability of a smaller magnitude than ``true_n``.

        Args:
            true_n: true magnitude.
            contact: posterior probability of contact.
            rng: draws the rank of no force within the probability of no contact.
        """
        fits, angle = self._last
        if true_n == 0.0:
            return float(rng.random() * (1.0 - contact))
        if fits.found == 0:
            return 1.0 - contact
        scratch = self._scratch
        forces, across_std, weights, rates = (
            each[: fits.found] for each in (scratch.forces, scratch.across_std, scratch.weights, scratch.node_rates)
        )
        across = forces[:, :1] + _ACROSS * across_std[:, None]
        along = np.broadcast_to(forces[:, 1:], across.shape)
        x, y = fits.c * along - fits.s * across, fits.s * along + fits.c * across
        size = np.hypot(x, y)
        largest_n = self._settings.prior.largest_force_n
        pushes = np.vectorize(is_possible)(x, y, size, math.cos(angle), math.sin(angle), largest_n)
        counted = _ACROSS_SHARE * (size <= largest_n)
        density = np.abs(rates[:, 0]) * weights / np.maximum(counted.sum(axis=1), 1e-300)
        share = (density[:, None] * counted * pushes / np.hypot(size, _NEAR_NOTHING * fits.step_n)).ravel()
        if share.sum() == 0.0:
            return 1.0 - contact
        order = np.argsort(size, axis=None)
        sizes, shares = size.ravel()[order], share[order] / share.sum()
        below = np.cumsum(shares) - 0.5 * shares
        return float(1.0 - contact + contact * np.interp(true_n, sizes, below, 0.0, 1.0))


def session(preset: str, seed: int, number: int) -> dict[str, Any]:
    """Draws one session and filters it.

    Args:
        preset: name of the preset that gives the metadata.
        seed: seed of the sessions.
        number: number of the session.

    Returns:
        Figures of its frames, and normal scores of constants at its end.
    """
    settings = RodTrackSettings(direction_s=0.0)
    info = SimulatedBench(PRESETS[preset], seed, number, resolution=FAST).session_info
    rng = np.random.default_rng([seed, number, 80])
    world = World(settings, info, rng)
    filter_ = RankedFilter(settings, Knowledge.stated(settings), world.model, info)
    frames: list[dict[str, float]] = []
    for frame in range(FRAMES):
        world.advance(frame)
        line = world.line()
        if line is None:
            break
        found = filter_.step(line, world.scale, world.knob_deg(frame), FRAME_S)
        force, true = found.force, world.q[:FORCE].copy()
        size = float(np.hypot(*true))
        frames.append({
            "time_s": FRAME_S * frame, "true_n": size, "explained": found.explained, "contact": force.contact,
            "found_n": float(np.hypot(*force.force_n)), "low_n": float(force.low_n[2]),
            "high_n": float(force.high_n[2]), "rank": filter_.rank(size, force.contact, rng),
        })  # fmt: skip
    scores = {}
    if filter_.state is not None:
        mean, covariance = filter_.state.mean, filter_.state.covariance
        for name in CHECKED:
            k = UNKNOWNS.index(name)
            scores[name] = float((world.q[k] - mean[k]) / math.sqrt(covariance[k, k]))
        curvature, std = filter_.state.unloaded_curvature_per_m()
        scores["unloaded curvature"] = (world.curvature_per_m() - curvature) / std
    return {"session": number, "frames": frames, "scores": scores}


def _tenths(ranks: FloatArray) -> str:
    return " ".join(f"{each:.3f}" for each in np.histogram(ranks, 10, (0.0, 1.0))[0] / len(ranks))


def table(rows: list[dict[str, Any]]) -> str:
    """Returns the text of the results."""
    frames = [frame for row in rows for frame in row["frames"] if frame["explained"]]
    total = sum(len(row["frames"]) for row in rows)
    lines = [f"{len(rows)} sessions, {total} frames, {len(frames)} explained by the rod"]
    strata: list[tuple[str, list[dict[str, float]]]] = [("no force", [f for f in frames if f["true_n"] == 0.0])]
    pushed = [f for f in frames if f["true_n"] > 0.0]
    strata.append(("all in contact", pushed))
    for low, high in pairwise(STRATA_N):
        strata.append((f"{low:g} to {high:g} N", [f for f in pushed if low < f["true_n"] <= high]))
    for name, own in strata:
        if own:
            ranks = np.array([f["rank"] for f in own])
            held = np.mean([f["low_n"] <= f["true_n"] <= f["high_n"] for f in own])
            error = np.mean([abs(f["found_n"] - f["true_n"]) for f in own])
            inner = np.mean((ranks > 0.05) & (ranks < 0.95))
            lines.append(
                f"{name}: {len(own)} frames, intervals hold {held:.1%}, {inner:.1%} of the ranks within 0.05 and 0.95, "
                f"off by {1e3 * error:.0f} mN; tenths {_tenths(ranks)}"
            )
    lines.append(f"all ranks in tenths: {_tenths(np.array([f['rank'] for f in frames]))}")
    for name in rows[0]["scores"]:
        scores = np.array([row["scores"][name] for row in rows if row["scores"]])
        lines.append(
            f"{name} at the end: mean {scores.mean():+.2f}, standard deviation {scores.std():.2f} of the stated one, "
            f"90 % interval holds {np.mean(np.abs(scores) < GAUSS_90):.0%}"
        )
    return "\n".join(lines)


def main() -> None:
    """Draws, filters and prints."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--preset", default="varied", choices=list(PRESETS))
    parser.add_argument("--seed", type=int, default=78_000)
    parser.add_argument("--sessions", type=int, default=40)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    rows = []
    for number in range(options.sessions):
        rows.append(session(options.preset, options.seed, number))
        if options.out:
            options.out.write_text(json.dumps(rows) + "\n", encoding="utf-8")
    print(table(rows))


if __name__ == "__main__":
    main()
