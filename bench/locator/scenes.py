"""Reads single scenes of the compositor as a user would have them read: which of the locator's lines are right?

    python -m bench.locator.scenes --features FILE.npz [--seed 700000] [--scenes 600]

Each scene is a session of one image, with nothing stated, or with the border, the size, a box at the base, or box and
size; some show no catheter. Where a second instrument looks alike the base is marked: nothing else says which is meant.
Right: as `bench.studies.locator_accuracy` judges it, with 2 px for each 10 px of diameter where the shaft is thicker.
FILE.npz goes to ``python -m bench.locator.probability FILE.npz ...``.
"""

import argparse
import math
from collections import Counter
from pathlib import Path

import cv2
import numpy as np
from bench.locator import empty, scene
from bench.locator.tubes import Drawer
from bench.studies.locator_accuracy import judge

from tipforce.errors import InputError
from tipforce.training.locator import SEEN, SIDES, Scene
from tipforce.vision import VisionSettings
from tipforce.vision.locator import Known, Located, Prompts, locate
from tipforce.vision.locator._line_probability import line_features, probability
from tipforce.vision.locator._session import POINTS, session_constants

SIZES_PX, LENGTH_SHARES = (384, 640), (scene.LENGTH_SHARES, (0.08, 0.3))
"""Sides of every other image, and the lengths of the catheters in it: in a photograph of a bench they are small."""
STATED = ("nothing", "border", "size", "box", "box and size")
VALID_PROBABILITY = VisionSettings().least_probability
EMPTY_SHARE = 0.15
"""Share of the scenes that are of a kind without a catheter."""
USUAL_DIAMETER_PX = 10.0
SIZE_ERROR, BOX_DIAMETERS = 0.04, 1.5
"""Error of a stated size, and half of the side of a box at the base."""


def prompts(drawn: Scene, stated: str, rng: np.random.Generator) -> Prompts:
    """Returns the prompts of a user who states ``stated``."""
    length = float(np.linalg.norm(np.diff(drawn.line, axis=0), axis=1).sum())
    size = np.exp(rng.normal(0.0, SIZE_ERROR, 2)) * (length, drawn.diameter_px) if "size" in stated else (None, None)
    half = max(BOX_DIAMETERS * drawn.diameter_px, 6.0)
    middle = drawn.line[0] + rng.uniform(-0.5, 0.5, 2) * half
    box = tuple(round(float(edge)) for edge in (*(middle - half), *(middle + half))) if "box" in stated else None
    border = SIDES[drawn.side] if stated == "border" and drawn.side >= 0 else None
    return Prompts(region=box, border=border, length_px=size[0], diameter_px=size[1])


def read(image: np.ndarray, asked: Prompts) -> Located | None:
    """Returns the line in ``image`` with the constants of a session of this one image."""
    try:
        found = session_constants([image], asked, moves=False)
    except InputError:
        return None
    known = Known(
        found.length_px, found.length_std_px, found.base_px if found.base_in_view else None,
        max(0.15 * found.diameter_px, 1.5), found.base_in_view,
    )  # fmt: skip
    with_constants = Prompts(found.base_px, asked.region, asked.border, found.length_px, found.diameter_px)
    return locate(image, with_constants, POINTS, known)


def main() -> None:
    """Reads the scenes, prints how many lines are right, and stores their features."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--features", type=Path)
    parser.add_argument("--seed", type=int, default=700_000)
    parser.add_argument("--scenes", type=int, default=600)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    rng, drawers = np.random.default_rng(options.seed), [Drawer(side, side) for side in SIZES_PX]
    rows, right, marked, numbers = [], [], [], []
    counts: dict[str, Counter[str]] = {each: Counter() for each in STATED}
    for number in range(options.scenes):
        if rng.random() < EMPTY_SHARE:
            drawn = empty.draw(str(rng.choice(list(empty.KINDS))), rng, drawers[0], SIZES_PX[0])
        else:
            which = number % 2
            drawn = scene.draw(rng, drawers[which], SIZES_PX[which], LENGTH_SHARES[which])
        visible = drawn.state == SEEN
        if drawn.present and (visible.mean() < 0.5 or not math.isfinite(drawn.diameter_px)):
            continue
        stated = STATED[int(rng.integers(3, 5) if drawn.decoys else rng.integers(5))]
        line = read(drawn.image, prompts(drawn, stated, rng))
        if line is None:
            counts[stated]["no line"] += 1
            continue
        scale = max(1.0, drawn.diameter_px / USUAL_DIAMETER_PX)
        size = round(drawn.image.shape[0] / scale), round(drawn.image.shape[1] / scale)
        good = drawn.present and judge(line.points / scale, line.seen, drawn.line / scale, visible, size)["right"]
        rows.append(line_features(line))
        right.append(good)
        marked.append("box" in stated)
        numbers.append(number)
        counts[stated][
            ("right" if good else "wrong") + (" valid" if probability(line) > VALID_PROBABILITY else " refused")
        ] += 1
    for stated, count in counts.items():
        print(f"{stated}: {dict(count)}")
    if options.features:
        np.savez(
            options.features,
            preset="scenes",
            xray=False,
            features=np.array(rows),
            right=np.array(right),
            marked=np.array(marked),
            session=numbers,
        )


if __name__ == "__main__":
    main()
