"""Judges detection on real X-ray backgrounds: simulated catheters, multiplied into images of a phantom by attenuation.

    python -m bench.studies.xray_backgrounds FOLDER [--seed 81000] [--backgrounds 30] [--frames 6] [--sheet FILE.png]

FOLDER holds the images `N_A.png` and `N_B.png` of github.com/tudorjnu/guide3d (figs/raw/epilines). The lines and dots
that are drawn into them are filled from above and below. Each background is one session of a catheter of
``fluoro-varied`` (1,024 px, no collimator, table at rest); it is resolved on 16 images. The photons that the catheter
takes away also make the image noisier there, as the noise of the background says. Measures: see `locator_accuracy`.
"""

import argparse
import json
import math
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from bench.studies.locator_accuracy import ANY_STD_PX, RESOLVED_ON, Tally, judge

from tipforce.errors import InputError
from tipforce.simulation import PRESETS, FluoroSettings, SimulatedBench
from tipforce.simulation.world import FAST
from tipforce.types import DetectedShape, FloatArray, Status
from tipforce.vision import ShapeDetector, VisionSettings, auto_calibrate

SIDE_PX = 1024
COLOURED = 14
"""Difference of the channels, in grey levels, from which a pixel is part of a drawn line; the images are grey."""
BRIGHT_LINE, FAINT_LINE = 45, 9
"""A pixel that differs from the median of its surroundings by these grey levels is part of a white or black line, or of
a line of any grey if it is on a straight one of 400 px."""
FIELD_LEVEL = 12
"""Pixels darker than this after smoothing are outside of the round field."""
BLUR_PX = 1.2
SIDES = ("left", "right", "top", "bottom")


def background(path: Path) -> tuple[FloatArray, np.ndarray]:
    """Reads an image and removes the lines that are drawn into it.

    Args:
        path: the image.

    Returns:
        (h, w) grey levels, and (h, w) whether a pixel is within the round field.
    """
    pixels = cv2.imread(str(path))
    if pixels is None or pixels.shape[:2] != (SIDE_PX, SIDE_PX):
        raise SystemExit(f"{path}: expected an image of {SIDE_PX} x {SIDE_PX} pixels")
    grey = np.median(pixels, axis=2).astype(np.uint8)
    coloured = np.ptp(pixels.astype(int), axis=2) > COLOURED
    off = np.abs(grey.astype(int) - cv2.medianBlur(grey, 21))
    drawn = (coloured | (off > BRIGHT_LINE)).astype(np.uint8)
    faint = cv2.HoughLinesP(
        (off > FAINT_LINE).astype(np.uint8), 1.0, np.pi / 720, 250, minLineLength=400, maxLineGap=60
    )
    for u1, v1, u2, v2 in [] if faint is None else faint.reshape(-1, 4).tolist():
        cv2.line(drawn, (u1, v1), (u2, v2), 1, 5)
    # the gaps between lines are filled, too: dots and the guidewire go along them
    drawn = cv2.dilate(cv2.morphologyEx(drawn, cv2.MORPH_CLOSE, np.ones((15, 3), np.uint8)), np.ones((7, 5), np.uint8))
    clean = filled(grey, drawn > 0)
    rng = np.random.default_rng(0)
    clean += (drawn > 0) * rng.normal(size=grey.shape) * math.sqrt(noise_per_level(clean)) * np.sqrt(clean)
    field = cv2.GaussianBlur(clean, (0, 0), 4.0) > FIELD_LEVEL
    return np.maximum(clean, 0.0), cv2.erode(field.astype(np.uint8), np.ones((9, 9), np.uint8)) > 0


def filled(grey: FloatArray, holes: np.ndarray) -> FloatArray:
    """Returns the image (h, w) whose ``holes`` (h, w) are interpolated along the columns: lines are nearly level."""
    smooth, rows = cv2.blur(grey, (1, 3)).astype(np.float32), np.arange(len(grey))
    clean = grey.astype(np.float32)
    for column, hole in enumerate(holes.T):
        if hole.any() and not hole.all():
            clean[hole, column] = np.interp(rows[hole], rows[~hole], smooth[~hole, column])
    soft = cv2.blur(clean, (7, 1))
    return np.where(holes, soft, clean)


def noise_per_level(grey: FloatArray) -> float:
    """Returns the variance of the noise divided by the grey level, from second differences along the rows."""
    second = grey[:, 2:] - 2.0 * grey[:, 1:-1] + grey[:, :-2]
    spread = 1.4826 * float(np.median(np.abs(second))) / math.sqrt(6.0)
    return spread**2 / max(float(np.median(grey)), 1.0)


