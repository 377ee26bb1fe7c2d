"""The error of detected centrelines on simulated images, fitted to the small model that bound and `rod-3d` use.

    OMP_NUM_THREADS=1 .venv/bin/python -m bench.studies.line_noise --preset bench-2021 --sessions 16 --out DIR
    OMP_NUM_THREADS=1 .venv/bin/python -m bench.studies.line_noise --preset biplane --sessions 16 --out DIR

Images of each view are drawn, go through JPEG as in a recording of cameras, and are detected as they come; the true
line is projected through the true camera. The part of the error that frames of a session more than a second apart
share is lasting, the rest fresh. Frames in which a wrong object was detected (tip off by more than 5 px, a point by
more than 2 px) are left out; of the others, errors beyond three robust standard deviations count as three. Where vision
states the standard deviations of a line's points, the root mean square of the errors over them is printed.
By default the sessions are of seed 1000, which no split has. Writes ``line-noise-PRESET.json`` and ``.svg``.
"""

import argparse
import json
import os
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import matplotlib.pyplot as plt
import numpy as np
from scipy.interpolate import CubicSpline

from tipforce.geometry import arc_length
from tipforce.limits import CentrelineNoise
from tipforce.mechanics import LineNoise
from tipforce.simulation import PRESETS, SimulatedBench
from tipforce.vision import SessionDetector, VisionSettings

POINTS = 33
FIRST_FRAME = 24
SPREAD = 16
"""Number of frames over the session for the calibration of vision, with the session's metadata."""
MIN_LASTING_FRAMES = 24
"""Distance in frames from which the error that two frames share counts as lasting."""
WRONG_PX, WRONG_TIP_PX = 2.0, 5.0
ROBUST = 3.0
BODY = slice(4, POINTS - 4)
"""Points far from both ends."""


def recorded(bench: SimulatedBench, index: int, view: str) -> np.ndarray:
    """Returns an image as a recording has it: that of a camera is compressed."""
    image = bench.frame(index, view).image
    if bench.session_info.view(view).modality == "xray":
        return image
    return through_jpeg(image, bench.imaging.scene.jpeg_quality)


