"""The presets of other people's benches and of the thesis's own image: what they draw, and that it acts."""

import json
from hashlib import sha256

import numpy as np
import pytest

from tipforce.mechanics import face_depths
from tipforce.pipelines import preset_settings
from tipforce.simulation import PRESETS, SimulatedBench, SimulationSettings, collect_truth, read_truth, write_truth
from tipforce.simulation._settings import settings_of_session
from tipforce.simulation.rendering._random import gauss_table
from tipforce.simulation.rendering.camera._pipeline import develop
from tipforce.simulation.rendering.camera._scene import SensorNoise, SensorPipeline
from tipforce.simulation.rendering.camera._sensor_noise import frame_key
from tipforce.simulation.world import FAST
from tipforce.simulation.world._hand_motion import hand_wave
from tipforce.simulation.world._parameters import BY_HAND, sample_device, sample_kind, sample_parameters
from tipforce.vision import ShapeDetector, VisionSettings

SEEDS = range(300)


def brief(preset: str) -> SimulationSettings:
    settings = PRESETS[preset]
    assert isinstance(settings, SimulationSettings)
    return settings.model_copy(update={"world": settings.world.model_copy(update={"seconds": 8.0, "tare_s": 1.0})})


@pytest.mark.parametrize(
    ("preset", "digest"),
    [
        ("bench-2021", "c1782ce35f7627d2"),
        ("generalise", "604f018d0ab8e78c"),
        ("fluoro", "401967dada5f0e80"),
        ("biplane", "0f21002af0bac215"),
        ("fluoro-varied", "120cb742559a5d3e"),
        ("biplane-varied", "4ed76922e43ee423"),
        ("guidewire", "6dca64fce092954c"),
        ("catheter-5f", "be0e4bb13b045a89"),
    ],
)
def test_what_stands_in_the_truth_of_older_presets_is_what_stood_there_before_there_was_more_to_set(preset, digest):
    record = {**PRESETS[preset].model_dump(mode="json"), "seed": 0, "number": 0}
    assert sha256(json.dumps(record, sort_keys=True).encode()).hexdigest()[:16] == digest


@pytest.fixture(scope="module")
def kinds():
    world = PRESETS["varied"].world
    return [sample_kind(world, np.random.default_rng([0, number, 10])) for number in SEEDS]


def test_laws_faces_and_hands_come_as_often_as_the_protocol_says(kinds):
    for name, values in (("law", ("linear", "hertz", "exponential")), ("face", ("flat", "convex", "concave"))):
        shares = [np.mean([kind[name] == value for kind in kinds]) for value in values]
        np.testing.assert_allclose(shares, 1 / 3, atol=0.08)
    assert np.mean([kind.get("wave") == BY_HAND for kind in kinds]) == pytest.approx(0.5, abs=0.09)
    radii = [kind["face_radius_m"] for kind in kinds if kind["face"] != "flat"]
    assert 15e-3 <= min(radii) < 18e-3
    assert 57e-3 < max(radii) <= 60e-3


def test_stiffness_is_log_uniform_and_known_values_are_off_by_up_to_5_percent():
    world = PRESETS["varied"].world
    devices = [sample_device(world, 0, 5 * number) for number in SEEDS]
    drawn = [sample_parameters(world, each, np.random.default_rng(k)) for k, each in enumerate(devices)]
    place = np.log(np.array([each.wall_stiffness_n_per_m for each in drawn]) / 30.0) / np.log(500 / 30)
    np.testing.assert_allclose(np.quantile(place, [0.1, 0.5, 0.9]), [0.1, 0.5, 0.9], atol=0.08)
    off = np.array([each.nominal_diameter_m / each.diameter_m - 1.0 for each in devices])
    assert 0.045 < np.abs(off).max() <= 0.05


def test_a_hand_presses_pauses_and_does_not_repeat_itself():
    time_s = np.arange(0.0, 60.0, 4e-3)
    wave = hand_wave(time_s, np.random.default_rng(3))
    assert (wave.min(), wave.max()) == pytest.approx((-1.0, 1.0))
    speed = np.abs(np.gradient(wave, time_s))
    assert (speed < 0.15).mean() > 0.1  # pauses
    slow = wave - wave.mean()
    power = np.abs(np.fft.rfft(slow)) ** 2
    assert power[: int(60 * 0.9)].sum() > 0.5 * power.sum()  # slower than a heart beats, mostly
    assert power.max() < 0.5 * power.sum()  # and at no rate of its own


def test_neighbouring_pixels_share_noise_behind_a_mosaic():
    clean = np.full((3, 96, 128), 120.0, np.float32)
    noise, key = SensorNoise.at_mid_grey(4.0, read_share=0.5), frame_key(1, 2)

    def correlation(pipeline: SensorPipeline) -> float:
        image = develop(clean, pipeline, noise, key, gauss_table()).astype(float)
        grey = image[8:-8, 8:-8, 1] if image.ndim == 3 else image[8:-8, 8:-8]
        off = grey - grey.mean()
        return float((off[:, 1:] * off[:, :-1]).mean() / off.var())

    assert correlation(SensorPipeline(mosaic=False, sharpen=0.0, sharpen_px=1.0, grey=True)) == pytest.approx(
        0, abs=0.05
    )
    spread = correlation(SensorPipeline(mosaic=True, sharpen=0.0, sharpen_px=1.0, grey=False))
    assert spread > 0.2
    assert correlation(SensorPipeline(mosaic=True, sharpen=1.0, sharpen_px=1.2, grey=False)) < spread


