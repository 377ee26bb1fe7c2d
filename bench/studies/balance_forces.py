"""The same force found five ways at every instant of a beating contact."""

import numpy as np
from bench.strains import carried, moment
from bench.studies.balance_runs import EXACT_CLOCK, EXACT_SENSOR, Run, crept, tangential, touched_way

from tipforce.mechanics.spatial._rod import frames_of
from tipforce.simulation.world import ForceSensor, SensorLoad
from tipforce.simulation.world._force_sensor import GRAVITY_M_PER_S2

LEVER_PER_M = 25.0
"""Scales forces to moments in the least squares: one over a rod's length."""


def from_strain(r: Run, strain: np.ndarray, memory: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Force on the tip (n, 3) and moment at the clamp (n, 3), from the shaft's strain and places alone.

    The moments M_i = M_0 - p_i x F of all joints, solved for both by least squares: no use is made of where the force
    acts, or of any law of the wall.
    """
    rod = r.session.bench_model.rod
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


def force_balance(r: Run, rows: np.ndarray) -> dict[str, float]:
    """Largest differences over the instants ``rows``, relative to the largest force or moment among them."""
    bench_model, contact, wall = r.session.bench_model, r.contact, r.session.bench_model.wall
    d = np.asarray(wall.normal)
    force = contact.force_n[rows]
    size = float(np.linalg.norm(force, axis=1).max())
    indentation = contact.indentation_m
    law = (
        wall.stiffness_n_per_m * indentation[rows]
        + wall.damping_ns_per_m * (indentation[rows] - indentation[rows - 1]) / r.step_s[rows - 1]
    )
    law = np.where(contact.touching[rows], law, 0.0)
    drag = tangential(r, contact.force_n)
    pull, limit = np.linalg.norm(drag[rows], axis=1), wall.friction * law
    slips = contact.slipping[rows]
    # The tie holds from the second instant of a contact on, with the displacement of the first.
    held = contact.touching[rows - 2] & contact.touching[rows - 1] & contact.touching[rows]
    sticks = held & ~slips
    stretch = -wall.tangential_n_per_m * touched_way(r)
    tie = np.linalg.norm(drag[rows] - drag[rows - 1] - stretch[rows], axis=1)

    load = SensorLoad(r.time_s, -contact.force_n, contact.touch_m, r.session.trajectory.acceleration_m_per_s2)
    angle = float(np.arctan2(bench_model.forward[1], bench_model.forward[0]))
    sensor = ForceSensor(EXACT_SENSOR, EXACT_CLOCK, angle, r.settings.seconds, np.random.default_rng(0))
    sensor.take(load, 0, len(sensor.log.stamp_ns))
    log = sensor.log
    place = rows - round(-r.time_s[0] / r.step_s[0])
    acceleration = load.acceleration_m_per_s2[rows]
    moving = EXACT_SENSOR.moving_mass_kg * (GRAVITY_M_PER_S2 - acceleration)
    read = log.force_n[place] @ log.rotation - moving

    strain = r.strain
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
