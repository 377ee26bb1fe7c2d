"""Measures the largest age of a valid force, for every driver and every output.

    python -m bench.studies.live_age drivers [--only NAME] [--json FILE]
    python -m bench.studies.live_age outputs [--only NAME] [--json FILE]

A camera takes image N at a time that is known; the method reads N in the image and returns it as the force, so that
whoever reads a force knows the true age of its image. Drivers: the program is stopped for 8 s (SIGSTOP), the network
stalls for 8 s while the camera's server keeps the images, the first images come seconds apart, or one image comes every
4 s. Outputs: the reader pauses for 8 s, or takes five messages a second of 30, and the run ends. A force counts as
valid until a reader gets another message or its own expiry time has passed.
"""

import argparse
import json
import os
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
import types
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from bench.machine import machine
from pydantic import BaseModel

from tipforce.estimators import Estimator
from tipforce.hardware import (
    GenICamCamera,
    GenICamCameraConfig,
    HardwareSource,
    OpenCvCamera,
    OpenCvCameraConfig,
    Video,
    VideoConfig,
)
from tipforce.io import encode_image
from tipforce.live import Engine, LiveUpdate
from tipforce.live.streams import open_sink
from tipforce.types import ForceEstimate, Frame, SessionInfo, SystemClock

PERIOD_S = 1 / 30
PAUSE_S = 8.0
WARM_S, AFTER_S = 4.0, 8.0
SIZE = 128
NEWTONS = 1e-4
"""The force of image N is N times this."""


# A camera whose image N is taken at a known time


def taken_s(number: int, situation: str) -> float:
    """Returns the time of image ``number``, in seconds since the start."""
    if situation == "slow camera":
        return 4.0 * number
    if situation == "slow start":
        return 3.0 * number if number < 4 else 9.0 + (number - 3) * PERIOD_S
    return number * PERIOD_S


