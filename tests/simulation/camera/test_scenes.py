"""Sessions drawn from ranges: every setting does something, and the same seed gives the same bytes."""

import dataclasses
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import pytest
from pydantic import ValidationError

from tipforce.simulation.rendering.camera import (
    BENCH_2021,
    GENERALISE,
    CameraRenderer,
    SceneRanges,
    TissueHome,
    TissueState,
    sample_scene,
)

LENGTH_M = 0.048
HOME = TissueHome(np.array([0.047, 0.004, 0.0]), np.array([0.9, 0.43588989, 0.0]))
SMALL = {"width": 320, "height": 240}


def scene_of(ranges=BENCH_2021, seed=0):
    return sample_scene(ranges, np.random.default_rng(seed), length_m=LENGTH_M)


def state(x_m=0.0, indentation_m=0.0):
    return TissueState(np.array([[x_m, 0.0, 0.0]]), indentation_m, HOME.surface_m)


@pytest.fixture(scope="module")
def busy():
    """A session with everything in it."""
    ranges = GENERALISE.model_copy(update={"second_instrument": 1.0, "hidden_share": (0.15, 0.15)})
    return CameraRenderer(scene_of(ranges, 5), LENGTH_M, tissue=HOME, **SMALL)


def test_frames_do_not_depend_on_what_was_drawn_before_or_on_which_thread(arc, busy):
    jobs = [(arc(0.2 * k), state(2e-3 * k - 3e-3, 1e-3), k) for k in range(5)]

    def draw(job):
        return busy.render(job[0], job[1], frame=job[2], time_s=0.1 * job[2])

    first = [draw(job) for job in jobs]
    again = [draw(job) for job in reversed(jobs)][::-1]
    with ThreadPoolExecutor(2) as pool:
        threads = list(pool.map(draw, jobs))
    fresh = CameraRenderer(busy.scene, LENGTH_M, tissue=HOME, **SMALL)
    alone = fresh.render(jobs[3][0], jobs[3][1], frame=3, time_s=0.1 * 3)
    for one, two, three in zip(first, again, threads, strict=True):
        np.testing.assert_array_equal(one, two)
        np.testing.assert_array_equal(one, three)
    np.testing.assert_array_equal(first[3], alone)
    assert (first[0] != first[1]).mean() > 0.5


def test_noise_is_new_in_every_frame_and_centred_on_the_clean_image(arc, busy):
    clean = busy.clean(arc(0.3), state())
    mean = np.mean([busy.render(arc(0.3), state(), frame=k).astype(float) for k in range(24)], axis=0)
    inside = (clean > 25) & (clean < 230)
    off = (mean - clean)[inside]
    assert abs(off.mean()) < 0.03
    assert off.std() < 2.5 * busy.scene.noise.sigma(160.0) / 24**0.5


def test_what_moves_is_seen_and_what_does_not_stays(arc):
    renderer = CameraRenderer(scene_of(BENCH_2021, 2), LENGTH_M, tissue=HOME, **SMALL)
    here, there = (renderer.clean(arc(0.3), state(x)) for x in (0.0, 2e-3))
    changed = np.abs(here - there).max(axis=2) > 1.0
    assert 0.01 < changed.mean() < 0.5
    indented = renderer.clean(arc(0.3), state(0.0, 2e-3))
    assert 0.0002 < (np.abs(here - indented).max(axis=2) > 1.0).mean() < 0.05
    bent = renderer.clean(arc(-0.3), state())
    assert 0.003 < (np.abs(here - bent).max(axis=2) > 1.0).mean() < 0.3
    assert (here[-1] == bent[-1]).all()


def test_the_tissue_moves_by_what_it_is_told(arc):
    scene = dataclasses.replace(scene_of(BENCH_2021, 4), colour=False)
    renderer = CameraRenderer(scene, LENGTH_M, tissue=HOME)
    far = arc(0.0) + np.array([0.0, 0.3, 0.0])
    shift = 3.3 * scene.lens.scale_m_per_px
    here, there = (renderer.clean(far, state(x)).astype(np.float32) for x in (0.0, shift))
    at = renderer.camera.project(HOME.surface_m[None])[0]
    moved = renderer.camera.project(HOME.surface_m[None] + [[shift, 0.0, 0.0]])[0] - at
    u, v = (int(x) for x in at)
    part = (slice(v - 40, v + 40), slice(u - 15, u + 40))
    back = cv2.warpAffine(
        there, np.array([[1, 0, -moved[0]], [0, 1, -moved[1]]]), here.shape[::-1], flags=cv2.INTER_CUBIC
    )
    assert np.abs(here[part] - there[part]).mean() > 2.0
    assert np.abs(here[part] - back[part]).mean() < 0.25 * np.abs(here[part] - there[part]).mean()


