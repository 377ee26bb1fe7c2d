"""The fluoroscope: geometry, attenuation, noise, lag, and images that come again."""

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from tipforce.geometry import CameraModel, CArm, triangulate
from tipforce.simulation.rendering.camera import TissueState
from tipforce.simulation.rendering.fluoroscope import (
    BIPLANE,
    FLUORO,
    Pulse,
    XrayRenderer,
    XrayScene,
    sample_xray_scene,
)
from tipforce.simulation.rendering.fluoroscope._detector import (
    blurred,
    frame_key,
    photon_tables,
    sample_photons,
    sum_with_lag,
)
from tipforce.simulation.rendering.fluoroscope._scene import lag_weights
from tipforce.simulation.rendering.fluoroscope._tube_kernels import add_tube, no_spans
from tipforce.simulation.rendering.fluoroscope._tube_model import Layer, axial_profile, section_profiles

LENGTH_M = 50e-3
SIZE = 256


def bent(curvature_per_m: float = 18.0, out_of_plane: float = 0.0, n: int = 60) -> np.ndarray:
    s = np.linspace(0.0, LENGTH_M, n)
    x, y = np.sin(curvature_per_m * s) / curvature_per_m, (1 - np.cos(curvature_per_m * s)) / curvature_per_m
    c = math.cos(out_of_plane)
    return np.stack([x, c * y, math.sin(out_of_plane) * y], axis=1)


def moved(shape: np.ndarray, y_m: float) -> np.ndarray:
    return shape + np.array([0.0, y_m, 0.0])


def pulse(frame: int, shift_m: float = 0.0) -> Pulse:
    shape = moved(bent(), shift_m)
    return Pulse(np.stack([shape, moved(shape, 3e-4)]), None, frame, frame / 15.0)


@pytest.fixture(scope="module")
def scene() -> XrayScene:
    return sample_xray_scene(BIPLANE, np.random.default_rng(5))


@pytest.fixture(scope="module")
def renderer(scene: XrayScene) -> XrayRenderer:
    return XrayRenderer(scene, LENGTH_M, width=SIZE, height=SIZE)


def drawn(camera: CameraModel, points: np.ndarray, size: int = 512) -> np.ndarray:
    table = section_profiles([(Layer(0.6, 1.0, 300.0),)], 1.2e-3, 4000.0, 0.4)
    length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    way = axial_profile(length, [(0.0, length, 0, 1.0)], 1)
    image = np.zeros((size, size), np.float32)
    arrays = table.table, table.half_px, table.reach_px, way.amount, way.size
    add_tube(image, no_spans(size), camera.row, points, 1.2e-3, *arrays)
    return image


# Geometry


def test_images_are_shown_as_usual() -> None:
    ap, lateral = CArm(0.0, 0.0, 1.1, 0.75, 0.25e-3).camera(), CArm(90.0, 0.0, 1.1, 0.75, 0.25e-3).camera()
    middle, left, head, back = ap.project([[0, 0, 0], [0.01, 0, 0], [0, 0, 0.01], [0, 0.01, 0]]) - 255.5
    np.testing.assert_allclose(middle, 0.0, atol=1e-9)
    np.testing.assert_allclose(left, [40.0, 0.0], atol=1e-9)  # the patient's left at the right
    np.testing.assert_allclose(head, [0.0, -40.0], atol=1e-9)
    np.testing.assert_allclose(back, 0.0, atol=1e-9)
    assert ap.position_m[1] == pytest.approx(0.75)  # the tube behind the patient
    assert lateral.position_m[0] == pytest.approx(-0.75)  # the detector at the left: LAO
    assert CArm(0.0, 30.0, 1.1, 0.75, 0.25e-3).camera().position_m[2] < 0  # the detector toward the head: cranial


@given(st.floats(-90, 90), st.floats(-40, 40), st.floats(-5, 5), st.tuples(*[st.floats(-0.04, 0.04)] * 3))
def test_the_scale_holds_at_the_isocentre_whatever_the_angles(
    primary: float, secondary: float, roll: float, point: tuple[float, float, float]
) -> None:
    arm = CArm(primary, secondary, 1.1, 0.75, 0.25e-3, roll)
    camera, p = arm.camera(), np.array(point)
    ahead = (p - camera.position_m) @ -camera.position_m / 0.75
    across = np.linalg.norm(p - camera.position_m - ahead * -camera.position_m / 0.75)
    assert np.linalg.norm(camera.project([p])[0] - 255.5) == pytest.approx(across / ahead * 0.75 / 0.25e-3, abs=1e-6)
    assert arm.imager_spacing_m() == pytest.approx(0.25e-3 * 1.1 / 0.75)


