"""Fits the regression that predicts whether a line of the locator is right.

    python -m bench.locator.probability FILE.npz ... [--write]

The files come from ``python -m bench.studies.locator_accuracy PRESET --features FILE.npz`` and ``python -m
bench.locator.scenes --features FILE.npz``. Prints how often lines of sessions that a regression has not seen are right,
by its probability. ``--write`` writes the weights into tipforce/vision/locator/_line_probability.py. Files of X-ray
images give the ``log_odds`` of the detector for X-ray images, which ``--write`` writes into its facts.
"""

import json
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.special import expit
from sklearn.linear_model import LogisticRegression
from sklearn.model_selection import GroupKFold, cross_val_predict
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from tipforce._system.json_files import read_json
from tipforce.vision.locator import DETECTOR_FACTS, XRAY_DETECTOR, _line_probability
from tipforce.vision.locator._line_probability import (
    MARKED_LOG_ODDS,
    WEIGHTS,
    fitted_log_odds,
    standardised,
)

STEPS = (0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 0.97, 1.0)
"""Limits of the rows of the reliability table."""
UNMARKED_XRAY_LOG_ODDS = -0.8
"""Logit added to the fit in X-ray images: a line along another instrument has the features of a right one. Chosen on 74
sessions of `fluoro` and `biplane`, of which 9 show another instrument in most frames."""
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
    means: npt.NDArray[np.float64], spreads: npt.NDArray[np.float64], weights: npt.NDArray[np.float64], marked: float
) -> None:  # fmt: skip
    path = Path(_line_probability.__file__)
    head, rest = path.read_text(encoding="utf-8").split(BEGIN)
    first, tail = rest.split("\n", 1)[0], rest.split(END)[1]
    lines = [f"{BEGIN}{first}", f"MEANS = np.array([{_numbers(means)}])", f"SPREADS = np.array([{_numbers(spreads)}])"]
    lines += ["WEIGHTS = np.array(["]
    lines += [f"    {_numbers(weights[k : k + 12])}," for k in range(0, len(weights), 12)]
    lines += ["])  # fmt: skip", f"MARKED_LOG_ODDS = {marked:.3g}", f"{END}"]
    path.write_text(head + "\n".join(lines) + tail, encoding="utf-8")


def _read(paths: list[str]) -> tuple[npt.NDArray[Any], ...]:
    """Returns the features (n, 10) of the lines, whether each is right and its base is marked, and its session."""
    rows, right, marked, groups = [], [], [], []
    for path in paths:
        with np.load(path) as read:
            rows.append(read["features"])
            right.append(read["right"])
            marked.append(np.broadcast_to(read["marked"], len(read["right"])))
            groups.append(np.char.add(f"{path} ", read["session"].astype(str)))
    return np.concatenate(rows), np.concatenate(right).astype(bool), np.concatenate(marked), np.concatenate(groups)


def _fit_camera(paths: list[str], write: bool) -> None:
    x, y, marked, group = _read(paths)
    print("by the weights in tipforce:")
    _reliability(expit(standardised(x) @ WEIGHTS + MARKED_LOG_ODDS * marked), y)
    means, spreads = x.mean(axis=0), x.std(axis=0)
    terms = np.column_stack([standardised(x, means, spreads)[:, 1:], marked])
    model = make_pipeline(StandardScaler(), LogisticRegression(C=0.5, max_iter=5000))
    stated = cross_val_predict(model, terms, y, groups=group, cv=GroupKFold(8), method="predict_proba")[:, 1]
    print("by regressions that did not see the session:")
    _reliability(stated, y)
    scaler, regression = (step for _, step in model.fit(terms, y).steps)
    weights = regression.coef_[0] / scaler.scale_
    if write:
        constant = regression.intercept_ - weights @ scaler.mean_
        _write(means, spreads, np.concatenate([constant, weights[:-1]]), weights[-1])


def _fit_xray(paths: list[str], write: bool) -> None:
    x, y, marked, _ = _read(paths)
    facts = XRAY_DETECTOR / DETECTOR_FACTS
    present, score = read_json(facts), standardised(x) @ WEIGHTS + MARKED_LOG_ODDS * marked
    log_odds = fitted_log_odds(score, y) + UNMARKED_XRAY_LOG_ODDS
    for text, each in (("in tipforce", present["log_odds"]), ("new", log_odds)):
        print(f"X-ray, log_odds {each:.3f} ({text}):")
        _reliability(expit(score + each), y)
    if write:
        facts.write_text(json.dumps({**present, "log_odds": round(log_odds, 3)}, indent=2) + "\n", encoding="utf-8")


def main() -> None:
    """Fits, prints and writes."""
    paths = [each for each in sys.argv[1:] if each != "--write"]
    in_xray = [bool(np.load(path)["xray"]) for path in paths]
    for xray, fit in ((False, _fit_camera), (True, _fit_xray)):
        own = [path for path, each in zip(paths, in_xray, strict=True) if each == xray]
        if own:
            fit(own, "--write" in sys.argv)


if __name__ == "__main__":
    main()