def test_covers_and_instruments_in_front_hide_what_truth_says_is_hidden(arc):
    for share in (0.1, 0.2):
        ranges = GENERALISE.model_copy(
            update={"second_instrument": 0.0, "tissue_over_tip": 0.0, "hidden_share": (share, share)}
        )
        seen = []
        for seed in range(4):
            renderer = CameraRenderer(scene_of(ranges, seed), LENGTH_M, **SMALL)
            truth = renderer.truth(arc(0.2))
            seen.append(truth.visible_share)
            near = np.rint(truth.centreline_px[8:]).astype(int)
            hidden = [not truth.mask[v, u] for u, v in near]
            assert np.mean(np.array(hidden) == ~truth.visible[8:]) > 0.9
        assert 1 - np.mean(seen) == pytest.approx(share + 0.03, abs=0.08)  # the base lies beyond the border
    free = scene_of(ranges.model_copy(update={"hidden_share": (0.0, 0.0)}), 0)
    assert CameraRenderer(free, LENGTH_M, **SMALL).truth(arc(0.2)).visible_share > 0.93


def test_a_tall_phantom_hides_the_tip_that_sinks_in(arc):
    shape = arc(0.2)
    over, under = (
        CameraRenderer(
            dataclasses.replace(s, tissue=dataclasses.replace(s.tissue, over_tip=hides)), LENGTH_M, tissue=HOME, **SMALL
        ).truth(shape, TissueState(shape[0, -1:] - HOME.surface_m - 3e-3 * HOME.into))
        for s in [scene_of(BENCH_2021, 1)]
        for hides in (True, False)
    )
    assert not over.visible[-3:].any()
    assert under.visible[-3:].all()
    assert over.mask.sum() < under.mask.sum()


@pytest.mark.parametrize("ranges", [BENCH_2021, GENERALISE])
def test_drawn_scenes_keep_to_their_ranges(ranges):
    for seed in range(40):
        scene = scene_of(ranges, seed)
        for value, bounds in (
            (scene.light.level, ranges.light),
            (scene.lens.blur_px, ranges.blur_px),
            (scene.noise.sigma(128.0), ranges.noise_grey),
            (scene.lens.scale_m_per_px, ranges.scale_m_per_px),
            (scene.jpeg_quality, ranges.jpeg_quality),
            (np.dot(scene.ground.colour, (0.299, 0.587, 0.114)), ranges.ground_grey),
            (np.dot(scene.catheter.finish.shaft, (0.299, 0.587, 0.114)), ranges.shaft_grey),
        ):
            assert bounds[0] - 1e-9 <= value <= bounds[1] + 1e-9
        total = scene.light.ambient + sum(lamp.strength for lamp in scene.light.lamps)
        assert total == pytest.approx(1.0)


def test_a_third_of_generalise_has_a_second_instrument_and_none_of_the_bench():
    share = np.mean([scene_of(GENERALISE, seed).instrument is not None for seed in range(300)])
    assert share == pytest.approx(1 / 3, abs=0.09)
    assert all(scene_of(BENCH_2021, seed).instrument is None for seed in range(20))


def test_every_range_changes_the_scene():
    base = scene_of(GENERALISE.model_copy(update={"second_instrument": 1.0}), 3)
    for name in SceneRanges.model_fields:
        value = getattr(GENERALISE, name)
        if isinstance(value, bool):
            other = not value
        elif name == "grounds":
            other = ("cloth",) if base.ground.kind != "cloth" else ("paper",)
        elif name == "tissue_colours":
            other = ((10.0, 200.0, 30.0),)
        elif name == "base_side":
            other = "bottom"
        elif name == "second_instrument":
            other = 0.0
        elif name == "variety":
            continue  # it is drawn for a framed session: tests/simulation/test_varied.py
        elif name == "tissue_over_tip":
            other = 0.0 if base.tissue.over_tip else 1.0
        elif isinstance(value, tuple):
            other = tuple(sorted(type(x)(2 * x + (x == 0)) for x in value))
        else:
            other = type(value)(1.5 * value)
        update = {"second_instrument": 1.0} | {name: other}
        assert scene_of(GENERALISE.model_copy(update=update), 3) != base, name


def test_ranges_in_the_wrong_order_and_unknown_names_are_refused():
    with pytest.raises(ValidationError, match="low, high"):
        SceneRanges(light=(1.2, 0.8))
    with pytest.raises(ValidationError, match="brightness"):
        SceneRanges(brightness=(0.8, 1.2))


def test_the_base_lies_at_the_chosen_border():
    for side, want in {"left": (0, 240), "right": (640, 240), "top": (320, 0), "bottom": (320, 480)}.items():
        camera = scene_of(SceneRanges(base_side=side), 1).camera()
        base, tip = camera.project(np.array([[0.0, 0.0, 0.0], [0.03, 0.0, 0.0]]))
        assert np.abs(base - want).max() < 20
        assert (np.abs(tip - (319.5, 239.5)) <= np.abs(base - (319.5, 239.5)) + 12).all()
