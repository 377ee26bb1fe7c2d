"""Method 1 on real sessions of a tendon manipulator, from the raw CSV and JSON to the table.

    TIPFORCE_REAL_DATA=... .venv/bin/python -m bench.studies.real_sessions [random] [session]
    TIPFORCE_REAL_DATA=... .venv/bin/python -m bench.studies.real_sessions each [SEED]

The data: github.com/Bigyuun/LSTM-force-estimation, commit 621b92c9. Every constant that a fit chooses, it chooses by
cross-validation within its training part; which methods are listed here was decided by looking at these tables.
"""

import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import uniform_filter1d
from sklearn.ensemble import ExtraTreesRegressor

from tipforce.datasets import Dataset, open_dataset, splits
from tipforce.datasets.layouts._tendon_manipulator import TARE_ROWS
from tipforce.estimators import create
from tipforce.types import FloatArray

BEYOND: dict[str, Any] = {
    "force": "components",
    "scaling": "standard",
    "features": {"constant": False},  # the stored polynomials have none
    # the robot's length in the unit of the stored polynomials, undocumented: 1.0 to 1.6 give the same within 4 mN
    "angles": {"degree": 3, "length": 1.4},
    "linear": 1.0,
}
ACROSS = {
    **BEYOND,
    "c": [0.03, 0.1, 0.3, 1.0],
    "epsilon": [0.01, 0.03, 0.1],
    "sigma": [1.0, 2.0, 4.0],
    "training_samples": 800,
    "tuning_samples": 800,
    "label_average_ms": 300,
}
WITHIN = {
    **BEYOND,
    "hold_out": "sample",
    "folds": 3,
    "c": [3.0, 10.0, 30.0],
    "epsilon": [0.06],
    "sigma": [2.0, 3.0],
    "tuning_samples": 2500,
}
METHODS: dict[str, dict[str, Any]] = {
    "svr, the thesis's": {"force": "components"},
    "svr, across sessions": ACROSS,
    "svr, across sessions, window": {**ACROSS, "window": {"lags_ms": [0, 300], "average_ms": 150}},
    "svr, within sessions": WITHIN,
    "svr, within sessions, window": {**WITHIN, "window": {"lags_ms": [0, 300, 1000, 3000], "average_ms": 200}},
}

Answer = Callable[[Dataset, np.ndarray, np.ndarray], FloatArray]


def by_settings(settings: dict[str, Any]) -> Answer:
    def answer(data: Dataset, train: np.ndarray, test: np.ndarray) -> FloatArray:
        svr = create("svr", settings).fit(data.subset(train))
        if svr.uses_history:
            return np.array([estimate.force_n for estimate in svr.predict(data)])[test, :2]
        return np.array([estimate.force_n for estimate in svr.predict(data.subset(test))])[:, :2]

    return answer


def constant(data: Dataset, train: np.ndarray, test: np.ndarray) -> FloatArray:
    return np.tile(data.force_n[train, :2].mean(axis=0), (len(test), 1))


def extra_trees(data: Dataset, train: np.ndarray, test: np.ndarray) -> FloatArray:
    shapes = [observation.views["camera"].values for observation in data.observations()]  # type: ignore[union-attr]
    table = np.column_stack([shapes, *data.actuation.values()])
    trees = ExtraTreesRegressor(100, random_state=0).fit(table[train], data.force_n[train, :2])
    return trees.predict(table[test])


