"""Judges detection against the truth in new sessions of a preset, with all metadata stated.

    python -m bench.studies.locator_accuracy PRESET [--seed 52000] [--sessions 30] [--frames 12] [--method auto]
        [--marked] [--features FILE.npz]

Each session is resolved on 16 of its images. ``--marked``: a box in the first of them marks the base, or the point
where the catheter enters the image, as a user marks it with one click. Line: 95 % of the points stated as seen are
within 2 px of the true curve, and 90 % of the visible part is covered. Right: the line is, and a visible tip is within
10 px. Old measure: the tip within 5 px along the shaft and every point within 2 px. Two rows: as detection comes, and
with lines whose hidden tip is known less exactly than the limit. Errors: share of the seen points whose error across
the line is within the stated 90 % interval, and the median error over the median of this interval's Gaussian, by their
distance from the last seen point. Region: how often the stated 90 % region of the tip holds the true one.
``--features``: stores the features of the locator's lines and whether they are right, for
``python -m bench.locator.probability FILE.npz ...``; no line is refused then for its probability.
"""

import argparse
import math
from collections import Counter
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from bench.tubes import distance_to_curve

from tipforce.errors import InputError
from tipforce.simulation import PRESETS, SimulatedBench
from tipforce.simulation.world import FAST
from tipforce.types import DetectedShape, FloatArray, Image, Status
from tipforce.vision import ShapeDetector, VisionSettings, auto_calibrate
from tipforce.vision._by_locator import LocatorDetector
from tipforce.vision._settings import usual_tip_std_px
from tipforce.vision.locator._line_probability import line_features

RESOLVED_ON = 16
LINE_PX, TIP_PX, WRONG_TIP_PX = 2.0, 5.0, 10.0
ANY_STD_PX = 1e5
MARK_PX = 12.0
"""Half the side of the box with which a user marks the base."""
REGION_CHI2 = 4.605
"""90 % quantile of chi squared with two degrees of freedom."""
WITHIN_SIGMAS, MEDIAN_SIGMAS = 1.645, 0.674
END_SHARE = 0.125
"""Share of a line that counts as the end before its last seen point."""
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


def normalised_errors(shape: DetectedShape, line: FloatArray) -> FloatArray:
    """Returns the errors across the line of the seen points of ``shape``, but the first four and the tip.

    Args:
        shape: a detected shape with its covariance.
        line: (k, 2) px of the true centreline.

    Returns:
        (n, 2) distance from the last seen point as a share of the line, and error in the stated standard deviations.
    """
    stated = shape.std_along_and_across_px
    assert shape.centreline is not None
    assert stated is not None
    points, std = shape.centreline.points, stated[1]
    seen = np.ones(len(points), bool) if shape.seen is None else shape.seen.copy()
    seen[:4], seen[-1] = False, False
    at = np.flatnonzero(seen)
    if not len(at):
        return np.empty((0, 2))
    sigmas = distance_to_curve(points[at], line) / std[at]
    return np.column_stack([(at[-1] - at) / (len(points) - 1.0), sigmas])


def marked_box(truth: Any, image: Image) -> tuple[int, int, int, int]:
    """Returns a box (u0, v0, u1, v1) px around the first point of the true line that is inside the image."""
    line, (height, width) = np.asarray(truth.centreline_px), image.shape[:2]
    inside = ((line > -0.5) & (line < (width - 0.5, height - 0.5))).all(axis=1)
    low, high = line[inside][0] - MARK_PX, line[inside][0] + MARK_PX
    u0, v0 = np.maximum(np.floor(low), 0.0).astype(int).tolist()
    u1, v1 = np.minimum(np.ceil(high), (width, height)).astype(int).tolist()
    return u0, v0, u1, v1


