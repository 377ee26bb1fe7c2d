"""Whether the samples of ``tipforce simulate --as dataset`` are like the frames of whole sessions.

    OMP_NUM_THREADS=1 .venv/bin/python -m bench.sample_distributions --sessions 40

Runs the world of as many sessions twice, short as for samples and at the preset's length, at the same pace, and prints
quantiles of force, angle and knob over the frames that samples are drawn from. No image is drawn. ``--fine 4`` also
runs so many of the short ones at the recordings' pace and prints how far their forces lie apart, the motion being the
same.
"""

import argparse
import time
from collections.abc import Sequence

import numpy as np

from tipforce.simulation import PRESETS, SampleSet, SimulatedBench, sample_set
from tipforce.simulation.world import FAST, Resolution, Session
from tipforce.simulation.world._trajectory import integrate_trajectory

AT = (0.1, 0.25, 0.5, 0.75, 0.9, 0.99)


def figures(bench: SimulatedBench, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Force (k,), angle between tip and wall's normal where it touches (j,), knob (k,) at the frames ``rows``."""
    times = bench.frame_s[rows]
    contact, near = bench.trajectory.contact, bench.interpolator.nearest(times)
    touching = near[contact.touching[near]]
    axis = contact.tip_axes(touching)
    angle = np.degrees(np.arccos(np.clip(axis @ bench.session.bench_model.wall.normal, -1.0, 1.0)))
    return (
        np.linalg.norm(bench.interpolator.at(contact.force_n, times), axis=1),
        angle,
        bench.interpolator.at(bench.trajectory.knob_deg, times),
    )


def collect(made: SampleSet, sessions: int) -> list[np.ndarray]:
    """All sessions' figures together."""
    parts = []
    for number in range(sessions):
        bench = made.bench(number)
        parts.append(figures(bench, made.frames(bench, number)))
    return [np.concatenate(column) for column in zip(*parts, strict=True)]


def apart(session: Session, every: int) -> float:
    """Rms in newtons between the forces with the rod at every instant and at every so many, on the same motion."""
    fine = integrate_trajectory(session.bench_model, session.motion_profile, session.motion)
    coarse = integrate_trajectory(session.bench_model, session.motion_profile, session.motion, every)
    return float(np.sqrt(np.mean(np.sum((coarse.contact.force_n - fine.contact.force_n[::every]) ** 2, axis=1))))


def quantiles_text(name: str, values: np.ndarray, at: Sequence[float] = AT) -> str:
    """Quantiles in a line."""
    return f"{name:<34}" + "  ".join(f"{x:8.3f}" for x in np.quantile(values, at))


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--preset", default="bench-2021", choices=list(PRESETS))
    parser.add_argument("--sessions", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--fine", type=int, default=0)
    options = parser.parse_args()
    print(f"{'quantiles at':<34}" + "  ".join(f"{x:8.2f}" for x in AT))
    preset = PRESETS[options.preset]
    for label, seconds in (("samples", None), ("whole sessions", preset.world.seconds)):
        made = sample_set(preset, seed=options.seed, samples=10**9, per_session=150, seconds=seconds)
        started = time.process_time()
        force, angle, knob = collect(made, options.sessions)
        took = time.process_time() - started
        print(quantiles_text(f"{label}: force, N", force))
        print(quantiles_text(f"{label}: angle in contact, deg", angle))
        print(quantiles_text(f"{label}: knob, deg", knob))
        free = float((force < 1e-4).mean())
        print(f"{label}: without contact {free:.3f}, {took / options.sessions:.2f} s of CPU a session")
    short = sample_set(preset, seed=options.seed, samples=10**9, per_session=24)
    for number in range(options.fine):
        made_now = short.bench(number)
        rms = apart(made_now.session, FAST.every)
        print(f"session {number}: every {FAST.every} ms against {Resolution().every} ms: {1e3 * rms:.2f} mN rms")


if __name__ == "__main__":
    main()
