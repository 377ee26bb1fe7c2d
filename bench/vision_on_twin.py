"""What `fine` sees in recordings of the twin, held against their hidden truth, session by session.

    python bench/vision_on_twin.py RUNS [--every 20] [--auto] [--sheet worst.png] [--json FILE]

RUNS holds what `tipforce simulate` wrote. The settings are settled on each session's own first frames; the base's side
is stated, as a bench knows it (--auto: it is not). Wrong: given as valid, but with a tip more than 5 px off along the
shaft, or a point more than 2 px beside the true centreline. Errors are those of the frames that are right.
"""

import argparse
import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np

import tubes
from tipforce.recording import RecordingReader
from tipforce.twin import Truth, read_truth
from tipforce.vision import Vision, VisionSettings, settle

FIRST = 50


def look(vision: Vision, image: np.ndarray, curve: np.ndarray) -> dict[str, Any]:
    """One frame: what was found, and how far off."""
    sight = vision.see(image)
    if sight.centreline is None:
        return {"found": False, "why": f"{sight.status}: {sight.detail}", "bad": 1e3, "points": None}
    points = sight.centreline.points
    inside = (curve[:, 0] > -2) & (curve[:, 0] < image.shape[1] + 1)
    beside = tubes.distance_to_curve(points, curve[max(0, int(np.argmax(inside)) - 1) :])
    axis = curve[-1] - curve[-2]
    tip = abs(float((points[-1] - curve[-1]) @ axis / np.linalg.norm(axis)))
    wrong = tip > 5 or float(beside.max()) > 2
    row = {"found": True, "wrong": wrong, "side": float(np.median(beside)), "worst": float(beside.max()), "tip": tip}
    return row | {
        "why": f"tip {tip:.1f} px, side {beside.max():.1f} px",
        "bad": tip + float(beside.max()),
        "points": points,
    }


def session(path: Path, truth: Truth, every: int, auto: bool) -> list[dict[str, Any]]:
    """Every ``every``-th frame of a recording."""
    with RecordingReader(path) as reader:
        count = len(truth.stamp_ns)
        first = [reader.frame_at(k).image for k in range(0, min(FIRST, count), 5)]
        vision = Vision(settle(VisionSettings() if auto else VisionSettings(base_side="left"), first))
        rows = []
        for k in range(0, count, every):
            image = reader.frame_at(k).image
            row = look(vision, image, truth.centreline_px[k])
            if not row["found"] or row["wrong"]:
                row["image"], row["curve"] = image, truth.centreline_px[k]
            rows.append(row | {"name": f"{path.stem} frame {k}"})
    return rows


def sheet(rows: list[dict[str, Any]], path: Path) -> None:
    """The worst frames: truth in green, what was seen in red."""
    tiles = []
    for row in rows[:16]:
        tile = cv2.cvtColor(row["image"], cv2.COLOR_RGB2BGR)
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
    cv2.imwrite(str(path), np.vstack([np.hstack(tiles[k : k + 4]) for k in range(0, len(tiles), 4)]))


def figures(rows: list[dict[str, Any]]) -> dict[str, float]:
    """Shares in percent, errors in px."""
    right = [row for row in rows if row["found"] and not row["wrong"]]
    out = {"frames": len(rows), "refused": 100 * np.mean([not row["found"] for row in rows])}
    out["wrong"] = 100 * np.mean([row["found"] and row["wrong"] for row in rows])
    for key in ("side", "worst", "tip"):
        values = [row[key] for row in right] or [float("nan")]
        out |= {f"{key} median": float(np.median(values)), f"{key} 99 %": float(np.percentile(values, 99))}
    return out


def main() -> None:
    """Look, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path)
    parser.add_argument("--every", type=int, default=20)
    parser.add_argument("--auto", action="store_true", help="the base's side is not stated")
    parser.add_argument("--sheet", type=Path)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    paths = sorted(options.runs.glob("*.mcap"))
    if not paths:
        parser.error(f"{options.runs}: no recording; write some with `tipforce simulate`")
    results, everything = {}, []
    for path in paths:
        rows = session(path, read_truth(path), options.every, options.auto)
        results[path.stem] = figures(rows)
        everything += rows
        shown = ", ".join(f"{key} {value:.3g}" for key, value in results[path.stem].items())
        print(f"{path.stem}: {shown}", flush=True)
    results["all"] = figures(everything)
    print("all: " + ", ".join(f"{key} {value:.3g}" for key, value in results["all"].items()))
    if options.json:
        options.json.write_text(json.dumps(results, indent=2) + "\n", encoding="utf-8")
    bad = sorted((row for row in everything if "image" in row), key=lambda row: -row["bad"])
    if options.sheet and bad:
        sheet(bad, options.sheet)


if __name__ == "__main__":
    main()
