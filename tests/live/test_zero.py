"""The zero button and the force-time integral."""

import math

import numpy as np
import pytest

from tipforce.clinical import ContactSettings
from tipforce.errors import InputError
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
    return button, button.press(1000 * MS)


def test_what_is_read_becomes_zero_and_the_interval_moves_along():
    button, zero = zeroed()
    np.testing.assert_allclose(zero.offset_n, [0.03, 0.0, np.nan])
    assert zero.magnitude_n == pytest.approx(0.03)
    found = button.apply(force_estimate(1, 0.23), 1001 * MS)
    assert found.magnitude_n == pytest.approx(0.2)
    np.testing.assert_allclose(found.force_n, [0.2, 0.0, np.nan], atol=1e-12)
    np.testing.assert_allclose(found.interval_n[0], [0.19, 0.21])
    np.testing.assert_allclose(found.magnitude_interval_n, [0.19, 0.21])
    # what was subtracted is a force with a direction: less than it is a pull
    pulled = button.apply(force_estimate(1, 0.0), 1002 * MS)
    assert pulled.magnitude_n == pytest.approx(0.03)
    assert pulled.force_n[0] == pytest.approx(-0.03)


def test_an_invalid_estimate_stays_as_it_is():
    button, _ = zeroed()
    lost = ForceEstimate.invalid(0, Status.NO_CATHETER, "nothing")
    assert button.apply(lost, 1100 * MS) is lost


def test_a_method_that_yields_the_magnitude_alone_is_zeroed_too():
    nan = np.full(3, np.nan)
    button = ZeroButton(LiveSettings())

    def of(newtons):
        ends = np.array([newtons - 0.01, newtons + 0.01])
        return ForceEstimate(0, nan, np.zeros(3, bool), np.full((3, 3), np.nan), np.full((3, 2), np.nan), newtons, ends)

    for step in range(5):
        button.apply(of(0.02), step * 20 * MS)
    assert np.isnan(button.press(100 * MS).offset_n).all()
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
            state = totals.update(force_estimate(step * 100 * MS, 0.2))
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
