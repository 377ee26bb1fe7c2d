"""``python -m bench.studies.balance``: do the forces of one beating contact balance, and where does the energy go?

One session of the preset bench-2021, with all that is random in its force sensor switched off and a stage without
steps. At every instant the same force is found five ways: from the wall's law and its indentation, from the force
sensor with inertia and weight taken out, from the moments in the shaft's strain (the clamp's reaction, which the wall's
law has no part in), and their moment about the clamp. Over each beat the work that the wall's and the knob's motion put
in is compared with the stored and the lost energy; the dissipation of the integrator is a row of its own
(`balance_energy`). The time step is halved to find the order of the residual, and the steps in which the
tip touches, lets go, begins to slip or comes to rest are cut into sixteen to find their share.
"""

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
from bench.studies.balance_energy import NUMERICAL, energy_balance
from bench.studies.balance_forces import force_balance
from bench.studies.balance_runs import run, run_fine_at_events, settings_of

from tipforce.simulation.world import run_session

PARTS = 16
"""Number of parts of the step of an event."""


def measure(number: int = 0, seconds: float = 12.0, halvings: int = 2, seed: int = 0) -> dict[str, Any]:
    """Returns both balances of a session: forces at the simulation's step, energy also with ``halvings`` halvings."""
    settings = settings_of(seconds)
    session = run_session(settings, seed, number)
    period = 1.0 / session.bench_model.parameters.beat_hz
    first = settings.tare_s + 2.0  # the approach is over
    starts = first + period * np.arange(int((seconds - first) / period) + 1)
    own = run(session, settings, 1)
    begin, end = np.searchsorted(own.time_s, starts[[0, -1]] - 1e-9)
    figures = {
        "session": number,
        "beat_hz": session.bench_model.parameters.beat_hz,
        "forces": force_balance(own, np.arange(begin, end)),
        "energy": [],
        "energy, events resolved": [],
    }
    for halving in range(halvings + 1):
        even = own if halving == 0 else run(session, settings, 2**halving)
        figures["energy"].append(energy_balance(even, starts))
        figures["energy, events resolved"].append(energy_balance(run_fine_at_events(even, PARTS), starts))
    return figures


def show(figures: dict[str, Any]) -> None:
    forces = figures["forces"]
    print(
        f"session {figures['session']}, {figures['beat_hz']:.2f} beats a second: {forces['instants']} instants, peak "
        f"{forces['largest_force_n']:.3f} N, {forces['touching']:.0%} in contact, {forces['slipping']:.0%} slipping"
    )
    print("forces, largest difference over the largest force or moment:")
    for name, value in list(forces.items())[4:]:
        print(f"  {name:45} {value:9.1e}")
    print(f"energy, {figures['energy'][0]['beats']} whole beats, over the work done by the wall's motion to and fro:")
    for row in (figures["energy"][0], figures["energy"][-1]):
        shares = [f"{name} {share:+.5f}" for name, share in row["share of it"].items() if name not in NUMERICAL]
        numerical = [f"{name} {row['share of it'][name]:+.1e}" for name in NUMERICAL]
        print(f"  step {row['dt_ms']:5.3f} ms: {', '.join([*shares, *numerical])}")
    for title in ("energy", "energy, events resolved"):
        previous = None
        for row in figures[title]:
            rms, dt = row["rest, rms of the beats"], row["dt_ms"]
            order = "" if previous is None else f", order {np.log2(previous / rms):.2f}"
            finest = (
                "" if title == "energy" else f", {row['events_a_beat']:.1f} events a beat at {row['finest_dt_ms']:.4f}"
            )
            print(
                f"  step {dt:5.3f} ms{finest}: rest {rms:.1e} rms, {row['rest, worst beat']:.1e} at worst{order}; "
                f"without the events {row['rest in steps without an event, rms']:.1e}; "
                f"implicit Euler {row['implicit Euler, rms']:.1e}"
            )
            previous = rms


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m bench.studies.balance", description=__doc__)
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
