import json
import re
import socket
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin

from tipforce.errors import InputError
from tipforce.live import LiveUpdate, Sink
from tipforce.live.streams import LiveMessage, open_sink
from tipforce.types import SessionInfo

WAIT_S = 5.0
PAGE = Path(__file__).parents[3] / "docs" / "streams.md"


def test_datagrams_arrive(update: Callable[..., LiveUpdate], info: SessionInfo) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(WAIT_S)
        sink = open_sink(f"json-udp://127.0.0.1:{receiver.getsockname()[1]}")
        sink.start(info, "m")
        for number in range(2):
            sink.put(update(number, valid=number == 0))
            message = LiveMessage.model_validate_json(receiver.recv(1 << 16))
            assert (message.number, message.magnitude_n) == (number, None if number else 0.25)
        sink.close()
        sink.close()


def test_datagrams_to_nobody_are_no_error(update: Callable[..., LiveUpdate], info: SessionInfo, free_port: int) -> None:
    sink = open_sink(f"json-udp://127.0.0.1:{free_port}")
    sink.start(info, "m")
    for number in range(3):
        sink.put(update(number))
    sink.close()


def test_a_slow_receiver_can_ask_for_fewer_datagrams_and_is_told_at_once_of_an_invalid_estimate(
    update: Callable[..., LiveUpdate], info: SessionInfo
) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(0.1)
        sink = open_sink(f"json-udp://127.0.0.1:{receiver.getsockname()[1]}?rate_hz=0.5")
        sink.start(info, "m")
        for number in range(50):
            sink.put(update(number, valid=number != 40))
        found = [json.loads(receiver.recv(1 << 16)) for _ in range(2)]
        assert [(each["number"], each["status"]) for each in found] == [(0, "valid"), (40, "stale")]
        with pytest.raises(TimeoutError):
            receiver.recv(1 << 16)
        sink.close()
    for bad in ("0", "-1", "fast", "inf", "nan"):
        with pytest.raises(InputError, match="expected messages a second, as in rate_hz=30"):
            open_sink(f"json-udp://127.0.0.1:9?rate_hz={bad}")


def test_the_reader_in_the_documentation_passes_over_what_waited_too_long(
    update: Callable[..., LiveUpdate], info: SessionInfo, capsys: pytest.CaptureFixture[str], free_port: int
) -> None:
    text = re.search(r"```python\n(import json, socket, time.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert text
    program = text[1].replace("8766", str(free_port)).replace("while True:", "for _ in range(3):")
    old, new = update(0), update(1)
    late = replace(old, published_unix_ns=old.published_unix_ns - 1_100_000_000)
    sink = open_sink(f"json-udp://127.0.0.1:{free_port}")
    sink.start(info, "m")

    def send() -> None:
        time.sleep(0.1)
        for each in (late, new):
            sink.put(each)

    sender = threading.Thread(target=send)
    sender.start()
    names: dict[str, Any] = {}
    exec(program, names)
    names["receiver"].close()
    sender.join()
    sink.close()
    assert capsys.readouterr().out.splitlines() == [
        "0.25 [0.22, 0.28]",
        "no force: nothing was heard for 200 ms",
    ]


@pytest.fixture
def served(info: SessionInfo, free_port: int) -> Iterator[tuple[Sink, str]]:
    sink = open_sink(f"json-ws://127.0.0.1:{free_port}?origin=http://lab.example")
    sink.start(info, "m")
    yield sink, f"ws://127.0.0.1:{free_port}"
    sink.close()


def join(sink: Sink, update: LiveUpdate, *clients: ClientConnection) -> None:
    """Until each client has had ``update``: what came before its thread waits is not sent to it."""
    deadline = time.monotonic() + 4 * WAIT_S
    for client in clients:
        while True:
            sink.put(update)
            try:
                client.recv(0.05)
                break
            except TimeoutError:
                assert time.monotonic() < deadline


def number_after(client: ClientConnection, first: int) -> int:
    """Number of the next message from ``first`` on; what joined is passed over."""
    while (values := json.loads(client.recv(WAIT_S)))["number"] < first:
        pass
    return values["number"]


def test_each_client_gets_what_is_new(served: tuple[Sink, str], update: Callable[..., LiveUpdate]) -> None:
    sink, url = served
    sink.put(update(0))  # nobody is there
    with connect(url) as one, connect(url) as two:
        join(sink, update(1), one, two)
        sink.put(update(2, valid=False))
        for client in (one, two):
            while (values := json.loads(client.recv(WAIT_S)))["number"] < 2:
                assert values["number"] == 1
            assert (values["status"], values["magnitude_n"]) == ("stale", None)
        sink.close()
        with pytest.raises(ConnectionClosed):
            one.recv(WAIT_S)


def test_a_slow_client_gets_the_newest_and_holds_nobody_up(
    served: tuple[Sink, str], update: Callable[..., LiveUpdate]
) -> None:
    sink, url = served
    with connect(url, max_queue=1) as slow, connect(url) as fast:
        base, count = update(0), 3000
        join(sink, base, slow, fast)
        updates = [
            LiveUpdate(n, base.estimate, base.clinical, {}, base.captured_ns, base.published_ns, base.health)
            for n in range(1, count)
        ]
        start = time.monotonic()
        for each in updates:
            sink.put(each)
        assert time.monotonic() - start < WAIT_S
        last = 0
        while last < count - 1:
            number = number_after(fast, 1)
            assert number > last
            last = number
        seen = [number_after(slow, 1)]
        while seen[-1] < count - 1:
            seen.append(json.loads(slow.recv(WAIT_S))["number"])
        assert seen == sorted(set(seen))


def test_a_client_that_stops_reading_gets_a_few_old_messages_then_the_newest_and_the_last_one(
    served: tuple[Sink, str], update: Callable[..., LiveUpdate]
) -> None:
    sink, url = served
    with connect(url, max_queue=1) as client:
        join(sink, update(0), client)
        for number in range(1, 200):
            sink.put(update(number))
            time.sleep(0.005)
        seen = [json.loads(client.recv(WAIT_S))]
        while seen[-1]["number"] < 199:
            seen.append(json.loads(client.recv(WAIT_S)))
        old = [each for each in seen if each["number"] < 199]
        assert len(old) <= 8, "what it had not acknowledged, and what its own library had read"
        closing = threading.Thread(target=sink.close)
        sink.put(update(200, valid=False))
        closing.start()
        assert json.loads(client.recv(WAIT_S))["status"] == "stale"
        with pytest.raises(ConnectionClosed):
            client.recv(WAIT_S)
        closing.join()


def test_the_last_message_reaches_a_client_though_the_end_comes_at_once(
    served: tuple[Sink, str], update: Callable[..., LiveUpdate]
) -> None:
    sink, url = served
    with connect(url) as client:
        join(sink, update(0), client)
        sink.put(update(1, valid=False))
        sink.close()
        assert number_after(client, 1) == 1


def test_a_foreign_web_page_is_refused(served: tuple[Sink, str]) -> None:
    _, url = served
    for origin in ("http://evil.example", "http://localhost", "null"):
        with pytest.raises(InvalidStatus, match="403"), connect(url, origin=Origin(origin)):
            pass
    with connect(url, origin=Origin("http://lab.example")):
        pass


def test_a_port_in_use_is_an_error_of_the_sink(served: tuple[Sink, str], info: SessionInfo) -> None:
    _, url = served
    other = open_sink(url.replace("ws://", "json-ws://"))
    with pytest.raises(OSError, match="in use"):
        other.start(info, "m")
    other.close()
