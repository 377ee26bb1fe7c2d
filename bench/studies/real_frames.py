"""The four frames of a real tendon manipulator: found or not, and the shapes beside independently stored ones.

    TIPFORCE_REAL_DATA=FOLDER python -m bench.studies.real_frames [--out FOLDER] [--json FILE]

The stored curves are quartics y(x) without constant term in an undocumented unit. This chain gives them back to within
1e-5 in every coefficient, so that nothing about them is free any more: grey > 127; the largest component (the segments
between the two black rings); thinning after Lee, Kashyap and Chu; the longest path through the skeleton; origin at its
lowest pixel; x up the IMAGE and y to the left (the base tangent plays no part, hence the linear term); divided by the
longer side of the path's bounding box, which is another unit in every frame; ordinary least squares over the pixels.
The chain below is written anew from that description. A frame without stored curve is compared with its result.

Deviation: the distance from every point of the stored curve to our centreline, in pixels and in percent of the stored
curve's deflection at its end.
"""

import argparse
import json
import os
import pathlib
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.optimize import minimize
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree
from skimage.morphology import skeletonize

from tipforce.geometry import arc_length
from tipforce.vision import Tracer, VisionSettings

SETTINGS = VisionSettings(base_side="bottom", polarity="light", base_region=(280, 292, 330, 312), diameter_px=19.9)
THRESHOLD = 127


@dataclass(frozen=True)
class Source:
    """Result of the source's chain for a frame: ``path`` (n, 2) skeleton pixels u, v; the rest of its curve."""

    path: np.ndarray
    origin: np.ndarray
    unit: float
    quartic: np.ndarray

    @property
    def height(self) -> float:
        """Height of the curve in pixels."""
        return float(self.origin[1] - self.path[:, 1].min())


def stored(folder: pathlib.Path) -> dict[str, list[float]]:
    rows = json.loads((folder / "sessions" / "curve_fit_result-poly4d_nopayload.json").read_text())
    return {row["Image Filename"]: row["Coefficients"] for row in rows}


def longest_path(skeleton: np.ndarray) -> np.ndarray:
    """(n, 2) pixels u, v of the longest of the shortest ways between two pixels of a skeleton without loops."""
    pixels = np.argwhere(skeleton)
    near = cKDTree(pixels).query_pairs(1.5, output_type="ndarray")
    steps = np.linalg.norm(pixels[near[:, 0]] - pixels[near[:, 1]], axis=1)
    graph = coo_array((steps, near.T), shape=(len(pixels), len(pixels))).tocsr()
    first = int(dijkstra(graph, directed=False, indices=0).argmax())
    away, before = dijkstra(graph, directed=False, indices=first, return_predecessors=True)
    way = [int(away.argmax())]
    while way[-1] != first:
        way.append(int(before[way[-1]]))
    return pixels[way, ::-1].astype(float)


def fit(points: np.ndarray, origin: np.ndarray, unit: float) -> np.ndarray:
    """The quartic without constant term through ``points`` (n, 2): x up the image, y to the left, in ``unit``."""
    y, x = ((origin - points) / unit).T
    return np.linalg.lstsq(x[:, None] ** np.array([4, 3, 2, 1]), y, rcond=None)[0]


def source_chain(grey: np.ndarray) -> Source:
    _, labels, stats, _ = cv2.connectedComponentsWithStats((grey > THRESHOLD).astype(np.uint8), connectivity=8)
    largest = 1 + int(stats[1:, cv2.CC_STAT_AREA].argmax())
    path = longest_path(skeletonize(labels == largest, method="lee") > 0)
    origin, unit = path[path[:, 1].argmax()], float(np.ptp(path, axis=0).max())
    return Source(path, origin, unit, fit(path, origin, unit))