def catheter_bench(seed: int, number: int) -> SimulatedBench:
    """Returns the bench whose catheter goes into background ``number``."""
    preset = PRESETS["fluoro-varied"]
    assert isinstance(preset, FluoroSettings)
    assert preset.scene.variety is not None
    variety = preset.scene.variety.model_copy(
        update={"round_field": 0.0, "blades": 0.0, "wedge": 0.0, "panned": 0.0, "injection": 0.0}
    )
    scene = preset.scene.model_copy(
        update={"variety": variety, "base_side": SIDES[number % 4], "base_inset_m": (-1.6e-3, -1.6e-3)}
    )
    changes: dict[str, Any] = {"world": preset.world.model_copy(update={"seconds": 20.0}), "scene": scene}
    changes |= {"detectors": None, "width": SIDE_PX, "height": SIDE_PX, "preset": "fluoro-varied on a phantom"}
    return SimulatedBench(preset.model_copy(update=changes), seed, number, resolution=FAST)


class Composed:
    """Images of one session: its catheter in front of a real background.

    Args:
        bench: the session.
        path: image of the background.
        seed: seed of the noise.
    """

    def __init__(self, bench: SimulatedBench, path: Path, seed: int) -> None:
        self._bench, self._seed = bench, seed
        self._grey, self.field = background(path)
        self._per_level = noise_per_level(self._grey)
        self._renderer = bench.imaging._renderers["camera"]

    def image(self, index: int) -> np.ndarray:
        """Returns the image (h, w) of frame ``index``, 8 bits."""
        time_s = float(self._bench.frame_s[index])
        shapes, tissue = self._bench.interpolator.exposure(time_s, self._bench.imaging.exposure_s, 5)
        away = shapes + np.array([0.0, 0.0, 10.0])  # behind the focal spot
        lit = self._renderer.light(shapes, tissue, time_s=time_s)
        passed = lit / self._renderer.light(away, tissue, time_s=time_s)
        passed = np.clip(cv2.GaussianBlur(passed, (0, 0), BLUR_PX), 0.0, 1.0)
        rng = np.random.default_rng([self._seed, index])
        missing = np.sqrt(self._per_level * self._grey * np.maximum(passed - passed**2, 0.0))
        image = self._grey * passed + missing * rng.standard_normal(passed.shape, np.float32)
        return np.clip(image + 0.5, 0, 255).astype(np.uint8)

    def truth(self, index: int) -> tuple[FloatArray, np.ndarray]:
        """Returns the centreline (n, 2) in frame ``index``, and whether each point is within the round field."""
        truth = self._bench.image_truth(index)
        line = np.asarray(truth.centreline_px)
        u, v = np.clip(np.rint(line), 0, SIDE_PX - 1).astype(int).T
        return line, np.asarray(truth.visible, bool) & self.field[v, u]


def main() -> None:
    """Measures and prints."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=81_000)
    parser.add_argument("--backgrounds", type=int, default=30)
    parser.add_argument("--frames", type=int, default=6)
    parser.add_argument("--sheet", type=Path, help="writes one image of each session, side by side")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    paths = sorted(options.folder.glob("*_[AB].png"))[: options.backgrounds]
    if not paths:
        raise SystemExit(f"{options.folder}: there is no image N_A.png or N_B.png")
    usual, every = Tally("as it comes", hidden_tips=False), Tally("with hidden tips", hidden_tips=True)
    tips, tiles = 0, []
    for number, path in enumerate(paths):
        bench = catheter_bench(options.seed, number)
        composed, last = Composed(bench, path, options.seed + number), len(bench.frame_s) - 1
        if options.sheet:
            tiles.append(cv2.resize(composed.image(last - 1), (384, 384), interpolation=cv2.INTER_AREA))
            columns = [
                tiles[k : k + 6] + [np.zeros_like(tiles[0])] * (6 - len(tiles[k : k + 6]))
                for k in range(0, len(tiles), 6)
            ]
            cv2.imwrite(str(options.sheet), np.vstack([np.hstack(row) for row in columns]))
        if not options.frames:
            continue
        settings = VisionSettings(view="camera", max_tip_std_px=ANY_STD_PX)
        images = [composed.image(int(k)) for k in np.linspace(0, last, RESOLVED_ON)]
        detector, reason = None, ""
        try:
            detector = ShapeDetector(auto_calibrate(settings, images, bench.session_info))
        except InputError as error:
            reason = str(error)
        before = usual.count.copy()
        for k in np.linspace(0.1 * last, last - 1, options.frames).astype(int).tolist():
            image, (line, visible) = composed.image(k), composed.truth(k)
            tips += judge(line, np.ones(len(line), bool), line, visible, image.shape[:2])["tip_shown"]
            shape = detector.detect(image) if detector else DetectedShape(Status.NO_CATHETER, reason)
            for tally in (usual, every):
                tally.add(shape, line, visible, image.shape[:2])
        print(json.dumps({"background": path.name, **(usual.count - before), "reason": reason}), flush=True)
    if options.frames:
        for tally in (usual, every):
            print(f"real backgrounds, {tally.text(tips)}")


if __name__ == "__main__":
    main()
