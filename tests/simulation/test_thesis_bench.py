"""The preset thesis-2021: the thesis's own ranges on one bench."""

import numpy as np
import pytest
from pydantic import ValidationError

from tipforce.simulation import PRESETS, SimulatedBench, sample_set
from tipforce.simulation.world import FAST
from tipforce.simulation.world.settings import MotionSettings

THESIS = PRESETS["thesis-2021"]


def brief(session: int) -> SimulatedBench:
    clock = THESIS.world.clock.model_copy(update={"images_from_s": 2.5})
    world = THESIS.world.model_copy(update={"seconds": 11.0, "tare_s": 1.0, "clock": clock})
    settings = THESIS.model_copy(update={"world": world, "width": 320, "height": 240})
    return SimulatedBench(settings, 3, session, resolution=FAST)


@pytest.fixture(scope="module")
def benches() -> tuple[SimulatedBench, SimulatedBench]:
    return brief(0), brief(1)


def test_the_tip_stays_in_contact_within_the_thesis_s_forces(benches):
    for bench in benches:
        trajectory = bench.trajectory
        beating = trajectory.time_s > 2.5
        force_n = np.linalg.norm(trajectory.contact.force_n[beating], axis=1)
        assert trajectory.contact.touching[beating].all()
        assert force_n.min() == pytest.approx(0.160, rel=0.05)
        assert force_n.max() == pytest.approx(0.275, rel=0.05)
        assert 5.0 <= 2e3 * bench.session.motion.amplitude_m <= 10.0, "peak to peak, in mm"
        assert bench.knob_log()[1] == pytest.approx(10.0)


def test_no_image_is_taken_before_the_approach_is_over(benches):
    for bench in benches:
        assert bench.frame_s.min() > 2.4
        assert len(bench.frame_s) > 190


def test_sessions_share_the_bench_and_differ_in_motion_and_noise(benches):
    first, second = benches
    assert first.imaging.scene == second.imaging.scene
    assert first.session_info.views == second.session_info.views, "the scale was measured once"
    names = ("device", "contact_angle_deg", "tilt_deg", "wall_stiffness_n_per_m", "friction", "out_of_plane_per_m")
    one, two = (bench.session.bench_model.parameters for bench in benches)
    assert [getattr(one, name) for name in names] == [getattr(two, name) for name in names]
    assert (one.beat_hz, one.lateral_phase) != (two.beat_hz, two.lateral_phase)
    corner = [bench.frame(0).image[:40, -40:].astype(int) for bench in benches]
    assert np.abs(corner[0] - corner[1]).mean() > 0.5, "the noise of each session is its own"


def test_another_seed_is_another_bench(benches):
    other = SimulatedBench(benches[0].preset_settings, 4, 0, resolution=FAST)
    assert other.imaging.scene != benches[0].imaging.scene
    assert other.session.bench_model.parameters.device != benches[0].session.bench_model.parameters.device


@pytest.mark.slow
def test_single_images_come_from_the_same_bench_and_from_contact_alone():
    wanted = sample_set(THESIS, seed=3, samples=20, per_session=10)
    bench = wanted.bench(0)
    assert bench.imaging.scene.lens == SimulatedBench(THESIS, 3, 0, resolution=FAST).imaging.scene.lens
    assert bench.frame_s[wanted.frames(bench, 0)].min() > 6.4


def test_a_smallest_force_needs_a_tolerance():
    with pytest.raises(ValidationError, match="least_force_n needs peak_within_n"):
        MotionSettings(least_force_n=(0.1, 0.1))
