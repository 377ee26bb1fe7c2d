"""The layer in front of the drives: limits, invalid estimates, watchdog, stop key, and the states of a run."""

from collections.abc import Callable

import numpy as np
import pytest

from tipforce.control import (
    ControlSettings,
    ControlState,
    ObserverSettings,
    Path,
    SafetyAction,
    SafetyLayer,
    SafetySettings,
    Sample,
    WallObserver,
)
from tipforce.errors import InputError
from tipforce.types import ForceEstimate, Status

from .conftest import DT_S, FRAME_S, PATH, Plant, estimate_of  # type: ignore[import-not-found]


def layer(**settings: object) -> tuple[Plant, SafetyLayer]:
    plant = Plant(lambda _: 100.0, 0.1)
    made = SafetyLayer(plant, plant.clock, PATH, SafetySettings.model_validate(settings), FRAME_S)  # type: ignore[arg-type]
    return plant, made


def test_the_upper_end_of_the_interval_counts_not_the_force() -> None:
    plant, safety = layer()
    safety.observe(estimate_of(0, 0.2, 0.15), 0)
    assert safety.check()[0] is SafetyAction.PASS
    safety.observe(estimate_of(10, 0.2, 0.21), 10)
    action, reason = safety.check()
    assert action is SafetyAction.OVER_LIMIT
    assert "0.41 N above 0.4 N" in reason
    safety.observe(estimate_of(20, 0.2, 0.18), 20)  # below the limit, not yet below the release
    assert safety.check()[0] is SafetyAction.OVER_LIMIT
    safety.observe(estimate_of(30, 0.2, 0.1), 30)
    assert safety.check()[0] is SafetyAction.PASS
    assert not plant.commands


def test_no_command_goes_faster_or_farther_than_allowed() -> None:
    plant, safety = layer(max_advance_mm_per_s=12.0)
    for number in range(400):
        plant.step()
        safety.observe(estimate_of(plant.clock.now_ns(), 0.1), plant.clock.now_ns())
        safety.command(100.0 if number < 300 else -100.0)
    places = np.array([place for _, place in plant.commands])
    assert np.abs(np.diff(places)).max() <= 12.0 * DT_S + 1e-9
    assert places.max() <= 10.0
    assert places.min() >= -10.0


def test_above_the_limit_the_catheter_is_drawn_back_whatever_is_wanted() -> None:
    plant, safety = layer()
    plant.place = 0.0
    for _ in range(12):
        plant.step()
        safety.observe(estimate_of(plant.clock.now_ns(), 0.5), plant.clock.now_ns())
        assert safety.command(20.0).action is SafetyAction.OVER_LIMIT
    assert plant.commands[-1][1] < plant.commands[0][1] - 2.0


def test_the_operators_limit_counts_where_it_is_smaller_and_at_once() -> None:
    _, safety = layer(limit_n=0.4)
    safety.observe(estimate_of(0, 0.3, 0.02), 0)
    assert safety.check()[0] is SafetyAction.PASS
    safety.set_limit(0.25)  # the force is above it already
    action, reason = safety.check()
    assert (action, safety.limit_n) == (SafetyAction.OVER_LIMIT, 0.25)
    assert "above 0.25 N" in reason
    safety.set_limit(9.0)
    assert safety.limit_n == 0.4
    assert safety.check()[0] is SafetyAction.PASS


def test_without_a_fresh_estimate_it_is_stale_after_200_ms() -> None:
    plant, safety = layer()
    plant.clock.sleep_until_ns(60_000_000)
    safety.observe(estimate_of(0, 0.2), 0)  # the chain is 60 ms late as a rule
    plant.clock.sleep_until_ns(60_000_000 + 199_000_000)
    assert safety.check()[0] is SafetyAction.PASS
    plant.clock.sleep_until_ns(60_000_000 + 201_000_000)
    action, reason = safety.check()
    assert action is SafetyAction.RETRACT
    assert "stale" in reason


def test_an_old_image_that_comes_late_does_not_feed_the_watchdog() -> None:
    plant, safety = layer()
    safety.observe(estimate_of(0, 0.2), 0)
    plant.clock.sleep_until_ns(300_000_000)
    safety.observe(estimate_of(10_000_000, 0.2), 10_000_000)
    assert safety.check()[0] is SafetyAction.RETRACT


