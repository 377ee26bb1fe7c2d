"""Errors of models and of the detection on the foreign sessions, against the truth that is stored beside them."""

import json
import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

import tipforce
from tipforce.datasets import join
from tipforce.errors import InputError
from tipforce.estimators import Estimator
from tipforce.evaluation import Constant
from tipforce.io import atomic_text, open_recording, spread_images, write_atomic
from tipforce.types import BoolArray, DetectedShape, FloatArray, Frame, Image, IntArray
from tipforce.vision import ShapeDetector, VisionSettings, auto_calibrate, contact_sheet

__all__ = ["draw_sheet", "judge"]

CONTACT_N = 0.01
WRONG_N = 0.05
WRONG_PX = 10.0
LARGE_N = 0.3
SHEET_PX = 256
INTERVAL_SIGMAS = 1.645
"""A 90 % interval reaches this number of standard deviations."""
HALVES = ("svr:half", "constant:half")
"""Trained on every other session and judged on the rest, both ways."""


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """Truth of the m frames of one session: stamps (m,), force (m, 3) and centreline (m, p, 2)."""

    stamp_ns: IntArray
    force_n: FloatArray
    line_px: FloatArray

    @classmethod
    def of(cls, recording: Path) -> "Truth":
        """Reads the truth that is stored beside ``recording``."""
        with np.load(recording.with_suffix(".truth.npz")) as found:
            return cls(found["stamp_ns"], found["force_n"], found["line_px"])

    def rows(self, stamps_ns: Sequence[int]) -> IntArray:
        """Index of each stamp."""
        rows = np.searchsorted(self.stamp_ns, stamps_ns)
        if not np.array_equal(self.stamp_ns[rows], stamps_ns):
            raise ValueError("the truth has other stamps than the recording; make the session again")
        return rows


def judge(models: Sequence[str], data: Path, output: Path | None) -> None:
    """Prints a table a model and one of the detection; writes all figures to ``output`` if that is given."""
    recordings = sorted(data.glob("session_*.mcap"))
    figures: dict[str, Any] = {"sessions": [path.stem for path in recordings], "models": {}}
    print(f"{len(recordings)} sessions; magnitude of the force in contact (above {CONTACT_N * 1e3:.0f} mN), in mN")
    print(f"{'model':22} frames abstained  MAE   RMSE  bias  wrong>50  90% holds  free: MAE  >300: bias")
    for model in models:
        reasons = Counter[str]()
        by_session = dict(_estimates(model, recordings, reasons))
        scored = score(np.vstack(list(by_session.values())))
        figures["models"][model] = {"all": scored, **{name: score(rows) for name, rows in by_session.items()}}
        figures["models"][model]["statuses"] = dict(reasons)
        print(f"{model[-22:]:22} {_line(scored)}", flush=True)
        for name, rows in by_session.items():
            print(f"  {name:20} {_line(score(rows))}")
        print("  " + ", ".join(f"{count} {status}" for status, count in reasons.most_common()), flush=True)
    figures["detection"] = _judge_detection(recordings)
    if output is not None:
        with atomic_text(output) as out:
            json.dump(figures, out, indent=1)


def _estimates(model: str, recordings: Sequence[Path], reasons: Counter[str]) -> Iterator[tuple[str, FloatArray]]:
    """Session and rows of (true magnitude, estimate, low, high), NaN where the model abstains; counts ``reasons``."""
    if model not in HALVES:
        estimator = tipforce.load_model(model)
        for path in recordings:
            yield path.stem, _rows(estimator, path, reasons)
        return
    for tested in (0, 1):
        training = [path for i, path in enumerate(recordings) if i % 2 != tested]
        with tempfile.TemporaryDirectory() as folder:
            estimator = _trained(model, training, Path(folder))
            for path in recordings[tested::2]:
                yield path.stem, _rows(estimator, path, reasons)


def _trained(model: str, recordings: Sequence[Path], folder: Path) -> Estimator:
    if model == "constant:half":
        return Constant().fit(join([tipforce.open_dataset(path) for path in recordings]))
    return tipforce.train(list(recordings), folder / "model", estimator="svr", max_left_out=1.0).estimator


def _rows(estimator: Estimator, recording: Path, reasons: Counter[str]) -> FloatArray:
    truth, found = Truth.of(recording), list(tipforce.estimate(estimator, recording))
    reasons.update(each.status.value for each in found)
    size = np.linalg.norm(truth.force_n[truth.rows([each.stamp_ns for each in found])], axis=1)
    return np.column_stack([size, [[each.magnitude_n, *each.magnitude_interval_n] for each in found]])


def score(rows: FloatArray) -> dict[str, float]:
    """Figures of rows of (true magnitude, estimate, low, high); in newtons and shares."""
    answered = ~np.isnan(rows[:, 1])
    touching = rows[:, 0] > CONTACT_N
    used, free, large = (rows[answered & chosen] for chosen in (touching, ~touching, rows[:, 0] > LARGE_N))
    error = used[:, 1] - used[:, 0]
    return {
        "frames": int(touching.sum()),
        "abstained": float(np.mean(~answered[touching])) if touching.any() else np.nan,
        "mae_n": _mean(np.abs(error)),
        "rmse_n": float(np.sqrt(_mean(error**2))),
        "bias_n": _mean(error),
        "wrong": _mean(np.abs(error) > WRONG_N),
        "holds": _mean((used[:, 2] <= used[:, 0]) & (used[:, 0] <= used[:, 3])),
        "free_mae_n": _mean(np.abs(free[:, 1] - free[:, 0])),
        "large_bias_n": _mean(large[:, 1] - large[:, 0]),
    }


