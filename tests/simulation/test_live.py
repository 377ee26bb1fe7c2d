"""The simulated bench while it runs: what is commanded happens, within limits, and nothing else changes."""

import math
import time
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tipforce.mechanics import solve_static_spatial
from tipforce.simulation import (
    PRESETS,
    FluoroSettings,
    LiveSimulation,
    RealTimeClock,
    SimulatedBench,
    SimulationSettings,
    collect_truth,
)
from tipforce.types import Actuators, Frame, Source, Wrench

DOCS = Path(__file__).resolve().parents[2] / "docs" / "simulation.md"

SETTINGS = SimulationSettings.model_validate(
    {
        "world": {
            "seconds": 8.0,
            "tare_s": 1.0,
            "shaft": {"creep_share": 0.0},
            "actuation": {"drift_rms": 0.0},
            "wall": {"contact_angle_deg": [30, 30], "friction": [0, 0], "tilt_deg": [0, 0]},
            "clock": {"fps": 6.0},
            "motion": {"peak_within_n": 5e-3},
        },
        "scene": {"objects": [0, 0]},
        "width": 160,
        "height": 120,
    }
)
ALL = {"advance_mm", "knob_deg", "stage_forward_mm", "stage_across_mm"}


@pytest.fixture(scope="module")
def simulation():
    return LiveSimulation(SETTINGS, seed=2, images=False)


def content_of(event):
    """Kind and content of an event."""
    if isinstance(event, Frame):
        return event.view, (event.stamp_ns, event.image.tobytes())
    if isinstance(event, Wrench):
        return "wrench", (event.stamp_ns, event.frame, event.force_n.tobytes(), event.torque_nm.tobytes())
    return event.stream, (event.stamp_ns, dict(event.values))


def until(bench, seconds):
    """Let time go on; returns the events."""
    events = []
    for event in bench.source:
        events.append(event)
        if bench.clock.now_ns() >= seconds * 1e9:
            break
    return events


def test_without_commands_each_stream_is_the_recorded_one_to_the_byte():
    recorded, live = defaultdict(list), defaultdict(list)
    bench = SimulatedBench(SETTINGS, seed=2)
    for event in bench:
        kind, content = content_of(event)
        recorded[kind].append(content)
    with LiveSimulation(SETTINGS, seed=2) as running:
        assert isinstance(running.source, Source)
        for event in running.source:
            kind, content = content_of(event)
            live[kind].append(content)
            if isinstance(event, Frame):  # an exposure must have ended, and its image must have come through
                assert running.clock.now_ns() >= event.stamp_ns + 15_000_000
        assert live == recorded
        assert running.source.session_info == bench.session_info
        done, trajectory = running.source.run.final, running.source.trajectory
        np.testing.assert_array_equal(trajectory.wall_m[:done], bench.trajectory.wall_m[:done])
        truth, whole = running.truth(), collect_truth(bench)
        np.testing.assert_array_equal(truth.force_n, whole.force_n)
        np.testing.assert_array_equal(truth.mask_bytes, whole.mask_bytes)


@pytest.mark.slow
def test_two_views_are_the_recorded_ones_to_the_byte_where_images_of_either_are_dropped():
    clock = {"fps": 3.0, "dropped_share": 0.2}
    small = PRESETS["biplane"].model_dump() | {"width": 128, "height": 128, "view_delay_s": 0.05}
    small["world"] |= {"seconds": 8.0, "tare_s": 1.0, "clock": clock, "motion": {"peak_within_n": 5e-3}}
    biplane = FluoroSettings.model_validate(small)
    recorded, live = defaultdict(list), defaultdict(list)
    bench = SimulatedBench(biplane, seed=2)
    for event in bench:
        kind, content = content_of(event)
        recorded[kind].append(content)
    assert bench.arrived("a").tolist() != bench.arrived("b").tolist()
    with LiveSimulation(biplane, seed=2) as running:
        for event in running.source:
            kind, content = content_of(event)
            live[kind].append(content)
        assert {"a", "b"} <= set(live)
        assert live == recorded
        truth, whole = running.truth(), collect_truth(bench)
        np.testing.assert_array_equal(truth.stamp_ns, whole.stamp_ns)
        np.testing.assert_array_equal(truth.others["b"].mask_bytes, whole.others["b"].mask_bytes)


