"""The zero button and the force-time integral."""

import math
import time
from dataclasses import replace

import numpy as np
import pytest

from tipforce.clinical import ContactSettings
from tipforce.errors import InputError, ZeroInContactError
from tipforce.live import LiveSettings
from tipforce.live._contact import ContactTotals
from tipforce.live._zero import ZeroButton
from tipforce.types import ForceEstimate, Status

from .conftest import Camera, Method, Notes, force_estimate, wait_until

MS = 1_000_000


def zeroed(level_n=0.03, contact=math.nan):
    """A button pressed after a second at ``level_n``."""
    button = ZeroButton(LiveSettings())
    for step in range(50):
        button.apply(force_estimate(step * 20 * MS, level_n, contact), step * 20 * MS)
    return button, button.press(1000 * MS, by="page 1", confirmed_n=level_n)


def test_what_is_read_is_subtracted_and_the_interval_spans_the_force_with_and_without_it():
    button, zero = zeroed()
    np.testing.assert_allclose(zero.offset_n, [0.03, 0.0, np.nan])
    assert zero.magnitude_n == pytest.approx(0.03)
    found = button.apply(force_estimate(1, 0.23), 1001 * MS)
    assert found.magnitude_n == pytest.approx(0.2)
    np.testing.assert_allclose(found.force_n, [0.2, 0.0, np.nan], atol=1e-12)
    np.testing.assert_allclose(found.interval_n[0], [0.19, 0.24])
    np.testing.assert_allclose(found.magnitude_interval_n, [0.19, 0.24])
    # what was subtracted is a force with a direction: less than it is a pull
    pulled = button.apply(force_estimate(1, 0.0), 1002 * MS)
    assert pulled.magnitude_n == pytest.approx(0.03)
    assert pulled.force_n[0] == pytest.approx(-0.03)


def test_a_zero_in_contact_says_what_it_would_subtract_and_is_taken_when_that_is_confirmed():
    button = ZeroButton(LiveSettings())
    for step in range(50):
        button.apply(force_estimate(step * 20 * MS, 0.077, contact=0.9), step * 20 * MS)
    with pytest.raises(ZeroInContactError, match=r"7.9 g \(77 mN\) would be subtracted from every force") as asked:
        button.press(1000 * MS)
    assert button.zero is None
    with pytest.raises(ZeroInContactError):  # the force has changed since somebody agreed to 50 mN
        button.press(1000 * MS, confirmed_n=0.05)
    zero = button.press(1000 * MS, by="page 1", confirmed_n=asked.value.magnitude_n)
    assert (zero.by, zero.confirmed) == ("page 1", True)
    assert zero.since_unix_s == pytest.approx(time.time(), abs=5.0)


@pytest.mark.parametrize(("level_n", "contact"), [(0.06, 0.01), (0.008, math.nan)])
def test_a_zero_without_contact_is_taken_at_once(level_n, contact):
    button = ZeroButton(LiveSettings())
    for step in range(50):
        button.apply(force_estimate(step * 20 * MS, level_n, contact), step * 20 * MS)
    assert not button.press(1000 * MS).confirmed


@pytest.mark.parametrize("contact", [math.nan, 0.9])
def test_a_zero_moves_neither_the_upper_end_nor_the_limit(contact):
    button, _ = zeroed(0.077, contact)
    raw = force_estimate(1, 0.45)
    found = button.apply(raw, 1001 * MS)
    assert found.magnitude_n == pytest.approx(0.373)
    assert found.upper_n == raw.upper_n
    state = ContactTotals(ContactSettings(limit_n=0.4)).update(found, raw)
    assert state.contact == "excessive"
    assert state.above_limit > 0.99
    no_interval = replace(raw, magnitude_interval_n=np.full(2, np.nan))
    assert button.apply(no_interval, 1002 * MS).upper_n == pytest.approx(0.45)


def test_an_invalid_estimate_stays_as_it_is():
    button, _ = zeroed()
    lost = ForceEstimate.invalid(0, Status.NO_CATHETER, "nothing")
    assert button.apply(lost, 1100 * MS) is lost


def test_an_interval_that_abstains_spans_the_force_with_and_without_the_zero():
    button, _ = zeroed()
    wide = ForceEstimate.invalid(0, Status.UNOBSERVABLE, "too wide", abstained_interval_n=(0.02, 0.39))
    found = button.apply(wide, 1100 * MS)
    assert not found.valid
    assert found.abstained_interval_n == pytest.approx((0.0, 0.42))


