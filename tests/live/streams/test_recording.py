import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tipforce.errors import InputError
from tipforce.io import RecordingReader
from tipforce.live import LiveUpdate, Zero
from tipforce.live.streams import open_sink
from tipforce.pipelines import describe_recording, summarise_recording
from tipforce.types import SessionInfo


def test_all_estimates_and_their_images_are_kept(
    tmp_path: Path, update: Callable[..., LiveUpdate], info: SessionInfo
) -> None:
    path = tmp_path / "run.mcap"
    sink = open_sink(f"recording:{path}")
    assert sink.keeps_all
    sink.start(info, "pretrained/fusion")
    valid = [True, True, False, True]
    sent = [update(number, valid=each) for number, each in enumerate(valid)]
    for each in sent:
        sink.put(each)
    sink.close()
    sink.close()
    with RecordingReader(path) as reader:
        assert reader.session_info.views == info.views
        assert reader.info.metadata["tipforce.live"] == {"model": "pretrained/fusion"}
        found = list(reader.estimates())
        assert [each.valid for each in found] == valid
        np.testing.assert_equal([e.magnitude_n for e in found], [u.estimate.magnitude_n for u in sent])
        assert [e.stamp_ns for e in found] == [u.estimate.stamp_ns for u in sent]
        assert reader.stamps("camera").tolist() == [u.estimate.stamp_ns for u in sent if u.frames]


def test_a_zero_and_its_undoing_are_in_the_recording_and_inspect_says_so(
    tmp_path: Path, update: Callable[..., LiveUpdate], info: SessionInfo
) -> None:
    path = tmp_path / "run.mcap"
    sink = open_sink(f"recording:{path}")
    sink.start(info, "m")
    zero = Zero(np.array([0.077, 0.0, np.nan]), 0.077, 5, 1.8e9, "page 2 at 10.0.0.7", confirmed=True)
    for number, subtracted in enumerate([None, zero, replace(zero, drift_n=0.001), None]):
        sink.put(replace(update(number), zero=subtracted))
    sink.close()
    said = [line for line in describe_recording(summarise_recording(path)) if line.startswith("zero")]
    assert said == [
        (
            "zero          77.0 mN (7.9 g) are subtracted from the estimates from 1.020 s on (page 2 at 10.0.0.7, "
            "confirmed although the tip may have been in contact)"
        ),
        "zero          nothing is subtracted from the estimates from 1.060 s on",
    ]


def test_images_may_be_left_out(tmp_path: Path, update: Callable[..., LiveUpdate], info: SessionInfo) -> None:
    sink = open_sink(f"recording:{tmp_path}/run.mcap?frames=no")
    sink.start(info, "m")
    sink.put(update(0))
    sink.close()
    with RecordingReader(tmp_path / "run.mcap") as reader:
        assert set(reader.info.streams) == {"estimate"}


def test_a_recording_that_stands_is_not_written_over(
    tmp_path: Path, update: Callable[..., LiveUpdate], info: SessionInfo
) -> None:
    path = tmp_path / "run.mcap"
    sink = open_sink(f"recording:{path}")
    for number in range(2):  # the engine starts it again after an error
        sink.start(info, "m")
        sink.put(update(number))
        sink.close()
    assert sorted(each.name for each in tmp_path.iterdir()) == ["run-2.mcap", "run.mcap"]
    for name, number in (("run.mcap", 0), ("run-2.mcap", 1)):
        with RecordingReader(tmp_path / name) as reader:
            assert [each.stamp_ns for each in reader.estimates()] == [update(number).estimate.stamp_ns]
    with pytest.raises(InputError, match=re.escape(str(path))):
        open_sink(f"recording:{path}")
