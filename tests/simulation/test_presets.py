"""What the presets promise: devices, views, calibration, catheters that can be used."""

import numpy as np
import pytest

from tipforce.geometry import triangulate
from tipforce.simulation import PRESETS, FluoroSettings, SimulatedBench, collect_truth, read_truth, write_truth
from tipforce.simulation.world import run_session
from tipforce.simulation.world._session import UNFIT_CATHETER, catheter_of
from tipforce.simulation.world.settings import MotionSettings, WorldSettings
from tipforce.types import JOINTS, Actuation, Frame


def brief(preset: str, seconds: float = 8.0, **changes):
    settings = PRESETS[preset]
    motion = settings.world.motion.model_copy(update={"peak_within_n": settings.world.motion.peak_within_n or 5e-3})
    world = settings.world.model_copy(update={"seconds": seconds, "tare_s": 1.0, "motion": motion})
    small = {"width": 256, "height": 256} if isinstance(settings, FluoroSettings) else {}
    return settings.model_copy(update={"world": world, **small, **changes})


@pytest.fixture(scope="module")
def biplane() -> SimulatedBench:
    return SimulatedBench(brief("biplane"), 2, 0)


def test_two_views_show_the_same_catheter_in_space(biplane):
    shown = biplane.arrived("a")[[60, 90]]
    for index in shown.tolist():
        lines = [biplane.image_truth(index, view).centreline_px for view in biplane.views]
        cameras = [biplane.imaging.camera(view) for view in biplane.views]
        truth = biplane.interpolator.lines_m(biplane.frame_s[index : index + 1])[0]
        found = triangulate(cameras, np.stack(lines, axis=1))
        np.testing.assert_allclose(found.points_m, truth, atol=1e-9)
        for view, line in zip(biplane.views, lines, strict=True):
            image = biplane.frame(index, view).image
            assert image.shape == (256, 256)
            inside = ((line > 8) & (line < 247)).all(axis=1)
            assert inside.any()


def test_views_exposed_in_turn_show_later_instants_in_the_second_view(biplane):
    turns = SimulatedBench(brief("biplane", view_delay_s=0.033), 2, 0)
    turns.__dict__["session"] = biplane.session  # the same world
    index = int(biplane.arrived("b")[70])
    first, second = (turns.frame(index, view) for view in turns.views)
    assert (first.stamp_ns, second.stamp_ns) == (biplane.stamp_ns[index], biplane.stamp_ns[index] + 33_000_000)
    np.testing.assert_array_equal(first.image, biplane.frame(index, "a").image)
    later = turns.interpolator.lines_m(turns.frame_s[index : index + 1] + 0.033)[0]
    line = turns.image_truth(index, "b").centreline_px
    np.testing.assert_allclose(turns.imaging.camera("b").project(later), line, atol=1e-9)
    at_ns = [(at, stream) for at, stream, row in turns.schedule() if stream > 2 and row == 10]
    assert [stream for _, stream in sorted(at_ns)] == [3, 4]


@pytest.mark.parametrize(
    ("preset", "delay_s", "words"),
    [
        ("biplane", 0.07, "below the time between two pulses of a view, 0.0667 s, got 0.07"),
        ("fluoro", 0.03, "expected two planes with view_delay_s"),
    ],
)
def test_a_delay_between_views_that_cannot_be_is_refused(preset, delay_s, words):
    with pytest.raises(ValueError, match=words):
        FluoroSettings.model_validate(PRESETS[preset].model_dump() | {"view_delay_s": delay_s})


def test_the_stated_calibration_is_off_by_half_a_pixel_and_no_truth(biplane):
    info, values = biplane.session_info, biplane.values()
    points = biplane.interpolator.lines_m(np.array([7.0]))[0]
    pose = np.array(values["isocentre_from_base"])
    at_isocentre = points @ pose[:, :3].T + pose[:, 3]
    for view in biplane.views:
        assert info.views[view].projection_frame == "isocentre"
        stated, true = np.array(info.views[view].projection), np.array(values["projection"][view])
        seen = [rows @ matrix[:, :3].T + matrix[:, 3] for rows, matrix in ((at_isocentre, stated), (points, true))]
        pixels = [rows[:, :2] / rows[:, 2:] for rows in seen]
        off = np.linalg.norm(pixels[0] - pixels[1], axis=1)
        assert 0.001 < np.sqrt((off**2).mean()) < 1.0  # 0.5 px rms over the working volume at 512 columns


