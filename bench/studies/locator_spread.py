"""Compares the errors of the second network's offsets with the spread that it states, and with the tracer's errors.

    python -m bench.studies.locator_spread varied:97000:0-75 generalise:93000:0-20 ... [--frames 12] [--json FILE]

Each argument is PRESET:SEED:FIRST-LAST; every fifth session is drawn (another catheter), resolved as `SessionDetector`
does, and the network reads the strip along the locator's line in ``--frames`` images of its first 30 s. Errors are
distances from the true curve in diameters, at the seen stations between base and tip. `offset_std` in
`tipforce.vision.locator` follows the table of spreads. Errors of the tracer are those of its lines that are the
locator's (`same_line`).
"""

import argparse
import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from bench.tubes import distance_to_curve

from tipforce.io import spread_rows
from tipforce.simulation import PRESETS, SimulatedBench
from tipforce.types import FloatArray
from tipforce.vision import ResolvedVision, SessionDetector, VisionSettings
from tipforce.vision._by_locator import LocatorDetector, same_line
from tipforce.vision.locator import ALONG, as_colour, straightened
from tipforce.vision.locator._networks import refine
from tipforce.vision.locator._reading import MIN_SURE_SEEN
from tipforce.vision.tracer import Tracer

FIRST_S, RESOLVED_ON = 30.0, 16
INNER = slice(11, ALONG - 11)
"""Stations between base and tip: a strip reaches beyond both."""
BODY = slice(4, -6)
"""Points of a line whose errors are compared with the tracer's."""
MAX_WRONG_DIAMETERS = 0.3
"""A line that is further off in the median is another object."""
SPREADS = (0.0, 0.004, 0.006, 0.009, 0.013, 0.02, 0.03, 0.05, 0.1, 1.0)


def rms(values: FloatArray) -> float:
    """Returns the root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def of_session(preset: str, seed: int, number: int, count: int) -> dict[str, Any] | None:
    """Returns errors and spreads of one session, in diameters; None where the detection refuses it."""
    bench = SimulatedBench(PRESETS[preset], seed, number)
    view = bench.views[0]
    rows = np.flatnonzero(bench.frame_s < FIRST_S)
    images = [bench.frame(int(rows[k]), view).image for k in spread_rows(len(rows)).tolist()[:RESOLVED_ON]]
    vision = SessionDetector(VisionSettings(), bench.session_info, images).vision
    if not isinstance(vision, ResolvedVision) or vision.locator is None:
        return None
    locator, tracer, diameter = LocatorDetector(vision), Tracer(vision), vision.locator.diameter_px
    offsets, spreads, stated, traced = (
        list[FloatArray](),
        list[FloatArray](),
        list[float](),
        list[tuple[float, float]](),
    )
    for row in rows[np.linspace(0, len(rows) - 1, count).astype(int)].tolist():
        image, truth = bench.frame(row, view).image, np.asarray(bench.image_truth(row, view).centreline_px)
        line = locator.locate(image)
        if line is None:
            continue
        strip = straightened(as_colour(image), line.points, diameter)
        read = refine(strip)
        points = strip.points + (diameter * read.offset)[:, None] * strip.normals
        seen = read.seen[INNER] > MIN_SURE_SEEN
        error = distance_to_curve(points[INNER][seen], truth) / diameter
        if not seen.any() or np.median(error) > MAX_WRONG_DIAMETERS:
            continue
        offsets.append(error)
        spreads.append(read.spread[INNER][seen])
        shown = line.seen[BODY]
        own = distance_to_curve(line.points[BODY][shown], truth)
        stated.append(rms(own / line.std_px[BODY][shown]) if shown.any() else np.nan)
        other = tracer.detect(image).centreline
        if other is not None and same_line(other.points, line.points, diameter):
            traced.append((rms(own) / diameter, rms(distance_to_curve(other.points[BODY], truth)) / diameter))
    if not offsets:
        return None
    return {
        "session": f"{preset}:{seed}:{number}", "frames": len(offsets), "error": np.concatenate(offsets).tolist(),
        "spread": np.concatenate(spreads).tolist(), "over_stated": rms(np.array(stated)),
        "locator_and_tracer": np.median(traced, axis=0).tolist() if traced else None,
    }  # fmt: skip


def main() -> None:
    """Measures and prints."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sessions", nargs="+")
    parser.add_argument("--frames", type=int, default=12)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    found: list[dict[str, Any]] = []
    for part in options.sessions:
        preset, seed, numbers = part.split(":")
        first, last = (int(each) for each in numbers.split("-"))
        for number in range(first, last + 1, 5):
            one = of_session(preset, int(seed), number, options.frames)
            if one is not None:
                found.append(one)
                print(f"{one['session']}: error {rms(np.array(one['error'])):.4f}", flush=True)
    if options.json:
        options.json.write_text(json.dumps(found) + "\n", encoding="utf-8")
    print(table(found))


def table(found: list[dict[str, Any]]) -> str:
    """Returns the figures of all sessions."""
    error, spread = (np.concatenate([each[name] for each in found]) for name in ("error", "spread"))
    rows = [f"{len(found)} sessions, {sum(each['frames'] for each in found)} frames"]
    for low, high in pairwise(SPREADS):
        use = (spread >= low) & (spread < high)
        if use.any():
            rows.append(f"spread {spread[use].mean():.4f}: error {rms(error[use]):.4f} ({use.sum()} stations)")
    quantiles = np.percentile([each["over_stated"] for each in found], [5, 50, 95])
    rows.append("error over stated error, rms by session, 5, 50, 95 %: " + ", ".join(f"{q:.2f}" for q in quantiles))
    pairs = np.array([each["locator_and_tracer"] for each in found if each["locator_and_tracer"]])
    low, high = pairs.min(axis=0), pairs.max(axis=0)
    rows.append(
        f"in {len(pairs)} sessions with lines of both: locator {low[0]:.4f} to {high[0]:.4f}, tracer {low[1]:.4f} to "
        f"{high[1]:.4f}"
    )
    return "\n".join(rows)


if __name__ == "__main__":
    main()
