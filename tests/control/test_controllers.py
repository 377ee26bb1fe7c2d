"""Controllers on analytic plants: they hold the force, learn gain, rate and wall, and do not wind up."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from tests.control.conftest import estimate_of

from tipforce.control import (
    Admittance,
    ControlState,
    ObserverSettings,
    ProportionalIntegral,
    SafetyAction,
    Sample,
    WallObserver,
)
from tipforce.types import ForceEstimate, Status


def held(bench, seconds: float) -> np.ndarray:
    bench.loop.start()
    bench.run(28.0)
    assert bench.loop.state is ControlState.HOLD
    return bench.run(seconds)


@pytest.mark.parametrize(
    ("controller", "gain"),
    [
        ("pi", 0.12), ("admittance", 0.02), ("periodic", 0.12),
        *(
            pytest.param(*more, marks=pytest.mark.slow)
            for more in (("pi", 0.02), ("admittance", 0.12), ("periodic", 0.02))
        ),
    ],
)  # fmt: skip
def test_a_wall_at_rest_is_held_whatever_its_stiffness(bench: Callable, controller: str, gain: float) -> None:
    force = held(bench(controller=controller, gain_n_per_mm=gain), 2.0)
    np.testing.assert_allclose(force, 0.2, atol=0.012)


@pytest.mark.parametrize(("gain", "heart_hz"), [pytest.param(0.04, 1.6, marks=pytest.mark.slow), (0.12, 1.0)])
def test_heart_and_breath_are_rejected_at_the_rate_that_was_measured(
    bench: Callable, gain: float, heart_hz: float
) -> None:
    made = bench(2.0, 2.0, controller="periodic", gain_n_per_mm=gain, heart_hz=heart_hz)
    force = held(made, 8.0)
    assert np.sqrt(np.mean((force - 0.2) ** 2)) < 0.012
    assert made.ticks[-1].heart_hz == pytest.approx(heart_hz, abs=0.02)
    assert max(made.forces) < 0.4


@pytest.mark.parametrize("controller", ["pi", "periodic"])
def test_the_wanted_force_stays_where_the_upper_end_of_the_interval_is_below_the_limit(
    bench: Callable, controller: str
) -> None:
    made = bench(controller=controller, gain_n_per_mm=0.05)

    def widened(estimate: ForceEstimate) -> ForceEstimate:
        return replace(estimate, magnitude_interval_n=estimate.magnitude_n * np.array([0.6, 2.2]))

    made.spoil = widened
    force = held(made, 4.0)
    assert 0.11 < force.min() < force.max() < 0.17, "at 0.2 N the interval would reach to 0.44 N"
    assert not any(tick.applied.action is SafetyAction.RETRACT for tick in made.ticks[500:])


def test_without_rejection_the_same_wall_shakes_the_force_several_times_as_much(bench: Callable) -> None:
    with_it = held(bench(3.0, 2.0, controller="periodic", gain_n_per_mm=0.04), 8.0)
    without = held(bench(3.0, 2.0, controller="none", gain_n_per_mm=0.04), 8.0)
    assert with_it.std() < 0.25 * without.std()
    assert without.mean() == pytest.approx(0.2, abs=0.05)


def test_the_gain_is_found_from_the_approach_and_the_test_motion(bench: Callable) -> None:
    made = bench(3.0, 1.0, controller="periodic", gain_n_per_mm=0.15)
    held(made, 12.0)
    assert made.ticks[-1].gain_n_per_mm == pytest.approx(0.15, rel=0.4)  # begins with 0.06


def test_an_interval_that_does_not_exclude_no_contact_does_not_end_the_approach(bench: Callable) -> None:
    """Far from the wall every image gives "0 to 0.19 N": its middle is no contact."""
    made = bench(controller="periodic")

    def too_wide(estimate: ForceEstimate) -> ForceEstimate:
        if estimate.magnitude_n > 0.0:
            return estimate
        return ForceEstimate.invalid(
            estimate.stamp_ns, Status.UNOBSERVABLE, "too wide", abstained_interval_n=(0.0, 0.19)
        )

    made.spoil = too_wide
    made.loop.update(estimate_of(0, 0.0))
    made.loop.start()
    made.run(0.9)
    assert made.loop.state is ControlState.APPROACH


def test_a_free_tip_goes_little_deeper_than_where_the_last_touches_were_light(
    bench: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The wall moves out of reach while its rate is not known: the tip does not follow it at 5 mm/s."""
    made = bench(controller="periodic", gain_n_per_mm=0.1)
    held(made, 1.0)
    monkeypatch.setattr(WallObserver, "rate_range_hz", property(lambda _: 0.5))
    place_mm = made.plant.place
    made.plant.wall_mm = lambda time_s: 30.0
    made.run(1.0)
    assert made.plant.place < place_mm + 1.6


def test_pi_does_not_wind_up_behind_a_limit() -> None:
    controller = ProportionalIntegral(loop_delay_s=0.12)
    controller.begin(5.0)
    for number in range(300):  # ten seconds against the end of the path, with no force at all
        controller.add(Sample(number / 30, 0.0, 0.0, 5.0), 0.2, 0.05)
        controller.applied(min(controller.position_mm(number / 30, 0.2), 5.0))
    controller.add(Sample(10.1, 0.3, 0.0, 5.0), 0.2, 0.05)
    assert controller.position_mm(10.1, 0.2) < 5.0


def test_a_mass_that_was_stopped_starts_again_from_rest() -> None:
    controller = Admittance(loop_delay_s=0.12)
    controller.begin(0.0)
    controller.add(Sample(0.0, 0.0, 0.0, 0.0), 0.2, 0.05)
    places = [controller.position_mm(0.01 * step, 0.2) for step in range(50)]
    assert places[-1] > places[-2] > 0.0
    controller.applied(places[-1] - 1.0)
    controller.add(Sample(0.5, 0.2, 0.0, 0.0), 0.2, 0.05)
    assert controller.position_mm(0.51, 0.2) == pytest.approx(places[-1] - 1.0)


def test_an_estimate_that_comes_late_or_twice_changes_nothing() -> None:
    observer = WallObserver(ObserverSettings(), -5.0, 5.0)
    observer.add(Sample(1.0, 0.1, 0.01, 6.0))
    before = observer.wall_mm(1.5)
    observer.add(Sample(1.0, 0.4, 0.01, 6.0))
    observer.add(Sample(0.5, 0.4, 0.01, 6.0))
    assert observer.wall_mm(1.5) == before


def test_no_force_where_none_is_expected_tells_nothing_of_the_wall() -> None:
    observer = WallObserver(ObserverSettings(), -5.0, 1.0)
    observer.add(Sample(0.0, 0.0, 0.01, 0.0))
    assert observer.wall_mm(0.0) == -5.0
    observer.add(Sample(0.1, 0.0, 0.01, 8.0))  # deep in the wall, by the model, and still no force: it is farther away
    assert observer.wall_mm(0.1) < -5.0