def test_the_truth_of_both_views_comes_back(biplane, tmp_path):
    frames = biplane.arrived("a")[[5, 60]]
    truth = collect_truth(biplane, frames)
    write_truth(truth, tmp_path / "session_00.truth.npz")
    again = read_truth(tmp_path / "session_00.truth.npz")
    assert list(again.others) == ["b"]
    np.testing.assert_array_equal(again.others["b"].centreline_px, truth.others["b"].centreline_px)
    assert not np.allclose(again.centreline_px, again.others["b"].centreline_px)
    np.testing.assert_array_equal(again.mask(1), biplane.image_truth(int(frames[1]), "a").mask)
    np.testing.assert_array_equal(again.others["b"].mask(1), biplane.image_truth(int(frames[1]), "b").mask)


def test_images_of_a_view_are_the_same_in_any_order():
    settings = brief("fluoro")
    one, two = SimulatedBench(settings, 2, 0), SimulatedBench(settings, 2, 0)
    last = [one.frame(index).image for index in (40, 41, 42)][-1]
    np.testing.assert_array_equal(last, two.frame(42).image)
    assert one.views == ("camera",)


def test_a_guidewire_has_no_knob():
    bench = SimulatedBench(brief("guidewire"), 0, 0)
    streams = set()
    for at_ns, stream, row in bench.schedule()[:400]:
        event = bench.event(stream, row) if stream < 3 else Frame(at_ns, np.zeros((2, 2), np.uint8))
        if isinstance(event, Actuation):
            streams.add(event.stream)
    assert JOINTS not in streams
    assert bench.session_info.actuation.knob_gain_per_m_deg is None
    rod = bench.session.bench_model.rod
    assert rod.stiffness_profile[0] == 1.0
    assert rod.stiffness_profile[-1] == pytest.approx(0.05)
    assert bench.session_info.catheter.diameter_m == pytest.approx(0.035 * 25.4e-3, abs=1e-6)


def test_a_shaft_may_rest_in_a_shape_that_is_no_arc():
    settings = brief("bench-2021", seconds=4.0)
    shaft = settings.world.shaft.model_copy(update={"rest_curvature_per_m": (30.0, 0.0, -30.0)})
    world = settings.world.model_copy(update={"shaft": shaft})
    bench = SimulatedBench(settings.model_copy(update={"world": world}), 0, 0)
    assert bench.session_info.catheter.rest_curvature_per_m == (30.0, 0.0, -30.0)
    line = bench.interpolator.lines_m(bench.frame_s[:1])[0, :, :2]
    angle = np.unwrap(np.arctan2(*np.diff(line, axis=0).T[::-1]))
    knob = bench.session_info.actuation.knob_gain_per_m_deg * 10.0 * 0.04
    assert angle[len(angle) // 2] - angle[0] > 0.2
    assert angle[-1] - angle[0] == pytest.approx(knob, abs=0.15), "the S turns back"


@pytest.mark.parametrize("preset", ["guidewire", "catheter-5f"])
def test_a_devices_forces_stay_in_its_own_range(preset):
    settings = brief(preset).world
    session = run_session(settings, 4, 0)
    peak = float(np.linalg.norm(session.trajectory.contact.force_n, axis=1).max())
    low, high = settings.motion.peak_force_n
    assert 0.95 * low <= peak <= 1.05 * high


def hard(sessions_per_catheter: int) -> WorldSettings:
    """Catheters of which the soft ones cannot be pressed to the forces with so short a way."""
    generalise = PRESETS["generalise"].world
    return generalise.model_copy(
        update={
            "seconds": 8.0,
            "tare_s": 1.0,
            "motion": MotionSettings(amplitude_m=(0.5e-3, 1.2e-3), respiration_m=(0.0, 0.1e-3)),
            "wall": generalise.wall.model_copy(update={"contact_angle_deg": (70.0, 80.0), "tilt_deg": (0.0, 0.0)}),
            "shaft": generalise.shaft.model_copy(update={"sessions_per_catheter": sessions_per_catheter}),
        }
    )


def test_a_catheter_that_reaches_no_force_is_drawn_again_for_all_of_its_sessions_alike(monkeypatch):
    monkeypatch.setattr("tipforce.simulation.world._session._TRIALS", 4)
    catheters = [catheter_of(hard(5), 0, number) for number in range(0, 15, 5)]
    assert any(each.redraws for each in catheters)
    for number, each in zip(range(0, 15, 5), catheters, strict=True):
        assert catheter_of(hard(5), 0, number + 3) == each
    assert len({each.device for each in catheters}) == len(catheters)


def test_the_number_of_redrawn_catheters_stands_in_the_truth(monkeypatch):
    monkeypatch.setattr("tipforce.simulation.world._session.catheter_of", lambda *_: _third())
    session = run_session(brief("generalise").world, 0, 0)
    assert session.redraws[UNFIT_CATHETER] == 2


def _third():
    from tipforce.simulation.world._session import SampledDevice

    return SampledDevice(catheter_of(PRESETS["generalise"].world, 0, 0).device, 2)
