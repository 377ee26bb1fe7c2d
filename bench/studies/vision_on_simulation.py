"""Compares the detections of `fine` in recordings of the simulated bench with the hidden truth, by session.

    python -m bench.studies.vision_on_simulation RUNS [RUNS ...] [--every 12] [--live | --blind | --together N]
        [--sheet worst.jpg] [--json FILE]

Each RUNS is a folder of `tipforce simulate`; every view of a session is used. The settings are calibrated on 16
frames spread over the session and on its session metadata (nominal size, scale, the base's side); with --live on frames
of its first two seconds, in which the catheter is at rest; with --blind on the spread images alone; with
--together N once on images of the folder's first N sessions, as an estimator that trains on these does. Wrong: given
as valid, but with a tip more than 5 px off along the shaft, or a point more than 2 px beside the true centreline.
Errors are those of the frames that are right. Covered: an object hides more than 3 % of the catheter in the image.
"""

import argparse
import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from bench.tubes import distance_to_curve

from tipforce.errors import InputError
from tipforce.io import RecordingReader
from tipforce.simulation import Truth, read_truth
from tipforce.types import SessionInfo
from tipforce.vision import ResolvedVision, ShapeDetector, VisionSettings, auto_calibrate, for_session

FIRST, SPREAD = 50, 16
HIDDEN = 0.03
TIP_PX, SIDE_PX = 5.0, 2.0
"""A line further off is wrong."""


def off_curve(points: np.ndarray, image: np.ndarray, curve: np.ndarray) -> tuple[float, np.ndarray]:
    """Returns the error of the tip along the shaft, and the distance of each point from the true curve, in px."""
    inside = ((curve > -2) & (curve < np.array(image.shape[1::-1]) + 1)).all(axis=1)
    axis = curve[-1] - curve[-2]
    tip = abs(float((points[-1] - curve[-1]) @ axis / np.linalg.norm(axis)))
    return tip, distance_to_curve(points, curve[max(0, int(np.argmax(inside)) - 1) :])


def look(vision: ShapeDetector, image: np.ndarray, curve: np.ndarray) -> dict[str, Any]:
    """Returns the detection in one frame, and its error."""
    detection = vision.detect(image)
    if detection.centreline is None:
        why = f"{detection.status}: {detection.detail}"
        return {"found": False, "wrong": False, "why": why, "bad": 1e3, "points": None}
    points = detection.centreline.points
    tip, beside = off_curve(points, image, curve)
    wrong = tip > TIP_PX or float(beside.max()) > SIDE_PX
    row = {"found": True, "wrong": wrong, "side": float(np.median(beside)), "worst": float(beside.max()), "tip": tip}
    return row | {
        "why": f"tip {tip:.1f} px, side {beside.max():.1f} px",
        "bad": tip + float(beside.max()),
        "points": points,
    }


def covered(curve: np.ndarray, visible: float, size: tuple[int, int]) -> bool:
    """Returns whether an object hides the catheter where the image would show it."""
    inside = ((curve > -0.5) & (curve < np.array(size) - 0.5)).all(axis=1)
    return visible < float(inside.mean()) - HIDDEN


