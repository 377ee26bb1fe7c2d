"""How long an image may have waited in buffers, from times that the tests state."""

import numpy as np
import pytest

from tipforce.errors import DeviceError
from tipforce.hardware import ArrivalClock
from tipforce.hardware._arrival import ArrivalWait, LatenessCheck

MS = 1_000_000


def camera(pause_s, catch_up, lost=False, period_ms=40.0, seconds=20.0):
    """Times of exposure and arrival of a camera whose images wait for ``pause_s`` from 5 s on.

    ``catch_up``: after the pause they come that much faster than the camera takes them; or they were ``lost``.
    """
    taken = np.arange(0.0, seconds, 1e-3 * period_ms)
    if lost:
        taken = taken[(taken < 5.0) | (taken >= 5.0 + pause_s)]
        return taken, taken + 0.002
    arrived = taken + 0.002
    earliest = 5.0 + pause_s
    for k in np.flatnonzero(taken >= 5.0):
        arrived[k] = max(arrived[k], earliest)
        earliest = arrived[k] + 1e-3 * period_ms / catch_up
    return taken, arrived


def bounds(arrived):
    """How long each image may have waited, seconds, for a driver that reads all the time."""
    wait, found, asked = ArrivalWait(local=False), [], 0
    for at in np.round(arrived * 1e9).astype(int).tolist():
        found.append(wait.wait_ns(asked, at))
        asked = at
    return 1e-9 * np.array(found)


@pytest.mark.parametrize("pause_s", [0.5, 2.0, 8.0])
@pytest.mark.parametrize("catch_up", [1.2, 3.0, 500.0])
def test_after_a_pause_no_image_has_waited_for_longer_than_the_bound(pause_s, catch_up):
    taken, arrived = camera(pause_s, catch_up, seconds=20.0 + 6.0 * pause_s)
    bound, true = bounds(arrived), arrived - taken - 0.002
    assert np.all(bound >= true - 0.05)
    assert bound[-20:].max() < 0.05, "current again"
    assert bound[(taken > 1.0) & (taken < 5.0)].max() < 0.01


def test_images_that_were_lost_in_a_short_pause_are_not_waited_for():
    taken, arrived = camera(0.6, 1.0, lost=True)
    assert bounds(arrived)[taken > 8.0].max() < 0.01


def test_images_that_may_have_waited_for_a_second_and_do_not_catch_up_end_the_connection():
    _, arrived = camera(3.0, 1.0, lost=True)
    late = LatenessCheck()

    def check_all():
        for at, wait in zip(arrived, bounds(arrived), strict=True):
            assert at < 12.0
            late.check("camera a", round(wait * 1e9), round(at * 1e9))

    with pytest.raises(DeviceError, match=r"camera a: its images arrive 3\.0 s late, so it is connected anew"):
        check_all()


@pytest.mark.parametrize("period_ms", [33.0, 500.0])
@pytest.mark.parametrize("busy_ms", [1.0, 25.0])
def test_a_local_driver_that_had_to_wait_for_eight_images_has_a_current_one(period_ms, busy_ms):
    """On a busy machine reading takes as long as waiting."""
    wait, period, busy, now = ArrivalWait(local=True), round(period_ms * MS), round(busy_ms * MS), 0
    for _ in range(10):
        assert wait.wait_ns(now, now + period) < MS
        now += period
    now += 8000 * MS  # the program stood still, and four images had waited
    waits = [wait.wait_ns(now + k * busy, now + (k + 1) * busy) for k in range(4)]
    assert min(waits) > 5000 * MS
    now += 4 * busy
    fresh = [wait.wait_ns(now + k * period, now + (k + 1) * period) for k in range(8)]
    assert fresh[-1] < MS


def test_a_camera_that_becomes_slower_is_current_again_within_three_seconds():
    arrived = np.concatenate([np.arange(0.0, 5.0, 0.033), np.arange(5.0, 12.0, 0.066)])
    assert bounds(arrived)[arrived > 8.0].max() < 0.1


def test_images_that_come_in_bursts_are_as_old_as_they_are():
    taken = np.arange(0.0, 20.0, 0.04)
    arrived = 0.12 * np.ceil(taken / 0.12)  # three at once
    bound, true = bounds(arrived), arrived - taken
    assert np.all(bound[50:] >= true[50:] - 0.06)
    assert bound[50:].max() < 0.17


@pytest.mark.parametrize("catch_up", [1.0, 1.2, 100.0])
def test_stamps_of_a_camera_show_old_images_however_long_the_pause(catch_up):
    clock, waits = ArrivalClock(1_000_000_000), []
    taken, arrived = camera(15.0, catch_up, seconds=40.0)
    for stamp, at in zip(np.round(taken * 1e9).astype(int), np.round(arrived * 1e9).astype(int), strict=True):
        waits.append(1e-9 * (at - clock.host_ns(int(stamp) + 77 * 10**9, int(at))))
    np.testing.assert_allclose(waits, arrived - taken - 0.002, atol=1e-6)
