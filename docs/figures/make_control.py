"""Draws the figure of docs/results/control.md.

    OMP_NUM_THREADS=1 python docs/figures/make_control.py [--feedback pretrained/compact]

Session 0 of seed 7 of bench-2021, perpendicular contact: the force held, with invalid estimates for 1.2 seconds.
"""

import argparse
import pathlib

from tipforce.control import ControlSettings
from tipforce.estimators import load_model
from tipforce.pipelines import bench_of_regime, live_bench, plot_control, run_control
from tipforce.simulation import PRESETS
from tipforce.types import ForceEstimate, Status

FOLDER = pathlib.Path(__file__).parent
SECONDS = 18.0
GONE_S = (24.0, 25.2)


def hidden(estimate: ForceEstimate) -> ForceEstimate:
    """Returns an invalid estimate while the catheter is hidden from the camera."""
    if not GONE_S[0] <= estimate.stamp_ns * 1e-9 < GONE_S[1]:
        return estimate
    return ForceEstimate.invalid(estimate.stamp_ns, Status.NO_CATHETER, "something hides the catheter from the camera")


def main() -> None:
    """Run and draw."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--feedback", default="pretrained/compact")
    feedback = parser.parse_args().feedback
    model = "truth" if feedback == "truth" else load_model(pathlib.Path(feedback))
    bench = live_bench(model, bench_of_regime(PRESETS["bench-2021"], "perpendicular", SECONDS), seed=7)
    run = run_control(model, bench, ControlSettings(), seconds=SECONDS, spoil=hidden)  # type: ignore[arg-type]
    title = f"0.2 N held, perpendicular contact; no valid estimate from {GONE_S[0]:g} to {GONE_S[1]:g} s; {feedback}"
    (FOLDER / "control-invalid.svg").write_text(plot_control(run, title), encoding="utf-8")
    print(run.figures(SECONDS))


if __name__ == "__main__":
    main()
