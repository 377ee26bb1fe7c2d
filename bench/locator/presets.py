"""Training windows from the renderers of the simulation's presets, with the true catheter."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
import numpy.typing as npt
from bench.locator.curves import POINTS
from bench.locator.photometry import finish, motion_blur
from bench.locator.scene import CATHETER, HIDDEN, OUTSIDE, SEEN, SIDES, Scene
from bench.locator.windows import SIZE, UNKNOWN_KIND

from tipforce.simulation import PRESETS, SampleSet, sample_set

Float = npt.NDArray[np.float64]

SHARES = {
    "varied": 0.55,
    "generalise": 0.17,
    "bench-2021": 0.06,
    "thesis-2021-plain": 0.02,
    "fluoro": 0.1,
    "biplane": 0.1,
}
"""Relative frequency of the sessions of each preset."""
PER_SESSION = 10
"""Number of images of a session."""
WINDOWS_PER_IMAGE = 6
FIRST_SEED = 73_000
"""Seed of the training sessions; reports use seeds below 40_000."""


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """An image of a preset with its truth; ``line`` (POINTS, 2) px, ``state`` (POINTS,), ``mask`` (h, w) bool."""

    image: npt.NDArray[np.uint8]
    line: Float
    state: npt.NDArray[np.uint8]
    mask: npt.NDArray[np.bool_]
    side: int
    diameter_px: float
    xray: bool


@cache
def _set(preset: str, seed: int) -> SampleSet:
    return sample_set(PRESETS[preset], seed=seed, samples=1_000_000, per_session=PER_SESSION, seconds=16.0)


def samples(seed: int, number: int, preset: str) -> Iterator[Sample]:
    """The images of one session of ``preset``."""
    chosen = _set(preset, seed)
    bench = chosen.bench(number)
    info = bench.session_info
    for index in chosen.frames(bench, number).tolist():
        for view in bench.views:
            truth = bench.image_truth(index, view)
            image = bench.frame(index, view).image
            image = np.repeat(image[..., None], 3, axis=2) if image.ndim == 2 else image
            arc = np.linspace(0.0, 1.0, len(truth.centreline_px))
            even = np.linspace(0.0, 1.0, POINTS)
            line = np.column_stack([np.interp(even, arc, truth.centreline_px[:, k]) for k in (0, 1)])
            if not np.isfinite(line).all():
                continue
            h, w = image.shape[:2]
            inside = ((line > -0.5) & (line < (w - 0.5, h - 0.5))).all(axis=1)
            visible = np.interp(even, arc, np.asarray(truth.visible, np.float64)) > 0.5
            state = np.where(inside, np.where(visible, SEEN, HIDDEN), OUTSIDE).astype(np.uint8)
            scale = info.view(view).metres_per_px
            diameter = (info.catheter.diameter_m or 0.0023) / (scale or 2e-4)
            side = SIDES.index(info.view(view).base_side or "left")
            xray = info.view(view).modality == "xray"
            yield Sample(np.ascontiguousarray(image), line, state, np.asarray(truth.mask), side, diameter, xray)


def cut(sample: Sample, rng: np.random.Generator) -> Scene:
    """A window (SIZE, SIZE) of ``sample``: turned, scaled, mirrored, in another light."""
    length = float(np.linalg.norm(np.diff(sample.line, axis=0), axis=1).sum())
    scale = math.exp(rng.uniform(math.log(0.24), math.log(0.72))) * SIZE / length
    turn = 0.5 * math.pi * rng.integers(4) + rng.normal(0.0, 0.12)
    c, s = math.cos(turn), math.sin(turn)
    matrix = scale * np.array([[c, -s], [s, c]]) @ np.diag([1.0, rng.choice([-1.0, 1.0])])
    image, mask = sample.image, sample.mask.astype(np.uint8) * 255
    if scale < 0.6:  # a smaller image first, so that nothing aliases
        image = cv2.GaussianBlur(image, (0, 0), 0.45 / scale)
    middle = np.array([0.5 * (image.shape[1] - 1), 0.5 * (image.shape[0] - 1)])
    corner = np.abs(matrix) @ (middle + 0.5)
    line = (sample.line - middle) @ matrix.T
    low, high = 6.0 - line.min(axis=0), SIZE - 6.0 - line.max(axis=0)
    shift = np.where(low < high, rng.uniform(np.minimum(low, high), np.maximum(low, high)), 0.5 * (low + high))
    if rng.random() < 0.85:  # the window shows as little as possible beyond the image
        first, last = SIZE - corner, corner
        shift = np.clip(shift, np.minimum(first, last), np.maximum(first, last))
    affine = np.column_stack([matrix, shift - matrix @ middle])
    border = tuple(np.median(image.reshape(-1, 3)[::97], axis=0).tolist())
    drawn = cv2.warpAffine(
        image, affine, (SIZE, SIZE), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=border
    )
    seen = cv2.warpAffine(mask, affine, (SIZE, SIZE), flags=cv2.INTER_LINEAR) > 127
    line = line + shift
    inside = ((line > -0.5) & (line < SIZE - 0.5)).all(axis=1)
    values = drawn.astype(np.float32)
    if rng.random() < 0.4:
        values = 255.0 * (values / 255.0) ** np.float32(math.exp(rng.normal(0.0, 0.3)))
    if rng.random() < 0.4:
        values = values * np.exp(rng.normal(0.0, 0.1, 3)).astype(np.float32)
    if rng.random() < 0.15:
        values = motion_blur(values, rng, 5.0)
    lit = finish(values, rng) if rng.random() < 0.7 else np.clip(values, 0.0, 255.0).astype(np.uint8)
    outward = np.array([(-1.0, 0.0), (1.0, 0.0), (0.0, -1.0), (0.0, 1.0)])
    side = int(np.argmax(outward @ (matrix @ outward[sample.side])))
    return Scene(
        lit, line, np.where(inside, sample.state, OUTSIDE).astype(np.uint8),
        np.where(seen, CATHETER, UNKNOWN_KIND).astype(np.uint8), True, (), side, sample.diameter_px * scale,
    )  # fmt: skip
