"""Measures how often the networks are right in held-out sessions, and fits the regression that predicts it.

    python -m bench.keypoints.probability V G B F [--least 0.8]

Prints for each preset how many lines are right (tip within 5 px along the shaft, all points within 2 px of the true
curve), their errors, and the lines that are accepted at ``--least``, by regressions that did not see the session; and
the weights for tipforce/vision/keypoints/_probability.py.
"""

import argparse
from collections import defaultdict
from pathlib import Path

import cv2
import numpy as np
from bench.keypoints.samples import Sample, load, split
from bench.studies.vision_on_simulation import SIDE_PX, TIP_PX, off_curve
from sklearn.linear_model import LogisticRegression
from sklearn.model_selection import GroupKFold, cross_val_predict
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from tipforce.vision.keypoints import Located, consensus, locate, signs

POINTS = 64


def main() -> None:
    """Measures, fits and prints."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("datasets", nargs="+", type=Path)
    parser.add_argument("--least", type=float, default=0.8)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    sessions: dict[str, list[tuple[Sample, Located | None]]] = defaultdict(list)
    for folder in options.datasets:
        for sample in split(load(folder))[1]:  # each preset by itself, as in training
            found = locate(sample.image, sample.base_side, sample.length_px, sample.diameter_px, POINTS)
            sessions[sample.session].append((sample, found))
    presets, groups, rows, right, off = [], [], [], [], []
    unseen: dict[str, int] = defaultdict(int)
    for name, members in sessions.items():
        seen = [found for _, found in members if found is not None]
        for sample, found in members:
            if found is None or len(seen) < 3:
                unseen[sample.preset] += 1
                continue
            length = consensus(seen)[1]
            tip, beside_px = off_curve(found.points, sample.image, sample.line)
            presets.append(sample.preset)
            groups.append(name)
            rows.append(signs(found, length))
            right.append(tip <= TIP_PX and beside_px.max() <= SIDE_PX)
            off.append((np.median(beside_px), tip))
    x, y, errors_px, which = np.array(rows), np.array(right), np.array(off), np.array(presets)
    model = make_pipeline(StandardScaler(), LogisticRegression(C=0.3, max_iter=5000))
    told = cross_val_predict(model, x, y, groups=groups, cv=GroupKFold(10), method="predict_proba")[:, 1]
    for preset in dict.fromkeys(presets):
        own = which == preset
        answered = own & (told >= options.least)
        beside, tip = np.median(errors_px[own & y], axis=0)
        total = int(own.sum()) + unseen[preset]
        print(
            f"{preset}: {total} images, right {y[own].sum() / total:.1%} (median beside {beside:.2f} px, tip {tip:.2f} "
            f"px); answered {answered.sum() / total:.1%}, of these wrong {1 - y[answered].mean():.1%}"
        )
    scaler, regression = model.fit(x, y)
    weights = regression.coef_[0] / scaler.scale_
    print(f"_INTERCEPT = {regression.intercept_[0] - weights @ scaler.mean_:.2f}")
    print(f"_WEIGHTS = Signs({', '.join(f'{weight:.3g}' for weight in weights)})")


if __name__ == "__main__":
    main()
