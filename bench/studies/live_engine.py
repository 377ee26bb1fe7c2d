"""A live run measured: latency to the sink and to the page's socket, frames dropped, CPU, memory over time.

    OMP_NUM_THREADS=1 python -m bench.studies.live_engine pretrained/compact pretrained/dcfe fusion [--seconds S]
        [--json FILE]

Each model runs on a 640x480 video at 60 Hz (written here, lossy, from the simulated bench, and looped) and on the
simulated bench at 60 Hz in real time, which draws its images in the same process. A client on the page's socket
acknowledges each message immediately, as a quick browser does. The first seconds, in which kernels are loaded and
detection is calibrated, are left out of latencies and of the memory's growth. ``--seconds 3600`` is a soak.
"""

import argparse
import json
import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from bench.machine import machine
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from tipforce.estimators import load_model
from tipforce.live import Engine, LiveReport
from tipforce.live.server import PageSettings, serve
from tipforce.live.server._messages import HEADER
from tipforce.pipelines import LiveRunSettings, open_live_source, preset_settings, simulate
from tipforce.types import SessionInfo, read_bench

RATE_HZ = 60.0
WARM_S = 10.0
"""The figures leave out this time from the start."""
MEMORY_EVERY_S = 1.0


class Notes:
    """A sink that notes when each update reaches it."""

    name, keeps_all = "notes", True

    def __init__(self, clock, warm_ns: int) -> None:
        self.clock, self.warm_ns = clock, warm_ns
        self.delays_ns: list[int] = []
        self.valid = self.invalid = 0
        self.reasons: dict[str, int] = {}

    def start(self, info, model) -> None:
        pass

    def put(self, update) -> None:
        now_ns = self.clock.now_ns()
        if now_ns < self.warm_ns:
            return
        self.valid += update.estimate.valid
        self.invalid += not update.estimate.valid
        if not update.estimate.valid:
            reason = "".join("#" if letter.isdigit() else letter for letter in update.estimate.detail)[:90]
            if reason in self.reasons or len(self.reasons) < 50:
                self.reasons[reason] = self.reasons.get(reason, 0) + 1
        if update.frames and len(self.delays_ns) < 1_000_000:
            self.delays_ns.append(now_ns - update.captured_ns)

    def close(self) -> None:
        pass


class Page:
    """A page that acknowledges immediately; ``delays_ns``: from mid-exposure until it read the message."""

    def __init__(self, address: str, clock, warm_ns: int) -> None:
        self.delays_ns: list[int] = []
        self._address, self._clock, self._warm_ns = address.replace("http", "ws").rstrip("/") + "/live", clock, warm_ns
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        origin = self._address.replace("ws", "http").removesuffix("/live")
        try:
            with connect(self._address, origin=origin, max_size=None, compression=None) as socket:
                socket.send(json.dumps({"command": "display", "width_px": 640}))
                for message in socket:
                    if isinstance(message, bytes):
                        self._take(message)
                        number = HEADER.unpack_from(message)[3]
                        socket.send(json.dumps({"command": "ack", "number": number}))
        except ConnectionClosed:
            pass  # the run has ended

    def _take(self, message: bytes) -> None:
        now_ns = self._clock.now_ns()
        *_, captured_ns, _, _, image_bytes = HEADER.unpack_from(message)
        if image_bytes and now_ns >= self._warm_ns:
            self.delays_ns.append(now_ns - captured_ns)


