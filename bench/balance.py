"""``python -m bench.balance``: do the forces of one beating contact balance, and where does the energy go?

One session of the preset bench-2021, with all that is random in its force sensor switched off and a stage without
steps. At every instant the same force is found five ways: from the wall's law and its dent, from the force sensor with
inertia and weight taken out, from the moments in the shaft's strain (the clamp's reaction, which the wall's law has no
part in), and their moment about the clamp. Over each beat the work that the wall's and the knob's motion put in is
compared with what is stored and what is lost; the step of time is halved to see with which order the rest falls.
"""

import argparse
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from bench.strains import carried, density, linear_density, moment, rotation_vectors
from scipy.interpolate import CubicSpline

from tipforce.mechanics import SpatialContact, press_spatial
from tipforce.mechanics._spatial_rod import frames_of
from tipforce.twin import PRESETS
from tipforce.twin.world import STEP_S, Load, Session, read_sensor, run_session
from tipforce.twin.world._sensor import GRAVITY_M_PER_S2
from tipforce.twin.world.settings import ClockSettings, SensorSettings, WorldSettings

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
    """A session's contact with another step of time: the same motion of the wall and the knob in between."""

    session: Session
    settings: WorldSettings
    dt_s: float
    time_s: np.ndarray
    wall_m: np.ndarray
    rest: np.ndarray
    contact: SpatialContact


def run(session: Session, settings: WorldSettings, finer: int) -> Run:
    course, rig = session.course, session.rig
    count = (course.time_s.size - 1) * finer + 1
    time = course.time_s[0] + np.arange(count) * STEP_S / finer
    wall = CubicSpline(course.time_s, course.wall_m)(time)
    change = np.zeros((count, 3))
    change[:, 2] = np.interp(time, course.time_s, course.curvature_per_m)
    shaft = settings.shaft
    contact = press_spatial(
        rig.rod, rig.wall, wall, STEP_S / finer, rig.radius_m, precurvature_change_per_m=change,
        creep=shaft.creep_share, creep_time_s=shaft.creep_s,
    )  # fmt: skip
    rest = np.asarray(rig.rod.precurvature_per_m)[None] + change[:, None, :]
    return Run(session, settings, STEP_S / finer, time, wall, rest, contact)


def crept(r: Run, strain: np.ndarray) -> np.ndarray:
    """(m, k, 3): what the Maxwell springs have gone slack by; hung up long before the first instant."""
    relaxing = r.dt_s / r.settings.shaft.creep_s
    share = relaxing / (1.0 + relaxing)
    against = strain - r.rest
    memory = np.empty_like(against)
    memory[0] = against[0]
    for row in range(1, len(memory)):
        memory[row] = memory[row - 1] + share * (against[row] - memory[row - 1])
    return memory


def tangential(r: Run, vectors: np.ndarray) -> np.ndarray:
    """The part of (m, 3) vectors in the wall's plane."""
    d = np.asarray(r.session.rig.wall.normal)
    return vectors - (vectors @ d)[:, None] * d


def touched_way(r: Run) -> np.ndarray:
    """(m, 3): how far the dome's touching point moves in the wall's plane, seen from the wall, since the last instant.

    The material point, so that rolling counts: it turns with the electrode.
    """
    d, radius = np.asarray(r.session.rig.wall.normal), r.session.rig.radius_m
    axes = frames_of(r.contact.quaternions[:, -1])
    arm = radius * d @ axes  # in the electrode's frame
    middle = 0.5 * (arm[1:] + arm[:-1])
    turned = np.einsum("mij,mj->mi", axes[1:] - axes[:-1], middle)
    centre = r.contact.touch_m - radius * d
    way = np.diff(centre, axis=0) + turned - np.diff(r.wall_m, axis=0)
    return np.concatenate([np.zeros((1, 3)), tangential(r, way)])


