"""Method 1 under the thesis's protocol over many draws of its samples, beside whole sessions held out.

    tipforce simulate --preset thesis-2021 --as dataset --samples 1836 --samples-per-session 153 --seed 0 -o SET
    python -m bench.studies.thesis_letter SET [--seeds 20] [--session-seeds 3] [--methods letter default]

Each seed draws 220 frames of the first eight sessions and splits them 165 / 55 at random; "sessions" draws 220 frames
of all sessions and holds each session out in turn. ``letter``: thesis algorithm 1 and the knob alone; ``default``: the
tracer and all drives. Errors of the magnitude against the force sensor, in mN.
"""

import argparse
from pathlib import Path

import numpy as np

from tipforce.datasets import open_dataset
from tipforce.estimators import Svr, SvrSettings
from tipforce.evaluation import EvaluationSettings, Method, evaluate


def main() -> None:
    """Prints a line for each protocol and method: mean and standard deviation over the seeds."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--session-seeds", type=int, default=3)
    parser.add_argument("--methods", nargs="+", choices=("letter", "default"), default=["letter"])
    options = parser.parse_args()
    data = open_dataset(options.data)
    settings = {"letter": SvrSettings.model_validate(Svr.thesis_settings), "default": SvrSettings()}
    methods = [Method(name, Svr(settings[name])) for name in options.methods]
    print("protocol  method    MAE          RMSE         largest       smallest  bias          abstained  better")
    for protocol, seeds in (("thesis", options.seeds), ("session", options.session_seeds)):
        rows: dict[str, list[list[float]]] = {}
        for seed in range(seeds):
            result = evaluate(data, methods, EvaluationSettings(protocols=[protocol], samples=220, seed=seed))
            for each in result.results:
                scores = each.metrics["quantities"]["magnitude"]
                shares = [each.metrics["abstained_share"], np.nan]
                rows.setdefault(each.method, []).append(
                    [scores[key] for key in ("mae_n", "rmse_n", "max_n", "min_n", "bias_n")] + shares
                )
        constant = np.array(rows["constant"])[:, 0]
        for method, found in rows.items():
            table = np.array(found)
            table[:, :5] *= 1e3
            mean, spread = table.mean(axis=0), table.std(axis=0)
            texts = [f"{m:5.1f} +- {s:4.1f}" for m, s in zip(mean[:5], spread[:5], strict=True)]
            better = np.mean(np.array(found)[:, 0] < constant)
            print(f"{protocol:9} {method:9} {'  '.join(texts)}  {mean[5]:.3f}  {better:.2f}", flush=True)


if __name__ == "__main__":
    main()
