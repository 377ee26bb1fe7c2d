"""Detection on images of every size, with extreme settings: an answer or a reason, and no index out of bounds.

`make prove` runs these with NUMBA_BOUNDSCHECK=1, where an index out of bounds raises IndexError.
"""

import itertools
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from tipforce.errors import InputError
from tipforce.vision import (
    ResolvedVision,
    ShapeDetector,
    ShapeFeatureSettings,
    Tally,
    VisionSettings,
    auto_calibrate,
    inspect_image,
    shape_features,
)

SIZES = [(1, 1), (2, 2), (3, 3), (4, 4), (7, 7), (640, 1), (1, 480), (2, 300), (300, 3), (5, 200), (61, 97), (120, 161)]
"""(h, w)."""
EXTREMES = [
    {},
    {"base_side": "right", "roi": (10**9, 0, 2 * 10**9, 1)},
    {"base_side": "top", "base_region": (0, 10**6, 10, 2 * 10**6)},
    {"base_side": "bottom", "base_region": (-(2**62), -5, 2**62, 2**62)},
    {"roi": (-5, -5, 3, 3)},
    {"roi": (50, 50, 40, 40), "base_region": (0, 0, 20, 20)},
    {"base_side": "right", "base_region": (3, 0, 4, 10**9)},
    {"diameter_px": 1.0001, "max_gap_px": 0.0, "points": 8},
    {"diameter_px": 10_000.0, "length_px": 100_000.0, "max_gap_px": 10_000.0, "points": 4096},
    {"diameter_px": 6.0, "length_px": 1.0001, "length_tolerance": 1e-12},
    {"diameter_px": 6.0, "length_px": 100_000.0, "length_tolerance": 0.4999},
    {"diameter_px": 6.0, "length_px": 60.0, "length_tolerance": 0.4999, "max_gap_px": 10_000.0},
    {"threshold": 0, "base_columns": 2},
    {"threshold": 255, "base_columns": 10_000},
]

KNOWN = VisionSettings(polarity="dark", base_side="left", diameter_px=5.0, threshold=128)


