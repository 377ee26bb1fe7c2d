"""Engine, loop, page and drives together, as `tipforce.pipelines.live` runs them."""

import json
import threading
from typing import Any
from urllib.parse import urlsplit

import pytest
from pydantic import ValidationError
from websockets.sync.client import ClientConnection, connect

from tipforce.clinical import ContactSettings
from tipforce.control import SafetySettings
from tipforce.live import LiveUpdate
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


def test_window_and_limits_that_contradict_the_loop_are_refused() -> None:
    with pytest.raises(ValidationError, match=r"hold.target_n below contact.limit_n = 0.15, got 0.2"):
        LiveRunSettings.model_validate({"hold": {"target_n": 0.2}, "contact": {"limit_n": 0.15}})
    narrow = {"target_n": 0.05, "safety": {"limit_n": 0.08}}
    with pytest.raises(ValidationError, match=r"contact.window_n\[0\] of at most hold.safety.limit_n = 0.08, got 0.1"):
        LiveRunSettings.model_validate({"hold": narrow})


@pytest.mark.parametrize(("alarm_n", "safety_n"), [(0.4, 0.3), (0.3, 0.4)])
def test_alarm_and_loop_have_one_limit_which_the_page_lowers_for_both(alarm_n: float, safety_n: float) -> None:
    camera, drives = Camera(100_000), Drives()
    drives.clock = camera.clock
    camera.actuators = drives  # type: ignore[attr-defined]
    hold = HOLD.model_copy(update={"safety": SafetySettings(limit_n=safety_n)})
    contact = ContactSettings(limit_n=alarm_n)
    settings = SETTINGS.model_copy(update={"hold": hold, "contact": contact})
    seen: list[object] = []

    def operate(address: str) -> None:
        with connect(f"ws://{urlsplit(address).netloc}/live", proxy=None) as socket:

            def hear(answer: str, limit_n: float | None = None) -> dict[str, Any]:
                while True:
                    text = socket.recv(timeout=5.0)
                    values = json.loads(text) if isinstance(text, str) else {"answer": "a frame"}
                    at = values.get("limit_n", values.get("contact", {}).get("limit_n"))
                    if values["answer"] == answer and limit_n in (None, at):
                        return values

            def ask(limit_n: float) -> bool:
                limits = {"command": "limits", "id": 1, "window_n": [0.1, 0.4], "limit_n": limit_n}
                socket.send(json.dumps(limits))
                return hear("command")["ok"]

            seen.append(hear("state")["contact"]["limit_n"])
            seen.append(hear("loop")["limit_n"])
            seen.append((ask(safety_n + 0.01), ask(0.2)))
            hear("loop", 0.2)
            seen.append(ask(safety_n))  # up again, as far as the loop may
            hear("loop", safety_n)

    operators: list[threading.Thread] = []

    def on_page(address: str) -> None:
        operators.append(threading.Thread(target=operate, args=(address,)))
        operators[0].start()

    def on_update(update: LiveUpdate) -> None:
        if not operators[0].is_alive():
            raise Over

    with pytest.raises(Over):
        live(Method(lambda _: 0.0), camera, page=PageAddress(), settings=settings, seconds=20.0, on_page=on_page,
             on_update=on_update)  # fmt: skip
    assert seen == [0.3, 0.3, (False, True), True]


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