def test_a_slow_camera_has_two_and_a_half_frames() -> None:
    plant = Plant(lambda _: 100.0, 0.1)
    safety = SafetyLayer(plant, plant.clock, PATH, SafetySettings(), 0.2)  # type: ignore[arg-type]
    safety.observe(estimate_of(0, 0.2), 0)
    plant.clock.sleep_until_ns(490_000_000)
    assert safety.check()[0] is SafetyAction.PASS
    plant.clock.sleep_until_ns(510_000_000)
    assert safety.check()[0] is SafetyAction.RETRACT


def test_the_stop_key_brakes_at_once_and_lets_nothing_pass(bench: Callable) -> None:
    made = bench(controller="pi")
    made.loop.start()
    made.run(6.0)
    made.loop.stop()
    count = len(made.plant.commands)
    assert made.plant.stops == 1
    made.loop.start()
    made.run(1.0)
    assert len(made.plant.commands) == count
    made.loop.retract()
    made.loop.release()
    made.loop.retract()
    made.run(2.0)
    assert made.plant.place == pytest.approx(-10.0, abs=0.1)


def test_a_run_goes_through_its_states_and_back_when_the_operator_ends_it(bench: Callable) -> None:
    made = bench(controller="pi")
    made.plant.place, made.plant.sent = -8.0, type(made.plant.sent)([(-1.0, -8.0)])
    assert made.run(0.2).max() == 0.0
    assert not made.plant.commands  # idle: nothing moves
    made.loop.start()
    made.run(9.0)
    made.loop.retract()
    made.run(3.0)
    states = [tick.state for tick in made.ticks]
    order = [state for before, state in zip([None, *states], states, strict=False) if state is not before]
    assert order == [
        ControlState.IDLE,
        ControlState.RETRACT,
        ControlState.APPROACH,
        ControlState.CONTACT,
        ControlState.HOLD,
        ControlState.RETRACT,
        ControlState.IDLE,
    ]
    assert made.plant.place == pytest.approx(-10.0, abs=0.1)


def test_at_the_goal_without_contact_it_goes_back(bench: Callable) -> None:
    made = bench(controller="pi", approach_mm_per_s=10.0)
    made.plant.wall_mm = lambda _: 50.0
    made.loop.start()
    made.run(5.0)
    assert made.loop.state is ControlState.IDLE
    assert "without contact" in made.loop.reason
    assert made.plant.place == pytest.approx(-10.0, abs=0.1)


@pytest.mark.parametrize("controller", ["pi", "periodic"])
def test_an_invalid_estimate_in_mid_contact_is_bridged_and_then_drawn_back(bench: Callable, controller: str) -> None:
    made = bench(2.0, 1.0, controller=controller, gain_n_per_mm=0.05, restarts=1)
    made.loop.start()
    made.run(16.0)
    assert made.loop.state is ControlState.HOLD
    made.status = Status.NO_CATHETER
    made.run(0.15)  # the frames before are still on their way
    assert made.loop.state is ControlState.HOLD
    made.run(1.5)
    assert made.loop.state in (ControlState.RETRACT, ControlState.IDLE)
    assert "no_catheter" in made.loop.reason
    first = next(
        row for row, tick in enumerate(made.ticks) if tick.applied.action is SafetyAction.RETRACT and row * DT_S > 16.0
    )
    assert first * DT_S - 16.0 < 0.06 + 0.2 + 2 * FRAME_S
    assert max(made.forces) < 0.4
    assert made.forces[-1] == 0.0
    made.status = Status.VALID
    made.run(4.0)  # begins again by itself, once
    assert made.loop.restarts == 1
    assert made.loop.state is not ControlState.IDLE
    made.silent = True
    made.run(2.0)
    made.silent = False
    made.run(3.0)
    assert made.loop.state is ControlState.IDLE


def test_above_the_limit_for_too_long_all_the_way_back(bench: Callable) -> None:
    made = bench(controller="pi", gain_n_per_mm=0.05, restarts=0)
    made.loop.start()
    made.run(8.0)
    made.half_width_n = 0.6  # not sure of anything any more
    made.run(3.0)
    assert made.loop.state is ControlState.IDLE
    assert "above 0.4 N" in made.loop.reason


def test_start_and_goal_must_fit_the_drives() -> None:
    plant = Plant(lambda _: 0.0, 0.1)
    for start, goal, said in (
        ({"advance_mm": 0.0}, {"knob_deg": 1.0}, "the same axes"),
        ({"advance_mm": 0.0}, {"advance_mm": 0.0}, "two positions"),
    ):
        with pytest.raises(InputError, match=said):
            Path(start, goal)
    for start, goal, said in (
        ({"advance_mm": 0.0}, {"advance_mm": 30.0}, "expected -20 to 20, got 30"),
        ({"knob_deg": 0.0}, {"knob_deg": 30.0}, "there is no axis knob_deg"),
    ):
        with pytest.raises(InputError, match=said):
            SafetyLayer(plant, plant.clock, Path(start, goal), SafetySettings(), FRAME_S)  # type: ignore[arg-type]


