"""Share of the 641 soft-arm images in which the arm is found, and a sheet of 25 of them.

    TIPFORCE_REAL_DATA=FOLDER python -m bench.studies.soft_arm_sheet --out FOLDER [--json FILE]

The images are 64 x 64 px; the arm is 5 px wide, hangs from the top and starts at its clamp near (31, 12).
"""

import argparse
import collections
import json
import os
import pathlib

import cv2
import h5py
import numpy as np

from tipforce.vision import DetectedShape, Tracer, VisionSettings

SETTINGS = VisionSettings(
    polarity="light", base_side="top", base_region=(22, 14, 42, 26), diameter_px=4.2, max_gap_px=3.0, base_columns=6
)


def images(folder: pathlib.Path) -> np.ndarray:
    with h5py.File(folder / "soft-arm" / "images.mat") as file:
        stored = np.array(file["input_test"])
    frames = np.rint(stored.reshape(-1, 64, 64).transpose(0, 2, 1) * 255).astype(np.uint8)
    return np.ascontiguousarray(frames)


def tile(image: np.ndarray, detection: DetectedShape, name: str, scale: int = 5) -> np.ndarray:
    big = cv2.cvtColor(cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_NEAREST), cv2.COLOR_GRAY2BGR)
    if detection.centreline is not None:
        line = (detection.centreline.points + 0.5) * scale - 0.5
        cv2.polylines(big, [np.int32(np.rint(line * 16))], False, (60, 60, 255), 1, cv2.LINE_AA, 4)
    cv2.putText(big, name, (4, 14), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (0, 220, 255), 1, cv2.LINE_AA)
    if not detection.found:
        cv2.putText(big, str(detection.status), (4, 30), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (0, 120, 255), 1, cv2.LINE_AA)
    return big


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=pathlib.Path)
    parser.add_argument("--json", type=pathlib.Path)
    parser.add_argument("--missed", action="store_true", help="draw those that were not found instead")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    frames = images(pathlib.Path(os.environ["TIPFORCE_REAL_DATA"]))
    tracer = Tracer(SETTINGS)
    seen = [tracer.detect(frame) for frame in frames]
    found = [k for k, detection in enumerate(seen) if detection.found]
    why = collections.Counter(str(detection.status) for detection in seen)
    lengths = np.array([np.linalg.norm(np.diff(seen[k].centreline.points, axis=0), axis=1).sum() for k in found])
    print(f"found {len(found)} of {len(frames)} = {100 * len(found) / len(frames):.1f} %   {dict(why)}")
    print(
        f"length px: median {np.median(lengths):.1f}, "
        f"1 % {np.quantile(lengths, 0.01):.1f}, 99 % {np.quantile(lengths, 0.99):.1f}"
    )
    if given.out:
        rng = np.random.default_rng(given.seed)
        pool = sorted(set(range(len(frames))) - set(found)) if given.missed else list(range(len(frames)))
        chosen = sorted(rng.choice(pool, min(25, len(pool)), replace=False))
        tiles = [tile(frames[k], seen[k], str(k)) for k in chosen]
        tiles += [np.zeros_like(tiles[0])] * (-len(tiles) % 5)
        sheet = np.vstack([np.hstack(tiles[k : k + 5]) for k in range(0, len(tiles), 5)])
        given.out.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(given.out / "soft_arm_sheet.png"), sheet)
    if given.json:
        result = {"images": len(frames), "found": len(found), "share": len(found) / len(frames), "statuses": dict(why)}
        given.json.write_text(json.dumps(result, indent=2) + "\n")


if __name__ == "__main__":
    main()