def test_the_stated_calibration_is_off_by_what_the_preset_says() -> None:
    grid = np.array([(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)]) * 40e-3
    for seed in range(6):
        for view in sample_xray_scene(BIPLANE, np.random.default_rng(seed)).views:
            off = view.stated.camera().project(grid) - view.true.camera().project(grid)
            assert math.sqrt((off**2).sum(axis=1).mean()) == pytest.approx(0.5, abs=1e-3)


def test_the_planes_of_a_biplane_stand_across() -> None:
    for seed in range(20):
        first, second = (
            view.true.display_axes()[2] for view in sample_xray_scene(BIPLANE, np.random.default_rng(seed)).views
        )
        assert 80.0 <= math.degrees(math.acos(first @ second)) <= 100.0


def test_two_views_give_the_line_in_space_back(scene: XrayScene) -> None:
    shape = bent(out_of_plane=0.5)
    seen = [XrayRenderer(scene, LENGTH_M, view=k, width=SIZE, height=SIZE).truth(shape[None]) for k in (0, 1)]
    pixels = np.stack([truth.centreline_px for truth in seen], axis=1)
    true = triangulate([scene.camera(k, SIZE, SIZE) for k in (0, 1)], pixels)
    np.testing.assert_allclose(true.points_m, shape, atol=1e-9)
    as_stated = replace(scene, views=tuple(replace(view, true=view.stated) for view in scene.views))
    stated = triangulate([as_stated.camera(k, SIZE, SIZE) for k in (0, 1)], pixels)
    off = np.linalg.norm(stated.points_m - shape, axis=1)
    assert 1e-6 < off.mean() < 1e-3  # half a pixel, turns of a tenth of a degree


def test_the_truth_is_where_the_camera_sees_the_axis(scene: XrayScene, renderer: XrayRenderer) -> None:
    truth = renderer.truth(bent()[None])
    np.testing.assert_array_equal(truth.centreline_px, scene.camera(0, SIZE, SIZE).project(bent()))
    inside = truth.centreline_px[truth.visible]
    assert truth.visible_share > 0.9
    assert truth.mask[tuple(np.rint(inside[:-2, ::-1]).astype(int).T)].all()


# Attenuation


@settings(max_examples=15, deadline=None)
@given(st.floats(0.0, 1.1), st.floats(-30, 30), st.floats(0, 3))
def test_the_tube_lies_where_its_axis_is_projected(lean: float, curvature: float, turn: float) -> None:
    camera = CArm(10.0, 5.0, 1.1, 0.75, 0.25e-3).camera()
    axes = CArm(10.0, 5.0, 1.1, 0.75, 0.25e-3).display_axes()
    s = np.linspace(-15e-3, 15e-3, 41)
    way = math.cos(lean) * (math.cos(turn) * axes[0] + math.sin(turn) * axes[1]) + math.sin(lean) * axes[2]
    aside = np.cross(axes[2], way)
    points = s[:, None] * way + 0.5 * curvature * (s**2)[:, None] * aside / np.linalg.norm(aside)
    image = drawn(camera, points)
    # All that the tube holds is in the image, around the middle of the projected axis.
    v, u = np.mgrid[0:512, 0:512]
    middle = np.array([(image * u).sum(), (image * v).sum()]) / image.sum()
    nearness = camera.camera_from_world.apply(points)[:, 2] ** -2.0  # what is nearer is seen larger
    nearness[[0, -1]] *= 0.5
    np.testing.assert_allclose(middle, nearness @ camera.project(points) / nearness.sum(), atol=0.15)
    length = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    whole = 300.0 * math.pi * 1.2e-3**2 * (1 - 0.36) * length / 0.25e-3**2
    assert image.sum() == pytest.approx(whole, rel=0.02)  # attenuation per metre times volume


def test_a_leaning_tube_is_as_much_thicker_as_it_is_shorter() -> None:
    arm = CArm(0.0, 0.0, 1.1, 0.75, 0.25e-3)
    s = np.linspace(-10e-3, 10e-3, 41)[:, None]
    for degrees in (0.0, 30.0, 55.0, 66.0):
        way = np.array([math.cos(math.radians(degrees)), math.sin(math.radians(degrees)), 0.0])
        peak = drawn(arm.camera(), s * way)[255:257, 254:258].mean()
        thickness = 300.0 * 2 * 1.2e-3 * 0.4
        assert peak == pytest.approx(thickness / math.cos(math.radians(degrees)), rel=0.03)


