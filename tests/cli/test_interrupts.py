"""Ctrl-C and SIGTERM end a verb and all of its processes, say what is kept, and leave nothing half-written."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="looks at processes in /proc")


def of_session(leader: int) -> list[int]:
    """Processes of the session that ``leader`` began, without those that have ended."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, *rest = stat.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if state not in "ZX" and int(rest[2]) == leader:
            found.append(int(stat.parent.name))
    return found


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_no_process_and_no_half_file_is_left_of_a_simulation(tmp_path: Path, number: signal.Signals) -> None:
    words = [
        "simulate",
        "--sessions",
        "2",
        "--seconds",
        "60",
        "--set",
        "width=160",
        "--set",
        "height=120",
        "-o",
        "runs",
    ]
    child = subprocess.Popen(
        [sys.executable, "-m", "tipforce", *words],
        cwd=tmp_path, env={**os.environ, "TIPFORCE_CORES": "2"},
        stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    deadline = time.monotonic() + 60
    while len(of_session(child.pid)) < 4 and time.monotonic() < deadline:  # itself, two workers, multiprocessing's own
        time.sleep(0.05)
    (os.killpg if number is signal.SIGINT else os.kill)(child.pid, number)
    _, said = child.communicate(timeout=30)
    while of_session(child.pid) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not of_session(child.pid)
    if number is not signal.SIGKILL:
        assert child.returncode == 128 + number
        assert said.strip().splitlines()[-1] == (
            f"tipforce: stopped by {number.name}; finished sessions are kept, and the same command goes on"
        )
        assert "Traceback" not in said
        assert not list(tmp_path.rglob("*.part"))