def drawn(quartic: np.ndarray, origin: np.ndarray, unit: float, start: float, end: float) -> np.ndarray:
    """(n, 2) points u, v of the quartic from ``start`` to ``end`` pixels above its origin, 0.05 px apart."""
    x = np.linspace(start, end, 2000)
    y = np.polyval([*quartic, 0.0], x / unit) * unit
    return dense(origin - np.stack([y, x], axis=1))


def dense(points: np.ndarray, step: float = 0.05) -> np.ndarray:
    s = arc_length(points)
    at = np.arange(0, s[-1], step)
    return np.stack([np.interp(at, s, points[:, k]) for k in (0, 1)], axis=1)


def distances(points: np.ndarray, line: np.ndarray) -> np.ndarray:
    return cKDTree(line).query(points)[0]


def in_the_image(source: Source, line: np.ndarray) -> np.ndarray:
    """Returns the stored curve at the position of the chain, without free parameters."""
    return distances(drawn(source.quartic, source.origin, source.unit, 0, source.height), line)


def fitted_alike(source: Source, line: np.ndarray) -> np.ndarray:
    """Returns our centreline between the same ends, with its lowest point as origin, fitted by the same chain."""
    ends = np.sort(cKDTree(line).query(source.path[[0, -1]])[1])
    part = line[ends[0] : ends[1] + 1]
    origin = part[part[:, 1].argmax()]
    ours = drawn(fit(part, origin, source.unit), origin, source.unit, -3, source.height + 3)
    return distances(drawn(source.quartic, origin, source.unit, 0, source.height), ours)


def one_unit(sources: list[Source], lines: list[np.ndarray], shifted: bool) -> tuple[np.ndarray, list[np.ndarray]]:
    """The unit taken for common to all frames, and fitted; with a common shift of the origins where ``shifted``."""
    trees = [cKDTree(line) for line in lines]

    def off(p: np.ndarray) -> list[np.ndarray]:
        shift = p[1:] if shifted else np.zeros(2)
        ways = [drawn(s.quartic, s.origin + shift, p[0], 0, s.height)[::10] for s in sources]
        return [tree.query(way)[0] for tree, way in zip(trees, ways, strict=True)]

    def cost(p: np.ndarray) -> float:
        return sum(float((d**2).mean()) for d in off(p))

    starts = [np.r_[unit, [0.0, 0.0] if shifted else []] for unit in (100.0, 120.0, 140.0)]
    best = min((minimize(cost, start, method="Nelder-Mead") for start in starts), key=lambda found: found.fun)
    return best.x, off(best.x)


def drawing(image: np.ndarray, line: np.ndarray, source: Source) -> np.ndarray:
    """The manipulator four times as large: our centreline red, the stored curve blue, the source's skeleton olive."""
    left, top, right, bottom, zoom = 140, 60, 420, 350, 4
    part = image[top:bottom, left:right] // 2
    u, v = (source.path - (left, top)).astype(int).T
    part[v, u] = (40, 110, 110)
    big = cv2.resize(part, None, fx=zoom, fy=zoom, interpolation=cv2.INTER_NEAREST)
    curve = drawn(source.quartic, source.origin, source.unit, 0, source.height)
    for points, colour, width in ((curve, (255, 160, 60), 2), (line, (80, 80, 255), 1)):
        at = (points - (left, top) + 0.5) * zoom - 0.5
        cv2.polylines(big, [np.int32(np.rint(at * 16))], False, colour, width, cv2.LINE_AA, 4)
    return big


