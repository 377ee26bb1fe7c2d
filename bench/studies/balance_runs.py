"""Repeats a beating contact of the simulation with other time steps: even ones, or finer ones at events."""

from dataclasses import dataclass

import numpy as np
from bench.strains import rotation_vectors
from scipy.interpolate import CubicSpline

from tipforce.mechanics import SpatialContact, SpatialContactSolver
from tipforce.mechanics.spatial._rod import frames_of
from tipforce.simulation import PRESETS
from tipforce.simulation.world import STEP_S, Session
from tipforce.simulation.world.settings import ClockSettings, SensorSettings, WorldSettings

EXACT_SENSOR = SensorSettings(
    pose_error_deg=(0.0, 0.0), noise_n=0.0, step_n=(1e-12, 1e-12, 1e-12), drift_n_per_min=(0.0, 0.0),
    bias_n=(0.0, 0.0), torque_noise_nm=0.0, torque_step_nm=1e-12,
)  # fmt: skip
EXACT_CLOCK = ClockSettings(force_offset_ms=(0.0, 0.0), force_drift_ppm=(0.0, 0.0))


def settings_of(seconds: float) -> WorldSettings:
    """The preset's world, with an exact sensor, clocks that agree, and a stage that moves without steps."""
    world = PRESETS["bench-2021"].world
    motion = world.motion.model_copy(update={"step_m": 1e-12})
    return world.model_copy(update={"seconds": seconds, "motion": motion, "sensor": EXACT_SENSOR, "clock": EXACT_CLOCK})


@dataclass(frozen=True, eq=False)
class Run:
    """A session's contact at other instants: the same motion of the wall and the knob in between.

    ``time_s`` (m,), ``step_s`` (m - 1,), ``wall_m`` (m, 3), ``rest`` (m, k, 3): the joints' pre-curvature.
    """

    session: Session
    settings: WorldSettings
    time_s: np.ndarray
    step_s: np.ndarray
    wall_m: np.ndarray
    rest: np.ndarray
    contact: SpatialContact

    @property
    def strain(self) -> np.ndarray:
        """(m, k, 3)."""
        return rotation_vectors(self.contact.quaternions) / self.session.bench_model.rod.joint_spans_m[:, None]

    @property
    def events(self) -> np.ndarray:
        """(m - 1,): steps in which the tip touches, lets go, begins to slip or comes to rest."""
        c = self.contact
        return (c.touching[1:] != c.touching[:-1]) | (c.slipping[1:] != c.slipping[:-1])


def run(session: Session, settings: WorldSettings, finer: int) -> Run:
    """Runs the contact with the simulation's step divided by ``finer``."""
    trajectory = session.trajectory
    steps = (trajectory.time_s.size - 1) * finer
    return _run(session, settings, trajectory.time_s[0], np.full(steps, STEP_S / finer))


def run_fine_at_events(rough: Run, parts: int) -> Run:
    """``rough`` again with the steps of its events, and those beside them, in ``parts``."""
    near = rough.events
    near = near | np.append(near[1:], False) | np.insert(near[:-1], 0, False)
    step = np.repeat(np.where(near, rough.step_s / parts, rough.step_s), np.where(near, parts, 1))
    return _run(rough.session, rough.settings, rough.time_s[0], step)


def _run(session: Session, settings: WorldSettings, begin_s: float, step: np.ndarray) -> Run:
    trajectory, bench_model, shaft = session.trajectory, session.bench_model, settings.shaft
    time = begin_s + np.concatenate([[0.0], np.cumsum(step)])
    wall = CubicSpline(trajectory.time_s, trajectory.wall_m)(time)
    change = np.zeros((time.size, 3))
    change[:, 2] = np.interp(time, trajectory.time_s, trajectory.curvature_per_m)
    solver = SpatialContactSolver(
        bench_model.rod,
        bench_model.wall,
        step[0],
        bench_model.radius_m,
        creep=shaft.creep_share,
        creep_time_s=shaft.creep_s,
    )
    # The first instant has no step before it; after it the stretches of even steps, one by one.
    before = np.insert(step, 0, step[0])
    ends = np.append(np.flatnonzero(np.diff(before)) + 1, time.size)
    found, start = [], 0
    for end in ends:
        solver.change_step(before[start])
        found.append(solver.run(wall[start:end], change[start:end]))
        start = end
    joined = {
        name: np.concatenate([getattr(part, name) for part in found])
        for name in SpatialContact.__dataclass_fields__
        if name not in ("rod", "wall")
    }
    rest = np.asarray(bench_model.rod.precurvature_per_m)[None] + change[:, None, :]
    return Run(session, settings, time, step, wall, rest, SpatialContact(bench_model.rod, bench_model.wall, **joined))


def crept(r: Run, strain: np.ndarray) -> np.ndarray:
    """Returns the relaxed strain (m, k, 3) of the Maxwell springs; they are relaxed at the first instant."""
    relaxing = r.step_s / r.settings.shaft.creep_s
    share = relaxing / (1.0 + relaxing)
    against = strain - r.rest
    memory = np.empty_like(against)
    memory[0] = against[0]
    for row in range(1, len(memory)):
        memory[row] = memory[row - 1] + share[row - 1] * (against[row] - memory[row - 1])
    return memory


def tangential(r: Run, vectors: np.ndarray) -> np.ndarray:
    """The part of (m, 3) vectors in the wall's plane."""
    d = np.asarray(r.session.bench_model.wall.normal)
    return vectors - (vectors @ d)[:, None] * d


def touched_way(r: Run) -> np.ndarray:
    """(m, 3): how far the dome's touching point moves in the wall's plane, seen from the wall, since the last instant.

    The material point, so that rolling counts: it turns with the electrode.
    """
    d, radius = np.asarray(r.session.bench_model.wall.normal), r.session.bench_model.radius_m
    axes = frames_of(r.contact.quaternions[:, -1])
    arm = radius * d @ axes  # in the electrode's frame
    middle = 0.5 * (arm[1:] + arm[:-1])
    turned = np.einsum("mij,mj->mi", axes[1:] - axes[:-1], middle)
    centre = r.contact.touch_m - radius * d
    way = np.diff(centre, axis=0) + turned - np.diff(r.wall_m, axis=0)
    return np.concatenate([np.zeros((1, 3)), tangential(r, way)])
