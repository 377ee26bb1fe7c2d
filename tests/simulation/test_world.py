"""The world of the simulated bench: waves, drives, drift, sensor, and whole sessions."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tipforce.errors import InputError
from tipforce.mechanics import HEART_WAVES, HeartMotion
from tipforce.simulation.world import (
    FAST,
    Axis,
    AxisModel,
    Drive,
    ForceSensor,
    SensorLoad,
    run_session,
    smooth_centrelines,
)
from tipforce.simulation.world._motion_profile import slow_drift
from tipforce.simulation.world.settings import ClockSettings, MotionSettings, SensorSettings, WorldSettings

SHORT = WorldSettings(seconds=14.0, tare_s=2.0)


@pytest.mark.parametrize("wave", HEART_WAVES.values())
def test_waves_fill_the_span_and_repeat(wave):
    cycles = np.linspace(0, 1, 2001)
    assert wave(cycles).min() == pytest.approx(-1.0, abs=1e-3)
    assert wave(cycles).max() == pytest.approx(1.0, abs=1e-3)
    np.testing.assert_allclose(wave(cycles + 3), wave(cycles), atol=1e-9)


def test_a_half_wave_rests_longer_than_it_pushes():
    values = HEART_WAVES["half-wave PQRST"](np.linspace(0, 1, 1000, endpoint=False))
    assert (values < 0).mean() > 0.6


@given(
    goals=st.lists(st.floats(-0.02, 0.02), min_size=1, max_size=5),
    speed=st.floats(0.02, 0.3),
    acceleration=st.floats(0.5, 10.0),
    lag=st.sampled_from([0.0, 5e-3, 30e-3]),
)
def test_an_axis_never_exceeds_its_limits_and_arrives(goals, speed, acceleration, lag):
    axis = Axis(AxisModel(1e-5, speed, acceleration, lag_s=lag, low=-0.015, high=0.015), dt_s=1e-3)
    wait = int(1000 * (0.04 / speed + 2 * speed / acceleration + 10 * lag + 0.2))
    place = axis.follow(np.repeat(goals, wait))
    assert np.abs(place).max() <= 0.015
    velocity = np.diff(np.concatenate([[0.0], place])) / 1e-3
    assert np.abs(velocity).max() <= speed * (1 + 1e-9)
    assert np.abs(np.diff(velocity)).max() <= acceleration * 1e-3 * (1 + 1e-6)
    assert place[-1] == pytest.approx(np.clip(goals[-1], -0.015, 0.015), abs=2e-5)


def test_a_drive_is_late_by_its_delay_and_reads_whole_steps():
    model = AxisModel(step=1e-4, max_speed=1.0, max_acceleration=50.0, delay_s=0.01)
    programme = 1e-2 * np.sin(2 * np.pi * np.arange(0, 1, 1e-3))
    commanded, smooth, places = Drive(model, 1e-3, programme, by_hand=False).run(0, 1000)
    np.testing.assert_array_equal(commanded, programme)
    np.testing.assert_allclose(smooth[100:], programme[90:-10], atol=1e-5)
    np.testing.assert_allclose(places, smooth, atol=0.5001e-4)
    assert np.unique(np.round(places / 1e-4 % 1.0, 6) % 1.0).tolist() == [0.0]


@given(
    cuts=st.lists(st.integers(1, 400), max_size=6),
    orders=st.lists(st.tuples(st.integers(0, 399), st.sampled_from([-3e-3, 2e-3, 4e-3, np.nan])), max_size=4),
    by_hand=st.booleans(),
)
def test_a_drive_does_the_same_however_its_time_is_cut(cuts, orders, by_hand):
    model = AxisModel(step=1e-5, max_speed=0.05, max_acceleration=2.0, delay_s=5e-3, lag_s=4e-3)
    programme = 1e-3 * np.sin(2 * np.pi * np.arange(0, 0.4, 1e-3))

    def run(edges):
        drive = Drive(model, 1e-3, programme, by_hand=by_hand)
        for order in sorted(orders, key=lambda order: order[0]):
            drive.command(*order)
        return np.hstack([drive.run(*edge) for edge in pairwise(edges)])

    np.testing.assert_array_equal(run(sorted({0, 400, *cuts})), run([0, 400]))


@given(at=st.integers(5, 300), speed=st.floats(-0.04, 0.04))
def test_a_stop_brakes_as_fast_as_the_axis_may_and_then_holds(at, speed):
    model = AxisModel(step=1e-6, max_speed=0.05, max_acceleration=2.0, delay_s=5e-3)
    drive = Drive(model, 1e-3, speed * np.arange(0, 0.4, 1e-3), by_hand=True)
    drive.command(at, np.nan)
    _, smooth, _ = drive.run(0, 400)
    velocity = np.diff(smooth) / 1e-3
    np.testing.assert_allclose(velocity[: at + 4], speed, atol=1e-9)  # as before, until the command has come through
    rests = at + 5 + int(np.ceil(abs(speed) / 2.0 / 1e-3))
    assert np.abs(velocity[rests:]).max(initial=0.0) < 1e-9
    assert np.abs(np.diff(velocity)).max() <= 2.0 * 1e-3 * (1 + 1e-6)


def test_a_heart_motion_is_what_the_thesis_bench_was_commanded():
    heart = HeartMotion(5e-3, 1.25, "half-wave PQRST", lateral_share=0.5, respiration_m=1e-3, standoff_m=2e-3)
    times = np.arange(0, 4.0, 0.01)
    forward, across = np.transpose([list(heart.command(t).values()) for t in times.tolist()])
    assert heart.command(0.0).keys() == {"stage_forward_mm", "stage_across_mm"}
    np.testing.assert_allclose(np.ptp(across), 5.0, atol=0.01)
    np.testing.assert_allclose(forward, 2 * across + np.sin(2 * np.pi * 0.25 * times) - 2.0, atol=2e-4)
    with pytest.raises(ValueError, match="wave: expected one of sine, half-wave PQRST, got square"):
        HeartMotion(5e-3, 1.0, "square")


def test_drift_has_its_size_and_its_memory():
    rows = np.array([slow_drift(0.01, 20.0, np.arange(0, 60, 0.1), np.random.default_rng(k)) for k in range(400)])
    assert rows.std() == pytest.approx(0.01, rel=0.05)
    correlation = (rows[:, 0] * rows[:, 200]).mean() / (rows[:, 0].std() * rows[:, 200].std())
    assert correlation == pytest.approx(np.exp(-1.0), abs=0.12)  # 20 s apart


def test_the_sensor_reads_tip_weight_and_inertia_in_its_own_frame_and_time():
    t = np.arange(-0.5, 4.0, 1e-3)
    tip = np.outer(np.sin(3 * t), [0.1, 0.2, 0.05])
    pull = np.outer(np.cos(5 * t), [0.5, -0.3, 0.0])
    load = SensorLoad(t, tip, np.tile([0.0, 0.0, 0.02], (t.size, 1)), pull)
    exact = SensorSettings(noise_n=0.0, torque_noise_nm=0.0, step_n=(1e-9, 1e-9, 1e-9), torque_step_nm=1e-9)
    sensor = ForceSensor(exact, ClockSettings(), np.radians(33.4), 3.0, np.random.default_rng(4))
    sensor.take(load, 0, len(sensor.log.stamp_ns))
    log = sensor.log
    assert log.nominal_angle_deg == 33.0
    own = log.stamp_ns * 1e-9
    np.testing.assert_allclose(log.true_s, own * (1 + log.drift) + log.offset_s, atol=1e-12)
    true = np.stack([np.interp(log.true_s, t, (tip - 0.05 * pull)[:, k]) for k in range(3)], axis=1)
    true[:, 2] -= 0.05 * 9.80665
    base = (log.force_n - log.bias_n - np.outer(log.true_s, log.drift_n_per_s)) @ log.rotation
    np.testing.assert_allclose(base, true, atol=1e-6)
    turn = np.degrees(np.arctan2(log.rotation[0, 1], log.rotation[0, 0]))
    assert 32.0 <= turn <= 34.0
    np.testing.assert_allclose(log.rotation @ log.rotation.T, np.eye(3), atol=1e-12)
    lever = np.cross([0.0, 0.0, 0.02], np.stack([np.interp(log.true_s, t, tip[:, k]) for k in range(3)], axis=1))
    np.testing.assert_allclose(log.torque_nm @ log.rotation, lever, atol=1e-7)


@pytest.fixture(scope="module")
def sessions():
    return [run_session(SHORT, 3, number) for number in range(2)]


def test_forces_and_free_time_are_what_the_settings_ask_for(sessions):
    for session in sessions:
        contact, time_s = session.trajectory.contact, session.trajectory.time_s
        size = np.linalg.norm(contact.force_n, axis=1)
        assert 0.1425 <= size.max() <= 0.3675
        assert not size[time_s < 2.0].any()
        assert 0.05 <= 1 - contact.touching[time_s > 3.5].mean() <= 0.20
        assert session.motion.amplitude_m <= 10e-3


def test_the_wall_only_pushes_and_friction_stays_in_its_cone(sessions):
    for session in sessions:
        contact, wall = session.trajectory.contact, session.bench_model.wall
        push = -contact.force_n @ np.asarray(wall.normal)
        assert (push[contact.touching] > 0).all()
        along = np.linalg.norm(contact.force_n + np.outer(push, wall.normal), axis=1)
        assert (along <= wall.friction * push + 1e-9).all()
        assert contact.slipping.any()


def test_the_clamp_carries_what_the_wall_does(sessions):
    contact = sessions[0].trajectory.contact
    np.testing.assert_allclose(contact.reaction_force_n, -contact.force_n, atol=1e-12)


def test_the_same_seed_is_the_same_session(sessions):
    again = run_session(SHORT, 3, 1)
    np.testing.assert_array_equal(again.trajectory.contact.force_n, sessions[1].trajectory.contact.force_n)
    assert again.bench_model.parameters == sessions[1].bench_model.parameters
    assert sessions[0].bench_model.parameters != sessions[1].bench_model.parameters


def test_sessions_of_one_catheter_share_it():
    shared = WorldSettings.model_validate({"shaft": {"sessions_per_catheter": 2, "known_to": 0.05}})
    from tipforce.simulation.world._parameters import sample_device

    devices = [sample_device(shared, 0, number) for number in range(4)]
    assert devices[0] == devices[1]
    assert devices[2] == devices[3]
    assert devices[0] != devices[2]


def test_a_session_that_cannot_be_had_says_what_to_change(monkeypatch):
    monkeypatch.setattr("tipforce.simulation.world._session._DRAWS", 2)
    weak = SHORT.model_copy(update={"motion": MotionSettings(amplitude_m=(1e-5, 2e-5), respiration_m=(0.0, 0.0))})
    with pytest.raises(InputError, match="too little force at the largest amplitude; widen motion"):
        run_session(weak, 0, 0)


def test_a_session_without_a_second_of_beats_is_refused_in_a_sentence():
    least = SHORT.model_copy(update={"seconds": 4.5})  # tare 2 s, approach 1.5 s
    assert run_session(least, 3, 0).trajectory.time_s[-1] > 4.5
    with pytest.raises(InputError, match=r"world.seconds=4.4: .* state at least 4.5 s"):
        run_session(SHORT.model_copy(update={"seconds": 4.4}), 3, 0)


def test_the_drawn_line_goes_through_the_rods_nodes_and_is_smooth(sessions):
    contact, rod = sessions[0].trajectory.contact, sessions[0].bench_model.rod
    rows = contact.quaternions[[0, 5000, 9000]]
    lines = smooth_centrelines(rod, rows, 961)
    steps = np.linalg.norm(np.diff(lines, axis=1), axis=2)
    np.testing.assert_allclose(steps, rod.length_m / 960, rtol=1e-3)
    nodes = rod.nodes_m(rows)
    for line, node in zip(lines, nodes, strict=True):
        away = np.linalg.norm(line[:, None] - node[None], axis=2).min(axis=0)
        assert away.max() < 0.55 * rod.length_m / 960
        np.testing.assert_allclose(line[[0, -1]], node[[0, -1]], atol=1e-12)


def test_a_session_in_haste_comes_to_the_forces_that_were_drawn_all_the_same():
    for number in range(4):
        session = run_session(SHORT, 17, number, FAST)
        peak = float(np.linalg.norm(session.trajectory.contact.force_n, axis=1).max())
        assert peak == pytest.approx(session.bench_model.parameters.peak_force_n, abs=12e-3)
        beating = session.trajectory.time_s > SHORT.tare_s + 1.5
        low, high = SHORT.motion.free_share
        assert low <= 1.0 - session.trajectory.contact.touching[beating].mean() <= high


def test_haste_says_in_the_same_words_what_cannot_be_had(monkeypatch):
    monkeypatch.setattr("tipforce.simulation.world._session._DRAWS", 3)
    weak = SHORT.motion.model_copy(update={"amplitude_m": (0.0, 0.2e-3), "respiration_m": (0.0, 0.0)})
    with pytest.raises(InputError, match="too little force at the largest amplitude"):
        run_session(SHORT.model_copy(update={"motion": weak, "seconds": 6.0}), 17, 0, FAST)