def noise(data: Dataset) -> list[tuple[str, FloatArray]]:
    """Returns the smallest error of a method that follows the slow pull, and the readings that show it.

    The pull changes over seconds. Its motion about the mean over one second is noise of the sensor; it is not white
    (its first differences are uncorrelated), so ten rows of tare average little of it away.
    """
    force = data.force_n[:, :2] * 1e3
    parts = [force[data.session == name] for name in data.sessions]
    slow = [uniform_filter1d(part, 31, axis=0) for part in parts]
    fast = np.sqrt(np.mean(np.concatenate([p - s for p, s in zip(parts, slow, strict=True)]) ** 2, axis=0) * 31 / 30)
    still = force[data.session == "nopayload"]
    blocks = still[: len(still) // TARE_ROWS * TARE_ROWS].reshape(-1, TARE_ROWS, 2)
    return [
        ("no load at all: spread of the readings", np.std(still, axis=0)),
        ("about their mean over one second, all sessions", fast),
        (f"no load: spread of the medians of {TARE_ROWS} rows (tare)", np.std(np.median(blocks, axis=1), axis=0)),
    ]


def each_session(data: Dataset, seed: int) -> None:
    """Prints the estimates of the best method across sessions, for each session that it was not trained on.

    Wrong: off by more than twice the error over the folds of its own training part, which is the error that it expects.
    """
    settings = {**METHODS["svr, across sessions, window"], "seed": seed}
    print(f"{'session':16s} {'abstains':>8s} {'RMSE, mN':>13s} {'bias, mN':>13s} {'wrong, %':>13s} {'holds, %':>13s}")
    rows: list[FloatArray] = []
    for split in splits("session", data):
        svr = create("svr", settings).fit(data.subset(split.train))
        answers = svr.predict(data.subset(split.test))
        error = np.array([answer.force_n[:2] for answer in answers]) - data.force_n[split.test, :2]
        expected = np.array([target.cv_rmse_n for target in svr.describe().targets.values()])
        ends = np.array([answer.interval_n[:2] for answer in answers])
        truth = data.force_n[split.test, :2]
        held = (ends[:, :, 0] <= truth) & (truth <= ends[:, :, 1])
        valid = np.array([[answer.valid] * 2 for answer in answers])
        wrong = np.abs(error) > 2 * expected
        rows.append(np.stack([error, *(share.astype(np.float64) for share in (wrong, held, valid))]))
        _print_session(str(data.session[split.test[0]]), rows[-1])
    _print_session("all", np.concatenate(rows, axis=1))


def _print_session(name: str, rows: FloatArray) -> None:
    error, wrong, held = rows[:3, rows[3, :, 0] > 0]
    parts = [np.sqrt(np.mean(error**2, axis=0)) * 1e3, error.mean(axis=0) * 1e3, wrong.mean(axis=0) * 100]
    text = "".join(f" {x:6.1f}/{y:6.1f}" for x, y in [*parts, held.mean(axis=0) * 100])
    print(f"{name:16s} {100 * (1 - rows[3, :, 0].mean()):6.1f} %{text}", flush=True)


def main() -> None:
    """Prints the table."""
    root = os.environ.get("TIPFORCE_REAL_DATA")
    if not root:
        sys.exit("set TIPFORCE_REAL_DATA to the folder that holds tendon-manipulator/")
    data = open_dataset(Path(root) / "tendon-manipulator")
    if sys.argv[1:2] == ["each"]:
        each_session(data, int(sys.argv[2]) if len(sys.argv) > 2 else 0)
        return
    protocols = [word for word in sys.argv[1:] if word in ("random", "session")] or ["random", "session"]
    print(f"{data.title}\n{len(data)} rows, {len(data.sessions)} sessions; RMSE fx / fy in mN, all test rows pooled\n")
    methods: dict[str, Answer] = {"constant": constant, "extra trees (reference)": extra_trees}
    methods |= {name: by_settings(settings) for name, settings in METHODS.items()}
    for protocol in protocols:
        plan = splits(protocol, data, folds=4 if protocol == "random" else None)  # type: ignore[arg-type]
        print(f"{protocol}, {len(plan)} folds")
        for name, answer in methods.items():
            start = time.perf_counter()
            found = np.empty((len(data), 2))
            for split in plan:
                found[split.test] = answer(data, split.train, split.test)
            rmse = np.sqrt(np.mean((found - data.force_n[:, :2]) ** 2, axis=0)) * 1e3
            print(f"  {name:32s} {rmse[0]:6.1f} / {rmse[1]:6.1f}   {time.perf_counter() - start:5.0f} s", flush=True)
    print("noise")
    for name, (x, y) in noise(data):
        print(f"  {name:52s} {x:6.1f} / {y:6.1f}")


if __name__ == "__main__":
    main()
