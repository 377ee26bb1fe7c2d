"""The error of centrelines that `tracer` detects on simulated images, fitted to the small model that the bound uses.

    OMP_NUM_THREADS=1 .venv/bin/python -m bench.studies.line_noise --preset bench-2021 --sessions 16 --out DIR

Images are drawn, go through JPEG as in a recording, and are detected; the true line is projected through the true
camera. The part of the error that frames of a session more than a second apart share is lasting, the rest fresh. Frames
in which a wrong object was detected (tip off by more than 5 px, a point by more than 2 px) are left out; of the
others, errors beyond three robust standard deviations count as three.
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

from tipforce.errors import InputError
from tipforce.geometry import arc_length
from tipforce.limits import CentrelineNoise
from tipforce.mechanics import LineNoise
from tipforce.simulation import PRESETS, SimulatedBench
from tipforce.vision import ShapeDetector, VisionSettings, auto_calibrate

POINTS = 33
FIRST_FRAME = 24
SPREAD = 16
"""Number of frames over the session for the calibration of vision, with the session's metadata."""
MIN_LASTING_FRAMES = 24
"""Distance in frames from which the error that two frames share counts as lasting."""
WRONG_PX, WRONG_TIP_PX = 2.0, 5.0
ROBUST = 3.0


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


def session_errors(preset: str, seed: int, frames: int, number: int) -> dict[str, Any]:
    """Returns errors (k, POINTS + 1) in px of the right frames, their numbers (k,), and the number of other frames."""
    bench = SimulatedBench(PRESETS[preset], seed, number)
    quality, camera = bench.imaging.scene.jpeg_quality, bench.imaging.renderer.camera
    lines = bench.interpolator.lines_m(bench.frame_s)
    spread = np.linspace(0, len(lines) - 1, SPREAD).astype(int).tolist()
    try:
        images = [through_jpeg(bench.frame(k).image, quality) for k in spread]
        vision = ShapeDetector(auto_calibrate(VisionSettings(), images, bench.session_info))
    except InputError:  # nothing is seen in this session
        return {"number": number, "frames": [], "errors": [], "lengths": [], "lost": frames, "wrong": 0}
    right, rows, lengths, lost, wrong = [], [], [], 0, 0
    for k in np.linspace(FIRST_FRAME, len(lines) - 1, frames).astype(int).tolist():
        detection = vision.detect(through_jpeg(bench.frame(k).image, quality))
        if detection.centreline is None:
            lost += 1
            continue
        true = camera.project(lines[k])
        errors, length = line_errors(detection.centreline.points, true, bench.settings.width, bench.settings.height)
        if abs(errors[-1]) > WRONG_TIP_PX or np.abs(errors[:-1]).max() > WRONG_PX:
            wrong += 1
            continue
        right.append(k)
        rows.append(errors)
        lengths.append(length)
    return {"number": number, "frames": right, "errors": rows, "lengths": lengths, "lost": lost, "wrong": wrong}


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
        found = list(pool.map(partial(session_errors, options.preset, options.seed, options.frames), numbers))
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
    by_session = [(row["number"], len(row["frames"]), row["lost"], row["wrong"]) for row in found]
    figures["by_session"] = [dict(zip(("number", "right", "lost", "wrong"), row, strict=True)) for row in by_session]
    place = options.out / f"line-noise-{options.preset}"
    place.with_suffix(".json").write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    parts, models = {"fresh": fresh, "lasting": lasting}, {"fresh": noise.fresh, "lasting": noise.lasting}
    title = f"{options.preset}: the seen centreline's error, {right} frames of {options.sessions} sessions"
    draw(parts, models, arc, title, place.with_suffix(".svg"))
    print(json.dumps(figures, indent=2))


if __name__ == "__main__":
    main()
