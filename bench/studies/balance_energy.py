"""Energy balance of a beating contact, step by step: put in, stored, lost, and dissipated by the integrator.

At every instant the rod is in equilibrium with the forces of that instant, for every law of force. So the work of
every force over a step is its mean at both ends times the displacement, which is of second order in the step. By its
law, a damper, a slip or a creep loses its force at the end of the step, from the rate in the step, times the
displacement. The difference to the mean, half the change of the force times the displacement, is the dissipation of
implicit Euler; it is a row of its own. The remaining difference is the residual.
"""

from typing import Any

import numpy as np
from bench.strains import density, linear_density
from bench.studies.balance_runs import Run, crept, tangential, touched_way

PUT_IN = ("wall's motion", "knob")
STORED = ("bend", "indentation", "tie")
LOST = ("tissue's damping", "friction", "shaft's creep")
NUMERICAL = tuple(f"implicit Euler, {name}" for name in LOST)


def mean(values: np.ndarray) -> np.ndarray:
    """(m, ...) -> (m - 1, ...): of both ends of each step."""
    return 0.5 * (values[1:] + values[:-1])


def energies(r: Run) -> dict[str, np.ndarray]:
    """Returns (m - 1,) each, in J, for every step: `PUT_IN`, increase of `STORED`, `LOST` by the laws, `NUMERICAL`."""
    bench_model, contact, wall, shaft = r.session.bench_model, r.contact, r.session.bench_model.wall, r.settings.shaft
    rod, d, spans = bench_model.rod, np.asarray(wall.normal), bench_model.rod.joint_spans_m
    u, rest = r.strain, r.rest
    memory = crept(r, u)

    def elastic(strain: np.ndarray, at_rest: np.ndarray, slack: np.ndarray) -> np.ndarray:
        maxwell = shaft.creep_share * linear_density(rod, strain - at_rest - slack)
        return (density(rod, strain, at_rest) + maxwell) @ spans

    knob = 0.5 * (
        elastic(u[:-1], rest[1:], memory[:-1]) - elastic(u[:-1], rest[:-1], memory[:-1])
        + elastic(u[1:], rest[1:], memory[1:]) - elastic(u[1:], rest[:-1], memory[1:])
    )  # fmt: skip
    indentation, drag = contact.indentation_m, tangential(r, contact.force_n)
    # With and without contact the dashpot has the difference of the indentation's spring and the force of the tip.
    dashpot = -contact.force_n @ d - wall.stiffness_n_per_m * indentation
    springs = np.array([rod.gj_nm2, rod.bending_stiffness_nm2, rod.bending_stiffness_nm2])
    stress = shaft.creep_share * (u - rest - memory) * springs * np.asarray(rod.stiffness_profile)[:, None]
    stress = stress * spans[:, None]
    tied = contact.touching[1:] & contact.touching[:-1]
    slip = touched_way(r)[1:] + np.diff(drag, axis=0) / wall.tangential_n_per_m
    slip = np.where(tied[:, None], slip, 0.0)
    law = {
        "tissue's damping": wall.damping_ns_per_m * np.diff(indentation) ** 2 / r.step_s,
        "friction": -np.sum(drag[1:] * slip, axis=1),
        "shaft's creep": np.sum(stress[1:] * np.diff(memory, axis=0), axis=(1, 2)),
    }
    excess = {
        "tissue's damping": -0.5 * np.diff(dashpot) * np.diff(indentation),
        "friction": 0.5 * np.sum(np.diff(drag, axis=0) * slip, axis=1),
        "shaft's creep": -0.5 * np.sum(np.diff(stress, axis=0) * np.diff(memory, axis=0), axis=(1, 2)),
    }
    return {
        "wall's motion": np.sum(mean(contact.force_n) * np.diff(r.wall_m, axis=0), axis=1),
        "knob": knob,
        "bend": np.diff(elastic(u, rest, memory)),
        "indentation": np.diff(0.5 * wall.stiffness_n_per_m * indentation**2),
        "tie": np.diff(np.sum(drag**2, axis=1) / (2 * wall.tangential_n_per_m)),
        **law,
        **{f"implicit Euler, {name}": values for name, values in excess.items()},
    }


def energy_balance(r: Run, starts_s: np.ndarray) -> dict[str, Any]:
    """Beat by beat, from each of ``starts_s`` to the next: all parts and the residual, as shares of the total."""
    parts = energies(r)
    at = np.searchsorted(r.time_s, starts_s - 0.5 * r.step_s.min())

    def beats(steps: np.ndarray) -> np.ndarray:
        return np.diff(np.concatenate([[0.0], np.cumsum(steps)])[at])

    exchanged = beats(np.abs(parts["wall's motion"]))
    left = sum(parts[name] for name in PUT_IN) - sum(parts[name] for name in (*STORED, *LOST, *NUMERICAL))
    rest, at_events = beats(left) / exchanged, beats(left * r.events) / exchanged

    def rms(values: np.ndarray) -> float:
        return float(np.sqrt(np.mean(values**2)))

    return {
        "dt_ms": 1e3 * float(r.step_s.max()),
        "finest_dt_ms": 1e3 * float(r.step_s.min()),
        "beats": len(exchanged),
        "events_a_beat": float(beats(r.events.astype(float)).mean()),
        "exchanged_j": float(exchanged.mean()),
        "share of it": {name: float(beats(values).mean() / exchanged.mean()) for name, values in parts.items()},
        "rest, rms of the beats": rms(rest),
        "rest, worst beat": float(np.abs(rest).max()),
        "rest in steps without an event, rms": rms(rest - at_events),
        "implicit Euler, rms": rms(beats(sum(parts[name] for name in NUMERICAL)) / exchanged),
    }
