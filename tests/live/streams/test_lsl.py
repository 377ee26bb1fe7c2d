import math
from collections.abc import Callable

import numpy as np
import pylsl
import pytest

from tipforce.live import LiveUpdate
from tipforce.live.streams import open_sink
from tipforce.live.streams._lsl import CHANNELS, STATUS_CODES
from tipforce.types import SessionInfo, Status

WAIT_S = 5.0


def test_an_inlet_reads_samples_and_their_description(update: Callable[..., LiveUpdate], info: SessionInfo) -> None:
    sink = open_sink("lsl://Tipforce-test")
    sink.start(info, "pretrained/fusion")
    found = pylsl.resolve_byprop("source_id", "tipforce-Tipforce-test", timeout=WAIT_S)
    assert found, "the stream is not found on this machine: is multicast blocked?"
    inlet = pylsl.StreamInlet(found[0])
    inlet.open_stream(timeout=WAIT_S)
    described = inlet.info(timeout=WAIT_S)
    assert (described.name(), described.type(), described.channel_count()) == ("Tipforce-test", "Force", len(CHANNELS))
    about = described.desc()
    assert (about.child_value("session"), about.child_value("model")) == ("bench", "pretrained/fusion")
    channel, seen = about.child("channels").child("channel"), []
    while not channel.empty():
        seen.append(tuple(channel.child_value(name) for name in ("label", "unit", "type")))
        channel = channel.next_sibling()
    assert tuple(seen) == CHANNELS
    assert about.child("status_codes").child_value("stale") == str(STATUS_CODES[Status.STALE])

    labels = [label for label, _, _ in CHANNELS]
    sink.put(update(0))
    sample, stamp = inlet.pull_sample(timeout=WAIT_S)
    values = dict(zip(labels, sample, strict=True))
    assert (values["fx_n"], values["fy_low_n"], values["magnitude_high_n"]) == (-0.15, 0.17, 0.28)
    assert math.isnan(values["fz_n"])
    assert (values["status"], values["contact"]) == (0.0, 0.98)
    assert values["latency_s"] == pytest.approx(0.012)
    assert stamp == pytest.approx(pylsl.local_clock() - 0.012, abs=0.5)

    sink.put(update(1, valid=False))
    sample, _ = inlet.pull_sample(timeout=WAIT_S)
    values = dict(zip(labels, sample, strict=True))
    assert values["status"] == STATUS_CODES[Status.STALE] != 0
    assert np.isnan([values[label] for label, unit, kind in CHANNELS if unit == "N" and "Force" in kind[:5]]).all()
    assert [values[f"zero_{axis}n"] for axis in ("x_", "y_", "z_", "")] == [0.0] * 4
    inlet.close_stream()
    sink.close()


def test_the_codes_of_statuses_do_not_change() -> None:
    """A recording of last year has to be read next year: new ones come at the end."""
    assert [status.value for status in STATUS_CODES][:9] == [
        "valid", "no_catheter", "cut_off", "not_a_function", "missing_input",
        "out_of_distribution", "unobservable", "fold", "stale",
    ]  # fmt: skip
    assert list(STATUS_CODES.values()) == list(range(len(Status)))
