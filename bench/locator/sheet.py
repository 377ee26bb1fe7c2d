"""Draws some training windows with their lines: seen in green, hidden in red, decoys in blue.

python -m bench.locator.sheet -o sheet.png [--seed S] [--size 256]
"""

import argparse
import time
from pathlib import Path

import cv2
import numpy as np
from bench.locator import scene
from bench.locator.tubes import Drawer


def main() -> None:
    """Draws and writes the sheet."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", dest="out", type=Path, required=True)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--size", type=int, default=256)
    options = parser.parse_args()
    rng, drawer = np.random.default_rng(options.seed), Drawer(options.size, options.size)
    scene.draw(rng, drawer, options.size)  # compiles
    began, rows = time.perf_counter(), []
    drawn = [scene.draw(rng, drawer, options.size) for _ in range(32)]
    print(f"{32 / (time.perf_counter() - began):.0f} scenes a second")
    for one in drawn:
        image = one.image.copy()
        for decoy in one.decoys:
            cv2.polylines(image, [np.round(decoy).astype(np.int32)], False, (0, 0, 255), 1)
        if one.present:
            for point, state in zip(one.line, one.state, strict=True):
                tone = ((255, 255, 0), (255, 0, 0), (0, 255, 0))[state]
                cv2.circle(image, tuple(np.round(point).astype(int).tolist()), 1, tone, -1)
        rows.append(image)
    sheet = np.vstack([np.hstack(rows[i : i + 8]) for i in range(0, 32, 8)])
    cv2.imwrite(str(options.out), sheet[..., ::-1])


if __name__ == "__main__":
    main()
