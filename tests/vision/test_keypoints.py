"""Detection by the trained networks, on a simulated session of another kind than the tracer was made for."""

import functools
from dataclasses import replace

import numpy as np
import pytest

from tipforce.errors import InputError
from tipforce.simulation import PRESETS, SimulatedBench
from tipforce.simulation.world import FAST
from tipforce.types import Catheter, Image, SessionInfo, Status, ViewInfo
from tipforce.vision import ResolvedVision, ShapeDetector, VisionSettings, auto_calibrate, for_session
from tipforce.vision._by_keypoints import find_by_keypoints
from tipforce.vision._session_size import with_view
from tipforce.vision.keypoints import ACROSS, HALF_WIDTH, LENGTH_PX, locate, straightened, upright

SEED, SESSION = 9500, 3
"""Not among the sessions that the networks were trained on, nor those that results are reported on."""
FRAMES = 8
AUTO = VisionSettings(method="auto")


@functools.cache
def session() -> tuple[list[Image], list[np.ndarray], SessionInfo]:
    """Images spread over a session of `varied`, their true centrelines, and its metadata."""
    preset = PRESETS["varied"]
    world = preset.world.model_copy(update={"seconds": 12.0})
    bench = SimulatedBench(preset.model_copy(update={"world": world}), SEED, SESSION, resolution=FAST)
    at = np.linspace(0, len(bench.frame_s) - 1, FRAMES).astype(int).tolist()
    return [bench.frame(k).image for k in at], [bench.image_truth(k).centreline_px for k in at], bench.session_info


@functools.cache
def resolved() -> ResolvedVision:
    images, _, info = session()
    return auto_calibrate(AUTO, images, info)


@pytest.mark.parametrize("side", ["left", "right", "top", "bottom"])
def test_an_upright_image_maps_points_there_and_back(side):
    image = np.zeros((90, 160), np.uint8)
    image[20:23, 100:103] = 255
    turned = upright(image, side, 42.0)
    assert turned.image.shape == ((180, 320, 3) if side in ("left", "right") else (320, 180, 3))
    place = turned.from_original(np.array([[101.0, 21.0]]))
    v, u = np.unravel_index(turned.image[..., 0].argmax(), turned.image.shape[:2])
    assert np.linalg.norm(place[0] - (u, v)) < 3.0
    assert turned.to_original(place) == pytest.approx(np.array([[101.0, 21.0]]))
    ends = turned.from_original(np.array([[10.0, 10.0], [52.0, 10.0]]))
    assert np.linalg.norm(ends[1] - ends[0]) == pytest.approx(LENGTH_PX)


def test_a_strip_shows_the_shaft_beside_the_line_where_it_lies():
    image = np.zeros((60, 200), np.uint8)
    image[34:37] = 200  # the axis 5 px below the line
    strip = straightened(image, np.column_stack([np.linspace(10.0, 190.0, 50), np.full(50, 30.0)]), 10.0)
    across = np.linspace(-HALF_WIDTH, HALF_WIDTH, ACROSS) * 10.0
    found = strip.points + across[strip.values[..., 0].argmax(axis=0), None] * strip.normals
    assert found[strip.seen, 1] == pytest.approx(35.0, abs=1.5)
    assert not strip.seen[0]
    assert strip.seen[len(strip.seen) // 2]


def test_the_networks_find_what_the_tracer_does_not():
    images, curves, info = session()
    with pytest.raises(InputError):
        auto_calibrate(VisionSettings(method="tracer"), images, info)
    detector = ShapeDetector(resolved())
    right = 0
    for image, curve in zip(images, curves, strict=True):
        shape = detector.detect(image)
        if shape.centreline is None:
            continue
        points = shape.centreline.points
        beside = np.linalg.norm(points[:, None] - curve[None], axis=-1).min(axis=1)
        assert beside.max() < 3.0
        assert np.linalg.norm(points[-1] - curve[-1]) < 6.0
        assert shape.probability_right >= AUTO.least_probability
        right += 1
    assert right >= FRAMES // 2


def test_they_refuse_an_image_without_the_catheter_and_say_why():
    images, _, _ = session()
    noise = np.random.default_rng(0).integers(0, 255, images[0].shape, dtype=np.uint8)
    for other in (noise, np.ascontiguousarray(images[0][::-1, ::-1])):
        shape = ShapeDetector(resolved()).detect(other)
        assert shape.status in (Status.NO_CATHETER, Status.CUT_OFF)
        assert shape.detail


def test_they_are_not_asked_without_the_catheters_size():
    images, _, info = session()
    unknown = SessionInfo(info.name, Catheter(), info.views)
    assert find_by_keypoints(AUTO, with_view(AUTO, unknown), images, unknown, None, whole=True) is None
    assert find_by_keypoints(AUTO, with_view(AUTO, info), images, info, None, whole=True) is not None


def test_a_catheter_of_a_few_px_is_not_looked_for():
    assert locate(np.zeros((480, 640), np.uint8), "left", 2.0, 1.0, 64) is None
    assert locate(np.zeros((480, 640), np.uint8), "left", 50.0, 4.0, 64) is None


def test_a_stated_length_does_not_keep_them_from_answering():
    images, _, info = session()
    found = resolved()
    tracer = ResolvedVision.stated(AUTO.model_copy(update={"polarity": found.polarity, "base_side": found.base_side}))
    joined = find_by_keypoints(AUTO, with_view(AUTO, info), images, info, tracer, whole=True)
    assert joined is not None
    assert joined.nominal_px == found.nominal_px
    assert sum(ShapeDetector(joined).detect(image).found for image in images) >= FRAMES // 2


def test_what_they_found_is_saved_but_not_for_another_session():
    found = resolved()
    assert ResolvedVision.model_validate_json(found.model_dump_json()) == found
    _, _, info = session()
    nearer = SessionInfo("next", info.catheter, {"camera": ViewInfo(0.9 * (info.view("camera").metres_per_px or 0.0))})
    assert for_session(found, nearer).keypoints is None
    assert for_session(found, info).keypoints == found.keypoints
    assert for_session(found, replace(info, name="next")).keypoints is None
