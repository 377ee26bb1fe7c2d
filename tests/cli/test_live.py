"""``tipforce live`` on a video: the line, the page's address, the recording, what is refused."""

import json
import shutil
import threading
import time
import urllib.request
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from tipforce.cli import app
from tipforce.errors import InputError
from tipforce.io import open_recording
from tipforce.live import LiveReport
from tipforce.pipelines import LiveRunSettings, PageAddress, live, open_live_source
from tipforce.types import Frame, SessionInfo


def run(*words: str):
    return CliRunner().invoke(app, ["live", *words], catch_exceptions=False)


def test_a_video_is_estimated_as_it_plays_and_recorded(model: Path, video: Path, tmp_path: Path):
    recording, figures = tmp_path / "run.mcap", tmp_path / "run.json"
    done = run(
        str(model), str(video), "--knob-deg", "10", "--no-page", "--set", "rate_hz=50", "--set", "stale_s=1",
        "--record", str(recording), "--json", str(figures),
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    assert "20 frames" in done.output
    assert "the source has ended" in done.output
    found = json.loads(figures.read_text())
    assert found["frames_in"] == 20
    assert found["unusable"] == 1  # two frames show nothing but ground, and are the same
    assert found["estimated"] + found["dropped"] == 19
    # the other frame of ground has no catheter, and the last image is stale if the source ends before its estimate
    assert found["valid"] >= found["estimated"] - 2 > 10
    with open_recording(recording) as source:
        events = list(source.events())
    frames = [event for event in events if isinstance(event, Frame)]
    assert len(frames) == found["estimated"]


def test_a_recording_whose_folder_is_removed_is_not_called_written(model: Path, video: Path, tmp_path: Path):
    folder = tmp_path / "runs"

    def remove() -> None:
        while not (folder / "run.mcap.part").exists():
            time.sleep(0.005)
        shutil.rmtree(folder)

    thread = threading.Thread(target=remove, daemon=True)
    thread.start()
    done = run(
        str(model), str(video), "--knob-deg", "10", "--no-page", "--set", "rate_hz=50", "--set", "loop=true",
        "--seconds", "1.5", "--record", str(folder / "run.mcap"),
    )  # fmt: skip
    assert done.exit_code == 2
    assert "wrote" not in done.output
    assert done.output.count("nothing of this recording is kept (after ") == 1
    assert not folder.exists()


def test_a_recording_where_nothing_can_be_written_is_refused_before_anything_starts(model: Path, video: Path):
    with pytest.raises(InputError, match=r"/proc/run.mcap: cannot be written"):
        run(str(model), str(video), "--knob-deg", "10", "--no-page", "--record", "/proc/run.mcap")


def test_the_page_is_served_while_it_runs(trained, video: Path):
    addresses, pages, reports = [], [], []

    def look(_):
        if not pages:
            with urllib.request.urlopen(addresses[0], timeout=5) as answer:
                pages.append(answer.read())

    with open_live_source(
        video, stated=stated_knob(), settings=LiveRunSettings(rate_hz=50, loop=True, stale_s=1)
    ) as source:
        live(
            trained, source, page=PageAddress(), seconds=1.0, on_page=addresses.append, on_update=look,
            on_report=reports.append,
        )  # fmt: skip
    assert addresses[0].startswith("http://127.0.0.1:")
    assert b"<html" in pages[0]
    assert reports[0].sinks["page"].taken > 0


def stated_knob() -> SessionInfo:
    return SessionInfo.from_values({"actuation": {"constant": {"knob_deg": 10.0}}})


def test_the_report_comes_also_where_something_ends_the_run(trained, video: Path):
    class Stop(BaseException):
        pass

    def stop(_):
        raise Stop

    reports: list[LiveReport] = []
    with (
        open_live_source(video, stated=stated_knob(), settings=LiveRunSettings(loop=True)) as source,
        pytest.raises(Stop),
    ):
        live(trained, source, on_update=stop, on_report=reports.append)
    assert reports[0].seconds > 0


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ((), "expected one source"),
        (("VIDEO", "--simulated", "bench-2021"), "expected one source"),
        (("--simulated", "bench-1999"), "there is no such preset"),
        (("VIDEO", "--no-page"), "does not carry knob_deg"),
        (("VIDEO", "--knob-deg", "10", "--out", "post://here"), "no such kind of output"),
        (("VIDEO", "--set", "stale_ms=5"), "there is no such setting"),
    ],
)
def test_what_cannot_run_is_refused(model: Path, video: Path, words: tuple[str, ...], sentence: str):
    typed = [str(video) if word == "VIDEO" else word for word in words]
    with pytest.raises(InputError, match=sentence):
        run(str(model), *typed)


def test_images_without_times_need_a_rate(tmp_path: Path):
    for number in range(3):
        cv2.imwrite(str(tmp_path / f"{number}.png"), np.full((8, 8), 9, np.uint8))
    with pytest.raises(InputError, match="state rate_hz"), open_live_source(tmp_path):
        pass
    with open_live_source(tmp_path, settings=LiveRunSettings(rate_hz=100)) as source:
        assert sum(isinstance(event, Frame) for event in source) == 3


def test_the_devices_of_a_bench_are_the_source_where_there_is_no_other(trained, video: Path, tmp_path: Path):
    bench = tmp_path / "bench.toml"
    bench.write_text(f'[hardware.cameras.camera]\ndriver = "video"\nsource = "{video}"\n')
    reports: list[LiveReport] = []
    with open_live_source(bench=bench, stated=stated_knob(), settings=LiveRunSettings(stale_s=1)) as source:
        live(trained, source, settings=LiveRunSettings(stale_s=1), seconds=20.0, on_report=reports.append)
    assert reports[0].end == "the source has ended"
    assert reports[0].valid > 3
