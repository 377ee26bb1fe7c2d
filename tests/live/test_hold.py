"""Engine, loop, page and drives together, as `tipforce.pipelines.live` runs them."""

import json
import threading
from urllib.parse import urlsplit

import pytest
from websockets.sync.client import ClientConnection, connect

from tipforce.control import SafetySettings
from tipforce.pipelines import HoldSettings, LiveRunSettings, PageAddress, live

from ..control.test_live import Drives  # type: ignore[import-not-found]
from .conftest import FAST, Camera, Method  # type: ignore[import-not-found]

HOLD = HoldSettings(
    controller="pi", approach_mm_per_s=20.0, safety=SafetySettings(least_stale_s=0.1),
    start={"advance_mm": 0.0}, goal={"advance_mm": 15.0},
)  # fmt: skip
SETTINGS = LiveRunSettings(**FAST.model_dump(), hold=HOLD)


class Over(Exception):
    """As Ctrl-C."""


def state_of(socket: ClientConnection) -> str:
    """The next word of the loop, past frames and answers."""
    while True:
        text = socket.recv(timeout=5.0)
        if isinstance(text, str) and (values := json.loads(text))["answer"] == "loop":
            return values["state"]


@pytest.mark.parametrize("end", ["interrupt", "source ends"])
def test_a_run_is_started_over_the_socket_and_whatever_ends_it_stops_the_drives(end: str) -> None:
    camera, drives = Camera(100_000), Drives()
    drives.place, drives.clock = 4.0, camera.clock
    camera.actuators = drives  # type: ignore[attr-defined]
    interrupt = threading.Event()

    def operate(address: str) -> None:
        with connect(f"ws://{urlsplit(address).netloc}/live", proxy=None) as socket:
            while state_of(socket) != "approach":
                socket.send('{"command":"loop","id":1,"do":"start"}')  # refused before the first estimate is there
            interrupt.set()
            if end == "source ends":
                camera.frames = 0

    def on_update(_: object) -> None:
        if end == "interrupt" and interrupt.is_set():
            raise Over

    method = Method(lambda _: 0.0)
    operators: list[threading.Thread] = []

    def on_page(address: str) -> None:
        operators.append(threading.Thread(target=operate, args=(address,)))
        operators[0].start()

    try:
        live(
            method, camera, page=PageAddress(), settings=SETTINGS, seconds=20.0, on_page=on_page, on_update=on_update,
        )  # fmt: skip
    except Over:
        assert end == "interrupt"
    operators[0].join(5.0)
    assert interrupt.is_set()
    assert drives.stops >= 1
    assert not any(thread.name == "control" for thread in threading.enumerate())
