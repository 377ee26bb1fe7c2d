import re
import resource
import shutil
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import count
from pathlib import Path

import numpy as np
import pytest

from tipforce.errors import InputError, OutputError
from tipforce.io import RecordingReader
from tipforce.live import LiveSettings, LiveUpdate, Sink, Zero
from tipforce.live._runner import SinkRunner
from tipforce.live.streams import open_sink
from tipforce.pipelines import describe_recording, summarise_recording
from tipforce.types import SessionInfo, SystemClock


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
    sink.start(info, "m")
    sink.put(update(0))
    sink.close()
    before = path.read_bytes()
    with pytest.raises(InputError, match=re.escape(str(path))):
        sink.start(info, "m")
    with pytest.raises(InputError, match=re.escape(str(path))):
        open_sink(f"recording:{path}")
    assert path.read_bytes() == before


def fill(sink: Sink, update: Callable[..., LiveUpdate], seconds: float = 5.0) -> str:
    """Puts updates until the sink raises; returns the message."""
    end = time.monotonic() + seconds
    for number in count():
        assert time.monotonic() < end
        try:
            sink.put(update(number))
        except OutputError as error:
            return str(error)
        time.sleep(0.01)
    raise AssertionError


def test_where_no_more_fits_the_recording_ends_with_what_is_kept_and_where(
    tmp_path: Path, update: Callable[..., LiveUpdate], info: SessionInfo
) -> None:
    path = tmp_path / "run.mcap"
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, limits[1]))  # as a full disk, without one
    try:
        sink = open_sink(f"recording:{path}")
        sink.start(info, "m")
        said = fill(sink, update)
        sink.close()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    kept = re.fullmatch(
        rf"{re.escape(str(path))}: cannot be written any more, .*; ([\d.]+) s of this recording are kept in (\S+)", said
    )
    assert kept, said
    assert [each.name for each in tmp_path.iterdir()] == ["run.mcap.part"]
    with pytest.warns(UserWarning, match="recovered"), RecordingReader(Path(kept[2])) as reader:
        stamps = [each.stamp_ns for each in reader.estimates()]
    assert (stamps[-1] - stamps[0]) * 1e-9 == pytest.approx(float(kept[1]), abs=0.11)


def test_a_recording_whose_folder_is_removed_says_that_nothing_is_kept(
    tmp_path: Path, update: Callable[..., LiveUpdate], info: SessionInfo
) -> None:
    folder = tmp_path / "runs"
    sink = open_sink(f"recording:{folder}/run.mcap")
    sink.start(info, "m")
    sink.put(update(0))
    shutil.rmtree(folder)
    said = fill(sink, update)
    sink.close()
    assert "run.mcap.part was removed or moved; nothing of this recording is kept" in said
    assert not folder.exists()


def test_a_recording_whose_folder_is_moved_says_that_it_is_kept_elsewhere(
    tmp_path: Path, update: Callable[..., LiveUpdate], info: SessionInfo
) -> None:
    folder = tmp_path / "runs"
    sink = open_sink(f"recording:{folder}/run.mcap")
    sink.start(info, "m")
    for number in range(40):
        sink.put(update(number))
        time.sleep(0.01)
    folder.rename(tmp_path / "moved")
    said = fill(sink, update)
    assert re.search(r"[\d.]+ s of this recording are kept in run.mcap.part, wherever it was moved to", said), said
    with pytest.warns(UserWarning, match="recovered"), RecordingReader(tmp_path / "moved" / "run.mcap") as reader:
        assert len(list(reader.estimates())) > 10


def test_a_place_in_which_nothing_can_be_written_is_refused_at_once() -> None:
    with pytest.raises(InputError, match=r"/proc/run.mcap: cannot be written"):
        open_sink("recording:/proc/run.mcap")


def test_a_recording_that_ends_is_not_started_again_and_says_so_once(
    tmp_path: Path, update: Callable[..., LiveUpdate], info: SessionInfo
) -> None:
    folder = tmp_path / "runs"
    sink = open_sink(f"recording:{folder}/run.mcap")
    said: list[str] = []
    runner = SinkRunner(sink, info, "m", LiveSettings(reconnect_s=0.01), SystemClock(), said.append)
    runner.start()
    numbers = count()
    runner.offer(update(next(numbers)))
    end = time.monotonic() + 5.0
    while not (folder / "run.mcap.part").exists():
        assert time.monotonic() < end
        time.sleep(0.005)
    shutil.rmtree(folder)
    while not said:
        assert time.monotonic() < end
        runner.offer(update(next(numbers)))
        time.sleep(0.01)
    for _ in range(20):
        runner.offer(update(next(numbers)))
        time.sleep(0.005)
    health = runner.health(0)
    assert (health.failures, health.ended, health.message, len(said)) == (1, True, said[0], 1)
    assert not folder.exists()
    assert runner.wait_closed()
