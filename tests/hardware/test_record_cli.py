"""``tipforce record`` as it is typed: lines, figures, Ctrl-C, what it refuses."""

import json
import os
import re
import signal
import threading
import time

import numpy as np
import pytest
from typer.testing import CliRunner

from tipforce.cli import app
from tipforce.hardware.emulators import CameraEmulator, NetFtEmulator

BENCH = """
[sensor]
angle_deg = 0.0
reads = "tip-on-tissue"
[hardware.cameras.camera]
driver = "opencv"
device = "{camera}"
[hardware.force]
driver = "net-ft"
host = "127.0.0.1"
port = {port}
http_port = {http}
rate_hz = 500.0
"""


@pytest.fixture
def bench(tmp_path):
    with (
        CameraEmulator(lambda k: np.full((24, 32), 50 + k % 50, np.uint8), fps=60) as camera,
        NetFtEmulator(lambda t: (0.1, 0.0, 0.0, 0.0, 0.0, 0.0)) as box,
    ):
        path = tmp_path / "bench.toml"
        path.write_text(BENCH.format(camera=camera.url, port=box.port, http=box.http_port))
        yield path


def test_ctrl_c_ends_a_recording_with_all_that_it_has(bench, tmp_path, monkeypatch):
    monkeypatch.setattr("tipforce.cli.record._LINE_EVERY_S", 0.2)
    target = tmp_path / "run.mcap"
    before = signal.getsignal(signal.SIGINT)
    part = target.with_name("run.mcap.part")

    def interrupt():
        end = time.monotonic() + 60.0
        while not (part.exists() and part.stat().st_size > 80_000):  # some two seconds of events
            assert time.monotonic() < end
            time.sleep(0.01)
        os.kill(os.getpid(), signal.SIGINT)

    stop = threading.Thread(target=interrupt)
    stop.start()
    words = ["record", "--bench", str(bench), "-o", str(target), "--tare", "none", "--offset-ms", "none"]
    result = CliRunner().invoke(app, [*words, "--json", str(tmp_path / "run.json")])
    stop.join()
    assert result.exit_code == 0, result.output
    assert "hardware.force: rate_hz is 1000, not 500 as asked for" in result.output
    assert re.search(r"\d s: camera \d+\.\d Hz, force \d+\.\d Hz", result.output)
    assert signal.getsignal(signal.SIGINT) is before
    assert json.loads((tmp_path / "run.json").read_text())["streams"]["camera"]["count"] > 5
    assert not part.exists()


def test_a_bench_without_devices_and_an_offset_of_logs_are_refused(tmp_path):
    path = tmp_path / "bench.toml"
    path.write_text("[views.camera]\nmetres_per_px = 2.0e-4\n")
    run = CliRunner().invoke(app, ["record", "--bench", str(path), "-o", str(tmp_path / "run.mcap")])
    assert "describes no device" in str(run.exception)
    run = CliRunner().invoke(app, ["record", "--bench", str(path), "-o", "run.mcap", "--offset-ms", "start"])
    assert "--offset-ms start" in str(run.exception)