def test_truth_is_there_of_what_has_happened_only(simulation):
    with simulation as bench:
        until(bench, 1.0)
        assert 5 <= len(bench.truth().stamp_ns) <= 7
        assert bench.truth().stamp_ns[-1] <= 1.0e9


def test_the_true_force_now_is_that_of_the_truth_of_the_frames(simulation):
    with simulation as bench:
        now = [
            (bench.clock.now_ns(), bench.true_force_n())
            for _ in bench.source
            if 0 <= bench.clock.now_ns() < 6_000_000_000
        ]
        truth = bench.truth()
    then = truth.stamp_ns < 5_900_000_000
    true_n = np.linalg.norm(truth.force_n[then], axis=1)
    assert true_n.max() > 0.02
    np.testing.assert_allclose(np.interp(truth.stamp_ns[then], *np.transpose(now)), true_n, atol=3e-3)


orders = st.lists(
    st.tuples(st.floats(0.0, 1.0), st.sampled_from(sorted(ALL)), st.floats(-150, 150) | st.just(math.nan)),
    max_size=5,
)


@settings(max_examples=8, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(orders=orders)
def test_no_axis_exceeds_its_limits_or_moves_before_its_delay(simulation, orders):
    with simulation as still:
        until(still, 1.2)
        programme = still.source.trajectory
    with simulation as bench:
        actuators, first = bench.actuators, {}
        for when, name, target in sorted(orders, key=lambda order: order[0]):
            until(bench, when)
            first.setdefault(name, bench.clock.now_ns() * 1e-9)
            if math.isnan(target):
                actuators.stop(name)
                continue
            taken, limits = actuators.command({name: target}), actuators.limits[name]
            assert taken.targets[name] == min(max(target, limits.low), limits.high)
            assert taken.clipped == ({} if limits.low <= target <= limits.high else {name: target})
        until(bench, 1.2)
        trajectory, world, rows = bench.source.trajectory, SETTINGS.world, slice(0, 1600)
        delay = {"advance_mm": world.clamp.delay_s, "knob_deg": world.knob_drive.delay_s}
        for name, column in (
            ("advance_mm", lambda c: 1e3 * c.advance_m),
            ("knob_deg", lambda c: c.knob_deg),
            ("stage_forward_mm", lambda c: 1e3 * c.stage_m[:, 0]),
            ("stage_across_mm", lambda c: 1e3 * c.stage_m[:, 1]),
        ):
            places, limits = column(trajectory)[rows], actuators.limits[name]
            step = {"knob_deg": world.knob_drive.step_deg}.get(name, 1e3 * world.motion.step_m)
            assert limits.low <= places.min() <= places.max() <= limits.high
            assert np.abs(np.diff(places)).max() <= 1e-3 * limits.max_speed + 1.001 * step
            over = 50  # steps of the motor are small beside the way in this many instants
            mean = (places[over:] - places[:-over]) / (1e-3 * over)
            most = limits.max_acceleration * 1e-3 * over + 4 * step / (1e-3 * over)
            assert np.abs(mean[over:] - mean[:-over]).max() <= most
            moves = first.get(name, math.inf) + delay.get(name, world.motion.delay_s)
            before = trajectory.time_s[rows] <= moves
            np.testing.assert_array_equal(places[before], column(programme)[rows][before])


def test_a_clamp_whose_scale_begins_elsewhere_is_commanded_and_read_on_its_scale(simulation):
    clamp = SETTINGS.world.clamp.model_copy(update={"home_m": 8e-3, "logged": True})
    settings = SETTINGS.model_copy(update={"world": SETTINGS.world.model_copy(update={"clamp": clamp})})
    with simulation as bench, LiveSimulation(settings, seed=2, images=False) as other:
        low, high = (bench.actuators.limits["advance_mm"].low, bench.actuators.limits["advance_mm"].high)
        assert other.actuators.limits["advance_mm"].low == pytest.approx(low + 8.0)
        assert other.actuators.limits["advance_mm"].high == pytest.approx(high + 8.0)
        for each, target in ((bench, 2.0), (other, 10.0)):
            until(each, 0.2)
            each.actuators.command({"advance_mm": target})
        events = until(other, 1.0)
        until(bench, 1.0)
        np.testing.assert_array_equal(other.source.trajectory.advance_m, bench.source.trajectory.advance_m)
        assert other.actuators.read().values["advance_mm"] == pytest.approx(10.0, abs=0.01)
        logged = [event.values["advance_mm"] for event in events if "advance_mm" in getattr(event, "values", {})]
        assert logged[0] == pytest.approx(8.0, abs=0.01)
        assert logged[-1] == pytest.approx(10.0, abs=0.02)


def test_what_cannot_be_done_is_refused_and_nothing_moves(simulation):
    with simulation as bench:
        actuators = bench.actuators
        assert isinstance(actuators, Actuators)
        assert set(actuators.limits) == ALL
        with pytest.raises(ValueError, match="advance_cm: there is no such axis; there are advance_mm, knob_deg"):
            actuators.command({"knob_deg": 20.0, "advance_cm": 1.0})
        with pytest.raises(ValueError, match="advance_mm: expected a finite number, got nan"):
            actuators.command({"knob_deg": 20.0, "advance_mm": math.nan})
        with pytest.raises(ValueError, match="lift_mm: there is no such axis"):
            actuators.stop("knob_deg", "lift_mm")
        until(bench, 0.5)
        assert actuators.read().values["knob_deg"] == 10.0
    with pytest.raises(RuntimeError, match="closed"):
        actuators.command({"advance_mm": 1.0})
    with pytest.raises(RuntimeError, match="with statement"):
        _ = LiveSimulation(SETTINGS).source


def test_the_same_commands_give_the_same_events_and_others_do_not(simulation):
    def play(push_mm):
        with simulation as bench:
            for count, event in enumerate(bench.source):
                if count == 1500:
                    bench.actuators.command({"advance_mm": push_mm, "stage_forward_mm": 0.0})
                if count == 2500:
                    bench.actuators.stop()
                if count == 3000:
                    return
                yield content_of(event)

    once, again, other = (list(play(push)) for push in (6.0, 6.0, 6.1))
    assert once == again
    assert once[:1500] == other[:1500]
    assert once != other


def test_stop_brakes_all_axes_and_they_stay(simulation):
    with simulation as bench:
        until(bench, 1.5)  # the stage is on its way to the tip
        bench.actuators.command({"advance_mm": 15.0, "knob_deg": 60.0})
        until(bench, 1.6)
        bench.actuators.stop()
        until(bench, 2.0)
        rest = bench.actuators.read().values
        assert 1.0 < rest["advance_mm"] < 10.0
        assert 11.0 < rest["knob_deg"] < 40.0
        until(bench, 2.5)
        assert bench.actuators.read().values == rest
        stage = [e.values for e in until(bench, 2.7) if content_of(e)[0] == "stage"]
        assert all(values["stage_forward_mm"] == pytest.approx(rest["stage_forward_mm"], abs=1e-3) for values in stage)
        bench.actuators.command({"knob_deg": 10.0})  # what was stopped can be sent on again
        until(bench, 4.0)
        assert bench.actuators.read().values["knob_deg"] == pytest.approx(10.0, abs=0.06)


def test_a_step_arrives_late_by_delay_and_lag(simulation):
    clamp = SETTINGS.world.clamp
    with simulation as bench:
        until(bench, 0.3)
        now = bench.clock.now_ns() * 1e-9
        bench.actuators.command({"advance_mm": 1.0})
        until(bench, 0.8)
        trajectory = bench.source.trajectory
        moved = 1e3 * trajectory.advance_m
        begun = trajectory.time_s[np.flatnonzero(moved > 0)[0]] - now
        assert clamp.delay_s <= begun <= clamp.delay_s + 12e-3  # a lag of 10 ms hides the first microsteps
        # At rest the way left undone is the mean delay: dead time, lag and the drive's ramp (a triangle here).
        rows = (trajectory.time_s > now) & (trajectory.time_s <= now + 0.4)
        area_s = float((1.0 - moved[rows]).sum()) * 1e-3
        ramp_s = math.sqrt(1e-3 / clamp.max_acceleration_m_per_s2)
        assert area_s == pytest.approx(clamp.delay_s + clamp.lag_s + ramp_s, abs=3e-3)


def hold_still(bench, forward_mm, seconds):
    """The wall at rest, so far beyond where it first met the tip."""
    bench.actuators.command({"stage_forward_mm": forward_mm, "stage_across_mm": 0.0})
    until(bench, seconds)


def test_advancing_into_the_wall_raises_the_force_as_the_rods_stiffness_says(simulation):
    with simulation as bench:
        hold_still(bench, 4.0, 2.5)
        source = bench.source
        row = source.run.done - 1
        before = source.trajectory.contact.force_n[row]
        bench.actuators.command({"advance_mm": 1.0})
        until(bench, 4.5)
        risen = float(np.linalg.norm(source.trajectory.contact.force_n[source.run.done - 1]) - np.linalg.norm(before))
        bench_model = source.session.bench_model
        bent = bench_model.rod.precurvature_per_m + np.array([0.0, 0.0, source.trajectory.curvature_per_m[row]])
        # its end is the dome's middle, through which a wall without friction pushes
        to_dome = bench_model.rod.rigid_length_m - bench_model.radius_m
        rod = replace(bench_model.rod, precurvature_per_m=bent, rigid_length_m=to_dome)
        normal, push = np.asarray(bench_model.wall.normal), float(np.linalg.norm(before))
        assert push > 0.02
        back = [float(solve_static_spatial(rod, -force * normal).tip_m @ normal) for force in (push, push + risen)]
        compliance = (back[0] - back[1]) / risen + 1.0 / bench_model.wall.stiffness_n_per_m
        assert risen == pytest.approx(1e-3 * normal[0] / compliance, rel=0.03)


def test_the_knobs_play_of_one_degree_shows(simulation):
    with simulation as bench:
        trajectory, gain = bench.source.trajectory, SETTINGS.world.actuation.gain_per_m_deg

        def curvature_at(knob_deg, seconds):
            bench.actuators.command({"knob_deg": knob_deg})
            until(bench, seconds)
            return trajectory.curvature_per_m[bench.source.run.done - 1]

        up = curvature_at(13.05, 0.5)
        assert curvature_at(12.15, 1.0) == up  # 0.9 degrees back
        down = curvature_at(11.025, 1.5)  # 2.025 degrees back
        factor = bench.source.session.bench_model.parameters.knob_factor
        assert up - down == pytest.approx(1.025 * gain * factor, abs=0.15 * gain)


def test_real_time_waits_for_the_machines_clock():
    with LiveSimulation(SETTINGS, seed=2, real_time=True, images=False) as bench:
        started, zero = time.monotonic(), bench.clock.now_ns()
        until(bench, 0.3)
        assert time.monotonic() - started >= 0.29 - 1e-9 * zero
        sent = bench.actuators.command({"advance_mm": 1.0}).stamp_ns
        assert sent >= 0.3e9
        assert bench.actuators.read().values["advance_mm"] == 0.0
        until(bench, 0.6)
        assert bench.actuators.read().values["advance_mm"] > 0.5


def test_in_real_time_a_slow_computer_runs_it_slower_and_draws_every_image(simulation, monkeypatch):
    monkeypatch.setattr(simulation, "_real_time", True)
    monkeypatch.setattr(simulation, "_images", True)
    with simulation as bench:
        frames = (event for event in bench.source if isinstance(event, Frame))
        stamps, ages_s = [next(frames).stamp_ns], []
        for _ in range(3):
            time.sleep(0.5)  # a computer that is as slow as the test says
            stamps.append(next(frames).stamp_ns)
            ages_s.append((bench.clock.now_ns() - stamps[-1]) * 1e-9)
        pace = bench.clock.pace
    periods = np.diff(stamps) * 6e-9  # of 1/6 s
    assert periods.tolist() == pytest.approx([1.0, 1.0, 1.0], abs=0.05)
    assert max(ages_s) < 0.3
    assert 0.05 < pace < 0.8


def test_a_halt_is_no_slow_computer():
    clock = RealTimeClock(0)
    clock.wait_for(clock.now_ns() - 60_000_000_000)  # as after a minute of compiling
    assert clock.now_ns() < -59_000_000_000
    assert clock.pace == 1.0


@pytest.mark.walkthrough
def test_the_closed_loop_of_the_docs_holds_its_force_on_a_wall_at_rest(capsys):
    code = DOCS.read_text(encoding="utf-8").split("```python\n", 1)[1].split("```", 1)[0]
    names = {}
    exec(compile(code, str(DOCS), "exec"), names)
    assert 0.15 < float(capsys.readouterr().out.split()[0]) < 0.25  # what is printed: the sensor's last reading
    truth = names["truth"]
    late = truth.stamp_ns > 6.0e9
    held = np.linalg.norm(truth.force_n[late], axis=1)
    assert late.sum() > 30
    assert np.abs(held - 0.2).max() < 0.02
    assert not truth.touching[truth.stamp_ns < 1.0e9].any()