class Memory:
    """Resident memory of this process, once a second."""

    def __init__(self) -> None:
        self.at_s: list[float] = []
        self.mib: list[float] = []
        self._stop = threading.Event()
        self._began = time.monotonic()
        threading.Thread(target=self._follow, daemon=True).start()

    def _follow(self) -> None:
        page_mib = os.sysconf("SC_PAGE_SIZE") / 2**20
        while not self._stop.wait(MEMORY_EVERY_S):
            self.at_s.append(time.monotonic() - self._began)
            self.mib.append(int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * page_mib)

    def stop(self) -> dict[str, float]:
        self._stop.set()
        kept = [mib for at_s, mib in zip(self.at_s, self.mib, strict=False) if at_s >= WARM_S]
        if not kept:
            return {}
        part = max(1, len(kept) // 5)
        first, last = float(np.median(kept[:part])), float(np.median(kept[-part:]))
        return {"first_mib": round(first, 1), "last_mib": round(last, 1), "growth": round(last / first - 1.0, 4)}


def write_input(folder: Path, seconds: float) -> tuple[Path, SessionInfo]:
    """A video of the simulated bench at 60 Hz, and the session metadata of its bench.toml."""
    chosen = preset_settings("bench-2021", max(8.0, seconds), {"world": {"clock": {"fps": RATE_HZ}}})
    simulate(folder, chosen, sessions=1, seed=5, form="files")
    session = folder / "session_00"
    return session / "video.mp4", read_bench(session / "bench.toml")


@contextmanager
def loop_of(path: Path, info: SessionInfo) -> Iterator[Any]:
    with open_live_source(path, stated=info, settings=LiveRunSettings(loop=True, rate_hz=RATE_HZ)) as source:
        yield source


@contextmanager
def bench_in_real_time() -> Iterator[Any]:
    with open_live_source(preset="bench-2021", settings=LiveRunSettings(rate_hz=RATE_HZ, seed=5)) as source:
        yield source


def quantiles(delays_ns: list[int]) -> dict[str, float] | None:
    if not delays_ns:
        return None
    return {f"p{p}": round(float(np.percentile(delays_ns, p)) * 1e-6, 2) for p in (50, 99)}


def ends(delays_ns: list[int]) -> tuple[list[int], list[int]]:
    """The first and the last fifth: whether latency drifts."""
    part = max(1, len(delays_ns) // 5)
    return delays_ns[:part], delays_ns[-part:]


def measure(model: str, source, seconds: float) -> dict[str, Any]:
    """One run of ``seconds`` after the warm-up."""
    clock = source.clock
    engine = Engine(source, load_model(model), settings=LiveRunSettings(max_reconnects=0), clock=clock, model=model)
    with serve(engine, settings=PageSettings(clock=clock)) as server:
        warm_ns = clock.now_ns() + round(WARM_S * 1e9)
        notes, page, memory = Notes(clock, warm_ns), Page(server.address, clock, warm_ns), Memory()
        engine.add_sink(notes)
        engine.add_sink(server.sink)
        load_before = os.getloadavg()[0]
        with engine.running():
            engine.wait(WARM_S)
            cpu_s, began = time.process_time(), time.monotonic()
            frames_in, dropped = engine.latest().health.frames_in, engine.latest().health.dropped
            engine.wait(seconds)
            cpu_share = (time.process_time() - cpu_s) / (time.monotonic() - began)
            health = engine.latest().health
    report: LiveReport = engine.report
    return {
        "model": model,
        "frames_in": health.frames_in - frames_in,
        "dropped": health.dropped - dropped,
        "valid": notes.valid,
        "invalid": notes.invalid,
        "reasons": dict(sorted(notes.reasons.items(), key=lambda item: -item[1])[:5]),
        "sink_ms": quantiles(notes.delays_ns),
        "sink_ms_first_and_last_fifth": [quantiles(part) for part in ends(notes.delays_ns)],
        "page_ms": quantiles(page.delays_ns),
        "page_frames": len(page.delays_ns),
        "cpu_cores": round(cpu_share, 2),
        "memory": memory.stop(),
        "load": [round(load_before, 1), round(os.getloadavg()[0], 1)],
        "sinks": {name: sink.dropped for name, sink in report.sinks.items()},
        "end": report.end,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("models", nargs="+")
    parser.add_argument("--seconds", type=float, default=30.0, help="of each run, after the warm-up")
    parser.add_argument("--source", nargs="+", choices=("video", "simulated"), default=["video", "simulated"])
    parser.add_argument("--video-seconds", type=float, default=12.0, help="length of the video that is looped")
    parser.add_argument("--json", type=Path, help="where the figures go")
    chosen = parser.parse_args()
    figures: dict[str, Any] = {"machine": machine(), "runs": []}
    with TemporaryDirectory() as folder:
        path, info = Path(), SessionInfo()
        if "video" in chosen.source:
            path, info = write_input(Path(folder), chosen.video_seconds)
        for kind in chosen.source:
            for model in chosen.models:
                with loop_of(path, info) if kind == "video" else bench_in_real_time() as source:
                    run = {"source": kind, **measure(model, source, chosen.seconds)}
                figures["runs"].append(run)
                print(json.dumps(run), flush=True)
    if chosen.json:
        chosen.json.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