def test_the_drawn_face_is_the_one_that_is_pressed():
    aside = np.array([0.0, 5e-3, 9e-3, 12e-3])
    np.testing.assert_allclose(face_depths(15e-3, aside), -face_depths(-15e-3, aside))
    np.testing.assert_allclose(face_depths(15e-3, aside)[:3], 15e-3 - np.sqrt(15e-3**2 - aside[:3] ** 2))


def test_cameras_are_drawn_by_session_and_fit_the_protocol():
    settings = PRESETS["varied"]
    drawn = [settings_of_session(settings, 0, number) for number in range(60)]
    assert {each.scene.base_side for each in drawn} == {"left", "right", "top", "bottom"}
    assert {each.world.clock.fps for each in drawn} == {24.0, 25.0, 30.0, 50.0, 60.0}
    assert all(640 <= each.width <= 1280 and 480 <= each.height <= 1024 for each in drawn)
    assert settings_of_session(PRESETS["bench-2021"], 0, 3) is PRESETS["bench-2021"]


@pytest.mark.parametrize("preset", ["varied", "fluoro-varied"])
def test_a_stated_size_rate_or_side_holds_where_the_preset_draws_them(preset):
    changes = {"width": 320, "height": 240, "world": {"clock": {"fps": 12.0}}, "scene": {"base_side": "top"}}
    chosen = preset_settings(preset, changes=changes)
    drawn = [settings_of_session(chosen, 0, number) for number in range(6)]
    assert {(each.width, each.height, each.world.clock.fps, each.scene.base_side) for each in drawn} == {
        (320, 240, 12.0, "top")
    }
    faster = preset_settings(preset, changes={"world": {"clock": {"fps": 12.0}}})
    assert len({settings_of_session(faster, 0, number).width for number in range(12)}) > 1


@pytest.fixture(scope="module")
def varied() -> SimulatedBench:
    return SimulatedBench(brief("varied"), 0, 9, resolution=FAST)


def test_the_tip_is_in_view_and_the_metadata_hold_what_a_bench_knows(varied, tmp_path):
    index = len(varied.frame_s) - 40
    image, truth = varied.frame(index).image, varied.image_truth(index)
    assert image.shape[:2] == (varied.settings.height, varied.settings.width)
    assert (truth.centreline_px[-1] > 0).all()
    assert (truth.centreline_px[-1] < (varied.settings.width, varied.settings.height)).all()
    info, values = varied.session_info, varied.values()
    view = info.views["camera"]
    assert view.base_side == varied.settings.scene.base_side
    true = varied.imaging.scene.lens.scale_m_per_px * 640 / varied.settings.width
    assert abs(view.metres_per_px / true - 1) <= 0.021
    assert 0.099e-3 <= true <= 0.31e-3
    assert 0 < abs(info.catheter.diameter_m / values["diameter_m"] - 1) <= 0.05
    public = repr(info)
    assert info.tissue.stiffness_n_per_m is None
    for hidden in ("law", "concave", "sheath", "rim", "by hand"):
        assert hidden not in public
    write_truth(collect_truth(varied, np.array([index])), tmp_path / "session_09.truth.npz")
    again = read_truth(tmp_path / "session_09.truth.npz")
    for name in ("law", "face", "wall_stiffness_n_per_m", "loss_factor", "tissue_sight", "rim_m", "peak_force_n"):
        assert again.values[name] == values[name]
    assert again.settings["preset"] == "varied"
    assert again.image_size == (varied.settings.width, varied.settings.height)


def test_forces_come_to_what_was_drawn(varied):
    peak = float(np.linalg.norm(varied.trajectory.contact.force_n, axis=1).max())
    assert peak == pytest.approx(varied.values()["peak_force_n"], abs=0.015)


def test_algorithm_1_with_a_fixed_threshold_finds_the_thesis_s_own_image():
    bench = SimulatedBench(brief("thesis-2021-plain"), 0, 0, resolution=FAST)
    vision = ShapeDetector(VisionSettings(method="classic", base_side="left", polarity="dark", threshold=110))
    for index in (30, len(bench.frame_s) - 20):
        found = vision.detect(bench.frame(index).image)
        assert found.centreline is not None
        true = bench.image_truth(index).centreline_px
        away = np.linalg.norm(found.centreline.points[:, None] - true[None], axis=2).min(axis=1)
        assert np.median(away) < 2.5  # half the distance of the truth's points
        assert np.linalg.norm(found.centreline.points[-1] - true[-1]) < 4