def from_strain(r: Run, strain: np.ndarray, memory: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Force on the tip (n, 3) and moment at the clamp (n, 3), from the shaft's strain and places alone.

    The moments M_i = M_0 - p_i x F of all joints, solved for both by least squares: no use is made of where the force
    acts, or of any law of the wall.
    """
    rod = r.session.rig.rod
    u, rest = strain[rows], r.rest[rows]
    maxwell = r.settings.shaft.creep_share * (u - rest - memory[rows])
    springs = np.array([rod.gj_nm2, rod.bending_stiffness_nm2, rod.bending_stiffness_nm2])
    own = moment(rod, u, rest) + maxwell * springs * np.asarray(rod.stiffness_profile)[:, None]
    turns = u * rod.joint_spans_m[:, None]
    frames = frames_of(r.contact.quaternions[rows])
    before = np.concatenate([np.broadcast_to(np.eye(3), frames[:, :1].shape), frames[:, :-1]], axis=1)
    moments = np.einsum("mkij,mkj->mki", before, carried(turns, own))
    nodes = rod.nodes_m(r.contact.quaternions[rows])[:, :-1]
    forces, clamps = np.empty((rows.size, 3)), np.empty((rows.size, 3))
    joints = nodes.shape[1]
    for k in range(rows.size):
        p = nodes[k]
        table = np.zeros((joints, 3, 6))
        table[:, 0, 4], table[:, 0, 5] = p[:, 2], -p[:, 1]
        table[:, 1, 3], table[:, 1, 5] = -p[:, 2], p[:, 0]
        table[:, 2, 3], table[:, 2, 4] = p[:, 1], -p[:, 0]
        table[:, range(3), range(3)] = 1.0
        table[:, :, 3:] *= LEVER_PER_M
        found = np.linalg.lstsq(table.reshape(-1, 6), moments[k].ravel(), rcond=None)[0]
        clamps[k], forces[k] = found[:3], LEVER_PER_M * found[3:]
    return forces, clamps


LEVER_PER_M = 25.0
"""Scales forces to moments in the least squares: one over a rod's length."""


def force_balance(r: Run, rows: np.ndarray) -> dict[str, float]:
    """Largest differences over the instants ``rows``, relative to the largest force or moment among them."""
    rig, contact, wall = r.session.rig, r.contact, r.session.rig.wall
    d = np.asarray(wall.normal)
    force = contact.force_n[rows]
    size = float(np.linalg.norm(force, axis=1).max())
    dent = contact.indentation_m
    law = wall.stiffness_n_per_m * dent[rows] + wall.damping_ns_per_m * (dent[rows] - dent[rows - 1]) / r.dt_s
    law = np.where(contact.touching[rows], law, 0.0)
    drag = tangential(r, contact.force_n)
    pull, limit = np.linalg.norm(drag[rows], axis=1), wall.friction * law
    slips = contact.slipping[rows]
    # The tie holds from the second instant of a contact on, with what the first one moved.
    held = contact.touching[rows - 2] & contact.touching[rows - 1] & contact.touching[rows]
    sticks = held & ~slips
    stretch = -wall.tangential_n_per_m * touched_way(r)
    tie = np.linalg.norm(drag[rows] - drag[rows - 1] - stretch[rows], axis=1)

    load = Load(r.time_s, -contact.force_n, contact.touch_m, r.session.course.acceleration_m_per_s2)
    angle = float(np.arctan2(rig.forward[1], rig.forward[0]))
    log = read_sensor(EXACT_SENSOR, EXACT_CLOCK, load, angle, r.settings.seconds, np.random.default_rng(0))
    place = rows - round(-r.time_s[0] / r.dt_s)
    acceleration = load.acceleration_m_per_s2[rows]
    moving = EXACT_SENSOR.moving_mass_kg * (GRAVITY_M_PER_S2 - acceleration)
    read = log.force_n[place] @ log.rotation - moving

    strain = rotation_vectors(contact.quaternions) / rig.rod.joint_spans_m[:, None]
    inside, clamp = from_strain(r, strain, crept(r, strain), rows)
    about = np.cross(contact.touch_m[rows], force)
    moments = float(np.linalg.norm(about, axis=1).max())

    def worst(away: np.ndarray) -> float:
        return float(np.abs(away).max(initial=0.0))

    return {
        "instants": rows.size,
        "largest_force_n": size,
        "touching": float(contact.touching[rows].mean()),
        "slipping": float(slips.mean()),
        "wall law, normal": worst(-force @ d - law) / size,
        "Coulomb's limit where it slips": worst((pull - limit)[slips]) / size,
        "Coulomb's limit, beyond it": worst(np.maximum(pull - limit, 0.0)) / size,
        "tie where it sticks": worst(tie[sticks]) / size,
        "force sensor": worst(read + force) / size,
        "clamp's force, from the shaft's strain": worst(inside - force) / size,
        "clamp's moment, strain against reported": worst(clamp + contact.reaction_moment_nm[rows]) / moments,
        "clamp's moment, against the force's lever": worst(clamp - about) / moments,
    }


def energies(r: Run) -> dict[str, np.ndarray]:
    """(m,) each, in J, from the first instant on: put in, stored, lost."""
    rig, contact, wall, shaft = r.session.rig, r.contact, r.session.rig.wall, r.settings.shaft
    rod, d, spans = rig.rod, np.asarray(wall.normal), rig.rod.joint_spans_m
    strain = rotation_vectors(contact.quaternions) / spans[:, None]
    memory = crept(r, strain)

    def summed(steps: np.ndarray) -> np.ndarray:
        return np.concatenate([[0.0], np.cumsum(steps)])

    def elastic(u: np.ndarray, rest: np.ndarray, slack: np.ndarray) -> np.ndarray:
        return (density(rod, u, rest) + shaft.creep_share * linear_density(rod, u - rest - slack)) @ spans

    slope, dent = np.diff(contact.indentation_m) / r.dt_s, contact.indentation_m
    viscous = np.concatenate([[0.0], wall.damping_ns_per_m * slope]) * contact.touching
    elastic_force = contact.force_n + viscous[:, None] * d  # what does not hang on the rate
    moved = np.diff(r.wall_m, axis=0)
    # What hangs on the rate belongs to the step that made the rate, the rest to the mean of both ends.
    put_in = np.sum((elastic_force[1:] + elastic_force[:-1]) / 2 * moved, axis=1) - viscous[1:] * (moved @ d)
    u, rest = strain, r.rest
    knob = 0.5 * (
        elastic(u[:-1], rest[1:], memory[:-1]) - elastic(u[:-1], rest[:-1], memory[:-1])
        + elastic(u[1:], rest[1:], memory[1:]) - elastic(u[1:], rest[:-1], memory[1:])
    )  # fmt: skip
    springs = np.array([rod.gj_nm2, rod.bending_stiffness_nm2, rod.bending_stiffness_nm2])
    stress = shaft.creep_share * (u - rest - memory) * springs * np.asarray(rod.stiffness_profile)[:, None]
    crawl = np.sum(0.5 * (stress[1:] + stress[:-1]) * np.diff(memory, axis=0), axis=-1) @ spans
    drag = tangential(r, contact.force_n)
    slip = touched_way(r)[1:] + np.diff(drag, axis=0) / wall.tangential_n_per_m
    tied = contact.touching[1:] & contact.touching[:-1]
    rubbed = np.where(tied, -np.sum(0.5 * (drag[1:] + drag[:-1]) * slip, axis=1), 0.0)
    tie = np.sum(drag**2, axis=1) / (2 * wall.tangential_n_per_m)
    return {
        "wall's motion": summed(put_in),
        "knob": summed(knob),
        "bend": elastic(u, rest, memory),
        "dent": 0.5 * wall.stiffness_n_per_m * dent**2,
        "tie": tie,
        "tissue's damping": summed(wall.damping_ns_per_m * slope * np.diff(dent)),
        "friction": summed(rubbed),
        "shaft's creep": summed(crawl),
    }


PUT_IN, KEPT = ("wall's motion", "knob"), ("bend", "dent", "tie", "tissue's damping", "friction", "shaft's creep")


def energy_balance(r: Run, starts_s: np.ndarray) -> dict[str, Any]:
    """Beat by beat, from each of ``starts_s`` to the next: what went where in J, and the rest over what was moved."""
    parts = energies(r)
    at = np.round((starts_s - r.time_s[0]) / r.dt_s).astype(int)
    beats = {name: np.diff(values[at]) for name, values in parts.items()}
    moved = np.abs(np.diff(parts["wall's motion"]))
    exchanged = np.diff(np.concatenate([[0.0], np.cumsum(moved)])[at])
    left = sum(beats[name] for name in PUT_IN) - sum(beats[name] for name in KEPT)
    return {
        "dt_ms": 1e3 * r.dt_s,
        "beats": len(exchanged),
        "exchanged_j": float(exchanged.mean()),
        "share of it": {name: float(values.mean() / exchanged.mean()) for name, values in beats.items()},
        "rest, rms of the beats": float(np.sqrt(np.mean((left / exchanged) ** 2))),
        "rest, worst beat": float(np.abs(left / exchanged).max()),
    }


def measure(number: int = 0, seconds: float = 12.0, halvings: int = 2, seed: int = 0) -> dict[str, Any]:
    """Both balances of one session: forces at the twin's own step, energy at ``halvings`` halves of it too."""
    settings = settings_of(seconds)
    session = run_session(settings, seed, number)
    period = 1.0 / session.rig.draw.beat_hz
    first = settings.tare_s + 2.0  # the approach is over
    starts = first + period * np.arange(int((seconds - first) / period) + 1)
    runs = [run(session, settings, 2**k) for k in range(halvings + 1)]
    begin, end = np.searchsorted(runs[0].time_s, starts[[0, -1]] - 1e-9)
    return {
        "session": number,
        "beat_hz": session.rig.draw.beat_hz,
        "forces": force_balance(runs[0], np.arange(begin, end)),
        "energy": [energy_balance(r, starts) for r in runs],
    }


def show(figures: dict[str, Any]) -> None:
    forces = figures["forces"]
    print(
        f"session {figures['session']}, {figures['beat_hz']:.2f} beats a second: {forces['instants']} instants, peak "
        f"{forces['largest_force_n']:.3f} N, {forces['touching']:.0%} in contact, {forces['slipping']:.0%} slipping"
    )
    print("forces, largest difference over the largest force or moment:")
    for name, value in list(forces.items())[4:]:
        print(f"  {name:45} {value:9.1e}")
    shares = figures["energy"][-1]["share of it"]
    print(f"energy, {figures['energy'][0]['beats']} whole beats, over the work done by the wall's motion to and fro:")
    print("  " + ", ".join(f"{name} {share:+.4f}" for name, share in shares.items()))
    previous = None
    for row in figures["energy"]:
        rms = row["rest, rms of the beats"]
        order = "" if previous is None else f", order {np.log2(previous / rms):.2f}"
        print(f"  step {row['dt_ms']:5.3f} ms: rest {rms:.1e} rms, {row['rest, worst beat']:.1e} at worst{order}")
        previous = rms


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m bench.balance", description=__doc__)
    parser.add_argument("--sessions", type=int, nargs="+", default=[0], metavar="NUMBER", help="which ones")
    parser.add_argument("--seconds", type=float, default=12.0)
    parser.add_argument("--halvings", type=int, default=2, help="how often the step of 1 ms is halved")
    parser.add_argument("--json", type=Path, default=Path("build/balance.json"))
    chosen = parser.parse_args()
    figures = []
    for number in chosen.sessions:
        figures.append(measure(number, chosen.seconds, chosen.halvings))
        show(figures[-1])
    chosen.json.parent.mkdir(parents=True, exist_ok=True)
    chosen.json.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
