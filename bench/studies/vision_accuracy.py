"""Accuracy of `tracer` on synthetic tubes with exact truth: the standard set, then harder ones until it breaks.

    python -m bench.studies.vision_accuracy [--frames 1000] [--hard 80] [--json FILE]

Settings are calibrated on the first three frames of each group (side, polarity and diameter open), as a user would.
Centreline error: distance of each of the 64 points to the true curve. Tip error: along the shaft. A frame counts as
wrong where its tip is off by more than 5 px along the shaft or its worst point by more than 2 px: a wrong answer given
as right; a lost one is refused.
"""

import argparse
import json
import pathlib
from dataclasses import replace

import numpy as np
from bench import tubes

from tipforce.errors import InputError
from tipforce.vision import ShapeDetector, VisionSettings, auto_calibrate

SIDES = ("left", "right", "top", "bottom")
PLAIN = tubes.Look()
HARDER: list[tuple[str, list[tuple[str, tubes.Look]]]] = [
    ("noise sigma", [(str(x), replace(PLAIN, noise=x)) for x in (10, 20, 30, 40)]),
    ("contrast", [(str(x), replace(PLAIN, shaft=190.0 - x)) for x in (60, 40, 25, 15)]),
    ("diameter px", [(str(x), replace(PLAIN, diameter=x)) for x in (6.0, 4.0, 3.0, 2.0)]),
    ("blur px", [(str(x), replace(PLAIN, blur=x)) for x in (2.0, 3.0, 4.0, 6.0)]),
    ("exposure blur px", [(str(x), replace(PLAIN, exposure=x)) for x in (4.0, 8.0, 12.0)]),
    ("gap px", [(str(x), replace(PLAIN, gap=x)) for x in (6.0, 10.0, 14.0, 20.0)]),
    ("dark cable px", [(str(x), replace(PLAIN, cable=x)) for x in (3.0, 6.0, 12.0, 20.0)]),
    ("light cable px", [(str(x), replace(PLAIN, cable=x, cable_grey=240.0)) for x in (3.0, 6.0, 12.0)]),
    ("highlight grey", [(str(x), replace(PLAIN, highlight=x)) for x in (40.0, 80.0, 130.0)]),
    ("shadow share", [(str(x), replace(PLAIN, shadow=x)) for x in (0.2, 0.4, 0.6)]),
    ("texture grey", [(str(x), replace(PLAIN, texture=x)) for x in (6.0, 12.0, 20.0)]),
    ("vignette share", [(str(x), replace(PLAIN, vignette=x)) for x in (0.3, 0.6)]),
    ("electrode grey", [(str(x), replace(PLAIN, electrode=x)) for x in (30.0, 110.0, 160.0, 225.0)]),
    ("tissue at dark tip", [(str(x), replace(PLAIN, tissue=x)) for x in (150.0, 110.0, 60.0)]),
    ("tissue at metal tip", [(str(x), replace(PLAIN, tissue=x, electrode=225.0)) for x in (150.0, 110.0, 60.0)]),
]
BENCH = replace(
    PLAIN,
    electrode=150.0, highlight=50.0, shadow=0.25, texture=5.0, vignette=0.25, exposure=2.0, tissue=120.0, noise=4.0,
)  # fmt: skip
HARDER.append(("all of a bench", [("together", BENCH)]))


def measure(look: tubes.Look, frames: int, seed: int) -> dict[str, float]:
    """Figures over ``frames`` images, an equal number for each side and polarity."""
    rng = np.random.default_rng(seed)
    median, worst, tip = [], [], []
    lost = wrong = uncalibrated = 0
    groups = [(side, light) for light in (False, True) for side in SIDES]
    for k, (side, light) in enumerate(groups):
        n = frames // len(groups) + (k < frames % len(groups))
        painted = tubes.light_on_dark(look) if light else look
        drawn = [tubes.draw(rng, painted, side) for _ in range(min(3, n))]
        try:
            vision = ShapeDetector(auto_calibrate(VisionSettings(), [tube.image for tube in drawn]))
        except InputError:
            uncalibrated += n
            continue
        for m in range(n):
            tube = drawn[m] if m < len(drawn) else tubes.draw(rng, painted, side)
            detection = vision.detect(tube.image)
            if detection.centreline is None:
                lost += 1
                continue
            error = tubes.distance_to_curve(detection.centreline.points, tube.curve)
            along = tubes.tip_along(detection.centreline.points, tube)
            if abs(along) > 5 or error.max() > 2:
                wrong += 1
                continue
            median.append(np.median(error))
            worst.append(error.max())
            tip.append(abs(along))
    given = len(median)
    return {
        "frames": frames,
        "median_px": float(np.median(median)) if given else float("nan"),
        "worst_frame_median_px": float(np.max(median, initial=0)),
        "worst_point_median_px": float(np.median(worst)) if given else float("nan"),
        "worst_point_px": float(np.max(worst, initial=0)),
        "share_point_above_0_3": float(np.mean(np.array(worst) > 0.3)) if given else float("nan"),
        "tip_median_px": float(np.median(tip)) if given else float("nan"),
        "tip_worst_px": float(np.max(tip, initial=0)),
        "lost": lost + uncalibrated,
        "wrong": wrong,
    }


def row(name: str, level: str, r: dict[str, float]) -> str:
    return (
        f"{name:20} {level:>9} {r['median_px']:8.3f} {r['worst_frame_median_px']:8.3f} {r['worst_point_px']:8.3f}"
        f" {r['tip_median_px']:8.2f} {r['tip_worst_px']:8.2f} {100 * r['lost'] / r['frames']:7.1f}"
        f" {100 * r['wrong'] / r['frames']:7.1f}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=1000)
    parser.add_argument("--hard", type=int, default=80, help="frames for each harder setting; 0: none")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=pathlib.Path)
    given = parser.parse_args()
    results: dict[str, dict[str, float]] = {}
    print(f"{'':20} {'':>9} {'median':>8} {'worst':>8} {'worst':>8} {'tip':>8} {'tip':>8} {'lost':>7} {'wrong':>7}")
    print(f"{'set':20} {'level':>9} {'px':>8} {'frame':>8} {'point':>8} {'median':>8} {'worst':>8} {'%':>7} {'%':>7}")
    results["standard"] = measure(PLAIN, given.frames, given.seed)
    print(row("standard", str(given.frames), results["standard"]), flush=True)
    if given.hard:
        for name, levels in HARDER:
            for level, look in levels:
                results[f"{name} {level}"] = measure(look, given.hard, given.seed + 1)
                print(row(name, level, results[f"{name} {level}"]), flush=True)
    if given.json:
        given.json.write_text(json.dumps(results, indent=2) + "\n")


if __name__ == "__main__":
    main()
