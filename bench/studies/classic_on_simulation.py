"""Measures the share of frames in which thesis algorithm 1 (`vision.method=classic`) finds the shape, and its error.

    python -m bench.studies.classic_on_simulation [--preset thesis-2021-plain] [--threshold 110] [--frames 165]
        [--sessions 8]

Frames spread evenly over the sessions of seed 0, tare included. One fixed threshold for all of them, as the thesis has
it; 0: Otsu's in each image. Errors beside the truth: of the points of the found line, and of its last point along the
tip's axis, in px.
"""

import argparse

import numpy as np
from bench.studies.vision_on_simulation import look

from tipforce.simulation import PRESETS, SimulatedBench
from tipforce.vision import ShapeDetector, VisionSettings


def main() -> None:
    """Measures and prints."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--preset", default="thesis-2021-plain")
    parser.add_argument("--threshold", type=int, default=110)
    parser.add_argument("--frames", type=int, default=165)
    parser.add_argument("--sessions", type=int, default=8)
    parser.add_argument("--seconds", type=float, default=60.0)
    options = parser.parse_args()
    preset = PRESETS[options.preset]
    settings = preset.model_copy(update={"world": preset.world.model_copy(update={"seconds": options.seconds})})
    vision = ShapeDetector(
        VisionSettings(method="classic", base_side="left", polarity="dark", threshold=options.threshold or None)
    )
    rows = []
    for part, numbers in enumerate(np.array_split(np.arange(options.frames), options.sessions)):
        bench = SimulatedBench(settings, 0, part)
        places = np.linspace(0, len(bench.frame_s) - 1, len(numbers)).astype(int).tolist()
        rows += [look(vision, bench.frame(k).image, bench.image_truth(k).centreline_px) for k in places]
    found = [row for row in rows if row["found"]]
    print(f"{options.preset}, threshold {options.threshold or 'of Otsu'}: found in {len(found)} of {len(rows)} frames")
    for name in ("side", "worst", "tip") if found else ():
        values = np.array([row[name] for row in found])
        print(
            f"  {name}: median {np.median(values):.3f}, 90 % {np.quantile(values, 0.9):.3f}, most {values.max():.3f} px"
        )
    why = [row["why"].split(":")[0] for row in rows if not row["found"]]
    for reason in sorted(set(why)):
        print(f"  {reason}: {why.count(reason)}")


if __name__ == "__main__":
    main()
