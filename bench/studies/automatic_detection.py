"""Compares automatic detection in sessions of a preset with the truth; it knows the session metadata.

    python -m bench.studies.automatic_detection [--preset varied] [--method auto] [--sessions 40] [--frames 4]
        [--sheet FILE]

As `tipforce inspect` does: calibrated on 12 frames spread over each session. Wrong: given as valid, but the tip more
than 5 px off along the shaft or a point more than 2 px beside; "but for the sheath": only points before its mouth are.
Further columns: seconds of each session, the reached share of the drawn forces, and the drawn parameters.
"""

import argparse
import time
from collections import Counter

import cv2
import numpy as np
from bench.studies.vision_on_simulation import look
from bench.tubes import distance_to_curve

from tipforce.errors import InputError
from tipforce.simulation import PRESETS, SimulatedBench
from tipforce.simulation.world import FAST
from tipforce.vision import ShapeDetector, VisionSettings, auto_calibrate

SPREAD = 12


def main() -> None:
    """Measures and prints."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--preset", default="varied")
    parser.add_argument("--method", default="tracer", choices=["tracer", "auto"])
    parser.add_argument("--sessions", type=int, default=40)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--frames", type=int, default=4)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--sheet", default="")
    options = parser.parse_args()
    preset = PRESETS[options.preset]
    world = preset.world.model_copy(update={"seconds": options.seconds})
    settings = preset.model_copy(update={"world": world})
    count: Counter[str] = Counter()
    misses, off, tiles = [], [], []
    for number in range(options.first, options.first + options.sessions):
        began = time.process_time()
        bench = SimulatedBench(settings, 0, number, resolution=FAST)
        last = len(bench.frame_s) - 1
        images = [bench.frame(int(k)).image for k in np.linspace(0, last, SPREAD)]
        drawn = time.process_time() - began
        try:
            vision = ShapeDetector(auto_calibrate(VisionSettings(method=options.method), images, bench.session_info))
        except InputError as error:
            print(f"session {number}: {error}")
            vision = None
        now: Counter[str] = Counter()
        for k in np.linspace(0.3 * last, last, options.frames).astype(int).tolist():
            image, truth = bench.frame(k).image, bench.image_truth(k)
            row = {"found": False, "wrong": False} if vision is None else look(vision, image, truth.centreline_px)
            kind = "wrong" if row["wrong"] else "right" if row["found"] else "abstained"
            if kind == "wrong" and _right_beyond_mouth(row["points"], truth.centreline_px, row["tip"]):
                kind = "right but for the sheath"
            now[kind] += 1
            if kind == "right":
                misses.append((row["side"], row["tip"]))
            elif kind == "wrong":
                off.append(row["tip"])
        count += now
        values = bench.values()
        peak = float(np.linalg.norm(bench.trajectory.contact.force_n, axis=1).max())
        kinds = [str(values.get(name)) for name in ("law", "face", "wave", "tissue_sight", "ground", "fitting")]
        print(
            f"session {number}: {dict(now)}; {drawn:.1f} s; peak {peak:.3f} N, asked {values['peak_force_n']:.3f}; "
            f"{values['wall_stiffness_n_per_m']:.0f} N/m; {', '.join(kinds)}; "
            f"rim {1e3 * values.get('rim_m', 0):.1f} mm; "
            f"{bench.settings.width}x{bench.settings.height} {bench.settings.scene.base_side}; "
            f"drawn again {sum(values['redraws'].values())}",
            flush=True,
        )
        if options.sheet:
            tiles.append(_tile(bench.frame(int(0.8 * last)).image, number))
    total = sum(count.values())
    print({kind: f"{number} of {total}, {100 * number / total:.1f} %" for kind, number in sorted(count.items())})
    if misses:
        side, tip = np.array(misses).T
        print(f"right ones: beside {np.median(side):.3f} px, tip {np.median(tip):.2f} px (medians)")
    if off:
        near = np.mean(np.array(off) <= 5)
        print(f"wrong ones: tip {np.median(off):.0f} px off along the shaft (median), {near:.0%} within 5")
    if options.sheet:
        tiles += [np.zeros_like(tiles[0])] * (-len(tiles) % 4)
        rows = [np.hstack(tiles[k : k + 4]) for k in range(0, len(tiles), 4)]
        cv2.imwrite(options.sheet, np.vstack(rows), [cv2.IMWRITE_JPEG_QUALITY, 70])


def _right_beyond_mouth(points: np.ndarray, curve: np.ndarray, tip: float) -> bool:
    """Whether the line is right from the catheter's base on: it may have followed the sheath before."""
    way = (curve[1] - curve[0]) / np.linalg.norm(curve[1] - curve[0])
    beyond = points[(points - curve[0]) @ way > 0.0]
    return len(beyond) > 1 and tip <= 5 and float(distance_to_curve(beyond, curve).max()) <= 2


def _tile(image: np.ndarray, number: int) -> np.ndarray:
    """Returns a tile of 320 x 240 px from an image of any shape."""
    shown = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR if image.ndim == 2 else cv2.COLOR_RGB2BGR)
    share = min(320 / shown.shape[1], 240 / shown.shape[0])
    shown = cv2.resize(shown, None, fx=share, fy=share, interpolation=cv2.INTER_AREA)
    tile = np.zeros((240, 320, 3), np.uint8)
    tile[: shown.shape[0], : shown.shape[1]] = shown
    cv2.putText(tile, str(number), (6, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (0, 255, 255), 1, cv2.LINE_AA)
    return tile


if __name__ == "__main__":
    main()
