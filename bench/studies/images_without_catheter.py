"""Counts images without a catheter in which one is found, kind by kind.

    python -m bench.studies.images_without_catheter [--out FOLDER] [--seed 61000] [--sessions 2] [--kinds NAME ...]

21 kinds are drawn by code: 19 by `bench.locator.empty`, and the scenes of the presets `varied` and `fluoro` with their
catheter moved out of the image; their other instruments stay. Of each kind there are 8 scenes. Their images are read
alone, with nothing stated, and with the side and the size of a catheter stated. Two of the scenes are read as sessions
of 8 images as well, in which the objects sway by some px. Writes to FOLDER a contact sheet, kinds.png, with the lines
that were found drawn in them, and lines.json: each such line with the features of its probability.
"""

import argparse
import json
import math
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from bench.locator import empty
from bench.locator.tubes import Drawer

from tipforce.simulation import PRESETS, SimulatedBench
from tipforce.simulation.world import FAST
from tipforce.types import Catheter, Image, SessionInfo, ViewInfo
from tipforce.vision import ResolvedVision, SessionDetector, ShapeDetector, VisionSettings, contact_sheet, draw_shape
from tipforce.vision._by_locator import LocatorDetector
from tipforce.vision.locator._line_probability import line_features, probability

SCENES, FRAMES = 8, 8
"""Scenes of a kind, and images of a session."""
SIDES = ("left", "right", "top", "bottom")
DIAMETER_M = 2.33e-3
SWAY_SHARE = 0.02
"""Largest sway of the objects in a session, in shares of the image's side."""
GRAIN = 1.5
"""Standard deviation of the noise that differs between the images of a session, grey levels."""
AWAY_M = 0.5
"""The presets' catheter is moved by this distance: out of the image."""
PRESET_KINDS = {"preset varied": "varied", "preset fluoro": "fluoro"}
WAYS = ("alone", "alone, stated", "session", "session, stated")


def scenes(kind: str, seed: int, size: int) -> Iterator[tuple[list[Image], SessionInfo]]:
    """Yields the images of each session of a kind, with the metadata of a catheter that is not there."""
    index = [*empty.KINDS, *PRESET_KINDS].index(kind)
    for number in range(SCENES):
        if kind in PRESET_KINDS:
            yield _preset_session(PRESET_KINDS[kind], seed, number)
            continue
        drawer, frames = Drawer(size, size), []
        rng = np.random.default_rng([seed, index, number])
        turn, scene = rng.uniform(0.0, 2.0 * math.pi), None
        for k in range(FRAMES):
            reach = SWAY_SHARE * size * math.sin(2.0 * math.pi * k / FRAMES)
            sway = reach * math.cos(turn), reach * math.sin(turn)
            scene = empty.draw(kind, np.random.default_rng([seed, index, number]), drawer, size, sway)
            noisy = scene.image + rng.normal(0.0, GRAIN, scene.image.shape)
            frames.append(np.clip(noisy, 0.0, 255.0).astype(np.uint8))
        assert scene is not None
        length = float(np.linalg.norm(np.diff(scene.line, axis=0), axis=1).sum())
        scale = DIAMETER_M / scene.diameter_px
        sized = Catheter("absent", DIAMETER_M, length * scale, 0.0)
        yield frames, SessionInfo(f"{kind} {number}", sized, {"camera": ViewInfo(scale, SIDES[max(scene.side, 0)])})


def _preset_session(name: str, seed: int, number: int) -> tuple[list[Image], SessionInfo]:
    preset = PRESETS[name]
    preset = preset.model_copy(update={"world": preset.world.model_copy(update={"seconds": 8.0})})
    bench = SimulatedBench(preset, seed, number, resolution=FAST)
    exposed = bench.imaging._exposed

    def without(*arguments: Any) -> Any:
        shapes, tissue = exposed(*arguments)
        return shapes + np.array([0.0, AWAY_M, 0.0]), tissue

    bench.imaging._exposed = without
    view = bench.views[0]
    rows = np.linspace(0, len(bench.frame_s) - 1, FRAMES).astype(int).tolist()
    info = bench.session_info
    own = info.view(view)
    stated = SessionInfo(info.name, info.catheter, {"camera": ViewInfo(own.metres_per_px, own.base_side)})
    return [bench.frame(k, view).image for k in rows], stated