def calibrated_together(paths: list[Path]) -> dict[str, ResolvedVision]:
    """Returns the settings by view, calibrated once on `SPREAD` images spread over all recordings at ``paths``."""
    images: dict[str, list[np.ndarray]] = {}
    infos: dict[str, list[SessionInfo]] = {}
    for path in paths:
        with RecordingReader(path) as reader:
            for view in reader.views:
                places = np.linspace(0, len(reader.stamps(view)) - 1, max(1, SPREAD // len(paths))).astype(int)
                images.setdefault(view, []).extend(reader.frame_at(int(k), view).image for k in places)
                infos.setdefault(view, []).extend([reader.session_info] * len(places))
    return {view: auto_calibrate(VisionSettings(), images[view], infos[view]) for view in images}


def session(
    path: Path, truth: Truth, shared: dict[str, ResolvedVision], options: argparse.Namespace
) -> list[dict[str, Any]]:
    """Returns rows of every ``every``-th frame of each view of a recording."""
    with RecordingReader(path) as reader:
        return [row for view in reader.views for row in one_view(reader, view, path, truth, shared, options)]


def one_view(
    reader: RecordingReader,
    view: str,
    path: Path,
    truth: Truth,
    shared: dict[str, ResolvedVision],
    options: argparse.Namespace,
) -> list[dict[str, Any]]:
    """Returns rows of every ``every``-th frame of one view."""
    of_view = truth.others.get(view, truth)
    stamps = reader.stamps(view)
    count = len(stamps)
    if options.live:
        calibration = range(0, min(FIRST, count), 5)
    else:
        calibration = np.unique(np.linspace(0, count - 1, SPREAD).astype(int)).tolist()
    if view in shared:
        vision = ShapeDetector(for_session(shared[view], reader.session_info))
    else:
        images = [reader.frame_at(k, view).image for k in calibration]
        try:
            vision = ShapeDetector(
                auto_calibrate(
                    VisionSettings(),
                    images,
                    None if options.blind else reader.session_info,
                    whole=not options.live,
                )
            )
        except InputError as error:
            print(f"{path.stem} {view}: {error}")
            vision = ShapeDetector(VisionSettings())
    rows = []
    for k in range(0, count, options.every):
        image = reader.frame_at(k, view).image
        at = int(np.argmin(np.abs(truth.stamp_ns - stamps[k])))
        curve = of_view.centreline_px[at]
        row = look(vision, image, curve)
        row |= {"covered": covered(curve, float(of_view.visible[at]), of_view.image_size)}
        row |= {"image": image, "curve": curve} if row["bad"] > 1.0 else {}
        rows.append(row | {"name": f"{path.parent.name} {path.stem} {view} frame {k}"})
    return rows


def draw_contact_sheet(rows: list[dict[str, Any]], path: Path) -> None:
    """Draws the worst frames: truth in green, detection in red."""
    tiles = []
    for row in rows[:12]:
        grey = row["image"].ndim == 2
        tile = cv2.cvtColor(row["image"], cv2.COLOR_GRAY2BGR if grey else cv2.COLOR_RGB2BGR)
        cv2.polylines(tile, [np.rint(row["curve"] * 16).astype(np.int32)], False, (60, 200, 60), 1, cv2.LINE_AA, 4)
        if row["points"] is not None:
            points = np.rint(row["points"] * 16).astype(np.int32)
            cv2.polylines(tile, [points], False, (40, 40, 230), 1, cv2.LINE_AA, 4)
        for place, text in ((18, row["name"]), (36, row["why"][:75])):
            cv2.putText(tile, text, (6, place), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (255, 255, 255), 2, cv2.LINE_AA)
            cv2.putText(tile, text, (6, place), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (0, 0, 0), 1, cv2.LINE_AA)
        tiles.append(tile)
    while len(tiles) % 4:
        tiles.append(np.zeros_like(tiles[0]))
    drawn = np.vstack([np.hstack(tiles[k : k + 4]) for k in range(0, len(tiles), 4)])
    cv2.imwrite(str(path), cv2.resize(drawn, None, fx=0.6, fy=0.6, interpolation=cv2.INTER_AREA))


def figures(rows: list[dict[str, Any]]) -> dict[str, float]:
    """Shares in percent, errors in px."""
    right = [row for row in rows if row["found"] and not row["wrong"]]
    out: dict[str, float] = {"frames": len(rows), "right": 100 * len(right) / len(rows)}
    out["refused"] = 100 * np.mean([not row["found"] for row in rows])
    out["wrong"] = 100 * np.mean([row["wrong"] for row in rows])
    clear = [row for row in rows if not row["covered"]]
    out["covered"] = 100 * (1 - len(clear) / len(rows))
    if 0 < len(clear) < len(rows):
        out["right of the others"] = 100 * np.mean([row["found"] and not row["wrong"] for row in clear])
    for key in ("side", "worst", "tip"):
        values = [row[key] for row in right] or [float("nan")]
        out |= {f"{key} median": float(np.median(values)), f"{key} 99 %": float(np.percentile(values, 99))}
    return out


def main() -> None:
    """Detects, prints and writes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path, nargs="+")
    parser.add_argument("--every", type=int, default=12)
    start = parser.add_mutually_exclusive_group()
    start.add_argument("--live", action="store_true", help="calibrate on the first two seconds")
    start.add_argument("--blind", action="store_true", help="nothing is known but the images")
    start.add_argument("--together", type=int, default=0, help="calibrate once, on this number of sessions")
    parser.add_argument("--sheet", type=Path, help="draw the twelve worst frames")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    results: dict[str, dict[str, float]] = {}
    everything: list[dict[str, Any]] = []
    for folder in options.runs:
        paths = sorted(folder.glob("*.mcap"))
        if not paths:
            parser.error(f"{folder}: no recording; write some with `tipforce simulate`")
        together: list[dict[str, Any]] = []
        shared = calibrated_together(paths[: options.together]) if options.together else {}
        for path in paths:
            rows = session(path, read_truth(path), shared, options)
            together += rows
            report(results, f"{folder.name}/{path.stem}", rows)
        report(results, f"{folder.name}, all", together)
        everything += together
    if options.json:
        options.json.write_text(json.dumps(results, indent=2) + "\n", encoding="utf-8")
    bad = sorted((row for row in everything if "image" in row), key=lambda row: -row["bad"])
    if options.sheet and bad:
        draw_contact_sheet(bad, options.sheet)


def report(results: dict[str, dict[str, float]], name: str, rows: list[dict[str, Any]]) -> None:
    """Stores and prints the figures of ``rows``."""
    results[name] = figures(rows)
    print(f"{name}: " + ", ".join(f"{key} {value:.3g}" for key, value in results[name].items()), flush=True)


if __name__ == "__main__":
    main()