def test_attenuations_of_crossing_tubes_add(renderer: XrayRenderer) -> None:
    camera = CArm(0.0, 0.0, 1.1, 0.75, 0.25e-3).camera()
    s = np.linspace(-15e-3, 15e-3, 31)[:, None]
    one, two = s * (1.0, 0.0, 0.0), s * (0.6, 0.0, 0.8)
    both = drawn(camera, one) + drawn(camera, two)
    image = drawn(camera, one)
    assert both.max() > 1.9 * image[256, 200:300].max()
    table = section_profiles([(Layer(0.6, 1.0, 300.0),)], 1.2e-3, 4000.0, 0.4)
    way = axial_profile(30e-3, [(0.0, 30e-3, 0, 1.0)], 1)
    add_tube(
        image,
        no_spans(512),
        camera.row,
        two,
        1.2e-3,
        table.table,
        table.half_px,
        table.reach_px,
        way.amount,
        way.size,
    )
    np.testing.assert_allclose(image, both, atol=1e-5)


def test_platinum_is_all_but_opaque_and_the_shaft_is_not(scene: XrayScene) -> None:
    clear = tuple(replace(view, detector=replace(view.detector, scatter=0.0, glare=0.0)) for view in scene.views)
    renderer = XrayRenderer(replace(scene, views=clear, devices=()), LENGTH_M)
    shape = bent()
    with_it, without = renderer.light(shape[None]), renderer.light(moved(shape, 0.5)[None])
    left = with_it / without
    at = np.rint(renderer.camera.project(shape)).astype(int)
    tip, shaft = at[-5], at[25]
    assert left[tip[1], tip[0]] < 0.01
    assert 0.3 < left[shaft[1], shaft[0]] < 0.95


# Noise


@pytest.mark.parametrize("mean", [0.4, 3.3, 17.77, 35.9, 36.1, 90.0, 470.0])
def test_photon_counts_are_poisson(mean: float) -> None:
    tables = photon_tables()
    photons = np.empty((512, 512), np.uint16)
    sample_photons(np.full((512, 512), mean, np.float32), frame_key(3, 0, 7, 0), tables.alias, tables.gauss, photons)
    counts = np.bincount(photons.ravel(), minlength=2)
    expected = stats.poisson.pmf(np.arange(counts.size), mean) * photons.size
    common = expected > 8
    seen = np.append(counts[common], counts[~common].sum())
    due = np.append(expected[common], photons.size - expected[common].sum())
    assert stats.chisquare(seen, due * seen.sum() / due.sum()).pvalue > 1e-3


def test_neighbours_frames_and_views_have_noise_of_their_own() -> None:
    tables = photon_tables()

    def noise(seed: int, view: int, frame: int) -> np.ndarray:
        counts = np.empty((256, 256), np.uint16)
        sample_photons(
            np.full((256, 256), 80.0, np.float32), frame_key(seed, view, frame, 0), tables.alias, tables.gauss, counts
        )
        return (counts - 80.0) / math.sqrt(80.0)

    one = noise(1, 0, 0)
    others = [noise(1, 0, 1), noise(1, 1, 0), noise(2, 0, 0), np.roll(one, 1, 0), np.roll(one, 1, 1)]
    for other in others:
        assert abs((one * other).mean()) < 4.0 / 256.0


def test_the_exposure_control_holds_the_photons_that_were_drawn() -> None:
    for seed in range(2):
        scene = sample_xray_scene(FLUORO, np.random.default_rng(seed))
        held = replace(scene, devices=(), rhythm=replace(scene.rhythm, breath_hz=0.0, beat=0.0))
        renderer = XrayRenderer(held, LENGTH_M, width=SIZE, height=SIZE)
        light = renderer.light(moved(bent(), 0.5)[None])
        v, u = np.mgrid[0:SIZE, 0:SIZE]
        field = np.hypot(v + 0.5 - SIZE / 2, u + 0.5 - SIZE / 2) < 0.33 * SIZE
        assert light[field].mean() == pytest.approx(scene.views[0].beam.photons * 4, rel=0.01)


# Detector