def _features(image: Image, vision: ResolvedVision | None) -> dict[str, float]:
    """Returns the features and the probability of the locator's line; nothing where the locator was not used."""
    if vision is None or vision.locator is None:
        return {}
    line = LocatorDetector(vision).locate(image)
    if line is None:
        return {}
    return {
        "probability": probability(line),
        "by tracer": float(vision.locator.tracer),
        **line_features(line)._asdict(),
    }


def judge(
    frames: list[Image], stated: SessionInfo, *, as_session: bool
) -> tuple[Counter[str], list[dict[str, Any]], Image]:
    """Reads one scene alone and, where wanted, as a session.

    Returns:
        The number of valid lines and of images of each way; the valid lines; a drawing of the first image.
    """
    nothing = SessionInfo(stated.name)
    count: Counter[str] = Counter()
    lines: list[dict[str, Any]] = []
    drawing = None
    tried = [("alone", nothing, frames[:1]), ("alone, stated", stated, frames[:1])]
    tried += [("session", nothing, frames), ("session, stated", stated, frames)] if as_session else []
    for way, info, images in tried:
        detector = ShapeDetector(SessionDetector(VisionSettings(), info, images).vision, info)
        for k, image in enumerate(images):
            shape = detector.detect(image)
            count[f"{way} of"] += 1
            if not shape.found:
                continue
            count[way] += 1
            assert shape.centreline is not None
            ends = shape.centreline.points[[0, -1]].round(1).tolist()
            found = {"name": stated.name, "way": way, "image": k, "ends": ends, "seen": shape.confidence}
            lines.append(found | _features(image, detector.resolved))
            if drawing is None:
                drawing = draw_shape(image, shape, legend=False)
    return count, lines, frames[0] if drawing is None else drawing


def main() -> None:
    """Measures, prints and draws."""
    kinds = [*empty.KINDS, *PRESET_KINDS]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--seed", type=int, default=61_000)
    parser.add_argument("--size", type=int, default=320, help="side of the images of bench.locator.empty, px")
    parser.add_argument("--sessions", type=int, default=2, help="scenes of a kind that are read as sessions too")
    parser.add_argument("--kinds", nargs="+", choices=kinds, default=kinds)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    lines: list[dict[str, Any]] = []
    drawings, titles = [], []
    total: Counter[str] = Counter()
    print("valid of images: " + "; ".join(WAYS))
    for kind in options.kinds:
        count: Counter[str] = Counter()
        for number, (frames, stated) in enumerate(scenes(kind, options.seed, options.size)):
            own, found, drawing = judge(frames, stated, as_session=number < options.sessions)
            count += own
            lines += [{"kind": kind, **each} for each in found]
            drawings.append(drawing)
            titles.append(f"{kind}{'  VALID' if found else ''}")
        print(f"{kind}: " + "; ".join(f"{count[way]} of {count[f'{way} of']}" for way in WAYS), flush=True)
        total += count
        for way in WAYS:
            total[f"{way} kinds"] += count[way] > 0
        if options.out is not None:
            options.out.mkdir(parents=True, exist_ok=True)
            (options.out / "lines.json").write_text(json.dumps(lines, indent=1), encoding="utf-8")
    print("all: " + "; ".join(f"{total[way]} of {total[f'{way} of']}" for way in WAYS))
    print("kinds with a valid line: " + "; ".join(str(total[f"{way} kinds"]) for way in WAYS))
    if options.out is not None:
        sheet = contact_sheet(drawings, SCENES, titles, width=200)
        cv2.imwrite(str(options.out / "kinds.png"), sheet[..., ::-1])


if __name__ == "__main__":
    main()
