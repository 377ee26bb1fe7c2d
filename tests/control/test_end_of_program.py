"""Whatever ends a program that holds a force, its drives brake: signals, a closed terminal, an exception."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tipforce.hardware.emulators import GrblEmulator

pytestmark = pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="Windows has neither SIGHUP nor pseudo-terminals")

PROGRAM = """
import sys, time
import numpy as np
from tipforce._system.processes import Interrupted, signals_end_the_program
from tipforce.errors import InputError
from tipforce.hardware import AxisConfig, GrblConfig, GrblStage, HardwareSource
from tipforce.pipelines import HoldSettings, LiveControl
from tipforce.types import ForceEstimate

class Update:
    def __init__(self, stamp_ns):
        self.captured_ns = stamp_ns
        self.estimate = ForceEstimate(
            stamp_ns, np.zeros(3), np.ones(3, np.bool_), np.zeros((3, 3)), np.zeros((3, 2)), 0.0, np.zeros(2)
        )

    def as_of(self, now_ns):
        return self

axis = AxisConfig(axis="X", low=0.0, high=150.0)
source = HardwareSource([GrblStage(GrblConfig(port=sys.argv[1], axes={"advance_mm": axis}))])
hold = HoldSettings(start={"advance_mm": 0.0}, goal={"advance_mm": 140.0}, approach_mm_per_s=8.0)
try:
    with signals_end_the_program(), source:
        assert not source.wait_connected(5.0)
        with LiveControl(source.actuators, source.clock, hold) as control:
            started = False
            while True:
                control.take(Update(source.clock.now_ns()))
                time.sleep(0.02)
                if not started:
                    try:
                        control.start()
                    except InputError:
                        continue
                    started = True
                    print("started", flush=True)
                if sys.argv[2] == "exception" and control.status.place_mm > 4.0:
                    raise ValueError("a bug")
except Interrupted:
    pass
"""


slow = pytest.mark.slow


@pytest.mark.parametrize(
    "end",
    ["SIGINT", pytest.param("SIGTERM", marks=slow), pytest.param("SIGHUP", marks=slow), "SIGHUP twice", "exception"],
)
def test_the_drives_brake_whatever_ends_the_program(tmp_path: Path, end: str) -> None:
    with GrblEmulator(tmp_path / "stage") as grbl:
        command = [sys.executable, "-c", PROGRAM, str(grbl.path), end]
        child = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_DFL),  # nohup would be inherited
        )  # fmt: skip
        assert child.stdout is not None
        assert child.stdout.readline() == "started\n", child.communicate()[1]
        deadline = time.monotonic() + 60.0
        while grbl.place[0] < 4.0 and time.monotonic() < deadline:
            time.sleep(0.01)
        for _ in range(end.endswith("twice") + 1):
            if end != "exception":
                child.send_signal(getattr(signal, end.split()[0]))
        _, said = child.communicate(timeout=60.0)
        assert (end == "exception") == ("a bug" in said), said
        assert b"\x85" in grbl.realtime  # the jog was cancelled
        place = grbl.place[0]
        time.sleep(0.3)
        assert grbl.place[0] == place < 20.0
