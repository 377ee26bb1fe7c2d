"""The Net F/T driver against a box that speaks RDT: no gap, no fault and no error status becomes a force."""

import itertools
import math
import time

import numpy as np
import pytest

from tipforce.errors import DeviceError
from tipforce.hardware import HardwareSource, NetFt, NetFtConfig
from tipforce.hardware._net_ft import RDT_REPLY, RdtCheck, unit_in_newton_metres
from tipforce.hardware.emulators import NetFtEmulator, NetFtFaults
from tipforce.types import SystemClock


def driver_of(box, **more):
    return NetFt(NetFtConfig(host="127.0.0.1", port=box.port, http_port=box.http_port, **more))


def readings(driver, count, timeout_s=5.0):
    """At least ``count`` readings of a driver that is connected."""
    found, end = [], time.monotonic() + timeout_s
    while len(found) < count:
        assert time.monotonic() < end, f"{len(found)} of {count} readings came"
        found.extend(driver.read(0.05))
    return found


def test_counts_and_units_are_those_of_the_box():
    with NetFtEmulator(
        lambda _: (1.0, -2.0, 0.5, 10.0, 0.0, 0.0), rate_hz=2000, counts_per_force=4448, counts_per_torque=1000,
        force_unit="lbf", torque_unit="N-mm",
    ) as box:  # fmt: skip
        driver = driver_of(box, rate_hz=1000, bias=True)
        settings = {setting.name: setting for setting in driver.connect(SystemClock(10**9))}
        wrench = readings(driver, 5)[-1]
        driver.close()
    assert settings["rate_hz"].differs
    assert settings["rate_hz"].actual == 2000
    np.testing.assert_allclose(wrench.force_n, 4.4482216 * np.array([1.0, -2.0, 0.5]), rtol=1e-3)
    assert wrench.torque_nm[0] == pytest.approx(0.01)
    assert box.biased == 1


def test_stamps_are_those_of_the_box_not_of_the_arrival():
    with NetFtEmulator(rate_hz=1000) as box:
        driver = driver_of(box, latency_ms=3.0)
        clock = SystemClock(10**9)
        driver.connect(clock)
        stamps = np.array([event.stamp_ns for event in readings(driver, 200)])
        driver.close()
    steps = np.diff(stamps[20:]) * 1e-6
    assert np.median(steps) == pytest.approx(1.0, abs=1e-6)  # the arrivals jitter by more
    assert stamps[-1] < clock.now_ns()
    assert driver.clocks()["force"].delay_s >= 0


def packet(rdt, ft=None, status=0, fx=1000):
    return RDT_REPLY.pack(rdt % 2**32, (7 * rdt if ft is None else ft) % 2**32, status, fx, 0, 0, 0, 0, 0)


def test_every_gap_is_counted_also_where_the_count_wraps_round():
    counts: dict[str, int] = {}
    check = RdtCheck(counts)
    start = 2**32 - 3
    taken = [check.take(packet(start + k)) for k in (0, 1, 4, 3, 3, 9)]
    assert [t is not None for t in taken] == [True, True, True, False, False, True]
    assert counts == {"lost": 5, "late": 1, "duplicate": 1}  # 2, 5, 6, 7, 8 never came


def test_a_status_a_frozen_sequence_and_half_a_packet_give_no_reading():
    counts: dict[str, int] = {}
    check = RdtCheck(counts)
    assert check.take(packet(1)) == (1, (1000, 0, 0, 0, 0, 0))
    assert check.take(packet(2, status=0x80010000)) is None
    assert check.take(packet(3, ft=14)) is None  # the sequence of packet 2
    assert check.take(packet(4)[:-1]) is None
    assert check.take(packet(5)) is not None
    assert counts == {"status": 1, "frozen": 1, "malformed": 1, "lost": 1}


