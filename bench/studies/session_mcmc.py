"""Checks the session model's inference against long Markov chains of the same model.

    .venv/bin/python -m bench.studies.session_mcmc --lines DIR --sessions 10 --out chains.json

Of each session some frames, first without contact, then in contact, are given to `SessionFilter`, which learns from
each. The same posterior (constants of the session; for each frame in contact the force along the chord, the position of
the tip across it, and a lever) is sampled by Hamiltonian Monte Carlo with the Hessian as its mass; the samples are then
weighed by the prior of the last force. Compared is the magnitude in the last frame, and the stiffness and the unloaded
curvature. Lines are from `session_posterior`. Creep and drift are left out of both, the knob has no play, the lever is
new in each frame, the tip's direction is that of the nearest line, and the chain knows where the tip touches.
"""

import argparse
import json
import math
import pickle
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from bench.studies.session_posterior import Lines, frame_of
from numba import njit

from tipforce.estimators.session import (
    POINTS,
    Knowledge,
    NoiseSettings,
    PriorSettings,
    RodTrackSettings,
    SessionFilter,
    rod_model,
)  # fmt: skip
from tipforce.estimators.session._mixture import is_possible
from tipforce.estimators.session._state import COUNT, GAIN, K0, SessionState, fill_camera_modes
from tipforce.estimators.session._walk import Scratch, Session, make_scratch, predict, predict_held
from tipforce.mechanics.planar import FORCE, UNKNOWNS, Line, loaded_point_aside, make_work
from tipforce.types import CentrelinePx, FloatArray

EI = UNKNOWNS.index("stiffness")
SHARED = COUNT - FORCE - 1
"""Number of unknowns that all frames share: all but the force and the lever."""
PER_FRAME = 3
SETTINGS = RodTrackSettings(
    prior=PriorSettings(creep=0.0, creep_std=1e-5, knob_play_deg=0.0, contact_share=0.5), friction_s=1e-3,
    update_s=0.0, line_error_s=1e6, knob_drift=1e-6, base_walk_m=0.0, base_walk_deg=0.0, contact_s=1e6, gap_s=1e6,
    direction_s=0.0, huber=1e3, max_misfit=1e3, across_error_n=0.0, noise=NoiseSettings(level_frames=1e6),
)  # fmt: skip


class Frames(NamedTuple):
    """Lines of one session, (n, ...): see `Line`; ``touching`` (n,), ``knob_deg`` (n,), ``modes`` (n, ...).

    ``chord`` (n, 2): direction from the clamp to the tip.
    """

    points: FloatArray
    normals: FloatArray
    from_tip: FloatArray
    middle: FloatArray
    knob_deg: FloatArray
    touching: np.ndarray
    modes: FloatArray
    chord: FloatArray


@njit(cache=True, nogil=True)
def density(
    x: FloatArray,
    mean: FloatArray,
    information: FloatArray,
    frames: Frames,
    session: Session,
    theta: FloatArray,
    reaction: FloatArray,
    scratch: Scratch,
    gradient: FloatArray,
    hessian: FloatArray,
    curved: bool = False,
) -> float:
    """Log density at ``x``: shared unknowns, then force along the chord, position across it and lever of each frame.

    Fills ``gradient``, then the information in ``hessian``, and ``reaction`` (n, 2): the force across the chord and its
    derivative by the position.
    """
    gradient[:] = 0.0
    hessian[:] = 0.0
    value = 0.0
    apart = x[:SHARED] - mean
    pull = information @ apart
    value -= 0.5 * apart @ pull
    gradient[:SHARED] -= pull
    hessian[:SHARED, :SHARED] += information
    q = np.zeros(COUNT)
    rows = POINTS + 1
    index = np.zeros(COUNT, np.int64)
    for t in range(len(frames.knob_deg)):
        own = SHARED + PER_FRAME * t
        q[FORCE : COUNT - 1] = x[:SHARED]
        for k in range(SHARED):
            index[FORCE + k] = k
        index[0], index[1], index[COUNT - 1] = own, own + 1, own + 2
        q[0], q[1], q[COUNT - 1] = x[own], x[own + 1], x[own + 2]
        value -= 0.5 * q[COUNT - 1] ** 2
        gradient[own + 2] -= q[COUNT - 1]
        hessian[own + 2, own + 2] += 1.0
        line = Line(
            frames.points[t], frames.normals[t], frames.from_tip[t], frames.middle[t], np.zeros(2), False, np.zeros(0),
        )  # fmt: skip
        now = Session(
            session.model, frames.modes[t], session.whiten, session.gain_per_m_deg, frames.knob_deg[t],
            session.lever_per_m_n, session.huber, session.largest_n, 0.0, frames.chord[t, 0], frames.chord[t, 1],
        )  # fmt: skip
        scratch.rod.theta[:] = theta[t]
        if frames.touching[t]:
            # flat in the force over the stiffness and in the position
            value -= math.log(1.0 + q[EI])
            gradient[EI - FORCE] -= 1.0 / (1.0 + q[EI])
            scratch.rod.reaction[0] = reaction[t, 0]
            if not predict_held(q, now, line, scratch):
                return -math.inf
            reaction[t, 0], reaction[t, 1] = scratch.rod.reaction[0], scratch.rates[0]
        else:
            q[0] = q[1] = 0.0
            if not predict(q, now, line, scratch):
                return -math.inf
            for k in range(2):  # two unknowns without a meaning
                value -= 0.5 * x[own + k] ** 2
                gradient[own + k] -= x[own + k]
                hessian[own + k, own + k] += 1.0
                scratch.rod.slopes[:, k] = 0.0
        theta[t] = scratch.rod.theta
        white = session.whiten @ scratch.rod.slopes
        residual = session.whiten @ scratch.rod.residual
        value -= 0.5 * residual @ residual
        for a in range(COUNT):
            for i in range(rows):
                gradient[index[a]] += white[i, a] * residual[i]
        if curved:
            matrix = white.T @ white
            for a in range(COUNT):
                for b in range(COUNT):
                    hessian[index[a], index[b]] += matrix[a, b]
    return value


