"""Measures the speed of the live simulation: simulated seconds a second, and the time from one event to the next.

    OMP_NUM_THREADS=1 python -m bench.studies.live_simulation [--seconds S] [--blocks N] [--json FILE]

One session of bench-2021, with its images and without, and without them under a command every 10 ms. Each block is
the session from its beginning; rates are of the best block, also by processor time, which other load of the
machine does not change; steps are of all blocks.
"""

import argparse
import json
import pathlib
import time

import numpy as np

from tipforce.mechanics import HeartMotion
from tipforce.simulation import PRESETS, LiveSimulation
from tipforce.types import STAGE

HEART = HeartMotion(4e-3, 1.2, lateral_share=0.5)


def run(simulation: LiveSimulation, commanded: bool) -> tuple[float, float, np.ndarray]:
    """Wall and processor time of a session, and of each step the wall time."""
    with simulation as bench:
        steps = []
        begun, processor = time.perf_counter(), time.process_time()
        last = begun
        for event in bench.source:
            if commanded and getattr(event, "stream", "") == STAGE:
                bench.actuators.command(HEART.command(bench.clock.now_ns() * 1e-9) | {"advance_mm": 1.0})
            now = time.perf_counter()
            steps.append(now - last)
            last = now
        return last - begun, time.process_time() - processor, np.array(steps)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--blocks", type=int, default=5)
    parser.add_argument("--json", type=pathlib.Path)
    chosen = parser.parse_args()
    preset = PRESETS["bench-2021"]
    settings = preset.model_copy(update={"world": preset.world.model_copy(update={"seconds": chosen.seconds})})
    figures = {}
    for name, images, commanded in (("images", True, False), ("none", False, False), ("commanded", False, True)):
        simulation = LiveSimulation(settings, seed=0, session=1, images=images)
        run(simulation, commanded)  # compiled, drawn and tried out
        walls, processors, steps = zip(*(run(simulation, commanded) for _ in range(chosen.blocks)), strict=True)
        waits = 1e3 * np.concatenate(steps)
        figures[name] = {
            "simulated_s_per_s": chosen.seconds / min(walls),
            "simulated_s_per_processor_s": chosen.seconds / min(processors),
            "step_p50_ms": float(np.quantile(waits, 0.5)),
            "step_p99_ms": float(np.quantile(waits, 0.99)),
        }
        print(name, {key: round(value, 3) for key, value in figures[name].items()}, flush=True)
    if chosen.json:
        chosen.json.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
