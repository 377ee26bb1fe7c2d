"""Evaluates a checkpoint of the locator on photographs with known mouth and tip.

    python -m bench.locator.judge WEIGHTS.pt FOLDER [-o sheet.png]

FOLDER holds images and ``points.csv`` (image, mouth_u, mouth_v, tip_u, tip_v in px). Four prompts are tried: none, the
border that the catheter comes from, its size, a click on the mouth. Right: mouth and tip within 8 px.
"""

import argparse
import csv
import math
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import torch

from tipforce.training.locator import (
    NOMINAL_LENGTH_PX,
    Locator,
    heat_peaks,
    network_input,
    prompt_channels,
    read_checkpoint,
)

LIMIT_PX = 8.0
SCALES = (0.5, 0.7, 1.0, 1.4)
"""Scales of the image that are tried if no size is stated."""


@torch.inference_mode()
def locate(
    network: Locator, image: npt.NDArray[np.uint8], scale: float, base: tuple[float, float] | None = None,
    side: int | None = None, sizes: tuple[float, float] | None = None,
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.int64], float]:  # fmt: skip
    """Reads ``image`` (h, w, 3) at ``scale``.

    Args:
        network: the locator.
        image: RGB.
        scale: px of the network's image for each px of ``image``.
        base: a click on the base, px.
        side: border that the catheter comes from.
        sizes: length and diameter, px.

    Returns:
        Points (16, 2) px, their probabilities (16,), their states (16,), the probability of a catheter.
    """
    way = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_LINEAR
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=way)
    h, w = small.shape[:2]
    padded = cv2.copyMakeBorder(small, 0, -h % 32, 0, -w % 32, cv2.BORDER_REPLICATE)

    def stated(values: tuple[float, ...] | None, count: int, factor: float, offset: float = 0.0) -> torch.Tensor:
        found = [math.nan] * count if values is None else [value * factor + offset for value in values]
        return torch.tensor([found], dtype=torch.float32)

    planes = prompt_channels(
        padded.shape[:2], stated(base, 2, scale, 0.5 * (scale - 1.0)), stated(None, 4, 1.0),
        stated(None if side is None else (float(side),), 1, 1.0), stated(None, 2, 1.0),
        torch.full((1, 1, 2), math.nan), torch.full((1, 2, 2), math.nan), stated(sizes, 2, scale),
    )  # fmt: skip
    heat, _, _, states, present = network(network_input(torch.from_numpy(padded)[None], planes))
    points, mass = heat_peaks(heat)
    there = float(torch.sigmoid(present)[0])
    found = (points[0].numpy().astype(np.float64) + 0.5) / scale - 0.5
    return found, mass[0].numpy().astype(np.float64), states[0].argmax(-1).numpy(), there


def main() -> None:
    """Evaluates the checkpoint."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("weights", type=Path)
    parser.add_argument("folder", type=Path)
    parser.add_argument("-o", dest="out", type=Path)
    options = parser.parse_args()
    network = read_checkpoint(options.weights)
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
            found = max((locate(network, image, s, **facts) for s in scales), key=lambda each: float(each[1].mean()))
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
