"""Runs a bench of emulated devices: a camera, a Net F/T box, a GRBL stage and an encoder, and writes ``bench.toml``.

python -m tipforce.hardware.emulators FOLDER [--loss 0.01] [--reorder 0.01] [--fps 30] [--seconds S]
"""

import math
import sys
import time
from contextlib import ExitStack, suppress
from pathlib import Path

import numpy as np
import typer

from ...types import Image
from . import CameraEmulator, EncoderEmulator, GrblEmulator, NetFtEmulator, NetFtFaults

_BENCH = """# A bench of emulated devices, as long as `python -m tipforce.hardware.emulators` runs.
[views.camera]
metres_per_px = 2.0e-4
base_side = "left"

[sensor]
angle_deg = 0.0
reads = "tip-on-tissue"

[hardware.cameras.camera]
driver = "opencv"
device = "{url}"
grey = true

[hardware.force]
driver = "net-ft"
host = "127.0.0.1"
port = {port}
http_port = {http_port}
rate_hz = 1000.0

[hardware.stage]
driver = "grbl"
port = "{stage}"

[hardware.stage.axes.stage_forward_mm]
axis = "X"
low = -20.0
high = 20.0

[hardware.knob]
driver = "serial"
port = "{knob}"
rate_hz = 100.0
"""
_CONTACT_FROM_S, _BEAT_HZ, _PEAK_N = 5.0, 1.2, 0.2


def _push(seconds: float) -> float:
    """Returns the push of the tip, 0 to 1: 0 at first, then as of a heart that beats against the tip."""
    return 0.0 if seconds < _CONTACT_FROM_S else max(0.0, math.sin(2 * math.pi * _BEAT_HZ * seconds))


def _image(bend: float) -> Image:
    """Returns (480, 640) grey: a dark line from the left border, bent upward by ``bend``."""
    image = np.full((480, 640), 210, np.uint8)
    columns = np.arange(0, 480)
    middle = 240 - 80 * bend * (columns / 480) ** 2
    rows = np.arange(480)[:, None]
    image[:, :480][np.abs(rows - middle[None, :]) < 6] = 40
    return image


def main(folder: Path, loss: float = 0.0, reorder: float = 0.0, fps: float = 30.0, seconds: float = math.inf) -> None:
    """Starts a camera, a Net F/T box, a GRBL stage and an encoder, and writes FOLDER/bench.toml for them.

    It runs until Ctrl-C, or for SECONDS.

    Args:
        folder: the folder of ``bench.toml`` and of the devices' serial ports.
        loss: share of the force packets that are lost, 0 to 1.
        reorder: share of the force packets that come late, 0 to 1.
        fps: images per second of the camera.
        seconds: duration in s.
    """
    folder = folder.absolute()
    folder.mkdir(parents=True, exist_ok=True)
    zero = time.monotonic()
    faults = NetFtFaults(loss, reorder)
    with ExitStack() as stack:
        camera = stack.enter_context(CameraEmulator(lambda _: _image(_push(time.monotonic() - zero)), fps=fps))
        box = stack.enter_context(
            NetFtEmulator(lambda _: (0.0, _PEAK_N * _push(time.monotonic() - zero), 0.0, 0.0, 0.0, 0.0), faults=faults)
        )
        stage = stack.enter_context(GrblEmulator(folder / "stage"))
        knob = stack.enter_context(EncoderEmulator(folder / "knob", lambda _: 10.0))
        bench = folder / "bench.toml"
        bench.write_text(
            _BENCH.format(url=camera.url, port=box.port, http_port=box.http_port, stage=stage.path, knob=knob.path)
        )
        sys.stdout.write(f"next, in another terminal: tipforce record -o run.mcap --seconds 20 --bench {bench}\n")
        sys.stdout.flush()
        with suppress(KeyboardInterrupt):
            while time.monotonic() - zero < seconds:
                time.sleep(min(0.2, max(0.0, seconds - (time.monotonic() - zero))))


if __name__ == "__main__":
    typer.run(main)