def test_a_path_of_two_axes_moves_them_together_within_both_limits() -> None:
    path = Path({"advance_mm": -5.0, "knob_deg": 0.0}, {"advance_mm": 5.0, "knob_deg": 60.0})
    assert path.length_mm == 20.0
    assert path.targets(10.0) == {"advance_mm": 0.0, "knob_deg": 30.0}
    assert path.position_mm({"advance_mm": 0.0, "knob_deg": 30.0}) == pytest.approx(10.0)


def test_a_target_at_the_limit_is_refused() -> None:
    with pytest.raises(ValueError, match=r"below safety\.limit_n"):
        ControlSettings(target_n=0.4)


def abstained(stamp_ns: int, low_n: float, high_n: float) -> ForceEstimate:
    return ForceEstimate.invalid(
        stamp_ns, Status.UNOBSERVABLE, f"{low_n:g} to {high_n:g} N", abstained_interval_n=(low_n, high_n)
    )


def test_an_abstained_interval_above_the_limit_draws_back() -> None:
    plant, safety = layer()
    for number in range(4):
        plant.clock.sleep_until_ns(number * 33_000_000)
        safety.observe(estimate_of(number * 33_000_000, 0.2, 0.05), number * 33_000_000)
    assert safety.check()[0] is SafetyAction.PASS
    plant.clock.sleep_until_ns(132_000_000)
    safety.observe(abstained(132_000_000, 0.1, 0.3), 132_000_000)
    assert safety.check()[0] is SafetyAction.COAST
    safety.observe(abstained(133_000_000, 0.0, 0.7), 133_000_000)
    action, reason = safety.check()
    assert action is SafetyAction.OVER_LIMIT
    assert "upper end 0.70 N above 0.4 N" in reason


def test_abstained_intervals_below_the_limit_are_enough_for_a_second() -> None:
    plant, safety = layer()
    safety.observe(estimate_of(0, 0.2, 0.05), 0)
    actions = []
    for number in range(1, 34):
        stamp_ns = number * 33_000_000
        plant.clock.sleep_until_ns(stamp_ns)
        safety.observe(abstained(stamp_ns, 0.1, 0.3), stamp_ns)
        actions.append(safety.check()[0])
    assert actions == [SafetyAction.COAST] * 30 + [SafetyAction.RETRACT] * 3


def test_after_an_abstained_interval_estimates_without_one_are_bridged_for_200_ms() -> None:
    plant, safety = layer()
    safety.observe(estimate_of(0, 0.02, 0.01), 0)
    plant.clock.sleep_until_ns(150_000_000)
    safety.observe(abstained(150_000_000, 0.0, 0.1), 150_000_000)
    for after_ns, action in ((33_000_000, SafetyAction.COAST), (199_000_000, SafetyAction.COAST),
                             (201_000_000, SafetyAction.RETRACT)):  # fmt: skip
        stamp_ns = 150_000_000 + after_ns
        plant.clock.sleep_until_ns(stamp_ns)
        safety.observe(ForceEstimate.invalid(stamp_ns, Status.NO_CATHETER, "hidden"), stamp_ns)
        assert safety.check()[0] is action


def test_a_force_that_rises_fast_is_drawn_back_before_the_limit() -> None:
    plant, safety = layer()
    actions = []
    for number in range(4):
        stamp_ns = number * 33_000_000
        plant.clock.sleep_until_ns(stamp_ns + 60_000_000)
        safety.observe(estimate_of(stamp_ns, 0.08 * number, 0.02), stamp_ns)
        actions.append(safety.check()[0])
    assert actions == [SafetyAction.PASS] * 3 + [SafetyAction.OVER_LIMIT]
    assert safety.upper_n < 0.3


def test_an_interval_that_widens_upward_counts_as_a_rise_of_the_force() -> None:
    plant, safety = layer()
    for number, (force, half_width) in enumerate(((0.01, 0.03), (0.08, 0.09))):
        stamp_ns = number * 33_000_000
        plant.clock.sleep_until_ns(stamp_ns + 60_000_000)
        safety.observe(estimate_of(stamp_ns, force, half_width), stamp_ns)
    assert safety.check()[0] is SafetyAction.OVER_LIMIT
    assert safety.upper_n < 0.2