def _tube(size: tuple[int, int], seed: int) -> np.ndarray:
    """A dark shaft from the left with a paler end, on noisy ground, as far as there is room."""
    (h, w), rng = size, np.random.default_rng(seed)
    image = np.full(size, 200, np.uint8)
    t = np.linspace(0.0, rng.uniform(0.5, 1.2), 80)
    line = np.column_stack([t * w, 0.6 * h - rng.uniform(-0.5, 0.5) * h * t**2])
    thick = max(1, min(h, w) // int(rng.integers(8, 24)))
    for part, grey in ((line, 40), (line[60:], 90)):
        cv2.polylines(image, [np.rint(16 * part).astype(np.int32)], False, grey, thick, cv2.LINE_AA, 4)
    return np.clip(image + rng.normal(0, 3, size), 0, 255).astype(np.uint8)


def _images(size: tuple[int, int]) -> list[np.ndarray]:
    stripes = np.tile(np.arange(size[0], dtype=np.uint8)[:, None] // 3 % 2 * 200, (1, size[1]))
    return [_tube(size, 0), cv2.cvtColor(_tube(size, 1), cv2.COLOR_GRAY2RGB), stripes, 255 - _tube(size, 2)]


def test_a_series_that_needs_more_points_says_how_many(tube: Callable[..., np.ndarray]) -> None:
    shape = ShapeDetector(KNOWN.model_copy(update={"diameter_px": 12.0, "points": 8})).detect(tube("bent"))
    assert shape.found
    with pytest.raises(InputError, match=r"at least 10 points of the centreline, got 8: set vision.points=10"):
        shape_features(shape, ShapeFeatureSettings(kind="legendre", degree=8))


def test_a_drawing_of_a_narrow_image_stays_small() -> None:
    seen = inspect_image(np.zeros((640, 1), np.uint8), ShapeDetector(KNOWN).detect, KNOWN)
    assert seen.drawing.size < 10_000_000
    tally = Tally()
    tally.add("narrow", seen)
    assert tally.contact_sheet().size < 10_000_000


@pytest.mark.parametrize("method", ["tracer", "classic"])
@pytest.mark.parametrize("extreme", range(len(EXTREMES)))
def test_images_of_any_size_are_answered(method: str, extreme: int) -> None:
    stated = {"polarity": "dark", "base_side": "left", **EXTREMES[extreme]}
    settings = VisionSettings.model_validate({**stated, "method": method})
    detector = ShapeDetector(ResolvedVision.stated(settings))  # one for all sizes: a folder may mix them
    for size in SIZES:
        for image in _images(size):
            shape = detector.detect(image)
            if shape.centreline is None:
                assert shape.detail
                continue
            assert np.isfinite(shape.centreline.points).all()
            shape_features(shape, ShapeFeatureSettings(kind="legendre", degree=6))


@pytest.mark.parametrize("every", [4, pytest.param(1, marks=pytest.mark.slow)])
@pytest.mark.parametrize("method", ["tracer", "classic"])
def test_images_of_two_sizes_calibrate_together(method: str, every: int) -> None:
    for first, second in list(itertools.pairwise([*SIZES, SIZES[0]]))[::-every]:
        images = [_tube(first, 0), _tube(second, 1), _tube(second, 2)]
        for settings in (VisionSettings(method=method), VisionSettings(method=method, polarity="dark", length_px=60.0)):
            try:
                found = auto_calibrate(settings, images)
            except InputError:
                continue
            for image in images:
                ShapeDetector(found).detect(image)


@pytest.mark.parametrize("seed", range(8))
def test_shafts_that_are_traced_stay_within_bounds(seed: int) -> None:
    """The parts behind the first trace, too: what goes on beyond its end, a known length, a template of the tip."""
    rng = np.random.default_rng(seed)
    size = (int(rng.integers(60, 140)), int(rng.integers(60, 180)))
    images = [_tube(size, 100 * seed + k) for k in range(6)]
    known = [{"length_px": length, "length_tolerance": 0.3} for length in (15.0, 0.5 * size[1], 1.5 * size[1], 400.0)]
    for more in ({}, {"max_gap_px": 60.0}, *known):
        settings = VisionSettings.model_validate({"polarity": "dark", "base_side": "left", "diameter_px": 5.0, **more})
        template = tuple(rng.integers(0, 256, 13 * 7).tolist())
        plain = ResolvedVision.stated(settings)
        for vision in (plain, plain.model_copy(update={"tip_template": template})):
            detector = ShapeDetector(vision)
            for image in images:
                detector.detect(image)
                detector.detect(image[:, : size[1] // 2])  # not contiguous, and another size


_BAD = """
import sys
sys.path.insert(0, {folder!r})
import numpy as np
from bad_kernel import read, read_together
for kernel in (read, read_together):
    try:
        kernel(np.zeros(4), 4)
    except IndexError:
        print("caught")
"""
_KERNELS = """
from numba import njit
from tipforce._system.compilation import STEADY, compiled_together

@njit(cache=True, nogil=True, error_model="numpy", fastmath=STEADY)
def read(values, i):
    return values[i]

@compiled_together(__file__, "bad_kernel.py", STEADY)
def read_together(values, i):
    return read(values, i)
"""


@pytest.mark.slow
def test_the_check_of_bounds_holds_in_cached_kernels_too(tmp_path: Path) -> None:
    (tmp_path / "bad_kernel.py").write_text(_KERNELS)
    environment = {**os.environ, "NUMBA_BOUNDSCHECK": "1", "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    for _ in range(2):  # compiled, then from the cache
        command = [sys.executable, "-c", _BAD.format(folder=str(tmp_path))]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        assert done.stdout.split() == ["caught", "caught"]
    assert list((tmp_path / "cache").rglob("*.nbc"))