class Tally:
    """Counts of the frames of all sessions, under one limit of the tip's standard deviation.

    Args:
        name: name of the row.
        hidden_tips: whether lines with a hidden tip count; if not, the usual limit of its standard deviation holds.
    """

    def __init__(self, name: str, *, hidden_tips: bool) -> None:
        self._name, self._hidden_tips = name, hidden_tips
        self.count: Counter[str] = Counter()
        self._answered: list[Any] = []
        self._errors: list[FloatArray] = []

    def add(self, shape: DetectedShape, line: FloatArray, visible: np.ndarray, size: tuple[int, int]) -> None:
        """Adds one frame; see `judge`."""
        limit_px = math.inf if self._hidden_tips else usual_tip_std_px(shape.diameter_px)
        if shape.centreline is None or shape.tip_std_px > limit_px:
            self.count["abstained"] += 1
            return
        points = shape.centreline.points
        seen = np.ones(len(points), bool) if shape.seen is None else shape.seen
        found = judge(points, seen, line, visible, size)
        if shape.covariance_px2 is not None:
            off = points[-1] - line[-1]
            found["held"] = bool(off @ np.linalg.solve(shape.covariance_px2[-1], off) < REGION_CHI2)
            found["std"] = shape.tip_std_px
            self._errors.append(normalised_errors(shape, line))
        self._answered.append(found)
        self.count["right" if found["right"] else "wrong"] += 1

    def text(self, tips: int) -> str:
        """Returns the row; ``tips``: number of frames with a visible tip."""
        total, answered = sum(self.count.values()), self._answered
        shares = ", ".join(f"{kind} {self.count[kind] / total:.1%}" for kind in ("right", "wrong", "abstained"))
        near = sum(each["tip"] < TIP_PX for each in answered if each["tip_shown"])
        old = sum(each["old"] for each in answered)
        off = float(np.median([each["off"] for each in answered])) if answered else float("nan")
        rows = [
            f"{self._name}: {shares} of {total} frames",
            f"  visible tips within {TIP_PX:g} px: {near / max(tips, 1):.1%} of {tips}",
            f"  lines off by {off:.3f} px (median)",
            f"  old measure: right {old / total:.1%}, wrong {(len(answered) - old) / total:.1%}",
        ]
        if self._errors:
            share, sigmas = np.concatenate(self._errors).T
            for part, use in (("body", share > END_SHARE), ("end", share <= END_SHARE)):
                within, typical = np.mean(sigmas[use] < WITHIN_SIGMAS), np.median(sigmas[use]) / MEDIAN_SIGMAS
                rows.append(f"  errors of {use.sum()} seen points, {part}: within {within:.1%}, median {typical:.2f}")
        for kind, shown in (("visible", True), ("hidden", False)):
            own = [each for each in answered if "held" in each and each["tip_shown"] is shown]
            if own:
                held, std = np.mean([each["held"] for each in own]), np.median([each["std"] for each in own])
                rows.append(f"  region of {len(own)} {kind} tips: holds {held:.1%}, {std:.1f} px (median)")
        return "\n".join(rows)


def main() -> None:
    """Measures and prints."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("preset", choices=list(PRESETS))
    parser.add_argument("--seed", type=int, default=52_000)
    parser.add_argument("--sessions", type=int, default=30)
    parser.add_argument("--frames", type=int, default=12)
    parser.add_argument("--method", default="auto", choices=["auto", "tracer"])
    parser.add_argument("--marked", action="store_true")
    parser.add_argument("--features", type=Path)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    preset = PRESETS[options.preset]
    preset = preset.model_copy(update={"world": preset.world.model_copy(update={"seconds": 20.0})})
    usual = Tally("as it comes", hidden_tips=False)
    every = Tally("with hidden tips", hidden_tips=True)
    refusal = {"least_probability": 0.0} if options.features else {}
    tips, drawn = 0, {"features": [], "right": [], "session": []}
    for number in range(options.sessions):
        bench = SimulatedBench(preset, options.seed, number, resolution=FAST)
        view, last = next(iter(bench.views)), len(bench.frame_s) - 1
        settings = VisionSettings(method=options.method, view=view, max_tip_std_px=ANY_STD_PX, **refusal)
        images = [bench.frame(int(k), view).image for k in np.linspace(0, last, RESOLVED_ON)]
        vision, reason = None, ""
        if options.marked:
            settings = settings.model_copy(update={"base_region": marked_box(bench.image_truth(0, view), images[0])})
        try:
            vision = auto_calibrate(settings, images, bench.session_info)
        except InputError as error:
            reason = str(error)
        detector = ShapeDetector(vision) if vision else None
        locator = LocatorDetector(vision) if vision and vision.locator else None
        before = usual.count.copy()
        for k in np.linspace(0.1 * last, last - 1, options.frames).astype(int).tolist():
            image, truth = bench.frame(k, view).image, bench.image_truth(k, view)
            line, visible, size = np.asarray(truth.centreline_px), np.asarray(truth.visible, bool), image.shape[:2]
            tips += judge(line, np.ones(len(line), bool), line, visible, size)["tip_shown"]
            shape = detector.detect(image) if detector else DetectedShape(Status.NO_CATHETER, reason)
            for tally in (usual, every):
                tally.add(shape, line, visible, size)
            located = locator.locate(image) if options.features and locator else None
            if located is not None:
                drawn["features"].append(line_features(located))
                drawn["right"].append(judge(located.points, located.seen, line, visible, size)["right"])
                drawn["session"].append(number)
        print(f"session {number}: {dict(usual.count - before)} {reason}", flush=True)
    for tally in (usual, every):
        print(f"{options.preset}, {tally.text(tips)}")
    if options.features:
        modality = bench.session_info.view(view).modality
        facts = {"preset": options.preset, "xray": modality == "xray", "marked": options.marked}
        np.savez(options.features, **facts, **{name: np.array(values) for name, values in drawn.items()})


if __name__ == "__main__":
    main()
