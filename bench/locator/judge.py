"""Evaluates a checkpoint of the locator on photographs with known mouth and tip.

    python -m bench.locator.judge WEIGHTS.pt FOLDER [-o sheet.png]

FOLDER holds images and ``points.csv`` (image, mouth_u, mouth_v, tip_u, tip_v in px). Four prompts are tried: none, the
border that the catheter comes from, its size, a click on the mouth. Right: mouth and tip within 8 px.
"""

import argparse
import csv
import math
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import torch
from bench.locator.train import heat_peaks, read_weights

from tipforce.training.locator import (
    NOMINAL_LENGTH_PX,
    SIZE_MULTIPLE_PX,
    Locator,
    network_input,
    prompt_channels,
)
from tipforce.types import FloatArray, Image, IntArray

LIMIT_PX = 8.0
SCALES = (0.5, 0.7, 1.0, 1.4)
"""Scales of the image that are tried if no size is stated."""


class LocatedPoints(NamedTuple):
    """Points of the catheter in an image.

    Attributes:
        points_px: (LINE_POINTS, 2) u, v px of the image, base to tip.
        mass: (LINE_POINTS,) probability that the point is within a cell of its peak.
        states: (LINE_POINTS,) most probable states.
        present: probability of a catheter in the image.
    """

    points_px: FloatArray
    mass: FloatArray
    states: IntArray
    present: float


@torch.inference_mode()
def locate_points(
    network: Locator,
    image: Image,
    scale: float,
    *,
    base: tuple[float, float] | None = None,
    side: int | None = None,
    sizes: tuple[float, float] | None = None,
) -> LocatedPoints:
    """Returns the points that the network finds in an image.

    Args:
        network: the locator, in eval mode.
        image: (h, w, 3) RGB.
        scale: px of the network's image for each px of ``image``; the catheter is best some 110 px long there.
        base: u, v px of a click on the base.
        side: index in SIDES of the border that the catheter comes from.
        sizes: length and diameter in px; NaN for one that is not known.
    """
    interpolation = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_LINEAR
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=interpolation)
    h, w = small.shape[:2]
    padded = cv2.copyMakeBorder(small, 0, -h % SIZE_MULTIPLE_PX, 0, -w % SIZE_MULTIPLE_PX, cv2.BORDER_REPLICATE)

    def stated(values: tuple[float, ...] | None, count: int, factor: float = 1.0, offset: float = 0.0) -> torch.Tensor:
        row = [math.nan] * count if values is None else [value * factor + offset for value in values]
        return torch.tensor([row], dtype=torch.float32)

    channels = prompt_channels(
        (padded.shape[0], padded.shape[1]), stated(base, 2, scale, 0.5 * (scale - 1.0)), stated(None, 4),
        stated(None if side is None else (float(side),), 1), stated(None, 2), torch.full((1, 1, 2), math.nan),
        torch.full((1, 2, 2), math.nan), stated(sizes, 2, scale),
    )  # fmt: skip
    x = network_input(torch.from_numpy(np.asarray(padded, np.uint8))[None], channels)
    outputs = network(x.contiguous(memory_format=torch.channels_last))
    points, mass = heat_peaks(outputs.heat)
    return LocatedPoints(
        (points[0].numpy().astype(np.float64) + 0.5) / scale - 0.5,
        mass[0].numpy().astype(np.float64),
        outputs.states[0].argmax(-1).numpy(),
        float(torch.sigmoid(outputs.present)[0]),
    )


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
