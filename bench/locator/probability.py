"""Fits the regression that predicts whether a line of the locator is right.

    python -m bench.locator.probability FILE.npz ...

The files come from ``python -m bench.studies.locator_accuracy PRESET --features FILE.npz``. Prints how often lines of
sessions that a regression has not seen are right, by its probability, and the weights for
tipforce/vision/_line_probability.py.
"""

import sys
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from sklearn.linear_model import LogisticRegression
from sklearn.model_selection import GroupKFold, cross_val_predict
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from tipforce.vision._line_probability import INTERCEPT, WEIGHTS

STEPS = (0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 0.97, 1.0)
"""Limits of the rows of the reliability table."""


def _reliability(stated: npt.NDArray[np.float64], right: npt.NDArray[np.bool_]) -> None:
    for low, high in pairwise(STEPS):
        own = (stated >= low) & (stated <= high)
        if own.any():
            print(
                f"  {low:.2f} to {high:.2f}: {own.sum()} lines, {stated[own].mean():.3f}, right {right[own].mean():.3f}"
            )


def main() -> None:
    """Fits and prints."""
    rows, right, groups = [], [], []
    for path in sys.argv[1:]:
        with np.load(path) as read:
            rows.append(read["features"])
            right.append(read["right"])
            groups.append(np.char.add(f"{path} ", read["session"].astype(str)))
    x, y, group = np.concatenate(rows), np.concatenate(right).astype(bool), np.concatenate(groups)
    model = make_pipeline(StandardScaler(), LogisticRegression(C=0.3, max_iter=5000))
    stated = cross_val_predict(model, x, y, groups=group, cv=GroupKFold(8), method="predict_proba")[:, 1]
    print("by regressions that did not see the session:")
    _reliability(stated, y)
    print("by the weights in tipforce:")
    _reliability(1.0 / (1.0 + np.exp(-np.clip(INTERCEPT + x @ np.array(WEIGHTS), -30.0, 30.0))), y)
    scaler, regression = (step for _, step in model.fit(x, y).steps)
    weights = regression.coef_[0] / scaler.scale_
    print(f"INTERCEPT = {regression.intercept_[0] - weights @ scaler.mean_:.3f}")
    print(f"WEIGHTS = LineFeatures({', '.join(f'{weight:.3g}' for weight in weights)})")


if __name__ == "__main__":
    main()