def through_jpeg(image: np.ndarray, quality: int) -> np.ndarray:
    """Returns the image after the compression of a recording."""
    _, data = cv2.imencode(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, quality])
    return cv2.cvtColor(cv2.imdecode(data, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)


def line_grid(true: np.ndarray, width: int, height: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Positions on a line ``true`` (p, 2) px, evenly from the image's border to its end, and directions there.

    Returns positions, directions along the line and to its left, (POINTS, 2) each, and its length from the border on.
    """
    arc = arc_length(true)
    spline = CubicSpline(arc, true)
    fine = np.linspace(0.0, arc[-1], 2000)
    places = spline(fine)
    # how far inside the image; where it turns positive the line comes in
    inward = np.minimum(places, np.array([width - 1, height - 1]) - places).min(axis=1)
    first = int(np.argmax(inward >= 0))
    begin = fine[first]
    if first:
        begin -= (fine[1] - fine[0]) * inward[first] / (inward[first] - inward[first - 1])
    at = np.linspace(begin, arc[-1], POINTS)
    points, along = spline(at), spline(at, 1)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    return points, along, np.stack([along[:, 1], -along[:, 0]], axis=1), float(arc[-1] - begin)


def line_errors(seen: np.ndarray, true: np.ndarray, width: int, height: int) -> tuple[np.ndarray, float]:
    """Returns the distance of ``seen`` (n, 2) to the left of ``true`` (p, 2) at its `line_grid`, then along the tip.

    (POINTS + 1,) in px, and the true line's length in the image. Lines run from base to tip.
    """
    points, along, left, length = line_grid(true, width, height)
    way = arc_length(seen)
    spline = CubicSpline(way, seen)
    at = way[np.argmin(np.linalg.norm(seen[:, None] - points, axis=2), axis=0)]
    for _ in range(6):  # to where the seen line crosses the normal
        at = at - np.sum((spline(at) - points) * along, axis=1) / np.sum(spline(at, 1) * along, axis=1)
    errors = np.empty(POINTS + 1)
    errors[:POINTS] = np.sum((spline(at) - points) * left, axis=1)
    errors[POINTS] = (seen[-1] - points[-1]) @ along[-1]
    return errors, length


def session_errors(preset: str, seed: int, frames: int, number: int) -> list[dict[str, Any]]:
    """Returns for each view errors (k, POINTS + 1) in px of the right frames, their numbers (k,), and counts."""
    bench = SimulatedBench(PRESETS[preset], seed, number)
    spread = np.linspace(0, len(bench.frame_s) - 1, SPREAD).astype(int).tolist()
    chosen = np.linspace(FIRST_FRAME, len(bench.frame_s) - 1, frames).astype(int).tolist()
    found: list[dict[str, Any]] = []
    for view in bench.views:
        images = [recorded(bench, k, view) for k in spread]
        vision = SessionDetector(VisionSettings(view=view), bench.session_info, images)
        row: dict[str, Any] = {"number": number, "view": view, "lost": 0, "wrong": 0}
        row |= {name: [] for name in ("frames", "errors", "lengths", "over_stated")}
        for k in chosen:
            image = recorded(bench, k, view)
            shape = vision.detect(image)
            if shape.centreline is None:
                row["lost"] += 1
                continue
            true = np.asarray(bench.image_truth(k, view).centreline_px)
            errors, length = line_errors(shape.centreline.points, true, image.shape[1], image.shape[0])
            if abs(errors[-1]) > WRONG_TIP_PX or np.abs(errors[:-1]).max() > WRONG_PX:
                row["wrong"] += 1
                continue
            row["frames"].append(k)
            row["errors"].append(errors)
            row["lengths"].append(length)
            if shape.std_along_and_across_px is not None:
                across = shape.std_along_and_across_px[1]
                stated = np.interp(np.linspace(0.0, 1.0, POINTS), np.linspace(0.0, 1.0, len(across)), across)
                row["over_stated"].append(np.sqrt(np.mean((errors[BODY] / stated[BODY]) ** 2)))
        found.append(row)
    return found


def covariances(found: Iterable[dict[str, Any]]) -> tuple[np.ndarray, np.ndarray]:
    """(POINTS + 1, POINTS + 1) px^2 each: of the error that is fresh in every frame, and of the lasting one."""
    kept = [(np.array(row["frames"]), np.array(row["errors"])) for row in found if len(row["frames"]) > 1]
    everything = np.concatenate([errors for _, errors in kept])
    limit = ROBUST * 1.4826 * np.median(np.abs(everything), axis=0)
    shared, total = np.zeros((2, POINTS + 1, POINTS + 1))
    pairs = 0
    for frames, errors in kept:
        bounded = np.clip(errors, -limit, limit)
        apart = np.abs(frames[:, None] - frames) >= MIN_LASTING_FRAMES
        shared += bounded.T @ apart @ bounded
        pairs += int(apart.sum())
        total += bounded.T @ bounded
    shared /= pairs
    return _positive(total / len(everything) - shared), _positive(shared)


def _positive(covariance: np.ndarray) -> np.ndarray:
    """The nearest covariance: an estimate from few frames may have negative eigenvalues."""
    values, vectors = np.linalg.eigh(covariance)
    return (vectors * np.maximum(values, 1e-3 * values[-1] / len(values))) @ vectors.T


def draw(parts: dict[str, np.ndarray], noise: dict[str, LineNoise], arc: np.ndarray, title: str, path: Path) -> None:
    """Measured standard deviations and correlations with the middle, and the model's."""
    figure, axes = plt.subplots(1, 2, figsize=(11, 4.2), layout="constrained")
    for (name, covariance), colour in zip(parts.items(), ("#0072b2", "#d55e00"), strict=True):
        std, model = np.sqrt(np.diag(covariance)), noise[name].covariance_m2(arc)
        shown = np.sqrt(np.diag(model))
        axes[0].plot(arc, std[:-1], "o", color=colour, markersize=4, label=f"{name}, measured")
        axes[0].plot(arc, shown[:-1], color=colour, label=f"{name}, model")
        middle = POINTS // 2
        axes[1].plot(arc, covariance[middle, :-1] / (std[middle] * std[:-1]), "o", color=colour, markersize=4)
        axes[1].plot(arc, model[middle, :-1] / (shown[middle] * shown[:-1]), color=colour)
    axes[0].set(xlabel="way from the image's border, px", ylabel="standard deviation across the line, px", ylim=0)
    axes[1].set(xlabel="way from the image's border, px", ylabel="correlation with the middle", ylim=(-0.2, 1.05))
    axes[0].legend(frameon=False)
    figure.suptitle(title)
    figure.savefig(path)


def main() -> None:
    """Detects, fits, prints and writes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--preset", default="bench-2021", choices=list(PRESETS))
    parser.add_argument("--sessions", type=int, default=16)
    parser.add_argument("--seed", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--frames", type=int, default=72, help="of a session")
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    numbers = range(options.first, options.first + options.sessions)
    with ProcessPoolExecutor(options.workers) as pool:
        by_number = pool.map(partial(session_errors, options.preset, options.seed, options.frames), numbers)
        found = [row for rows in by_number for row in rows]
    right = sum(len(row["frames"]) for row in found)
    seen = {"right": right, "lost": sum(row["lost"] for row in found), "wrong": sum(row["wrong"] for row in found)}
    length = float(np.median([value for row in found for value in row["lengths"]]))
    arc = np.linspace(0.0, length, POINTS)
    fresh, lasting = covariances(found)
    noise = CentrelineNoise(LineNoise.fit(fresh, arc), LineNoise.fit(lasting, arc))
    figures = {
        "preset": options.preset,
        "seed": options.seed,
        "first": options.first,
        "sessions": options.sessions,
        "frames": seen,
        "length_px": length,
    }
    for name, part in (("fresh_px", noise.fresh), ("lasting_px", noise.lasting)):
        figures[name] = {key.removesuffix("_m"): value for key, value in asdict(part).items()}
    over_stated = np.concatenate([row["over_stated"] for row in found])
    if len(over_stated):  # 10, 50 and 90 % of the lines are below these
        figures["error_over_stated"] = np.percentile(over_stated, [10, 50, 90]).round(2).tolist()
    kept = ("number", "view", "lost", "wrong")
    figures["by_session"] = [{"right": len(row["frames"])} | {name: row[name] for name in kept} for row in found]
    place = options.out / f"line-noise-{options.preset}"
    place.with_suffix(".json").write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    parts, models = {"fresh": fresh, "lasting": lasting}, {"fresh": noise.fresh, "lasting": noise.lasting}
    title = f"{options.preset}: the seen centreline's error, {right} frames of {options.sessions} sessions"
    draw(parts, models, arc, title, place.with_suffix(".svg"))
    print(json.dumps(figures, indent=2))


if __name__ == "__main__":
    main()