def test_a_flash_fades_as_the_lag_says(scene: XrayScene) -> None:
    detector = replace(scene.views[0].detector, lag=((0.08, 0.4), (0.02, 0.7)))
    weights = lag_weights(detector)
    assert weights.sum() == pytest.approx(1.0)
    ages = np.arange(3)
    np.testing.assert_allclose(weights[1:4], 0.08 * 0.6 * 0.4**ages + 0.02 * 0.3 * 0.7**ages, rtol=1e-12)
    flash, dark = np.full((8, 8), 1000, np.uint16), np.zeros((8, 8), np.uint16)
    total = np.empty((8, 8), np.float32)
    for age in range(len(weights)):
        planes = [flash if k == age else dark for k in range(len(weights))]
        sum_with_lag(planes, weights, total)
        np.testing.assert_allclose(total, 1000 * weights[age], rtol=1e-5)
    sum_with_lag([flash, flash], weights, total)  # what is not known is as now: as bright
    np.testing.assert_allclose(total, 1000.0, rtol=1e-5)


def test_lag_leaves_a_ghost_where_the_catheter_was(scene: XrayScene) -> None:
    strong = tuple(replace(v, detector=replace(v.detector, lag=((0.3, 0.3),))) for v in scene.views)
    renderer = XrayRenderer(replace(scene, views=strong), LENGTH_M, width=SIZE, height=SIZE)
    here, gone = pulse(0), pulse(1, shift_m=0.02)
    ghost = renderer.render(gone.shapes_m, frame=1, time_s=1 / 15, before=(here,)).astype(float)
    clean = renderer.render(gone.shapes_m, frame=1, time_s=1 / 15, before=(replace(gone, frame=0),)).astype(float)
    was = renderer.truth(here.shapes_m).mask & ~renderer.truth(gone.shapes_m).mask
    assert (ghost - clean)[was].mean() < -2.0


def test_a_point_is_spread_by_the_detectors_gaussians(scene: XrayScene) -> None:
    detector = replace(scene.views[0].detector, blur_px=(0.6, 1.8), blur_tail=0.25)
    total = np.zeros((65, 65))
    for dv in (0, 1):
        for du in (0, 1):
            point = np.zeros((64, 64), np.float32)
            point[32 + dv, 32 + du] = 1.0
            total[1 - dv : 65 - dv, 1 - du : 65 - du] += blurred(point, detector, 1.0) / 4
    x = np.arange(65) - 33.0
    assert total.sum() == pytest.approx(1.0, abs=1e-5)
    assert (total.sum(axis=0) * x**2).sum() == pytest.approx(0.75 * 0.6**2 + 0.25 * 1.8**2, rel=0.05)


# Images that come again


def test_the_same_frame_comes_out_the_same_alone_in_a_run_and_on_threads(
    renderer: XrayRenderer, scene: XrayScene
) -> None:
    pulses = [pulse(k, 1e-4 * k) for k in range(6)]
    run = list(renderer.run(pulses))
    fresh = XrayRenderer(scene, LENGTH_M, width=SIZE, height=SIZE)

    def alone(k: int) -> np.ndarray:
        p = pulses[k]
        return fresh.render(p.shapes_m, frame=p.frame, time_s=p.time_s, before=pulses[:k])

    with ThreadPoolExecutor(3) as pool:
        again = list(pool.map(alone, [5, 2, 4, 0, 1, 3]))
    for k, image in zip([5, 2, 4, 0, 1, 3], again, strict=True):
        np.testing.assert_array_equal(image, run[k])
    assert (run[0] != run[1]).mean() > 0.5


def test_a_pulse_smears_what_moves(scene: XrayScene) -> None:
    still = XrayRenderer(replace(scene, devices=()), LENGTH_M)
    shape = bent()
    sweep = np.stack([moved(shape, -1e-3), moved(shape, 1e-3)])
    background = still.light(moved(shape, 0.5)[None])
    sharp, smeared = (still.light(s) / background for s in (shape[None], sweep))
    assert ((1 - smeared) > 0.02).sum() > 1.3 * ((1 - sharp) > 0.02).sum()
    assert (1 - smeared).sum() == pytest.approx((1 - sharp).sum(), rel=0.03)  # as much light is taken, elsewhere


def test_the_hearts_shadow_goes_with_its_wall(renderer: XrayRenderer) -> None:
    shape = bent()[None]
    rest, pushed = (renderer.light(shape, TissueState(np.array([[0.0, y, 0.0]]))) for y in (0.0, 4e-3))
    assert np.abs(np.log(pushed / rest)).max() > 0.05


@pytest.mark.parametrize(("side", "bits"), [(500, 8), (512, 17)])
def test_impossible_images_are_refused(scene: XrayScene, side: int, bits: int) -> None:
    with pytest.raises(ValueError, match="multiples of 8"):
        XrayRenderer(scene, LENGTH_M, width=side, height=side, bits=bits)


def test_shapes_of_another_form_are_refused(renderer: XrayRenderer) -> None:
    with pytest.raises(ValueError, match="shapes_m"):
        renderer.render(bent())
