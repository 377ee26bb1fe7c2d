"""Labelled images from the renderers of the simulation's presets, on which the locator is trained."""

import math
from collections.abc import Iterator
from functools import cache

import numpy as np

from tipforce.simulation import PRESETS, SampleSet, sample_set
from tipforce.training.locator import HIDDEN, LABEL_POINTS, OUTSIDE, SEEN, SIDES, LabelledImage

PRESET_IMAGE_SHARES = {
    "varied": 0.47,
    "generalise": 0.15,
    "bench-2021": 0.06,
    "thesis-2021-plain": 0.02,
    "fluoro": 0.04,
    "biplane": 0.04,
    "fluoro-varied": 0.12,
    "biplane-varied": 0.1,
}
"""Relative frequency of the sessions of each preset."""
PRESETS_WITH_OTHER_INSTRUMENTS = ("fluoro-varied", "biplane-varied")
IMAGES_PER_SESSION = 4
PRESET_IMAGES_SEED = 73_000
"""First seed of the training sessions; reports use seeds below 40,000."""


@cache
def _sample_set(preset: str, seed: int) -> SampleSet:
    return sample_set(PRESETS[preset], seed=seed, samples=1_000_000, per_session=IMAGES_PER_SESSION, seconds=16.0)


def preset_images(seed: int, number: int, preset: str) -> Iterator[LabelledImage]:
    """Yields the images of one session of a preset, from all of its views.

    Args:
        seed: seed of the set of sessions.
        number: number of the session in this set.
        preset: name of the preset.
    """
    chosen = _sample_set(preset, seed)
    bench = chosen.bench(number)
    info = bench.session_info
    for index in chosen.frames(bench, number).tolist():
        for view in bench.views:
            truth = bench.image_truth(index, view)
            image = bench.frame(index, view).image
            image = np.repeat(image[..., None], 3, axis=2) if image.ndim == 2 else image
            arc = np.linspace(0.0, 1.0, len(truth.centreline_px))
            even = np.linspace(0.0, 1.0, LABEL_POINTS)
            line = np.column_stack([np.interp(even, arc, truth.centreline_px[:, k]) for k in (0, 1)])
            if not np.isfinite(line).all():
                continue
            h, w = image.shape[:2]
            inside = ((line > -0.5) & (line < (w - 0.5, h - 0.5))).all(axis=1)
            visible = np.interp(even, arc, np.asarray(truth.visible, np.float64)) > 0.5
            state = np.where(inside, np.where(visible, SEEN, HIDDEN), OUTSIDE).astype(np.uint8)
            scale = info.view(view).metres_per_px
            diameter = (info.catheter.diameter_m or math.nan) / (scale or math.nan)
            side = SIDES.index(info.view(view).base_side or "left")
            xray = info.view(view).modality == "xray"
            pixels, mask = np.ascontiguousarray(image), np.asarray(truth.mask)
            yield LabelledImage(
                pixels, line, state, mask, side, diameter, xray, ambiguous=preset in PRESETS_WITH_OTHER_INSTRUMENTS
            )
