"""Judges detection on photographs of real catheters, and on images without one, each image by itself.

    python -m bench.studies.real_catheters PHOTOGRAPHS [--empty FOLDER]

PHOTOGRAPHS holds images and ``points.csv`` (image, mouth_u, mouth_v, tip_u, tip_v in px); the base is at the top.
Right: mouth and tip within 8 px. FOLDER holds images in which no catheter is.
"""

import argparse
import csv
from collections import Counter
from pathlib import Path

import cv2
import numpy as np

from tipforce.types import Catheter, Image, SessionInfo, ViewInfo
from tipforce.vision import SessionDetector, VisionSettings

LIMIT_PX = 8.0
DIAMETER_M = 3e-3
MARK_PX = 9
"""Half of the side of the marked box."""
ASPECT = 8.0
"""Length of the catheters in diameters, about."""
MAX_EMPTY_IMAGES = 20


def read(path: Path) -> Image:
    """Returns an image as RGB."""
    found = cv2.imread(str(path))
    if found is None:
        raise SystemExit(f"{path}: cannot be read as an image")
    return np.ascontiguousarray(found[..., ::-1])


def infos(mouth: np.ndarray, length_px: float) -> dict[str, SessionInfo]:
    """Returns the metadata that are tried: none, the side, the size, a box at the mouth, and together."""
    u, v = mouth.astype(int).tolist()
    box = (u - MARK_PX, v - MARK_PX, u + MARK_PX, v + MARK_PX)
    scale = DIAMETER_M * ASPECT / length_px
    sized = Catheter("photograph", DIAMETER_M, DIAMETER_M * ASPECT, 0.0)
    return {
        "nothing": SessionInfo("photograph"),
        "side": SessionInfo("photograph", views={"camera": ViewInfo(base_side="top")}),
        "side and size": SessionInfo("photograph", sized, {"camera": ViewInfo(scale, "top")}),
        "box": SessionInfo("photograph", views={"camera": ViewInfo(base_side="top", base_region=box)}),
        "box and size": SessionInfo("photograph", sized, {"camera": ViewInfo(scale, "top", box)}),
    }


def main() -> None:
    """Measures and prints."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("photographs", type=Path)
    parser.add_argument("--empty", type=Path)
    options = parser.parse_args()
    counts: dict[str, Counter[str]] = {}
    with (options.photographs / "points.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        image = read(options.photographs / row["image"])
        mouth, tip = (np.array([float(row[f"{end}_u"]), float(row[f"{end}_v"])]) for end in ("mouth", "tip"))
        for name, info in infos(mouth, float(np.linalg.norm(tip - mouth))).items():
            line = SessionDetector(VisionSettings(), info, [image]).detect(image).centreline
            kind = "abstained"
            if line is not None:
                off = np.linalg.norm(line.points[0] - mouth), np.linalg.norm(line.points[-1] - tip)
                kind = "right" if max(off) <= LIMIT_PX else "wrong"
            counts.setdefault(name, Counter())[kind] += 1
    for name, count in counts.items():
        print(f"{name}: {dict(count)}")
    if options.empty is not None:
        paths = sorted(path for path in options.empty.rglob("*") if path.suffix in (".png", ".jpg"))[:MAX_EMPTY_IMAGES]
        images = [read(path) for path in paths]
        valid = sum(
            SessionDetector(VisionSettings(), SessionInfo("empty"), [each]).detect(each).found for each in images
        )
        print(f"without a catheter: {valid} of {len(images)} valid")


if __name__ == "__main__":
    main()
