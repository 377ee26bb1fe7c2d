"""Accuracy of `fine` on simulated bench videos with their hidden truth, session by session.

    python bench/vision_on_bench.py FOLDER [--every 10] [--apart] [--json FILE]

FOLDER holds the sessions that `tipforce simulate` wrote. The settings are settled once, on the first frames of every
session together (--apart: on each session's own). Tip: distance of the last point to the truth's last point, along
the shaft. Bias: median of the signed distance to the true centreline, positive to the right of the way from base to
tip; side: median of the distance itself. Wrong: a tip more than 5 px off along the shaft, or a point more than 2 px
beside the true centreline, given as right.
"""

import argparse
import json
import pathlib
from collections.abc import Iterator
from itertools import islice

import av
import numpy as np

import tubes
from tipforce.twin.small import Truth, read_truth
from tipforce.vision import FineTracer, VisionSettings, settle

OPENING = 3
"""Frames of every session that the settings are settled on."""


def frames(folder: pathlib.Path, every: int = 1) -> Iterator[tuple[int, np.ndarray]]:
    with av.open(str(folder / "video.mp4")) as video:
        for k, frame in enumerate(video.decode(video=0)):
            if k % every == 0:
                yield k, frame.to_ndarray(format="rgb24")


def signed_distance(points: np.ndarray, curve: np.ndarray) -> np.ndarray:
    """(n,) distances of ``points`` to the polyline ``curve`` (m, 2), positive to the right of its direction."""
    away = tubes.distance_to_curve(points, curve)
    nearest = np.argmin(np.linalg.norm(points[:, None] - curve, axis=2), axis=1).clip(1, len(curve) - 2)
    tangent = curve[nearest + 1] - curve[nearest - 1]
    beside = points - curve[nearest]
    return away * np.sign(tangent[:, 0] * beside[:, 1] - tangent[:, 1] * beside[:, 0])


def measure(folder: pathlib.Path, truth: Truth, settings: VisionSettings, every: int) -> dict[str, float]:
    tracer = FineTracer(settings)
    seen = found = wrong = 0
    tips, biases, sides, worst = [], [], [], []
    for k, image in frames(folder, every):
        seen += 1
        sight = tracer.see(image)
        if sight.centreline is None:
            continue
        found += 1
        points, curve = sight.centreline.points, truth.centreline_px(k)
        beside = signed_distance(points, curve)
        tangent = curve[-1] - curve[-2]
        tip = float((points[-1] - curve[-1]) @ tangent / np.linalg.norm(tangent))
        wrong += abs(tip) > 5 or bool(np.abs(beside).max() > 2)
        tips.append(tip)
        biases.append(np.median(beside))
        sides.append(np.median(np.abs(beside)))
        worst.append(np.abs(beside).max())
    nothing = [float("nan")]
    return {
        "frames": seen,
        "found_share": found / max(seen, 1),
        "wrong_share": wrong / max(seen, 1),
        "tip_median_px": float(np.median(np.abs(tips or nothing))),
        "tip_worst_px": float(np.max(np.abs(tips or nothing))),
        "bias_px": float(np.median(biases or nothing)),
        "side_median_px": float(np.median(sides or nothing)),
        "side_worst_px": float(np.max(worst or nothing)),
        "diameter_px": settings.diameter_px or float("nan"),
        "true_diameter_px": truth.settings["diameter_m"] / truth.metres_per_px,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--every", type=int, default=10)
    parser.add_argument("--apart", action="store_true", help="settle on each session's own first frames")
    parser.add_argument("--json", type=pathlib.Path)
    given = parser.parse_args()
    sessions = sorted(path.parent for path in given.folder.glob("*/truth.npz"))
    if not sessions:
        parser.error(f"{given.folder}: no session with a truth.npz; write some with `tipforce simulate`")
    opening = {s: [image for _, image in islice(frames(s), OPENING)] for s in sessions}
    # one frame of every session, then the next one of each: the settings come from all of them
    together = [images[k] for k in range(OPENING) for images in opening.values()]
    shared = None if given.apart else settle(VisionSettings(), together)
    print(
        f"{'session':14} {'frames':>6} {'found %':>8} {'wrong %':>8} {'tip px':>7} {'worst':>7} {'bias px':>8}"
        f" {'side px':>8} {'worst':>7} {'diameter':>9} {'true':>6}"
    )
    results = {}
    for s in sessions:
        r = measure(s, read_truth(s), shared or settle(VisionSettings(), opening[s]), given.every)
        results[s.name] = r
        print(
            f"{s.name:14} {r['frames']:6} {100 * r['found_share']:8.1f} {100 * r['wrong_share']:8.1f}"
            f" {r['tip_median_px']:7.2f} {r['tip_worst_px']:7.2f} {r['bias_px']:8.3f} {r['side_median_px']:8.3f}"
            f" {r['side_worst_px']:7.3f} {r['diameter_px']:9.2f} {r['true_diameter_px']:6.2f}",
            flush=True,
        )
    if given.json:
        given.json.write_text(json.dumps(results, indent=2) + "\n")


if __name__ == "__main__":
    main()