def test_time_without_contact_does_not_make_a_wrong_model_of_the_wall_right() -> None:
    observer = WallObserver(ObserverSettings(), wall_mm=-10.0, wall_sigma_mm=1.0)
    for number in range(10):
        observer.add(Sample(number / 30, 0.3, 0.005, 0.0))
    wrong_n = observer.max_residual_n
    assert wrong_n > 0.2
    for number in range(10, 130):
        observer.add(Sample(number / 30, 0.0, 0.005, -20.0))
    assert observer.max_residual_n == wrong_n
    for number in range(130, 230):
        depth_mm = 0.1 / observer.gain_n_per_mm - observer.wall_mm(number / 30)
        observer.add(Sample(number / 30, 0.1, 0.005, depth_mm))
    assert observer.max_residual_n < 0.1


def test_without_estimates_the_force_is_taken_to_rise_as_fast_as_it_did() -> None:
    plant, safety = layer()
    for number, force in enumerate((0.1, 0.18, 0.2, 0.2)):
        plant.clock.sleep_until_ns(number * 33_000_000)
        safety.observe(estimate_of(number * 33_000_000, force, 0.02), number * 33_000_000)
    plant.clock.sleep_until_ns(132_000_000)
    safety.observe(ForceEstimate.invalid(132_000_000, Status.NO_CATHETER, "gone"), 132_000_000)
    assert safety.check()[0] is SafetyAction.COAST
    plant.clock.sleep_until_ns(180_000_000)
    action, reason = safety.check()
    assert action is SafetyAction.OVER_LIMIT
    assert "rising by 1.8 N/s" in reason


def test_until_the_rate_is_known_the_tip_goes_toward_the_wall_slowly(bench: Callable) -> None:
    made = bench(3.0, 1.0, controller="periodic", gain_n_per_mm=0.1, learn_at_most_s=0.0, learn_s=0.0)
    made.loop.start()
    while made.loop.state is not ControlState.HOLD:
        made.run(DT_S)
    made.run(0.5)
    sent = np.array([place for _, place in made.plant.commands])[-50:]
    assert np.diff(sent).max() <= 5.0 * DT_S + 1e-9


def test_held_is_said_of_a_force_at_the_target_only(bench: Callable) -> None:
    made = bench(controller="pi", gain_n_per_mm=0.08)
    made.loop.start()
    while made.loop.state is not ControlState.HOLD:
        made.run(DT_S)
    assert not made.loop.held
    assert "not held yet: brought to 0.20 N (20 g)" in made.loop.progress
    made.run(8.0)
    assert made.loop.progress == "the force is held at 0.20 N (20 g)"
    made.plant.gain = 0.16  # twice the force, at once
    made.run(0.4)
    assert not made.loop.held
    assert "not held" in made.loop.progress


def test_intervals_that_abstain_around_the_target_are_not_a_force_that_is_held(bench: Callable) -> None:
    made = bench(controller="pi", gain_n_per_mm=0.08)
    made.loop.start()
    while not made.loop.held:
        made.run(DT_S)

    def half_abstain(estimate: ForceEstimate) -> ForceEstimate:
        if estimate.stamp_ns // round(1e9 * FRAME_S) % 2:
            return estimate
        middle_n = estimate.magnitude_n
        wide = (max(0.0, middle_n - 0.15), middle_n + 0.15)
        return ForceEstimate.invalid(estimate.stamp_ns, Status.UNOBSERVABLE, "too wide", abstained_interval_n=wide)

    made.spoil = half_abstain
    made.run(4.0)
    while not made.ticks[-1].valid:
        made.run(DT_S)
    assert made.loop.state is ControlState.HOLD
    assert not made.loop.held


def test_no_estimate_counts_for_longer_than_a_second_however_slow_the_camera_is() -> None:
    plant = Plant(lambda _: 100.0, 0.1)
    safety = SafetyLayer(plant, plant.clock, PATH, SafetySettings(), 4.0)
    safety.observe(estimate_of(0, 0.1), 0)
    plant.clock.sleep_until_ns(990_000_000)
    assert safety.check()[0] is SafetyAction.PASS
    plant.clock.sleep_until_ns(1_010_000_000)
    action, reason = safety.check()
    assert action is SafetyAction.RETRACT
    assert "stale: no estimate for 1.01 s" in reason