def test_a_component_that_was_unknown_when_the_zero_was_taken_stays_as_it_is():
    button, _ = zeroed()
    both = replace(force_estimate(1, 0.23), known=np.array([True, True, True]), force_n=np.array([0.23, 0.0, 0.1]))
    found = button.apply(both, 1001 * MS)
    np.testing.assert_allclose(found.force_n, [0.2, 0.0, 0.1])


def test_a_method_that_yields_the_magnitude_alone_is_zeroed_too():
    nan = np.full(3, np.nan)
    button = ZeroButton(LiveSettings())

    def of(newtons):
        ends = np.array([newtons - 0.01, newtons + 0.01])
        return ForceEstimate(0, nan, np.zeros(3, bool), np.full((3, 3), np.nan), np.full((3, 2), np.nan), newtons, ends)

    for step in range(5):
        button.apply(of(0.02), step * 20 * MS)
    assert np.isnan(button.press(100 * MS, confirmed_n=0.02).offset_n).all()
    assert button.apply(of(0.12), 120 * MS).magnitude_n == pytest.approx(0.1)
    assert button.apply(of(0.0), 140 * MS).magnitude_n == 0.0


def test_it_refuses_what_is_no_error_of_the_zero_and_what_is_not_valid():
    with pytest.raises(InputError, match="no zero: 15 g are read, and an error of the zero is at most 10 g"):
        zeroed(0.15)
    button = ZeroButton(LiveSettings())
    with pytest.raises(InputError, match="0 valid estimates"):
        button.press(0)
    button.apply(force_estimate(0, 0.01), 0)
    with pytest.raises(InputError, match="0 valid estimates in the last 1 s"):
        button.press(5000 * MS)


def test_drift_is_told_from_moments_without_contact_alone():
    button, zero = zeroed(0.02, contact=0.01)
    assert math.isnan(zero.drift_n)
    button.apply(force_estimate(1, 0.3, contact=0.99), 1020 * MS)
    assert math.isnan(button.zero.drift_n)
    for step in range(300):
        button.apply(force_estimate(1, 0.035, contact=0.01), 2000 * MS + step * 20 * MS)
    assert button.zero.drift_n == pytest.approx(0.015, abs=1e-4)
    assert button.zero.drift_ns == 2000 * MS + 299 * 20 * MS
    button.apply(force_estimate(1, 0.3, contact=0.99), 9000 * MS)
    assert button.zero.drift_n == pytest.approx(0.015, abs=1e-4)


def test_a_method_without_a_probability_of_contact_tells_no_drift():
    button, _ = zeroed()
    button.apply(force_estimate(1, 0.05), 2000 * MS)
    assert math.isnan(button.zero.drift_n)


def test_the_integral_counts_from_start_to_stop():
    totals = ContactTotals(ContactSettings())
    state = None

    def run(first, last):
        nonlocal state
        for step in range(first, last + 1):
            found = force_estimate(step * 100 * MS, 0.2)
            state = totals.update(found, found)
        return state

    assert run(0, 10).integral_n_s == 0.0
    assert not totals.running
    totals.start()
    assert run(11, 20).integral_n_s == pytest.approx(0.2)
    assert state.elapsed_s == pytest.approx(1.0)
    totals.stop()
    assert run(21, 30).integral_n_s == pytest.approx(0.2)
    assert state.integral_interval_n_s == pytest.approx((0.19, 0.21))
    totals.start()
    assert run(31, 35).integral_n_s == pytest.approx(0.1)


def test_buttons_of_a_running_engine_show_in_its_updates(engine):
    notes = Notes()
    live = engine(Camera(100_000), Method(lambda number: 0.05, contact=0.01), notes)
    with live.running():
        wait_until(lambda: sum(each.estimate.valid for each in notes.updates) > 10)
        live.zero()
        live.start_integral()
        wait_until(lambda: (last := live.latest()).zero and last.estimate.valid and last.integral_running)
        last = live.latest()
        assert last.estimate.magnitude_n == pytest.approx(0.0, abs=1e-9)
        assert last.zero.magnitude_n == pytest.approx(0.05)
        live.stop_integral()
        live.clear_zero()
        wait_until(lambda: live.latest().zero is None and live.latest().estimate.valid)
        assert live.latest().estimate.magnitude_n == pytest.approx(0.05)
        assert not live.latest().integral_running
