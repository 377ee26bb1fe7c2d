"""Detection by the locator, on a simulated session of another kind than the tracer was made for."""

import functools
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from tipforce.errors import FileFormatError, InputError
from tipforce.geometry import resampled, tangents_and_normals
from tipforce.simulation import PRESETS, SimulatedBench
from tipforce.simulation.world import FAST
from tipforce.types import Catheter, CentrelinePx, DetectedShape, Image, SessionInfo, Status, ViewInfo
from tipforce.vision import (
    ResolvedVision,
    SessionDetector,
    ShapeDetector,
    VisionSettings,
    _auto_calibrate,
    _detector,
    auto_calibrate,
    fitted_log_odds,
    for_session,
    line_log_odds,
)
from tipforce.vision import (
    locator as locator_package,
)
from tipforce.vision._auto_calibrate import _compared
from tipforce.vision._by_locator import LocatorDetector
from tipforce.vision.locator import (
    ACROSS,
    ALONG,
    CAMERA_GRAPHS,
    HALF_WIDTH,
    XRAY_DETECTOR,
    Located,
    Prompts,
    SessionConstants,
    _networks,
    as_colour,
    locate,
    session_constants,
    straightened,
)
from tipforce.vision.locator._networks import refine, rough_points
from tipforce.vision.locator._prompts import channels
from tipforce.vision.locator._reading import offset_std
from tipforce.vision.locator._session import _length
from tipforce.vision.tracer import Tracer

SEED, SESSION = 9500, 3
"""Not among the sessions that the networks were trained on, nor those that results are reported on."""
FRAMES = 6
AUTO = VisionSettings(method="auto")
HIDDEN_TIPS = VisionSettings(method="auto", max_tip_std_px=1e5)


@functools.cache
def session(name: str = "varied") -> tuple[list[Image], list[np.ndarray], SessionInfo]:
    """Images spread over a session of a preset, their true centrelines, and its metadata."""
    preset = PRESETS[name]
    world = preset.world.model_copy(update={"seconds": 12.0})
    bench = SimulatedBench(preset.model_copy(update={"world": world}), SEED, SESSION, resolution=FAST)
    at = np.linspace(0, len(bench.frame_s) - 1, FRAMES).astype(int).tolist()
    return [bench.frame(k).image for k in at], [bench.image_truth(k).centreline_px for k in at], bench.session_info


@functools.cache
def resolved() -> ResolvedVision:
    images, _, info = session()
    return auto_calibrate(AUTO, images, info)


@functools.cache
def constants() -> SessionConstants:
    images, _, info = session()
    scale = info.view("camera").metres_per_px
    assert scale is not None
    assert info.catheter.flexible_length_m is not None
    length_px = (info.catheter.flexible_length_m + (info.catheter.rigid_length_m or 0.0)) / scale
    assert info.catheter.diameter_m is not None
    prompts = Prompts(length_px=length_px, diameter_px=info.catheter.diameter_m / scale)
    return session_constants(images, prompts, moves=True)


def beside_px(points: np.ndarray, curve: np.ndarray) -> np.ndarray:
    """Distance of each of ``points`` (n, 2) from the nearest point of ``curve`` (k, 2), px."""
    return np.linalg.norm(points[:, None] - curve[None], axis=-1).min(axis=1)