@njit(cache=True, nogil=True)
def hamiltonian(
    x: FloatArray,
    root: FloatArray,
    mean: FloatArray,
    information: FloatArray,
    frames: Frames,
    session: Session,
    theta: FloatArray,
    reaction: FloatArray,
    scratch: Scratch,
    burn: int,
    leaps: int,
    normal: FloatArray,
    uniform: FloatArray,
) -> tuple[FloatArray, float]:
    """Samples (kept, n) from ``x`` on, and the share that was accepted; ``root``: of the inverse mass.

    ``normal`` (burn + kept, n), ``uniform`` (burn + kept, 2): random numbers. The step adapts in the first ``burn``.
    """
    n = x.size
    kept = len(normal) - burn
    gradient, hessian = np.zeros(n), np.zeros((n, n))
    trial_gradient = np.zeros(n)
    value = density(x, mean, information, frames, session, theta, reaction, scratch, gradient, hessian)
    found, accepted, step = np.zeros((kept, n)), 0.0, 0.3
    for k in range(burn + kept):
        momentum = normal[k]
        at, energy = x.copy(), value - 0.5 * momentum @ momentum
        trial_gradient[:] = gradient
        trial = value
        size = step * (0.5 + uniform[k, 0])
        before, reacted = theta.copy(), reaction.copy()
        for _ in range(leaps):
            momentum = momentum + 0.5 * size * (root.T @ trial_gradient)
            at = at + size * (root @ momentum)
            trial = density(at, mean, information, frames, session, theta, reaction, scratch, trial_gradient, hessian)
            if trial == -math.inf:
                break
            momentum = momentum + 0.5 * size * (root.T @ trial_gradient)
        chance = 0.0
        if trial > -math.inf:
            chance = min(1.0, math.exp(min(0.0, trial - 0.5 * momentum @ momentum - energy)))
        if uniform[k, 1] < chance:
            x, value = at, trial
            gradient[:] = trial_gradient
        else:
            theta[:], reaction[:] = before, reacted
        if k < burn:
            step = min(1.0, max(1e-3, step * math.exp(0.1 * (chance - 0.8))))
        else:
            found[k - burn] = x
            accepted += chance / kept
    return found, accepted


class Posterior(NamedTuple):
    """Posterior: last magnitude (mean, 5 and 95 % quantiles); stiffness and unloaded curvature (mean, std)."""

    force_n: tuple[float, float, float]
    stiffness: tuple[float, float]
    curvature_per_m: tuple[float, float]


