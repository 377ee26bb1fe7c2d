"""The four frames of a real tendon manipulator: found or not, and the shapes beside independently stored ones.

    TIPFORCE_REAL_DATA=FOLDER python bench/real_frames.py [--out FOLDER] [--json FILE]

The stored curves are quartics without constant term in a base frame and a unit that nobody documented. Compared is the
flexible part, between the two black rings. Fitted: ONE scale and ONE base point for all three frames, and the direction
of the base tangent frame by frame, since the source measured it anew in every frame. Deviation: across the curve.
"""

import argparse
import json
import math
import os
import pathlib

import cv2
import numpy as np
from scipy.optimize import minimize

from tipforce.vision import FineTracer, VisionSettings

SETTINGS = VisionSettings(base_side="bottom", polarity="light", base_region=(280, 292, 330, 312), diameter_px=19.9)
SECOND_RING_PX = 187.0
"""Arc length from the base line to the near edge of the second black ring."""


def stored(folder: pathlib.Path) -> dict[str, list[float]]:
    rows = json.loads((folder / "sessions" / "curve_fit_result-poly4d_nopayload.json").read_text())
    return {row["Image Filename"]: row["Coefficients"] for row in rows}


def dense(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    s = np.r_[0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))]
    at = np.arange(0, s[-1], 0.5)
    return np.stack([np.interp(at, s, points[:, k]) for k in (0, 1)], axis=1), at


def deviations(
    parameters: np.ndarray, curves: list[np.ndarray], quartics: list[list[float]]
) -> list[tuple[np.ndarray, np.ndarray]]:
    scale, u, v = parameters[:3]
    result = []
    for angle, curve, quartic in zip(parameters[3:], curves, quartics, strict=True):
        offset = curve - np.array([u, v])
        x = offset @ np.array([math.cos(angle), -math.sin(angle)])
        y = offset @ np.array([-math.sin(angle), -math.cos(angle)])
        ahead = x >= 0
        x, y = x[ahead], y[ahead]
        if len(x) < 20:
            return []
        away = y - np.polyval([*quartic, 0.0], x / scale) * scale
        slope = np.gradient(y) / np.gradient(x)
        result.append((away / np.hypot(1, slope), y))
    return result


def compare(
    curves: list[np.ndarray], quartics: list[list[float]]
) -> tuple[np.ndarray, list[tuple[np.ndarray, np.ndarray]]]:
    def cost(p: np.ndarray) -> float:
        found = deviations(p, curves, quartics)
        return sum(float((d**2).mean()) for d, _ in found) if found else 1e9

    best = None
    for scale in (110.0, 130.0, 160.0):
        for v in (270.0, 285.0):
            start = [scale, 306.0, v, *[math.pi / 2] * len(curves)]
            options = {"maxiter": 6000, "maxfev": 6000, "adaptive": True}
            found = minimize(cost, start, method="Nelder-Mead", options=options)
            best = found if best is None or found.fun < best.fun else best
    return best.x, deviations(best.x, curves, quartics)


def picture(image: np.ndarray, tracer: FineTracer, points: np.ndarray) -> np.ndarray:
    big = cv2.resize(cv2.cvtColor(image, cv2.COLOR_RGB2BGR), None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)
    cv2.polylines(big, [np.int32(np.rint((points * 2 + 0.5) * 16))], False, (40, 40, 255), 2, cv2.LINE_AA, 4)
    for u, v in tracer.stations * 2 + 0.5:
        cv2.circle(big, (round(u * 16), round(v * 16)), 32, (0, 150, 0), -1, cv2.LINE_AA, 4)
    return big


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=pathlib.Path)
    parser.add_argument("--json", type=pathlib.Path)
    given = parser.parse_args()
    folder = pathlib.Path(os.environ["TIPFORCE_REAL_DATA"]) / "tendon-manipulator"
    known = stored(folder)
    tracer = FineTracer(SETTINGS)
    names, curves, quartics, results = [], [], [], {}
    for path in sorted((folder / "frames").glob("*.png")):
        image = cv2.cvtColor(cv2.imread(str(path)), cv2.COLOR_BGR2RGB)
        sight = tracer.see(image)
        tip = sight.centreline.points[-1] if sight.centreline else (math.nan, math.nan)
        print(f"{path.name:32} {sight.status} {sight.detail} tip ({tip[0]:.1f}, {tip[1]:.1f}) "
              f"diameter {sight.diameter_px:.2f} px, confidence {sight.confidence:.2f}")  # fmt: skip
        results[path.name] = {"found": sight.found, "tip_px": [float(tip[0]), float(tip[1])]}
        if sight.centreline is None:
            continue
        if given.out:
            given.out.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(given.out / path.name), picture(image, tracer, sight.centreline.points))
        if path.name in known:
            curve, s = dense(sight.centreline.points)
            names.append(path.name)
            curves.append(curve[s <= SECOND_RING_PX])
            quartics.append(known[path.name])
    fitted, found = compare(curves, quartics)
    print(f"one unit = {fitted[0]:.1f} px; base at ({fitted[1]:.1f}, {fitted[2]:.1f}); "
          f"base tangents {', '.join(f'{math.degrees(a):.1f}' for a in fitted[3:])} degrees")  # fmt: skip
    print(f"{'frame':32} {'deflection px':>14} {'max px':>8} {'rms px':>8} {'max %':>7} {'rms %':>7}")
    for name, (away, y) in zip(names, found, strict=True):
        worst, rms, tip = float(np.abs(away).max()), float(np.sqrt((away**2).mean())), abs(float(y[-1]))
        results[name] |= {"deflection_px": tip, "max_px": worst, "rms_px": rms}
        print(f"{name:32} {tip:14.1f} {worst:8.2f} {rms:8.2f} {100 * worst / tip:7.2f} {100 * rms / tip:7.2f}")
    if given.json:
        given.json.write_text(json.dumps(results, indent=2) + "\n")


if __name__ == "__main__":
    main()
