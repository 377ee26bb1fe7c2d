"""Judges detection against the truth in new sessions of a preset, with all metadata stated.

    python -m bench.studies.locator_accuracy PRESET [--seed 52000] [--sessions 30] [--frames 12] [--method auto]
        [--hidden] [--signs FILE.npz]

Each session is resolved on 16 of its images. Line: 95 % of the points stated as seen are within 2 px of the true curve,
and 90 % of the visible part is covered. Right: the line is, and a visible tip is within 10 px. Old measure: the tip
within 5 px along the shaft and every point within 2 px. ``--hidden``: lines whose tip is hidden are answered too.
``--signs``: stores the features of the locator's lines and whether they are right, for
``python -m bench.locator.probability FILE.npz ...``.
"""

import argparse
from collections import Counter
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from bench.tubes import distance_to_curve

from tipforce.errors import InputError
from tipforce.simulation import PRESETS, SimulatedBench
from tipforce.simulation.world import FAST
from tipforce.types import DetectedShape, FloatArray, Status
from tipforce.vision import ResolvedVision, ShapeDetector, VisionSettings, auto_calibrate
from tipforce.vision._by_locator import LocatorDetector
from tipforce.vision._line_probability import signs

RESOLVED_ON = 16
LINE_PX, TIP_PX, WRONG_TIP_PX = 2.0, 5.0, 10.0
TIP_POINTS = 3
"""The tip is visible where this number of the last points of the truth are."""


def judge(points: FloatArray, seen: np.ndarray, line: FloatArray, visible: np.ndarray, size: tuple[int, int]) -> Any:
    """Compares a detected line with the truth.

    Args:
        points: (n, 2) px of the detected line.
        seen: (n,) whether each point is stated as seen.
        line: (k, 2) px of the true centreline.
        visible: (k,) whether each of its points is visible.
        size: rows and columns of the image.

    Returns:
        Figures by name; lengths in px.
    """
    inside = ((line > -0.5) & (line < (size[1] - 0.5, size[0] - 0.5))).all(axis=1)
    shown = visible & inside
    off = distance_to_curve(points, line)
    covered = distance_to_curve(line, points[seen]) < LINE_PX if seen.sum() > 1 else np.zeros(len(line), bool)
    way = line[-1] - line[-8]
    along = float((points[-1] - line[-1]) @ way / np.linalg.norm(way))
    tip, tip_shown = float(np.linalg.norm(points[-1] - line[-1])), bool(shown[-TIP_POINTS:].all())
    right_line = bool(seen.any() and (off[seen] < LINE_PX).mean() >= 0.95 and covered[shown].mean() >= 0.9)
    return {
        "line": right_line, "right": right_line and not (tip_shown and tip > WRONG_TIP_PX), "tip": tip,
        "tip_shown": tip_shown, "old": abs(along) <= TIP_PX and off.max() <= LINE_PX,
        "off": float(np.median(off[seen])) if seen.any() else np.nan,
    }  # fmt: skip


def main() -> None:
    """Measures and prints."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("preset", choices=list(PRESETS))
    parser.add_argument("--seed", type=int, default=52_000)
    parser.add_argument("--sessions", type=int, default=30)
    parser.add_argument("--frames", type=int, default=12)
    parser.add_argument("--method", default="auto", choices=["auto", "tracer"])
    parser.add_argument("--hidden", action="store_true")
    parser.add_argument("--signs", type=Path)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    preset = PRESETS[options.preset]
    preset = preset.model_copy(update={"world": preset.world.model_copy(update={"seconds": 20.0})})
    count: Counter[str] = Counter()
    answered: list[Any] = []
    tips, drawn = 0, {"signs": [], "right": [], "session": []}
    for number in range(options.sessions):
        bench = SimulatedBench(preset, options.seed, number, resolution=FAST)
        view, last = next(iter(bench.views)), len(bench.frame_s) - 1
        settings = VisionSettings(
            method=options.method, view=view, max_tip_std_px=1e5 if options.hidden else VisionSettings().max_tip_std_px
        )
        images = [bench.frame(int(k), view).image for k in np.linspace(0, last, RESOLVED_ON)]
        vision, reason = None, ""
        try:
            vision = auto_calibrate(settings, images, bench.session_info)
        except InputError as error:
            reason = str(error)
        now: Counter[str] = Counter()
        for k in np.linspace(0.1 * last, last - 1, options.frames).astype(int).tolist():
            image, truth = bench.frame(k, view).image, bench.image_truth(k, view)
            line, visible = np.asarray(truth.centreline_px), np.asarray(truth.visible, bool)
            shape = ShapeDetector(vision).detect(image) if vision else DetectedShape(Status.NO_CATHETER, reason)
            shown = judge(line, np.ones(len(line), bool), line, visible, image.shape[:2])["tip_shown"]
            tips += shown
            if shape.centreline is None:
                now["abstained"] += 1
            else:
                points = shape.centreline.points
                seen = np.ones(len(points), bool) if shape.seen is None else shape.seen
                found = judge(points, seen, line, visible, image.shape[:2])
                answered.append(found)
                now["right" if found["right"] else "wrong"] += 1
            if options.signs and isinstance(vision, ResolvedVision) and vision.locator is not None:
                located = LocatorDetector(vision).locate(image)
                if located is not None:
                    found = judge(located.points, located.seen, line, visible, image.shape[:2])
                    drawn["signs"].append(signs(located))
                    drawn["right"].append(found["right"])
                    drawn["session"].append(number)
        count += now
        print(f"session {number}: {dict(now)} {reason}", flush=True)
    total = sum(count.values())
    near = sum(each["tip"] < TIP_PX for each in answered if each["tip_shown"])
    old = sum(each["old"] for each in answered)
    off = float(np.median([each["off"] for each in answered])) if answered else float("nan")
    print(
        f"{options.preset}, {total} frames: right {count['right'] / total:.1%}, wrong {count['wrong'] / total:.1%}, "
        f"abstained {count['abstained'] / total:.1%}; visible tips within {TIP_PX:g} px {near / max(tips, 1):.1%} of "
        f"{tips}; old measure right {old / total:.1%}, wrong {(len(answered) - old) / total:.1%}; lines {off:.3f} px "
        "off (median)"
    )
    if options.signs:
        np.savez(options.signs, preset=options.preset, **{name: np.array(values) for name, values in drawn.items()})


if __name__ == "__main__":
    main()
