"""Fits the regression that predicts whether a line of the locator is right.

    python -m bench.locator.probability FILE.npz ... [--write]

The files come from ``python -m bench.studies.locator_accuracy PRESET --features FILE.npz`` and ``python -m
bench.locator.scenes --features FILE.npz``. Prints how often lines of sessions that a regression has not seen are right,
by its probability. ``--write`` writes the weights into tipforce/vision/locator/_line_probability.py: those for camera
images, or those for X-ray images where the files are of such images.
"""

import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize
from scipy.special import expit
from sklearn.linear_model import LogisticRegression
from sklearn.metrics import roc_auc_score
from sklearn.model_selection import GroupKFold, cross_val_predict
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from tipforce.vision.locator import _line_probability
from tipforce.vision.locator._line_probability import (
    MARKED_LOG_ODDS,
    WEIGHTS,
    XRAY_WEIGHTS,
    standardised,
)

STEPS = (0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 0.97, 1.0)
"""Limits of the rows of the reliability table."""
XRAY_PRIOR = 10.0
"""Weights for X-ray images, which are fitted to fewer lines, stay near those for camera images: precision of a normal
distribution around them. 10 separated lines of unseen sessions as well as 1, and better than 30."""
UNMARKED_XRAY_LOG_ODDS = -0.8
"""Logit added to the fit in X-ray images: a line along another instrument has the features of a right one. Chosen on 74
sessions of `fluoro` and `biplane`, of which 9 show another instrument in most frames."""


def _reliability(stated: npt.NDArray[np.float64], right: npt.NDArray[np.bool_]) -> None:
    for low, high in pairwise(STEPS):
        own = (stated >= low) & (stated <= high)
        if own.any():
            print(
                f"  {low:.2f} to {high:.2f}: {own.sum()} lines, {stated[own].mean():.3f}, right {right[own].mean():.3f}"
            )


def _numbers(values: npt.NDArray[np.float64]) -> str:
    return ", ".join(f"{value:.3g}" for value in values)


def _write(part: str, lines: list[str]) -> None:
    """Writes ``lines`` into tipforce's source, between the comments BEGIN and END of ``part``."""
    path = Path(_line_probability.__file__)
    head, rest = path.read_text(encoding="utf-8").split(f"# BEGIN {part}")
    first, tail = rest.split("\n", 1)[0], rest.split(f"# END {part}")[1]
    path.write_text("\n".join([f"{head}# BEGIN {part}{first}", *lines, f"# END {part}{tail}"]), encoding="utf-8")


def _array(name: str, values: npt.NDArray[np.float64]) -> list[str]:
    return [f"{name} = np.array([", f"    {_numbers(values)},", "])  # fmt: skip"]


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
        lines = [f"MEANS = np.array([{_numbers(means)}])", f"SPREADS = np.array([{_numbers(spreads)}])"]
        lines += _array("WEIGHTS", np.concatenate([constant, weights[:-1]]))
        _write("camera", [*lines, f"MARKED_LOG_ODDS = {weights[-1]:.3g}"])


def _xray_weights(terms: npt.NDArray[np.float64], right: npt.NDArray[np.bool_]) -> npt.NDArray[np.float64]:
    """Returns the (11,) most probable weights of lines with ``terms`` (n, 11); the constant is free."""

    def loss(weights: npt.NDArray[np.float64]) -> tuple[float, npt.NDArray[np.float64]]:
        scores, off = terms @ weights, XRAY_PRIOR * np.append(0.0, (weights - WEIGHTS)[1:])
        value = np.logaddexp(0.0, scores).sum() - scores[right].sum() + 0.5 * float(off @ (weights - WEIGHTS))
        return float(value), terms.T @ (expit(scores) - right) + off

    return minimize(loss, WEIGHTS, jac=True).x


def _fit_xray(paths: list[str], write: bool) -> None:
    x, y, marked, group = _read(paths)
    if marked.any():
        raise SystemExit("X-ray: lines with a marked base are not fitted; leave their files out")
    terms = standardised(x)
    print("X-ray, by the weights in tipforce:")
    _reliability(expit(terms @ XRAY_WEIGHTS), y)
    print(f"area under the curve: {roc_auc_score(y, terms @ WEIGHTS):.3f} by the weights for camera images")
    stated = np.zeros(len(y))
    for seen, left in GroupKFold(8).split(terms, y, group):
        stated[left] = expit(terms[left] @ _xray_weights(terms[seen], y[seen]) + UNMARKED_XRAY_LOG_ODDS)
    print(f"X-ray, by weights that did not see the session; area {roc_auc_score(y, stated):.3f}:")
    _reliability(stated, y)
    if write:
        weights = _xray_weights(terms, y)
        weights[0] += UNMARKED_XRAY_LOG_ODDS
        _write("X-ray", _array("XRAY_WEIGHTS", weights))


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