def test_a_strip_shows_the_shaft_beside_the_line_where_it_lies():
    image = np.zeros((60, 200), np.uint8)
    image[34:37] = 200  # the axis 5 px below the line
    strip = straightened(image, np.column_stack([np.linspace(10.0, 190.0, 50), np.full(50, 30.0)]), 10.0)
    across = np.linspace(-HALF_WIDTH, HALF_WIDTH, ACROSS) * 10.0
    found = strip.points + across[strip.values[..., 0].argmax(axis=0), None] * strip.normals
    assert found[strip.inside_view, 1] == pytest.approx(35.0, abs=1.5)
    assert not strip.inside_view[0]
    assert strip.inside_view[len(strip.inside_view) // 2]


def test_the_catheter_is_found_on_a_bench_of_another_kind():
    images, curves, info = session()
    detector = ShapeDetector(auto_calibrate(HIDDEN_TIPS, images, info))
    for image, curve in zip(images, curves, strict=True):
        shape = detector.detect(image)
        assert shape.centreline is not None
        assert beside_px(shape.centreline.points[4:], curve).max() < 4.0
        assert np.linalg.norm(shape.centreline.points[0] - curve[0]) < 8.0
        assert np.linalg.norm(shape.centreline.points[-1] - curve[-1]) < 6.0
        assert shape.probability_right >= AUTO.least_probability


def test_an_image_without_the_catheter_is_refused_with_the_reason():
    images, _, _ = session()
    noise = np.random.default_rng(0).integers(0, 255, images[0].shape, dtype=np.uint8)
    for other in (noise, np.ascontiguousarray(images[0][::-1, ::-1])):
        shape = ShapeDetector(resolved()).detect(other)
        assert shape.status in (Status.NO_CATHETER, Status.CUT_OFF)
        assert shape.detail


def test_the_size_is_measured_where_it_is_not_stated():
    images, curves, info = session()
    unknown = SessionInfo(info.name, Catheter(), {"camera": ViewInfo(base_side=info.view("camera").base_side)})
    found = auto_calibrate(HIDDEN_TIPS, images, unknown).locator
    assert found is not None
    true_px = float(np.linalg.norm(np.diff(curves[0], axis=0), axis=1).sum())
    assert found.length_px == pytest.approx(true_px, rel=0.15)


def test_a_click_on_the_base_is_obeyed():
    images, _, _ = session()
    base = constants().base_px
    line = locate(images[0], Prompts(base_px=base), 64)
    assert line is not None
    assert np.linalg.norm(line.points[0] - base) < 6.0


def test_the_catheter_begins_at_the_base_in_the_stated_box_and_not_at_the_edge_of_the_box():
    images, curves, info = session()
    u, v = np.rint(curves[0][0]).astype(int).tolist()
    camera = info.view("camera")
    box = u - 25, v - 25, u + 25, v + 25
    stated = SessionInfo(info.name, info.catheter, {"camera": replace(camera, base_region=box)})
    vision = auto_calibrate(AUTO, images, stated)
    assert vision.base_region is not None
    low_u, low_v, high_u, high_v = vision.base_region
    base_line = {"left": (low_u, u), "right": (high_u, u), "top": (low_v, v), "bottom": (high_v, v)}
    at, true = base_line[vision.base_side]
    assert at == pytest.approx(true, abs=8.0)


def test_the_base_is_in_the_stated_box():
    images, _, _ = session()
    found = rough_points(np.ascontiguousarray(as_colour(images[0])[::3, ::3]), Prompts(region=(90, 60, 100, 70)))
    assert 80.0 < found.points[0, 0] < 110.0
    assert 50.0 < found.points[0, 1] < 80.0


def test_two_lengths_that_contradict_each_other_leave_the_length_unsure():
    lines = [
        cast(Located, SimpleNamespace(tip_seen=1.0, tip_peak=1.0, points=np.array([[0.0, 0.0], [length, 0.0]])))
        for length in (100.0, 200.0)
    ]
    length, error = _length(lines, np.zeros(2), None)
    assert length == 150.0
    assert error >= 50.0


def test_the_detected_diameter_is_that_of_the_image_and_not_the_stated_one():
    images, _, info = session()
    scale = info.view("camera").metres_per_px
    assert info.catheter.diameter_m is not None
    assert scale is not None
    true_px = info.catheter.diameter_m / scale
    stated = replace(info, catheter=replace(info.catheter, diameter_m=1.25 * info.catheter.diameter_m))
    detector = SessionDetector(HIDDEN_TIPS.model_copy(update={"least_probability": 0.0}), stated, images)
    diameters = [shape.diameter_px for image in images if (shape := detector.detect(image)).found]
    assert float(np.median(diameters)) == pytest.approx(true_px, rel=0.15)


def test_the_diameter_is_found_where_it_is_not_stated():
    images, _, info = session()
    scale = info.view("camera").metres_per_px
    assert info.catheter.diameter_m is not None
    assert scale is not None
    true_px = info.catheter.diameter_m / scale
    found = [locate(image, Prompts(length_px=constants().length_px), 64) for image in images]
    diameters = [line.diameter_px for line in found if line is not None]
    assert float(np.median(diameters)) == pytest.approx(true_px, rel=0.2)


def _covered(image: Image, tip: np.ndarray, radius_px: int) -> Image:
    """Returns ``image`` with a square of one colour over the tip."""
    u, v = np.rint(tip).astype(int).tolist()
    hidden = image.copy()
    hidden[max(v - radius_px, 0) : v + radius_px, max(u - radius_px, 0) : u + radius_px] = np.median(image, axis=(0, 1))
    return hidden


def _hidden_tip(settings: VisionSettings) -> tuple[DetectedShape, np.ndarray]:
    images, curves, info = session()
    vision = auto_calibrate(settings, images, info)
    image = _covered(images[0], curves[0][-1], 22)
    return ShapeDetector(vision.model_copy(update={"least_probability": 0.0})).detect(image), curves[0]


def test_a_hidden_tip_is_stated_as_hidden_and_is_at_the_sessions_length():
    shape, curve = _hidden_tip(HIDDEN_TIPS)
    assert shape.centreline is not None
    assert shape.seen is not None
    assert not shape.tip_seen
    assert shape.seen[1 : len(shape.seen) // 2].mean() > 0.9
    assert "hidden" in shape.detail
    off = float(np.linalg.norm(shape.centreline.points[-1] - curve[-1]))
    assert off < max(4.0 * shape.tip_std_px, 8.0)


def test_a_tip_that_is_known_less_exactly_than_the_limit_is_refused():
    shape, _ = _hidden_tip(VisionSettings(method="auto", max_tip_std_px=0.05))
    assert shape.status is Status.CUT_OFF
    assert "max_tip_std_px" in shape.detail


class _Shifted:
    """Takes the place of the tracer: finds the lines of the locator, moved across by ``px``."""

    def __init__(self, lines: Sequence[Located | None], px: float) -> None:
        self._points, self._px = [line.points for line in lines if line is not None], px

    def detect(self, image: Image) -> DetectedShape:
        del image
        points = self._points.pop(0)
        return DetectedShape(Status.VALID, "", CentrelinePx(points + self._px * tangents_and_normals(points)[1]))


@pytest.mark.parametrize(("share", "expected"), [(0.005, (True, True)), (0.03, (True, False)), (1.0, (False, False))])
def test_the_tracer_is_asked_first_only_where_it_is_as_exact_as_the_locator(
    share: float, expected: tuple[bool, bool]
) -> None:
    images, _, _ = session()
    found = constants()
    tracer = _Shifted(found.lines, share * found.diameter_px)
    assert _compared(cast(Tracer, tracer), images, found) == expected


def test_the_line_errs_by_as_much_as_it_states() -> None:
    _, curves, _ = session()
    errors = []
    for line, curve in zip(constants().lines, curves, strict=True):
        if line is None:
            continue
        seen = line.seen & (np.arange(len(line.points)) % 4 == 2)
        fine = resampled(curve, 4000)
        errors.append(beside_px(line.points[seen], fine) / line.std_px[seen])
    typical = np.median(np.concatenate(errors)) / 0.674
    assert 0.15 < typical < 1.6


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("along", "across"), [(0.0, 0.1), (3.0, 0.0), (2.0, 0.4)])
def test_the_errors_along_and_across_the_line_are_those_of_its_covariance(along: float, across: float) -> None:
    points = np.column_stack([np.linspace(0.0, 90.0, 40), 20.0 * np.sin(np.linspace(0.0, 2.0, 40))])
    tangents, normals = tangents_and_normals(points)
    covariance = sum(std**2 * way[:, :, None] * way[:, None] for std, way in ((along, tangents), (across, normals)))
    stated = DetectedShape(Status.VALID, "", CentrelinePx(points), covariance_px2=covariance).std_along_and_across_px
    assert stated is not None
    np.testing.assert_allclose(stated[0], along, atol=1e-6)
    np.testing.assert_allclose(stated[1], across, atol=1e-6)
    assert DetectedShape(Status.VALID, "", CentrelinePx(points)).std_along_and_across_px is None


def test_larger_spreads_of_the_network_state_more_than_their_share() -> None:
    exact, usual, wide = offset_std(np.array([0.005, 0.01, 0.02]))
    assert exact == pytest.approx(0.0054, rel=0.02)
    assert usual / exact > 2.0
    assert wide / usual > 2.0


def test_a_bar_from_border_to_border_is_not_the_catheter():
    image = np.full((240, 320), 200, np.uint8)
    image[100:140, :] = 60  # a bar from border to border
    noise = np.random.default_rng(0).normal(0.0, 3.0, (4, *image.shape))
    images = list(np.clip(image + noise, 0, 255).astype(np.uint8))
    with pytest.raises(InputError, match="base_region"):
        auto_calibrate(AUTO, images, SessionInfo("bar"))


def test_a_long_list_of_images_is_thinned_over_all_of_the_session(monkeypatch: pytest.MonkeyPatch):
    chosen: list[int] = []

    def taken(settings, stated, frames, *more, **options):
        chosen.extend(int(frame[0, 0]) for frame in frames)
        return ResolvedVision.stated(VisionSettings(polarity="dark", base_side="left"))

    monkeypatch.setattr(_auto_calibrate, "_of_session", taken)
    auto_calibrate(AUTO, [np.full((8, 8), value, np.uint8) for value in range(60)], SessionInfo("long"))
    assert len(chosen) == 16
    assert (chosen[0], chosen[-1]) == (0, 59)
    assert max(np.diff(chosen)) <= 4


def test_before_there_are_enough_images_the_first_one_resolves_the_detection(monkeypatch: pytest.MonkeyPatch):
    images, _, info = session()
    calls: list[int] = []

    def counted(*given, **more):
        calls.append(len(given[1]))
        return auto_calibrate(*given, **more)

    monkeypatch.setattr(_detector, "auto_calibrate", counted)
    detector = SessionDetector(HIDDEN_TIPS.model_copy(update={"least_probability": 0.0}), info)
    found = [detector.detect(image).found for image in images]
    assert all(found)
    assert calls == [1]


def test_a_fine_tuned_detector_is_read_from_its_folder(tmp_path: Path):
    images, _, info = session()
    view = replace(info.view("camera"), detector=str(tmp_path))
    named = replace(info, views={"camera": view})
    with pytest.raises(InputError, match=r"detector\.onnx: does not exist"):
        auto_calibrate(AUTO, images, named)
    shipped = Path(locator_package.__file__).with_name("locator.onnx")
    (tmp_path / "detector.onnx").write_bytes(shipped.read_bytes())
    with pytest.raises(InputError, match=r"line\.onnx: does not exist"):
        auto_calibrate(AUTO, images, named)
    (tmp_path / "line.onnx").write_bytes(shipped.with_name("refine.onnx").read_bytes())
    (tmp_path / "detector.json").write_text("{}", encoding="utf-8")
    with pytest.raises(FileFormatError, match="has no number log_odds"):
        auto_calibrate(AUTO, images, named)
    (tmp_path / "detector.json").write_text('{"log_odds": 0.5}', encoding="utf-8")
    found = auto_calibrate(AUTO, images, named)
    assert found.detector == str(tmp_path)
    assert found.locator is not None
    assert np.linalg.norm(np.array(found.locator.base_px) - constants().base_px) < 4.0


def test_xray_images_are_read_by_the_network_for_xray_as_the_saved_settings_say(monkeypatch: pytest.MonkeyPatch):
    images, _, info = session("fluoro")
    read: list[Path] = []
    graph_at = _networks._session
    monkeypatch.setattr(_networks, "_session", lambda path, *given: read.append(path) or graph_at(path, *given))
    found = auto_calibrate(AUTO.model_copy(update={"least_probability": 0.0}), images, info)
    assert found.locator is not None
    assert found.locator.xray
    assert set(read) == {XRAY_DETECTOR / "detector.onnx", CAMERA_GRAPHS[1]}
    read.clear()
    saved = ResolvedVision.model_validate_json(found.model_dump_json())
    line = LocatorDetector(saved).locate(images[0])
    assert set(read) == {XRAY_DETECTOR / "detector.onnx", CAMERA_GRAPHS[1]}
    assert line is not None
    assert line.xray
    assert line_log_odds(line) != line_log_odds(replace(line, xray=False))


def test_a_detector_of_an_earlier_version_is_refused_with_the_remedy(monkeypatch: pytest.MonkeyPatch):
    station = np.zeros((1, ALONG), np.float32)
    one_verdict = SimpleNamespace(run=lambda *_: [*5 * [station], np.zeros(1, np.float32), np.zeros(1, np.float32)])
    monkeypatch.setattr("tipforce.vision.locator._networks._graph", lambda *_: one_verdict)
    line = np.column_stack([np.linspace(10.0, 190.0, 50), np.full(50, 30.0)])
    strip = straightened(np.zeros((60, 200), np.uint8), line, 10.0)
    with pytest.raises(FileFormatError, match=r"bench/detector: an earlier version .* tipforce annotate"):
        refine(strip, Path("bench/detector"))


@pytest.mark.parametrize(
    "prompts",
    [
        Prompts(),
        Prompts(base_px=np.array([20.3, 31.7]), length_px=120.0, diameter_px=0.3),
        Prompts(border="bottom", diameter_px=7.0),
        Prompts(region=(10, 20, 30, 50), border="left"),
    ],
)
def test_prompts_are_the_channels_that_the_network_was_trained_with(prompts: Prompts):
    torch = pytest.importorskip("torch")
    from tipforce.training.locator import prompt_channels

    nothing = torch.full((1, 1, 2), torch.nan)
    stated = {"base": [torch.nan] * 2, "region": [torch.nan] * 4, "side": [torch.nan], "sizes": [torch.nan] * 2}
    if prompts.base_px is not None:
        stated["base"] = prompts.base_px.tolist()
    if prompts.region is not None:  # the last pixel belongs to the training's box
        u0, v0, u1, v1 = prompts.region
        stated["region"] = [u0, v0, u1 - 1, v1 - 1]
    if prompts.border is not None:
        stated["side"] = [("left", "right", "top", "bottom").index(prompts.border)]
    stated["sizes"] = [torch.nan if size is None else size for size in (prompts.length_px, prompts.diameter_px)]
    base, region, side, sizes = (torch.tensor([values], dtype=torch.float32) for values in stated.values())
    wanted = prompt_channels((64, 96), base, region, side, nothing[:, 0], nothing, nothing, sizes)
    np.testing.assert_allclose(channels(prompts, 64, 96), wanted[0].numpy(), atol=1e-5)


def test_prompts_move_with_the_image():
    prompts = Prompts(base_px=np.array([10.0, 20.0]), region=(0, 0, 9, 9), length_px=100.0, diameter_px=8.0)
    half = prompts.at_scale(0.5)
    assert half.base_px == pytest.approx([4.75, 9.75])
    assert (half.length_px, half.diameter_px, half.region) == (50.0, 4.0, (0, 0, 5, 5))


def test_the_constants_are_saved_but_do_not_hold_for_another_session():
    found = resolved()
    assert ResolvedVision.model_validate_json(found.model_dump_json()) == found
    _, _, info = session()
    nearer = SessionInfo("next", info.catheter, {"camera": ViewInfo(0.9 * (info.view("camera").metres_per_px or 0.0))})
    assert for_session(found, nearer).locator is None
    assert for_session(found, info).locator == found.locator
    assert for_session(found, replace(info, name="next")).locator is None


def test_the_log_odds_of_a_fine_tuned_detector_follow_the_evidence_and_stay_near_0_with_little_of_it():
    assert fitted_log_odds([], []) == 0.0
    one, two = fitted_log_odds([0.0], [True]), fitted_log_odds([0.0, 0.0], [True, True])
    assert 0.0 < one < two < 1.5
    assert fitted_log_odds([4.0] * 3, [False] * 3) < -2.0
    assert abs(fitted_log_odds([5.0] * 9, [True] * 9)) < 0.2  # a probability that is true stays
    many = fitted_log_odds([-2.0] * 200, [True] * 100 + [False] * 100)
    assert abs(many - 2.0) < 0.1
