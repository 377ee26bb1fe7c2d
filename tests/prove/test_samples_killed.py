"""A set of samples whose making is killed (SIGKILL, the whole group) and begun again is the same set."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

OPTIONS = ["--samples", "60", "--samples-per-session", "10", "--seconds", "8", "--seed", "3"]
OPTIONS += ["--set", "width=320", "--set", "height=240", "--set", "world.tare_s=2"]


def start(folder: Path, *more: str) -> "subprocess.Popen[bytes]":
    command = [sys.executable, "-m", "tipforce", "simulate", "-o", str(folder), *OPTIONS, *more]
    return subprocess.Popen(command, start_new_session=True, stderr=subprocess.DEVNULL)


def finished(folder: Path) -> dict[Path, int]:
    """Files that say that a session is whole, and when they were written."""
    parts = [*folder.glob(".parts/*.json"), *folder.glob(".parts/*.parquet")]
    return {path: path.stat().st_mtime_ns for path in parts}


@pytest.mark.slow
@pytest.mark.parametrize("more", [("--as", "dataset"), ("--as", "parquet")])
def test_a_killed_set_goes_on_without_losing_a_finished_session(more: tuple[str, ...], tmp_path: Path) -> None:
    assert start(tmp_path / "whole", *more).wait() == 0
    kills, before = 0, dict[Path, int]()
    while True:
        making = start(tmp_path / "cut", *more)
        while making.poll() is None and len(finished(tmp_path / "cut")) < len(before) + 2:
            time.sleep(0.02)
        if making.poll() is not None:
            break
        os.killpg(making.pid, signal.SIGKILL)
        making.wait()
        kills += 1
        now = finished(tmp_path / "cut")
        assert before.items() <= now.items()  # what was finished stands as it was
        before = now
    assert kills >= 1
    whole, cut = tmp_path / "whole", tmp_path / "cut"
    names = sorted(str(path.relative_to(whole)) for path in whole.rglob("*") if path.is_file())
    assert names == sorted(str(path.relative_to(cut)) for path in cut.rglob("*") if path.is_file())
    assert all((whole / name).read_bytes() == (cut / name).read_bytes() for name in names)
