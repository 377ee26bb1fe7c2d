"""Fits the regression that predicts whether a line of the locator is right.

    python -m bench.locator.probability FILE.npz ... [--write]

The files come from ``python -m bench.studies.locator_accuracy PRESET --features FILE.npz`` and ``python -m
bench.locator.scenes --features FILE.npz``. Prints how often lines of sessions that a regression has not seen are right,
by its probability. ``--write`` writes the weights into tipforce/vision/locator/_line_probability.py.
"""

import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import numpy.typing as npt
from sklearn.linear_model import LogisticRegression
from sklearn.model_selection import GroupKFold, cross_val_predict
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from tipforce.vision.locator import _line_probability
from tipforce.vision.locator._line_probability import (
    MARKED_LOG_ODDS,
    UNMARKED_XRAY_LOG_ODDS,
    WEIGHTS,
    XRAY_LOG_ODDS,
    standardised,
)

STEPS = (0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 0.97, 1.0)
"""Limits of the rows of the reliability table."""
BEGIN, END = "# BEGIN", "# END"


def _reliability(stated: npt.NDArray[np.float64], right: npt.NDArray[np.bool_]) -> None:
    for low, high in pairwise(STEPS):
        own = (stated >= low) & (stated <= high)
        if own.any():
            print(
                f"  {low:.2f} to {high:.2f}: {own.sum()} lines, {stated[own].mean():.3f}, right {right[own].mean():.3f}"
            )


def _numbers(values: npt.NDArray[np.float64]) -> str:
    return ", ".join(f"{value:.3g}" for value in values)


def _write(
    means: npt.NDArray[np.float64], spreads: npt.NDArray[np.float64], weights: npt.NDArray[np.float64], xray: float,
    marked: float,
) -> None:  # fmt: skip
    path = Path(_line_probability.__file__)
    head, rest = path.read_text(encoding="utf-8").split(BEGIN)
    first, tail = rest.split("\n", 1)[0], rest.split(END)[1]
    lines = [f"{BEGIN}{first}", f"MEANS = np.array([{_numbers(means)}])", f"SPREADS = np.array([{_numbers(spreads)}])"]
    lines += ["WEIGHTS = np.array(["]
    lines += [f"    {_numbers(weights[k : k + 12])}," for k in range(0, len(weights), 12)]
    lines += ["])  # fmt: skip", f"XRAY_LOG_ODDS, MARKED_LOG_ODDS = {xray:.3g}, {marked:.3g}", f"{END}"]
    path.write_text(head + "\n".join(lines) + tail, encoding="utf-8")


def main() -> None:
    """Fits, prints and writes."""
    rows, right, groups, xray, marked = [], [], [], [], []
    for path in (each for each in sys.argv[1:] if each != "--write"):
        with np.load(path) as read:
            rows.append(read["features"])
            right.append(read["right"])
            xray.append(np.full(len(read["right"]), bool(read["xray"])))
            marked.append(np.broadcast_to(read["marked"], len(read["right"])))
            groups.append(np.char.add(f"{path} ", read["session"].astype(str)))
    x, y, group = np.concatenate(rows), np.concatenate(right).astype(bool), np.concatenate(groups)
    in_xray, is_marked = np.concatenate(xray), np.concatenate(marked)
    print("by the weights in tipforce:")
    score = standardised(x) @ WEIGHTS + XRAY_LOG_ODDS * in_xray + MARKED_LOG_ODDS * is_marked
    score += UNMARKED_XRAY_LOG_ODDS * (in_xray & ~is_marked)
    _reliability(1.0 / (1.0 + np.exp(-score)), y)
    means, spreads = x.mean(axis=0), x.std(axis=0)
    terms = np.column_stack([standardised(x, means, spreads)[:, 1:], in_xray, is_marked])
    model = make_pipeline(StandardScaler(), LogisticRegression(C=0.5, max_iter=5000))
    stated = cross_val_predict(model, terms, y, groups=group, cv=GroupKFold(8), method="predict_proba")[:, 1]
    print("by regressions that did not see the session:")
    _reliability(stated, y)
    scaler, regression = (step for _, step in model.fit(terms, y).steps)
    weights = regression.coef_[0] / scaler.scale_
    if "--write" in sys.argv:
        constant = regression.intercept_ - weights @ scaler.mean_
        _write(means, spreads, np.concatenate([constant, weights[:-2]]), weights[-2], weights[-1])


if __name__ == "__main__":
    main()
