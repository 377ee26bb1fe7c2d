"""`tipforce live` that is killed (SIGKILL) while it records leaves a recording that ends shortly before the kill."""

import json
import os
import random
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest
from websockets.sync.client import connect

from tipforce.io import open_recording

pytestmark = pytest.mark.slow
_MODEL = "pretrained/compact"
_READY_S = 120.0
_LEAST_S = 2.0
"""Killed so long after the recording begins, or up to three seconds later."""
_LOST_S = 0.6
"""What may be missing at the end: a quarter of a second in the writer, what is on its way through the engine, and as
much again on a machine with other work."""
_S = 1e-9


@contextmanager
def running(folder: Path, *more: str) -> "Generator[subprocess.Popen[str]]":
    """`tipforce live` on the simulated bench in real time; what is left of it is killed."""
    command = [sys.executable, "-m", "tipforce", "live", _MODEL, "--simulated", "bench-2021", "--port", "0", *more]
    live = subprocess.Popen(command, cwd=folder, stderr=subprocess.PIPE, text=True)
    try:
        yield live
    finally:
        live.kill()
        live.wait()
        assert live.stderr is not None
        live.stderr.close()


def until(found: Callable[[], list[Path]]) -> Path:
    end = time.monotonic() + _READY_S
    while not (paths := found()):
        assert time.monotonic() < end, "nothing is recorded"
        time.sleep(0.02)
    return paths[0]


def press_record(live: "subprocess.Popen[str]") -> None:
    """As the button of the page does."""
    assert live.stderr is not None
    address = next(line.split()[-1] for line in live.stderr if line.startswith("page: "))
    with connect(f"ws://{urlsplit(address).netloc}/live", proxy=None) as socket:
        end = time.monotonic() + _READY_S
        while time.monotonic() < end:
            socket.send('{"command":"record","id":1,"on":true}')
            text = socket.recv(timeout=_READY_S)
            while not isinstance(text, str) or (answer := json.loads(text))["answer"] != "command":
                text = socket.recv(timeout=_READY_S)
            if answer["ok"]:
                return
            time.sleep(0.1)  # the page is there before the run
    raise AssertionError("the button does not begin a recording")


@pytest.mark.parametrize("by", ["option", "option again", "button"])
def test_a_killed_live_run_leaves_its_recording_up_to_shortly_before(by: str, tmp_path: Path) -> None:
    with running(tmp_path, *(() if by == "button" else ("--record", "run.mcap"))) as live:
        if by == "button":
            press_record(live)
        part = until(lambda: [path for path in tmp_path.glob("*.mcap.part") if path.stat().st_size > 50_000])
        time.sleep(_LEAST_S + random.Random(by).uniform(0.0, 3.0))
        killed_ns = time.monotonic_ns()  # the clock of the simulated bench in real time, and so of its stamps
        os.kill(live.pid, signal.SIGKILL)
        live.wait()
    path = part.with_suffix("")
    assert not path.exists()  # it does not look finished

    inspect = [sys.executable, "-m", "tipforce", "inspect", str(path)]
    said = subprocess.run(inspect, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert "recovered" in said.stdout + said.stderr
    assert path.exists()
    assert not part.exists()
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # once recovered it is a recording like any other
        reader = open_recording(path)
    with reader:
        estimates = list(reader.estimates())
        frames = reader.stamps("camera")
        assert all(reader.frame_at(index).image.shape[:2] == (480, 640) for index in range(len(frames)))
        assert reader.info.metadata["tipforce.live"] == {"model": _MODEL}
    stamps = np.array([each.stamp_ns for each in estimates])
    valid = [each for each in estimates if each.valid]
    lost_s, lost_images_s = (killed_ns - stamps[-1]) * _S, (killed_ns - frames[-1]) * _S
    print(
        f"{by}: {len(estimates)} estimates, {len(valid)} with a force, {len(frames)} images; "
        f"{lost_s:.3f} s and {lost_images_s:.3f} s of images before the kill are missing"
    )
    assert (stamps[-1] - stamps[0]) * _S > _LEAST_S - _LOST_S
    assert all(np.isfinite(each.force_n[each.known]).all() for each in valid)
    assert len(valid) > 5  # of 24 a second: an overloaded machine draws most of them too late
    assert {each.stamp_ns for each in valid} <= set(frames.tolist())  # a notice of the watchdog has no image
    assert set(frames[:-1].tolist()) <= set(stamps.tolist())  # the kill may come between an image and its estimate
    assert 0.0 < lost_s < _LOST_S
