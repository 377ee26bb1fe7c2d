"""A session of the simulated bench as a source of events."""

import numpy as np
import pytest

from tipforce.simulation import SimulatedBench, collect_truth
from tipforce.types import JOINTS, STAGE, Source


def stream_of(event):
    return getattr(event, "stream", type(event).__name__)


@pytest.fixture(scope="module")
def streams(short):
    """By stream, each event with the time on the bench's clock at which it came."""
    bench, found = SimulatedBench(short, seed=21, session=1), {}
    assert isinstance(bench, Source)
    with bench as events:
        for event in events:
            found.setdefault(stream_of(event), []).append((event, bench.clock.now_ns()))
    return found


def test_it_is_a_source_whose_streams_are_in_order(streams, bench):
    assert set(streams) == {"Frame", "Wrench", JOINTS, STAGE}
    for events in streams.values():
        assert (np.diff([event.stamp_ns for event, _ in events]) > 0).all()
    assert {event.frame for event, _ in streams["Wrench"]} == {"sensor"}
    assert streams[JOINTS][0][0].values == {"knob_deg": 10.0}
    assert set(streams[STAGE][0][0].values) == {"stage_forward_mm", "stage_across_mm"}
    assert [event.stamp_ns for event, _ in streams["Frame"]] == bench.stamp_ns.tolist()


def test_all_comes_at_its_time_on_the_cameras_clock_and_readings_with_stamps_of_their_own(streams, bench):
    for name in ("Frame", JOINTS, STAGE):
        assert all(now == event.stamp_ns for event, now in streams[name]), name
    truth = collect_truth(bench)
    assert 1e-3 < abs(truth.clock_offset_s) <= 0.08
    own = np.array([event.stamp_ns for event, _ in streams["Wrench"]]) * 1e-9
    came = np.array([now for _, now in streams["Wrench"]]) * 1e-9
    after = own + truth.clock_offset_s > 0  # what came before the camera's zero waits for it
    np.testing.assert_allclose(
        came[after], ((1 + truth.clock_drift) * own + truth.clock_offset_s)[after], rtol=0, atol=1e-8
    )


def test_the_same_arguments_give_the_same_bytes_and_others_do_not(bench, short):
    again = SimulatedBench(short, seed=21, session=1)
    np.testing.assert_array_equal(again.frame(40).image, bench.frame(40).image)
    np.testing.assert_array_equal(again.log.force_n, bench.log.force_n)
    assert (bench.frame(40).image != bench.frame(41).image).any()
    other = SimulatedBench(short, seed=21, session=2)
    assert (other.frame(40).image != bench.frame(40).image).any()
    assert other.values() != bench.values()


def test_what_the_bench_tells_is_near_the_truth_but_not_the_truth(bench):
    info, truth = bench.session_info, collect_truth(bench)
    true_scale = truth.values["lens"]["scale_m_per_px"] * 640 / bench.settings.width
    stated = info.view("camera").metres_per_px
    assert stated == pytest.approx(true_scale, rel=0.0105)
    assert stated != true_scale
    assert info.sensor.no_contact_s == (0.0, 2.0)
    assert info.simulated
    assert info.catheter.flexible_length_m != truth.values["flexible_length_m"]
    assert info.catheter.bending_stiffness_nm2 != truth.values["stiffness_nm2"]
