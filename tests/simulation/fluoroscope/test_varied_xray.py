"""X-ray images as they differ from laboratory to laboratory: what is drawn, and that the truth follows it."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from tipforce.simulation import PRESETS, FluoroSettings, SimulatedBench
from tipforce.simulation._settings import settings_of_session
from tipforce.simulation.rendering.fluoroscope import FLUORO_VARIED, XrayRenderer, XrayScene, sample_xray_scene
from tipforce.simulation.rendering.fluoroscope._display_processing import noise_gain, temporal_weights
from tipforce.simulation.rendering.fluoroscope._scene import lag_weights
from tipforce.simulation.rendering.fluoroscope._variety import Collimator, Pan
from tipforce.simulation.world import FAST

SIZE = 256
LENGTH_M = 50e-3
OPEN = Collimator((0.0, 0.0, 0.0, 0.0), 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


def bent(y_m: float = 0.0) -> np.ndarray:
    s = np.linspace(0.0, LENGTH_M, 60)
    return np.stack([np.sin(18 * s) / 18, (1 - np.cos(18 * s)) / 18 + y_m, 0 * s], axis=1)[None]


def varied(scene: XrayScene, **changes) -> XrayScene:
    assert scene.variety is not None
    return replace(scene, variety=replace(scene.variety, **changes))


@pytest.fixture(scope="module")
def scene() -> XrayScene:
    return varied(sample_xray_scene(FLUORO_VARIED, np.random.default_rng(3)), collimators=(OPEN,))


def brief(preset: str) -> FluoroSettings:
    settings = PRESETS[preset]
    assert isinstance(settings, FluoroSettings)
    world = settings.world.model_copy(update={"seconds": 8.0, "tare_s": 1.0})
    return settings.model_copy(update={"world": world, "detectors": None, "width": SIZE, "height": SIZE})


@pytest.fixture(scope="module")
def biplane() -> SimulatedBench:
    return SimulatedBench(brief("biplane-varied"), 5, 1, resolution=FAST)


def test_each_session_has_its_detector_pulse_rate_and_orientation():
    settings = PRESETS["fluoro-varied"]
    drawn = [settings_of_session(settings, 0, number) for number in range(40)]
    assert {each.width for each in drawn} == {512, 768, 1024}
    assert {each.world.clock.fps for each in drawn} == {7.5, 15.0}
    assert {each.scene.base_side for each in drawn} == {"left", "right", "top", "bottom"}
    assert settings_of_session(PRESETS["fluoro"], 0, 3) is PRESETS["fluoro"]


def test_laboratories_differ_as_often_as_the_ranges_say():
    scenes = [sample_xray_scene(FLUORO_VARIED, np.random.default_rng([9, seed])) for seed in range(200)]
    ranges, drawn = FLUORO_VARIED.variety, [each.variety for each in scenes]
    assert np.mean([each.collimators[0].circle > 0 for each in drawn]) == pytest.approx(ranges.round_field, abs=0.1)
    assert np.mean([each.processing.kept > 0 for each in drawn]) == pytest.approx(ranges.temporal, abs=0.1)
    assert np.mean([bool(each.pans[0]) for each in drawn]) == pytest.approx(ranges.panned, abs=0.1)
    assert np.mean([each.patient.can is not None for each in drawn]) == pytest.approx(ranges.can, abs=0.1)
    assert np.mean([each.patient.injection is not None for each in drawn]) == pytest.approx(ranges.injection, abs=0.1)
    assert {each.catheter.electrode_m for each in scenes} == set(ranges.tip_electrode_m)
    assert {len(each.catheter.rings_m) for each in scenes} == set(range(10))
    for each in scenes:
        ends = np.ravel([(0.0, each.catheter.electrode_m), *each.catheter.rings_m])
        assert (np.diff(ends) > 0).all()
        assert ends[-1] <= 40e-3


def test_images_come_again_in_any_order(biplane):
    again = SimulatedBench(brief("biplane-varied"), 5, 1, resolution=FAST)
    for view in biplane.views:
        last = [biplane.frame(index, view).image for index in (70, 71, 72)][-1]
        assert last.dtype == np.uint8
        np.testing.assert_array_equal(last, again.frame(72, view).image)


def test_the_truth_follows_the_table(scene):
    moving = varied(scene, pans=((Pan(1.0, 1.0, (8e-3, 0.0, 6e-3)),),))
    renderer = XrayRenderer(moving, LENGTH_M, width=SIZE, height=SIZE)
    before, after = (renderer.truth(bent(), time_s=time_s) for time_s in (0.5, 3.0))
    way = after.centreline_px - before.centreline_px
    assert np.linalg.norm(way, axis=1).min() > 5
    for time_s, truth in ((0.5, before), (3.0, after)):
        taken = np.log(renderer.light(bent(0.03), time_s=time_s) / renderer.light(bent(), time_s=time_s))
        near = cv2.dilate(truth.mask.astype(np.uint8), np.ones((5, 5))) > 0
        u, v = np.rint(truth.centreline_px[truth.visible]).astype(int).T
        assert np.quantile(taken[v, u], 0.1) > 0.05
        assert (taken[~near] < 0.05).all()


def test_blades_hide_the_catheter_behind_them(scene):
    renderer = XrayRenderer(scene, LENGTH_M, width=SIZE, height=SIZE)
    whole = renderer.truth(bent())
    middle = float(np.median(whole.centreline_px[whole.visible][:, 0])) / SIZE
    closed = replace(OPEN, inset=(middle, 0.0, 0.0, 0.0))
    behind = XrayRenderer(varied(scene, collimators=(closed,)), LENGTH_M, width=SIZE, height=SIZE)
    truth = behind.truth(bent())
    left = whole.centreline_px[:, 0] < middle * SIZE - 2
    assert whole.visible[left].any()
    assert not truth.visible[left].any()
    assert truth.visible[~left & whole.visible].sum() > 5
    assert not truth.mask[:, : int(middle * SIZE) - 2].any()
    assert truth.visible_share < whole.visible_share
    shadow, lit = behind.light(bent()), renderer.light(bent())
    columns = slice(2, int(middle * SIZE) - 8)
    assert shadow[:, columns].mean() < 0.5 * lit[:, columns].mean()


@pytest.mark.parametrize("kept", [0.3, 0.5])
def test_the_temporal_filter_is_the_recursion_of_the_vendors(scene, kept):
    weights = temporal_weights(np.ones(1), kept)
    assert weights.sum() == pytest.approx(1.0)
    filtered, frames = 0.0, np.random.default_rng(0).normal(size=200)
    for frame in frames:
        filtered = kept * filtered + (1 - kept) * frame
    assert float(weights @ frames[::-1][: weights.size]) == pytest.approx(filtered, abs=0.06)
    assert np.sqrt((weights**2).sum()) == pytest.approx(noise_gain(kept), rel=0.03)
    lag = lag_weights(scene.views[0].detector)
    assert temporal_weights(lag, kept).size <= 7
    assert temporal_weights(lag, 0.0) is lag


def test_the_metadata_hold_the_nominal_geometry_and_the_truth_the_electrodes(biplane):
    info, values = biplane.session_info, biplane.values()
    assert info.view("a").modality == "xray"
    assert 0.005 < info.view("a").metres_per_px_uncertainty < 0.03
    assert values["electrodes_m"][0] == (0.0, biplane.imaging.scene.catheter.electrode_m)
    pose = np.array(values["isocentre_from_base"])
    grid = np.array([(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)]) * 40e-3
    in_base = (grid - pose[:, 3]) @ pose[:, :3]
    for view in biplane.views:
        stated, true = np.array(info.views[view].projection), np.array(values["projection"][view])
        seen = [rows @ matrix[:, :3].T + matrix[:, 3] for rows, matrix in ((grid, stated), (in_base, true))]
        off = np.linalg.norm(seen[0][:, :2] / seen[0][:, 2:] - seen[1][:, :2] / seen[1][:, 2:], axis=1)
        assert 0.2 < np.sqrt((off**2).mean()) * 512 / SIZE < 4.1
    for hidden in ("can_turn_deg", "edge_gain", "electrodes", "injection"):
        assert hidden not in repr(info)


def test_sessions_of_one_catheter_show_the_same_electrodes():
    scenes = [SimulatedBench(brief("fluoro-varied"), 5, number, resolution=FAST).imaging.scene for number in (5, 6)]
    assert scenes[0].catheter == scenes[1].catheter
    assert scenes[0].variety != scenes[1].variety


def test_processing_needs_8_bits(scene):
    with pytest.raises(ValueError, match="expected 8 bits, got 12"):
        XrayRenderer(scene, LENGTH_M, width=SIZE, height=SIZE, bits=12)