def image_of(number: int) -> np.ndarray:
    """An image that shows its number as 16 bits of 32x32 pixels."""
    bits = [number >> k & 1 for k in range(16)]
    return np.kron(np.array(bits, np.uint8).reshape(4, 4) * 160 + 60, np.ones((SIZE // 4, SIZE // 4), np.uint8))


def number_of(image: np.ndarray) -> int:
    """The number that an image shows."""
    grey = image if image.ndim == 2 else image[:, :, 0]
    means = grey.reshape(4, SIZE // 4, 4, SIZE // 4).mean(axis=(1, 3)).ravel()
    return sum(int(mean > 140) << k for k, mean in enumerate(means))


class NoSettings(BaseModel):
    pass


class Number(Estimator):
    """Returns the number of each image as its force."""

    name = "number"
    settings_type = NoSettings
    views = ("camera",)
    required_actuation = ()

    def start(self, *_: Any):
        return self

    def update(self, observation) -> ForceEstimate:
        newtons = NEWTONS * number_of(observation.views["camera"])
        nan = float("nan")
        return ForceEstimate(
            observation.stamp_ns, np.array([newtons, 0.0, nan]), np.array([True, True, False]), np.full((3, 3), nan),
            np.full((3, 2), nan), newtons, np.full(2, nan),
        )  # fmt: skip


class Queue:
    """Four buffers of a driver that keeps the oldest images, as V4L2 does."""

    def __init__(self, zero_s: float, situation: str) -> None:
        self.zero_s, self.situation, self.next = zero_s, situation, 0
        self.taken_s = 0.0

    def read(self) -> int:
        """The oldest image that waits, or the next one."""
        now_s = time.monotonic() - self.zero_s
        if taken_s(self.next + 4, self.situation) < now_s and self.read_s + 4 * PERIOD_S < now_s:
            self.old, self.read_s = 4, now_s  # four are kept, later ones are lost
        if self.old == 0:
            while taken_s(self.next + 1, self.situation) < now_s:
                self.next += 1
        self.old = max(0, self.old - 1)
        number, self.next = self.next, self.next + 1
        time.sleep(max(0.0, taken_s(number, self.situation) - (time.monotonic() - self.zero_s)))
        self.taken_s = self.zero_s + taken_s(number, self.situation)
        self.read_s = time.monotonic() - self.zero_s
        return number

    old, read_s = 0, 0.0


class Capture:
    """A camera as OpenCV has it."""

    def __init__(self, queue: Queue, stamped: bool) -> None:
        self.queue, self.stamped = queue, stamped

    def isOpened(self) -> bool:
        return True

    def set(self, *_: Any) -> None:
        pass

    def read(self) -> tuple[bool, np.ndarray]:
        return True, cv2.cvtColor(image_of(self.queue.read()), cv2.COLOR_GRAY2BGR)

    def get(self, number: int) -> float:
        return 1e3 * self.queue.taken_s if number == cv2.CAP_PROP_POS_MSEC and self.stamped else 0.0

    def release(self) -> None:
        pass


def fake_harvesters(queue: Queue) -> None:
    """A module with the part of harvesters that the driver uses."""

    class Buffer:
        def __init__(self, number: int) -> None:
            part = types.SimpleNamespace(data=image_of(number).ravel(), width=SIZE, height=SIZE, data_format="Mono8")
            self.payload = types.SimpleNamespace(components=[part])
            self.timestamp_ns = 77 * 10**9 + round(queue.taken_s * 1e9)

        def __enter__(self):
            return self

        def __exit__(self, *_: Any) -> None:
            pass

    class Acquirer:
        remote_device = types.SimpleNamespace(node_map=types.SimpleNamespace())

        def start(self) -> None:
            pass

        stop = destroy = start

        def try_fetch(self, **_: Any) -> Buffer:
            return Buffer(queue.read())

    class Harvester:
        device_info_list = (types.SimpleNamespace(serial_number="1"),)

        def add_file(self, path: str) -> None:
            pass

        def update(self) -> None:
            pass

        reset = update

        def create(self, _: Any) -> Acquirer:
            return Acquirer()

    core: Any = types.ModuleType("harvesters.core")
    core.Harvester = Harvester
    sys.modules |= {"harvesters": types.ModuleType("harvesters"), "harvesters.core": core}


class Stalling:
    """A network camera whose server keeps every image while the network stalls, as motion JPEG."""

    def __init__(self, situation: str) -> None:
        self.stalled, self.zero_s = False, 0.0
        camera = self

        class Stream(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                self.send_response(200)
                self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=b")
                self.end_headers()
                number = 0
                while taken_s(number, situation) < time.monotonic() - camera.zero_s:
                    number += 1
                while True:
                    time.sleep(max(0.0, taken_s(number, situation) - (time.monotonic() - camera.zero_s)))
                    while camera.stalled:
                        time.sleep(0.01)
                    _, data = encode_image(image_of(number), lossless=False, jpeg_quality=90)
                    head = f"--b\r\nContent-Type: image/jpeg\r\nContent-Length: {len(data)}\r\n\r\n"
                    try:
                        self.wfile.write(head.encode() + data + b"\r\n")
                    except OSError:
                        return
                    number += 1

            def log_message(self, format: str, *args: object) -> None:
                pass

        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Stream)
        self.server.daemon_threads = True
        self.url = f"http://127.0.0.1:{self.server.server_address[1]}/camera.mjpg"
        threading.Thread(target=self.server.serve_forever, daemon=True).start()


DRIVERS = (
    "opencv, stamps of V4L2",
    "opencv, no stamps",
    "opencv, an address",
    "video, an address",
    "genicam",
    "foreign source",
)
SITUATIONS = ("the program is stopped for 8 s", "the network stalls for 8 s", "slow start", "slow camera")
NETWORK = ("opencv, an address", "video, an address")


class Foreign:
    """A source of another program on a clock of its own, fed by a socket that keeps unread data."""

    def __init__(self, queue: Queue) -> None:
        self.queue, self.session_info = queue, SessionInfo("foreign")

    def __iter__(self) -> Iterator[Frame]:
        while True:
            number = self.queue.read()
            yield Frame(round(self.queue.taken_s * 1e9) + 5 * 10**12, image_of(number))

    def __enter__(self):
        return self

    def __exit__(self, *_: Any) -> None:
        pass


def source_of(driver: str, situation: str, zero_s: float, url: str) -> Any:
    """The source of one run."""
    queue = Queue(zero_s, situation)
    if driver == "foreign source":
        return Foreign(queue)
    if driver == "genicam":
        fake_harvesters(queue)
        made: Any = GenICamCamera(GenICamCameraConfig(producer=Path(__file__)))
    elif driver == "opencv, an address":
        made = OpenCvCamera(OpenCvCameraConfig(device=url, grey=True))
    elif driver == "video, an address":
        made = Video(VideoConfig(source=url, grey=True))
    else:
        stamped = driver == "opencv, stamps of V4L2"
        made = OpenCvCamera(OpenCvCameraConfig(device=0), open_capture=lambda _: Capture(queue, stamped))
    return HardwareSource([made], newest_only=True)


class Ages:
    """A sink that notes the true age at which each valid force ends: with the next update, or at its expiry time."""

    name, keeps_all = "ages", True

    def __init__(self, zero_s: float, situation: str) -> None:
        self.zero_s, self.situation = zero_s, situation
        self.last: tuple[float, float] | None = None
        self.valid = 0
        self.oldest_s = 0.0
        self.said: set[str] = set()

    def start(self, info, model) -> None:
        pass

    def put(self, update: LiveUpdate) -> None:
        lag_ns = time.time_ns() - update.published_unix_ns
        published_s = time.monotonic() - 1e-9 * lag_ns
        self.end(published_s)
        if update.estimate.valid:
            number = round(update.estimate.magnitude_n / NEWTONS)
            expires_s = published_s + 1e-9 * (update.expires_ns - update.published_ns)
            self.last = self.zero_s + taken_s(number, self.situation), expires_s
            self.valid += 1
        else:
            self.said.add("".join("#" if c.isdigit() else c for c in update.estimate.detail)[:90])

    def end(self, at_s: float) -> None:
        if self.last is not None:
            taken, expires = self.last
            self.oldest_s = max(self.oldest_s, min(at_s, expires) - taken)
        self.last = None

    def close(self) -> None:
        pass


def run_driver(driver: str, situation: str, url: str, seconds: float) -> None:
    """Runs the live program of one run; prints its figures."""
    print("ready", flush=True)
    zero_s = float(sys.stdin.readline())
    source = source_of(driver, situation, zero_s, url)
    ages = Ages(zero_s, situation)
    engine = Engine(source, Number(), [ages], clock=getattr(source, "clock", None))
    with engine.running():
        time.sleep(seconds)
    ages.end(float("inf"))
    print(json.dumps({"valid": ages.valid, "oldest_valid_s": round(ages.oldest_s, 3), "said": sorted(ages.said)}))


def drivers(only: str | None) -> Iterator[dict[str, Any]]:
    """Runs each driver in each of its situations."""
    for driver in DRIVERS:
        for situation in SITUATIONS:
            if (only and only not in driver) or ("network" in situation and driver not in NETWORK):
                continue
            camera = Stalling(situation)
            stops = situation in SITUATIONS[:2]
            seconds = 1.0 + (WARM_S + PAUSE_S + AFTER_S if stops else 18.0)
            child = subprocess.Popen(
                [
                    sys.executable,
                    "-m",
                    "bench.studies.live_age",
                    "run",
                    driver,
                    situation,
                    camera.url,
                    str(seconds),
                ],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
            )
            assert child.stdout is not None
            assert child.stdin is not None
            assert child.stdout.readline() == "ready\n"
            zero_s = camera.zero_s = time.monotonic() + 1.0
            child.stdin.write(f"{zero_s}\n")
            child.stdin.flush()
            if stops:
                time.sleep(max(0.0, zero_s + WARM_S - time.monotonic()))
                if "network" in situation:
                    camera.stalled = True
                    time.sleep(PAUSE_S)
                    camera.stalled = False
                else:
                    os.kill(child.pid, signal.SIGSTOP)
                    time.sleep(PAUSE_S)
                    os.kill(child.pid, signal.SIGCONT)
            found = json.loads(child.communicate()[0])
            camera.server.shutdown()
            yield {"driver": driver, "situation": situation} | found


# Outputs


def udp(port: int) -> Iterator[dict[str, Any]]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", port))
        yield {}
        while True:
            yield json.loads(receiver.recv(1 << 16))
            receiver.settimeout(3.0)  # the last message is lost where the socket is full


def websocket(port: int) -> Iterator[dict[str, Any]]:
    from websockets.sync.client import connect

    with connect(f"ws://127.0.0.1:{port}", max_queue=1) as client:
        yield {}
        for text in client:
            yield json.loads(text)


def igtl(port: int) -> Iterator[dict[str, Any]]:
    head = struct.Struct(">H12s20sIIQQ")
    with socket.create_server(("127.0.0.1", port)) as server:
        yield {}
        connection, _ = server.accept()
        while header := connection.recv(head.size, socket.MSG_WAITALL):
            _, kind, _, _, _, size, _ = head.unpack(header)
            body = connection.recv(size, socket.MSG_WAITALL)
            if kind.startswith(b"STRING"):
                yield json.loads(body[4:])


def lsl(port: int) -> Iterator[dict[str, Any]]:
    import pylsl

    found = pylsl.resolve_byprop("source_id", f"tipforce-age-{port}", timeout=10.0)
    inlet = pylsl.StreamInlet(found[0])
    inlet.open_stream(timeout=10.0)
    yield {}
    while True:
        sample, stamp = inlet.pull_sample(timeout=3.0)
        if sample is None:
            return
        ahead_s = time.time() - pylsl.local_clock()
        yield {
            "status": "valid" if sample[13] == 0.0 else "stale",
            "magnitude_n": sample[9],
            "expires_unix_s": stamp + sample[15] + ahead_s,
        }


def foxglove(port: int) -> Iterator[dict[str, Any]]:
    from websockets.sync.client import connect
    from websockets.typing import Subprotocol

    with connect(
        f"ws://127.0.0.1:{port}", subprotocols=[Subprotocol("foxglove.sdk.v1")], max_queue=1, ping_interval=None
    ) as client:
        wanted: dict[str, int] = {}
        while "/live" not in wanted:
            said = json.loads(client.recv())
            wanted |= {each["topic"]: each["id"] for each in said.get("channels", ())}
        client.send(json.dumps({"op": "subscribe", "subscriptions": [{"id": 1, "channelId": wanted["/live"]}]}))
        yield {}
        for data in client:
            if isinstance(data, bytes):
                yield json.loads(data[13:])


OUTPUTS: dict[str, tuple[str, Callable[[int], Iterator[dict[str, Any]]], bool]] = {
    "json-udp": ("json-udp://127.0.0.1:{port}", udp, False),
    "json-ws": ("json-ws://127.0.0.1:{port}", websocket, True),
    "igtl": ("igtl://127.0.0.1:{port}", igtl, False),
    "lsl": ("lsl://age-{port}", lsl, True),
    "foxglove": ("foxglove://127.0.0.1:{port}", foxglove, True),
}
"""Name -> address, reader, and whether the output is there before its reader."""
READERS = ("pauses for 8 s", "takes five messages a second")


class SteadyCamera:
    """Images on the clock of the engine."""

    def __init__(self, zero_s: float) -> None:
        self.zero_s, self.session_info, self.clock = zero_s, SessionInfo("steady"), SystemClock()

    def __iter__(self) -> Iterator[Frame]:
        number = 0
        ahead_ns = self.clock.now_ns() - time.monotonic_ns()
        while True:
            at_s = self.zero_s + taken_s(number, "")
            time.sleep(max(0.0, at_s - time.monotonic()))
            yield Frame(round(at_s * 1e9) + ahead_ns, image_of(number))
            number += 1

    def __enter__(self):
        return self

    def __exit__(self, *_: Any) -> None:
        pass


def read_output(name: str, reader: str, port: int, zero_s: float) -> None:
    """Runs a reader in a process of its own; prints its figures."""
    messages = OUTPUTS[name][1](port)
    next(messages)
    print("ready", flush=True)
    began_s = time.monotonic()
    count = old = old_valid = 0
    oldest_s, last, paused = 0.0, {}, False
    try:
        for message in messages:
            now_s, unix_s = time.monotonic(), time.time()
            count, last = count + 1, message
            if message["status"] == "valid":
                age_s = now_s - zero_s - taken_s(round(message["magnitude_n"] / NEWTONS), "")
                valid = unix_s <= message["expires_unix_s"]
                old += age_s > 1.0
                old_valid += age_s > 1.0 and valid
                oldest_s = max(oldest_s, age_s if valid else 0.0)
            if reader.startswith("takes"):
                time.sleep(0.2)
            elif not paused and now_s > began_s + 3.0:
                paused = True
                time.sleep(PAUSE_S)
            if "stopped" in message.get("detail", "") or (name == "lsl" and now_s > began_s + 20.0):
                break
            if reader.startswith("takes") and now_s > began_s + 60.0:
                break
    except (OSError, EOFError) as error:
        last |= {"detail": f"then {type(error).__name__}"}
    found = {
        "read": count,
        "older_than_1_s": old,
        "of_these_not_expired": old_valid,
        "oldest_valid_s": round(oldest_s, 3),
        "last": f"{last.get('status')}: {last.get('detail', '')}",
    }
    print(json.dumps(found))


def outputs(only: str | None) -> Iterator[dict[str, Any]]:
    """Runs each output with each of its readers."""
    for name, (address, _, first) in OUTPUTS.items():
        for reader in READERS:
            if only and only != name:
                continue
            with socket.socket() as taken:
                taken.bind(("127.0.0.1", 0))
                port = taken.getsockname()[1]
            zero_s = time.monotonic()
            camera = SteadyCamera(zero_s)
            engine = Engine(camera, Number(), [], clock=camera.clock)
            command = [sys.executable, "-m", "bench.studies.live_age", "read", name, reader, str(port), str(zero_s)]
            with engine.running():
                if first:
                    engine.add_sink(open_sink(address.format(port=port)))
                    time.sleep(1.0)
                child = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
                assert child.stdout is not None
                assert child.stdout.readline() == "ready\n"
                if not first:
                    engine.add_sink(open_sink(address.format(port=port)))
                time.sleep(15.0)
            try:
                found = json.loads(child.communicate(timeout=90.0)[0])
            except subprocess.TimeoutExpired:
                child.kill()
                found = {"read": None}
            yield {"output": name, "reader": reader} | found


def main() -> None:
    if sys.argv[1:2] == ["run"]:
        _, _, driver, situation, url, seconds = sys.argv
        run_driver(driver, situation, url, float(seconds))
        return
    if sys.argv[1:2] == ["read"]:
        _, _, name, reader, port, zero_s = sys.argv
        read_output(name, reader, int(port), float(zero_s))
        return
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("drivers", "outputs"))
    parser.add_argument("--only")
    parser.add_argument("--json", type=Path)
    chosen = parser.parse_args()
    rows = []
    for row in (drivers if chosen.what == "drivers" else outputs)(chosen.only):
        rows.append(row | {"load": round(os.getloadavg()[0], 1)})
        print(json.dumps(rows[-1]), flush=True)
        if chosen.json:
            chosen.json.write_text(json.dumps({"machine": machine(), "rows": rows}, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