def test_a_stream_that_was_asked_for_again_may_count_anew():
    counts: dict[str, int] = {}
    check = RdtCheck(counts)
    check.take(packet(300))
    check.restart()
    assert check.take(packet(1)) is not None
    assert check.take(packet(3)) is not None
    check.restart()
    assert check.take(packet(6)) is not None  # it went on: what is missing is lost
    assert counts == {"restarts": 1, "lost": 3}


def test_a_box_that_counts_anew_is_told():
    check = RdtCheck({})
    check.take(packet(50_000))
    with pytest.raises(DeviceError, match="counts its packets anew"):
        check.take(packet(1))


def test_loss_and_reordering_leave_no_false_force():
    """The force is a ramp in the packet's own number, so that each reading says which packet it was."""
    number = itertools.count(1)
    with NetFtEmulator(
        lambda _: (1e-3 * next(number), 0, 0, 0, 0, 0), rate_hz=4000, faults=NetFtFaults(loss=0.05, reorder=0.05)
    ) as box:
        driver = driver_of(box)
        driver.connect(SystemClock(10**9))
        events = readings(driver, 1500)
        box.faults.loss = box.faults.reorder = 0.0
        events += readings(driver, 50)
        driver.close()
    # a packet is made, counted and only then lost: the ramp has a step wherever a sequence number is missing
    steps = np.round(np.diff([event.force_n[0] for event in events]) * 1e3).astype(int)
    assert steps.min() >= 1
    assert (steps - 1).sum() == driver.counts["lost"] + driver.counts["late"]
    assert 0 < driver.counts["lost"] <= box.sent["lost"]  # which goes on while this test counts
    assert 0 < driver.counts["late"] <= box.sent["reordered"]
    assert not driver.counts["duplicate"]


def test_an_error_status_is_never_a_force_and_is_said():
    with NetFtEmulator(lambda _: (0.1, 0, 0, 0, 0, 0), rate_hz=2000) as box:
        driver = driver_of(box)
        driver.connect(SystemClock(10**9))
        readings(driver, 10)
        box.faults.status = 0x80020000
        events, end = [], time.monotonic() + 0.1
        while time.monotonic() < end:
            events += driver.read(0.02)
        box.faults.status = 0
        events += readings(driver, 10)
        driver.close()
    assert {round(float(event.force_n[0]), 9) for event in events} == {0.1}
    assert driver.counts["status"] > 20
    assert "0x80020000" in driver.remark


def test_silence_is_asked_about_then_the_box_counts_as_lost_and_is_found_again(monkeypatch):
    monkeypatch.setattr("tipforce.hardware._net_ft.MAX_SILENCE_S", 0.3)
    monkeypatch.setattr("tipforce.hardware._net_ft.REQUEST_AGAIN_S", 0.1)
    with NetFtEmulator(lambda t: (math.sin(t), 0, 0, 0, 0, 0), rate_hz=1000) as box:
        source = HardwareSource([driver_of(box)])
        with source:
            assert source.wait_connected(5.0) == ()
            events = iter(source)
            before = [next(events) for _ in range(20)][-1]
            requests = box.sent["requests"]
            box.faults.silent = True
            end = time.monotonic() + 5.0
            while source.health()[0].state == "connected":
                assert time.monotonic() < end
                time.sleep(0.01)
            assert "no packet" in source.health()[0].message
            assert box.sent["requests"] > requests
            box.faults.silent = False
            gap = 0.0
            while gap < 0.2:
                after = next(events)
                gap, before = (after.stamp_ns - before.stamp_ns) * 1e-9, after
            assert source.health()[0].connections == 2
            source.stop()


def test_a_box_that_is_not_there_is_named():
    with pytest.raises(DeviceError, match=r"hardware\.force: the Net F/T box at 127\.0\.0\.1: .*netftapi2\.xml"):
        NetFt(NetFtConfig(host="127.0.0.1", http_port=9)).connect(SystemClock())


def test_a_unit_that_is_not_known_is_refused():
    with pytest.raises(DeviceError, match="'stone'"):
        unit_in_newton_metres("stone")
