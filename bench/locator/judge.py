"""Evaluates a checkpoint of the locator on photographs with known mouth and tip.

    python -m bench.locator.judge WEIGHTS.pt FOLDER [-o sheet.png]

FOLDER holds images and ``points.csv`` (image, mouth_u, mouth_v, tip_u, tip_v in px). Four prompts are tried: none, the
border that the catheter comes from, its size, a click on the mouth. Right: mouth and tip within 8 px.
"""

import argparse
import csv
from pathlib import Path

import cv2
import numpy as np

from tipforce.training.locator import (
    NOMINAL_LENGTH_PX,
    locate_points,
    read_weights,
)

LIMIT_PX = 8.0
SCALES = (0.5, 0.7, 1.0, 1.4)
"""Scales of the image that are tried if no size is stated."""


def main() -> None:
    """Evaluates the checkpoint."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("weights", type=Path)
    parser.add_argument("folder", type=Path)
    parser.add_argument("-o", dest="out", type=Path)
    options = parser.parse_args()
    network = read_weights(options.weights)
    with (options.folder / "points.csv").open() as file:
        rows = list(csv.DictReader(file))
    right = dict.fromkeys(("nothing", "side", "size", "mouth"), 0)
    sheet = []
    for row in rows:
        read = cv2.imread(str(options.folder / row["image"]))
        assert read is not None
        image = np.ascontiguousarray(read[..., ::-1])
        mouth = np.array([float(row["mouth_u"]), float(row["mouth_v"])])
        tip = np.array([float(row["tip_u"]), float(row["tip_v"])])
        length = float(np.linalg.norm(tip - mouth))
        sizes = length, length / 8.0
        tries = {"nothing": {}, "side": {"side": 2}, "size": {"sizes": sizes}, "mouth": {"base": tuple(mouth.tolist())}}
        for name, facts in tries.items():
            scales = (NOMINAL_LENGTH_PX / length,) if name == "size" else SCALES
            found = max(
                (locate_points(network, image, s, **facts) for s in scales), key=lambda each: float(each[1].mean())
            )
            points, mass, states, there = found
            off = np.linalg.norm(points[0] - mouth), np.linalg.norm(points[-1] - tip)
            right[name] += max(off) <= LIMIT_PX
            shown = "".join(str(state) for state in states)
            print(
                f"{row['image'][:26]:26s} {name:8s} mouth {off[0]:6.1f} px, tip {off[1]:6.1f} px, "
                f"mass {mass.mean():.2f}, a catheter {there:.2f}, states {shown}"
            )
            if name in ("nothing", "mouth"):
                drawn = image.copy()
                for point in points:
                    cv2.circle(drawn, tuple(np.round(point).astype(int).tolist()), 2, (255, 0, 0), -1)
                v, u = int(mouth[1]), int(mouth[0])
                sheet.append(drawn[max(v - 120, 0) : max(v - 120, 0) + 280, max(u - 160, 0) : max(u - 160, 0) + 320])
    for name, count in right.items():
        print(f"{name}: {count} of {len(rows)} right")
    if options.out:
        half = [np.hstack(sheet[k : k + 4]) for k in range(0, len(sheet) - len(sheet) % 4, 4)]
        cv2.imwrite(str(options.out), np.vstack(half)[..., ::-1])


if __name__ == "__main__":
    main()