def by_filter(
    lines: Sequence[Line], knobs: FloatArray, scale: float, info: Any
) -> tuple[Posterior, SessionFilter, Any]:
    """Returns the posterior of the filter, itself, and the last force with its prior's state."""
    model = rod_model(info, SETTINGS.segments)
    filter_ = SessionFilter(SETTINGS, Knowledge.stated(SETTINGS), model, info)
    result: Any = None
    for line, knob in zip(lines, knobs.tolist(), strict=True):
        result = filter_.step(line, scale, knob, 2.0)
    state = filter_.state
    assert state is not None
    force = result.force
    posterior = Posterior(
        (float(np.hypot(*force.force_n)), float(force.low_n[2]), float(force.high_n[2])),
        (float(state.mean[EI]), math.sqrt(float(state.covariance[EI, EI]))),
        state.unloaded_curvature_per_m(),
    )
    return posterior, filter_, result


def by_chain(
    lines: Sequence[Line],
    knobs: FloatArray,
    touching: np.ndarray,
    filter_: SessionFilter,
    info: Any,
    seed: int,
    starts_n: FloatArray,
    kept: int,
) -> tuple[Posterior, dict[str, float]]:
    """Returns the posterior of the chain, and figures of the chain."""
    fresh = SessionState(SETTINGS, Knowledge.stated(SETTINGS), info, float(knobs[0]))
    model, scratch = filter_._model, make_scratch(make_work(filter_._model, POINTS, COUNT), COUNT)
    modes = []
    for line in lines:
        fill_camera_modes(filter_._modes, line, model, SETTINGS)
        modes.append(filter_._modes.copy())
    chord = np.array([line.points[-1] - line.points[0] for line in lines])
    frames = Frames(
        *(np.array([getattr(line, name) for line in lines]) for name in ("points", "normals", "from_tip", "middle")),
        knobs, touching, np.array(modes), chord / np.linalg.norm(chord, axis=1)[:, None],
    )  # fmt: skip
    fresh.knob_deg = float(knobs[-1])
    session = filter_._session(fresh)
    mean = fresh.mean[FORCE : COUNT - 1].copy()
    information = np.linalg.inv(fresh.covariance[FORCE : COUNT - 1, FORCE : COUNT - 1])
    state = filter_.state
    assert state is not None
    own, theta, reaction = np.zeros((len(lines), PER_FRAME)), [], np.zeros((len(lines), 2))
    for t, (line, start) in enumerate(zip(lines, starts_n, strict=True)):
        q, (c, s) = state.mean.copy(), frames.chord[t].tolist()
        scratch.rod.theta[:] = filter_._shapes["free"]
        for share in (0.25, 0.5, 0.75, 1.0):  # a push that would buckle the free rod is not reached
            kept_theta, q[:FORCE] = scratch.rod.theta.copy(), share * start
            if not predict(q, session._replace(knob_deg=float(knobs[t])), line, scratch):
                scratch.rod.theta[:], q[:FORCE] = kept_theta, (share - 0.25) * start
                break
        reaction[t, 0] = c * q[1] - s * q[0]
        if touching[t]:
            own[t, :2] = c * q[0] + s * q[1], loaded_point_aside(q, c, s, model, scratch.rod)
        theta.append(scratch.rod.theta.copy())
    theta = np.array(theta)
    x = np.concatenate([state.mean[FORCE : COUNT - 1], own.ravel()])
    n = len(x)
    gradient, hessian = np.zeros(n), np.zeros((n, n))
    value = -math.inf
    for _ in range(60):  # to the neighbourhood of the maximum
        value = density(x, mean, information, frames, session, theta, reaction, scratch, gradient, hessian, True)
        step = np.linalg.solve(hessian, gradient)
        share, then = 1.0, -math.inf
        while share > 1e-3:
            then = density(
                x + share * step, mean, information, frames, session, theta, reaction, scratch, gradient, hessian
            )
            if then >= value:
                break
            share *= 0.5
        if then <= value + 1e-3:
            break
        x = x + share * step
    density(x, mean, information, frames, session, theta, reaction, scratch, gradient, hessian, True)
    root = np.linalg.inv(np.linalg.cholesky(hessian)).T
    rng = np.random.default_rng([seed, 79])
    for burn, count in (
        (600, 1200),
        (600, 1200),
        (600, kept),
    ):  # the mass: first the Hessian
        found, accepted = hamiltonian(
            x, np.ascontiguousarray(root), mean, information, frames, session, theta, reaction, scratch, burn, 12,
            rng.standard_normal((burn + count, n)), rng.random((burn + count, 2)),
        )  # fmt: skip
        x = found[-1]
        hessian_like = np.cov(found.T) + 0.05 * root @ root.T
        root = np.linalg.cholesky(hessian_like)
    forces, weights = np.zeros((kept, FORCE)), np.zeros(kept)
    c, s = frames.chord[-1].tolist()
    for k, sample in enumerate(found):
        density(sample, mean, information, frames, session, theta, reaction, scratch, gradient, hessian)
        along, (across, rate) = sample[SHARED + PER_FRAME * (len(lines) - 1)], reaction[-1].tolist()
        forces[k] = c * along - s * across, s * along + c * across
        size, angle = math.hypot(*forces[k]), theta[-1, -1]
        if is_possible(*forces[k], size, math.cos(angle), math.sin(angle), session.largest_n):
            weights[k] = abs(rate) / size
    weights /= weights.sum()
    size = np.hypot(*forces.T)
    order = np.argsort(size)
    low_n, high_n = np.interp([0.05, 0.95], np.cumsum(weights[order]), size[order]).tolist()
    gain, knob = fresh.gain_per_m_deg, fresh.knob_deg
    curvature = found[:, K0 - FORCE] + gain * knob * (1.0 + found[:, GAIN - FORCE])
    halves = [float(np.average(size[part], weights=weights[part])) for part in np.array_split(np.arange(kept), 2)]
    stiffness = found[:, EI - FORCE]
    posterior = Posterior(
        (float(np.hypot(*(weights @ forces))), low_n, high_n),
        (float(stiffness.mean()), float(stiffness.std())),
        (float(curvature.mean()), float(curvature.std())),
    )
    samples = 1.0 / float(weights @ weights)
    return posterior, {"accepted": accepted, "halves_apart_n": abs(halves[0] - halves[1]), "samples": samples}