def measure(folder: pathlib.Path, out: pathlib.Path | None = None) -> dict:
    """Returns all figures: per frame the detection, per variant and frame the deviations."""
    known = stored(folder)
    tracer = Tracer(SETTINGS)
    frames, sources, lines = {}, {}, {}
    for path in sorted((folder / "frames").glob("*.png")):
        image = cv2.imread(str(path))
        detection = tracer.detect(cv2.cvtColor(image, cv2.COLOR_BGR2RGB))
        frame = {"found": detection.found, "detail": detection.detail, "stored": path.name in known}
        frames[path.name] = frame
        if detection.centreline is None:
            continue
        source = source_chain(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY))
        if path.name in known:
            frame["chain_error"] = float(np.abs(source.quartic - known[path.name]).max())
            source = Source(source.path, source.origin, source.unit, np.array(known[path.name]))
        line = dense(detection.centreline.points, 0.02)
        end = np.polyval([*source.quartic, 0.0], source.height / source.unit) * source.unit
        frame |= {
            "tip_px": [float(value) for value in detection.centreline.points[-1]],
            "diameter_px": detection.diameter_px,
            "unit_px": source.unit,
            "origin_px": source.origin.tolist(),
            "deflection_px": abs(float(end)),
        }
        sources[path.name], lines[path.name] = source, line
        if out:
            out.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(out / path.name), drawing(image, line, source))
    both = [(sources[name], lines[name]) for name in sources]
    variants = {
        "source's own skeleton to its curve": (
            0,
            [distances(s.path, drawn(s.quartic, s.origin, s.unit, 0, s.height)) for s, _ in both],
        ),
        "stored curve in the image": (0, [in_the_image(*pair) for pair in both]),
        "ours fitted the same way": (0, [fitted_alike(*pair) for pair in both]),
    }
    alike = [name for name in sources if name in known]
    for title, shifted in (("one unit for all", False), ("one unit and one shift for all", True)):
        fitted, off = one_unit([sources[n] for n in alike], [lines[n] for n in alike], shifted)
        by_name = dict(zip(alike, off, strict=True))
        variants[f"{title} ({fitted[0]:.1f} px)"] = (len(fitted), [by_name.get(name) for name in sources])
    rows = []
    for title, (free, off) in variants.items():
        for name, d in zip(sources, off, strict=True):
            if d is not None:
                worst, rms = float(d.max()), float(np.sqrt((d**2).mean()))
                rows.append({"variant": title, "free": free, "frame": name, "max_px": worst, "rms_px": rms,
                             "max_percent": 100 * worst / frames[name]["deflection_px"]})  # fmt: skip
    return {"frames": frames, "deviations": rows}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=pathlib.Path, help="folder for the images")
    parser.add_argument("--json", type=pathlib.Path, help="file for the figures")
    given = parser.parse_args()
    figures = measure(pathlib.Path(os.environ["TIPFORCE_REAL_DATA"]) / "tendon-manipulator", given.out)
    for name, frame in figures["frames"].items():
        if not frame["found"]:
            print(f"{name}: not found: {frame['detail']}")
            continue
        u, v = frame["tip_px"]
        chain = f"chain against stored {frame['chain_error']:.1e}" if frame["stored"] else "no stored curve"
        print(f"{name}: found, tip ({u:.1f}, {v:.1f}), diameter {frame['diameter_px']:.2f} px; "
              f"unit {frame['unit_px']:.0f} px, deflection {frame['deflection_px']:.1f} px, {chain}")  # fmt: skip
    print("\nmax px / rms px / max in % of the deflection")
    shown = [name for name, frame in figures["frames"].items() if frame["found"]]
    print(f"{'':42}{'free':>4}  " + "".join(f"{name.split('_')[0]:>23}" for name in shown))
    for title in dict.fromkeys(row["variant"] for row in figures["deviations"]):
        rows = {row["frame"]: row for row in figures["deviations"] if row["variant"] == title}
        cells = [f"{r['max_px']:.2f} / {r['rms_px']:.2f} / {r['max_percent']:.2f} %" if (r := rows.get(n)) else "-"
                 for n in shown]  # fmt: skip
        print(f"{title:42}{next(iter(rows.values()))['free']:>4}  " + "".join(f"{cell:>23}" for cell in cells))
    if given.json:
        given.json.write_text(json.dumps(figures, indent=2) + "\n")


if __name__ == "__main__":
    main()