def _mean(values: FloatArray | BoolArray) -> float:
    return float(np.mean(values)) if len(values) else np.nan


def _line(scored: Mapping[str, float]) -> str:
    shares = {name: 100 * scored[name] for name in ("abstained", "wrong", "holds")}
    milli = {name: 1e3 * value for name, value in scored.items() if name.endswith("_n")}
    return (
        f"{scored['frames']:6} {shares['abstained']:7.0f} % {milli['mae_n']:5.0f} {milli['rmse_n']:6.0f} "
        f"{milli['bias_n']:+5.0f} {shares['wrong']:7.0f} % {shares['holds']:8.0f} % {milli['free_mae_n']:10.0f} "
        f"{milli['large_bias_n']:+11.0f}"
    )


def _judge_detection(recordings: Sequence[Path]) -> dict[str, Any]:
    """Frames in which a shape is found with the base's side stated, and how far its tip and base are off."""
    print(
        "\ndetection: found, of these tip off by more than 10 px, medians in px of tip, base; share of the seen points "
        "within the stated 90 % interval across the line"
    )
    found = {path.stem: _detected(path) for path in recordings}
    rows = {"all": np.vstack(list(found.values())), **found}
    figures: dict[str, Any] = {}
    for name, errors in rows.items():
        seen = errors[~np.isnan(errors[:, 0])]
        figures[name] = {
            "found": _mean(~np.isnan(errors[:, 0])),
            "wrong": _mean(seen[:, 0] > WRONG_PX),
            "tip_px": float(np.median(seen[:, 0])) if len(seen) else np.nan,
            "base_px": float(np.median(seen[:, 1])) if len(seen) else np.nan,
            "within": float(np.nanmean(seen[:, 2])) if np.isfinite(seen[:, 2]).any() else np.nan,
        }
        one = figures[name]
        print(
            f"  {name:20} {100 * one['found']:5.0f} % {100 * one['wrong']:5.0f} % "
            f"{one['tip_px']:6.1f} {one['base_px']:6.1f} {100 * one['within']:5.0f} %"
        )
    return figures


def _detected(recording: Path) -> FloatArray:
    """(m, 3): distances of tip and base from the truth in pixels, and the share of `_within`; NaN: nothing found."""
    truth, errors = Truth.of(recording), list[tuple[float, float, float]]()
    with open_recording(recording) as source:
        try:
            vision = auto_calibrate(VisionSettings(), spread_images(source), source.session_info)
        except InputError:
            return np.full((len(truth.stamp_ns), 3), np.nan)
        detector = ShapeDetector(vision)
        for event in source:
            if isinstance(event, Frame):
                line = truth.line_px[truth.rows([event.stamp_ns])[0]]
                shape = detector.detect(event.image)
                if shape.centreline is None:
                    errors.append((np.nan, np.nan, np.nan))
                else:
                    points = shape.centreline.points
                    tip, base = (float(np.linalg.norm(points[i] - line[i])) for i in (-1, 0))
                    errors.append((tip, base, _within(shape, line)))
    return np.array(errors)


def _within(shape: DetectedShape, line: FloatArray) -> float:
    """Share of the seen points, but the first four and the tip, within the stated 90 % interval; NaN: none is stated.

    Args:
        shape: a detected shape.
        line: (p, 2) px of the true centreline.
    """
    stated = shape.std_along_and_across_px
    if shape.centreline is None or stated is None or shape.seen is None:
        return np.nan
    points, seen = shape.centreline.points, shape.seen.copy()
    seen[:4] = seen[-1] = False
    arc = np.linspace(0.0, len(line) - 1.0, 40 * len(line))
    fine = np.column_stack([np.interp(arc, np.arange(len(line)), line[:, k]) for k in range(2)])
    off = np.linalg.norm(points[seen][:, None] - fine[None], axis=2).min(axis=1)
    return float(np.mean(off < INTERVAL_SIGMAS * stated[1][seen])) if seen.any() else np.nan


def draw_sheet(data: Path, output: Path) -> None:
    """The frame of each session with the largest force, in one picture."""
    images: list[Image] = []
    titles: list[str] = []
    for path in sorted(data.glob("session_*.mcap")):
        truth = Truth.of(path)
        size = np.linalg.norm(truth.force_n, axis=1)
        row = int(np.argmax(size))
        with open_recording(path) as source:
            images.append(source.frame_at(row, "camera").image)
        titles.append(f"{path.stem[-2:]}: {size[row]:.2f} N")
    sheet = cv2.cvtColor(contact_sheet(images, 5, titles, SHEET_PX), cv2.COLOR_RGB2BGR)
    write_atomic(output, cv2.imencode(".jpg", sheet, [cv2.IMWRITE_JPEG_QUALITY, 80])[1].tobytes())
