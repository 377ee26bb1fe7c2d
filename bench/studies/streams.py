"""Latency of the outgoing streams over loopback: from the sink's `put` to the receiver, which is another process.

    OMP_NUM_THREADS=1 python -m bench.studies.streams [--seconds S] [--rate-hz F] [--only KIND] [--json FILE]

Each update is one of ``fusion``'s size with an image of 640x480. ``put`` is how long the sink's thread is busy with
one. Receivers: a bare socket (JSON over UDP, OpenIGTLink), websockets (JSON, Foxglove by hand), a pylsl inlet; of a
recording only ``put`` is measured, and that all was read back.
"""

import argparse
import json
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from bench.machine import machine

from tipforce.clinical import ContactMonitor
from tipforce.io import RecordingReader
from tipforce.live import LiveHealth, LiveUpdate
from tipforce.live.streams import open_sink
from tipforce.simulation import PRESETS, LiveSimulation
from tipforce.types import (
    BasePose,
    CentrelinePx,
    DetectedShape,
    ForceEstimate,
    Frame,
    SessionInfo,
    Status,
    ViewInfo,
)

INFO = SessionInfo("loopback", views={"camera": ViewInfo(metres_per_px=2e-4)})
ADDRESSES = {
    "json-udp": "json-udp://127.0.0.1:{port}",
    "json-ws": "json-ws://127.0.0.1:{port}",
    "igtl": "igtl://127.0.0.1:{port}",
    "foxglove": "foxglove://127.0.0.1:{port}",
    "lsl": "lsl://bench-{port}",
    "recording": "recording:{folder}/run.mcap",
}
SERVERS_OF_OURS = ("json-ws", "foxglove", "lsl")


def images() -> list[np.ndarray]:
    """Images of a simulated session, whose compression is realistic."""
    preset = PRESETS["bench-2021"]
    world = preset.world.model_copy(update={"seconds": 8.0})
    with LiveSimulation(preset.model_copy(update={"world": world}), seed=0, session=1) as bench:
        return [event.image for event in bench.source if isinstance(event, Frame)][:16]


def update_of(number: int, image: np.ndarray, monitor: ContactMonitor) -> LiveUpdate:
    """A valid update whose image was taken 10 ms ago."""
    now_ns = time.monotonic_ns()
    line = np.stack([np.linspace(0.0, 400.0, 200), np.linspace(240.0, 300.0, 200)], axis=1)
    shape = DetectedShape(Status.VALID, "", CentrelinePx(line), BasePose(np.array([0.0, 240.0]), 0.0), 12.0, 1.0)
    estimate = ForceEstimate(
        stamp_ns=now_ns - 10_000_000,
        force_n=np.array([-0.1, 0.1, np.nan]),
        known=np.array([True, True, False]),
        covariance_n2=np.eye(3) * 1e-4,
        interval_n=np.array([[-0.12, -0.08], [0.08, 0.12], [np.nan, np.nan]]),
        magnitude_n=0.1414,
        magnitude_interval_n=np.array([0.12, 0.16]),
        contact=0.99,
        shape=shape,
    )
    health = LiveHealth(60.0, number + 1, 0, 0.01, 0.012, "running")
    return LiveUpdate(
        number, estimate, monitor.update(estimate), {"camera": image}, now_ns - 10_000_000, now_ns, health
    )


def free_port() -> int:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        return taken.getsockname()[1]


def measure(kind: str, seconds: float, rate_hz: float, shown: list[np.ndarray], folder: str) -> dict[str, float]:
    """Milliseconds of latency and of ``put``, and the share that arrived."""
    port = free_port()
    sink, monitor = open_sink(ADDRESSES[kind].format(port=port, folder=folder)), ContactMonitor()
    command = [sys.executable, "-m", "bench.studies.stream_receivers", kind, str(port)]
    if kind in SERVERS_OF_OURS:
        sink.start(INFO, "bench")
        sink.put(update_of(0, shown[0], monitor))  # of Foxglove it makes the channel of the view
    child = None if kind == "recording" else subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    if child:
        assert child.stdout is not None
        assert child.stdout.readline() == "ready\n"
    if kind not in SERVERS_OF_OURS:
        sink.start(INFO, "bench")
    sent: dict[int, int] = {}
    busy = []
    begun = time.monotonic()
    for number in range(1, round(seconds * rate_hz) + 1):
        time.sleep(max(0.0, begun + number / rate_hz - time.monotonic()))
        update = update_of(number, shown[number % len(shown)], monitor)
        sent[number] = start = time.monotonic_ns()
        sink.put(update)
        busy.append((time.monotonic_ns() - start) * 1e-6)
    if kind in ("igtl", "recording"):  # the receiver's end is ours
        sink.close()
    times = json.loads(child.communicate()[0]) if child else []
    sink.close()
    figures = {f"put_p{p}_ms": float(np.percentile(busy, p)) for p in (50, 99)}
    if child is None:
        with RecordingReader(Path(folder) / "run.mcap") as reader:
            kept = sum(1 for _ in reader.estimates())
        return figures | {"arrived": kept / len(sent)}
    if all(number == -1 for number, _ in times):
        assert len(times) == len(sent), (len(times), len(sent))
        times = [(number, at) for number, (_, at) in zip(sent, times, strict=True)]
    lag = [(at - sent[number]) * 1e-6 for number, at in times if number in sent]
    return (
        {f"latency_p{p}_ms": float(np.percentile(lag, p)) for p in (50, 99)}
        | {"latency_max_ms": max(lag)}
        | figures
        | {"arrived": len(lag) / len(sent)}
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--rate-hz", type=float, default=60.0)
    parser.add_argument("--only", choices=list(ADDRESSES))
    parser.add_argument("--json", type=Path)
    chosen = parser.parse_args()
    figures, shown = {}, images()
    for kind in [chosen.only] if chosen.only else ADDRESSES:
        with tempfile.TemporaryDirectory() as folder:
            figures[kind] = measure(kind, chosen.seconds, chosen.rate_hz, shown, folder)
        print(kind, {name: round(value, 3) for name, value in figures[kind].items()}, flush=True)
    if chosen.json:
        chosen.json.write_text(json.dumps({"machine": machine(), **figures}, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
