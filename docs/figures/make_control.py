"""Draws the figures of docs/results/control.md.

    OMP_NUM_THREADS=1 python docs/figures/make_control.py [--feedback truth]

Session 0 of seed 7 of bench-2021, perpendicular contact: the force held; and the same with invalid estimates for 1.2
seconds in mid-contact.
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
GONE_S = (19.0, 20.2)


def hidden(estimate: ForceEstimate) -> ForceEstimate:
    """As if something stood in front of the camera for a while."""
    if not GONE_S[0] <= estimate.stamp_ns * 1e-9 < GONE_S[1]:
        return estimate
    return ForceEstimate.invalid(estimate.stamp_ns, Status.NO_CATHETER, "something stands in front of the camera")


def main() -> None:
    """Run and draw."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--feedback", default="truth")
    feedback = parser.parse_args().feedback
    model = "truth" if feedback == "truth" else load_model(pathlib.Path(feedback))
    bench = live_bench(model, bench_of_regime(PRESETS["bench-2021"], "perpendicular", SECONDS), seed=7)
    for name, spoil, title in (
        ("control-hold", None, "0.2 N held, perpendicular contact"),
        ("control-invalid", hidden, "the same, without a valid estimate from 19 to 20.2 s"),
    ):
        run = run_control(model, bench, ControlSettings(), seconds=SECONDS, spoil=spoil)  # type: ignore[arg-type]
        (FOLDER / f"{name}.svg").write_text(plot_control(run, f"{title}; feedback: {feedback}"), encoding="utf-8")
        print(name, run.figures(SECONDS))


if __name__ == "__main__":
    main()
