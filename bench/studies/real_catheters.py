"""Judges detection on photographs of real catheters, and on images without one, each image by itself.

    python -m bench.studies.real_catheters PHOTOGRAPHS [--empty FOLDER]

PHOTOGRAPHS holds images and ``points.csv`` (image, mouth_u, mouth_v, tip_u, tip_v in px); the base is at the top, and
the shaft is taken for 3 mm wide. Right: mouth and tip within 8 px. FOLDER holds images without a
catheter, which are read as camera and as X-ray images.
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
METRES_PER_PX = {
    "LC_v4_cam0": 0.33e-3,
    "LC_v4_cam1": 0.43e-3,
    "test_highres_cam0": 0.43e-3,
    "test_highres_cam1": 0.56e-3,
}
"""Scale of the images by the beginning of their names, for a shaft of `DIAMETER_M`."""
MAX_EMPTY_IMAGES = 20


def read(path: Path) -> Image:
    """Returns an image as RGB."""
    found = cv2.imread(str(path))
    if found is None:
        raise SystemExit(f"{path}: cannot be read as an image")
    return np.ascontiguousarray(found[..., ::-1])


def infos(name: str, mouth: np.ndarray, length_px: float) -> dict[str, SessionInfo]:
    """Returns the metadata that are tried: none, the side, the size, a box at the mouth, and together."""
    u, v = mouth.astype(int).tolist()
    box = (u - MARK_PX, v - MARK_PX, u + MARK_PX, v + MARK_PX)
    scale = next((scale for begin, scale in METRES_PER_PX.items() if name.startswith(begin)), None)
    if scale is None:
        raise SystemExit(f"{name}: its scale is not known; add the beginning of its name to METRES_PER_PX")
    sized = Catheter("photograph", DIAMETER_M, length_px * scale, 0.0)
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
        for name, info in infos(row["image"], mouth, float(np.linalg.norm(tip - mouth))).items():
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
        for name in ("camera", "xray"):
            info = SessionInfo("empty", views={"camera": ViewInfo(modality=name)})
            valid = sum(SessionDetector(VisionSettings(), info, [each]).detect(each).found for each in images)
            print(f"without a catheter, read as {name}: {valid} of {len(images)} valid")


if __name__ == "__main__":
    main()