def chains(lines_of: Lines, free: int, touching: int, kept: int) -> dict[str, Any]:
    """Compares filter and chain on one session."""
    seen, frame = lines_of.seen_px(), frame_of(lines_of)
    rng = np.random.default_rng([*lines_of.seed, 78])
    none = np.flatnonzero(~lines_of.touching & (lines_of.time_s < 5.0))
    push = np.flatnonzero(lines_of.touching & (lines_of.size_n > 0.03))
    chosen = np.concatenate([np.sort(rng.choice(none, free)), np.sort(rng.choice(push, touching))])
    lines = [frame.line(CentrelinePx(seen[k])) for k in chosen]
    gain = lines_of.info.actuation.knob_gain_per_m_deg
    assert gain is not None
    knobs = lines_of.curvature_per_m[chosen] / gain  # without play and drift
    contact = lines_of.touching[chosen]
    filtered, filter_, result = by_filter(lines, knobs, frame.scale_m_per_px, lines_of.info)
    starts = lines_of.force_n[chosen, :2].copy()
    starts[~contact] = 0.0
    chain, figures = by_chain(lines, knobs, contact, filter_, lines_of.info, lines_of.seed[1], starts, kept)
    return {
        "session": lines_of.seed, "truth_n": float(lines_of.size_n[chosen[-1]]), "contact": result.force.contact,
        "filter": filtered._asdict(), "chain": chain._asdict(), **figures,
    }  # fmt: skip


def main() -> None:
    """Runs one of the checks."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--lines", type=Path, required=True)
    parser.add_argument("--sessions", type=int, default=10)
    parser.add_argument("--free", type=int, default=4)
    parser.add_argument("--touching", type=int, default=4)
    parser.add_argument("--kept", type=int, default=3000)
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    rows = []
    for place in sorted(options.lines.glob("*.pickle"))[: options.sessions]:
        row = chains(pickle.loads(place.read_bytes()), options.free, options.touching, options.kept)
        rows.append(row)
        options.out.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
        ends = " ".join(
            f"{name} {1e3 * row[name]['force_n'][0]:.0f} [{1e3 * row[name]['force_n'][1]:.0f}, "
            f"{1e3 * row[name]['force_n'][2]:.0f}] EI {row[name]['stiffness'][0]:+.3f} +- "
            f"{row[name]['stiffness'][1]:.3f} k0 {row[name]['curvature_per_m'][0]:.2f} +- "
            f"{row[name]['curvature_per_m'][1]:.2f};"
            for name in ("filter", "chain")
        )
        print(
            f"{row['session'][1]:3d} true {1e3 * row['truth_n']:.0f} mN; {ends} accepted {row['accepted']:.2f}, halves "
            f"{1e3 * row['halves_apart_n']:.1f} mN apart",
            flush=True,
        )


if __name__ == "__main__":
    main()
