import json
import socket
import time
from collections.abc import Callable, Iterator

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Origin

from tipforce.live import LiveUpdate, Sink
from tipforce.live.streams import LiveMessage, open_sink
from tipforce.types import SessionInfo

WAIT_S = 5.0


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


@pytest.fixture
def served(info: SessionInfo, free_port: int) -> Iterator[tuple[Sink, str]]:
    sink = open_sink(f"json-ws://127.0.0.1:{free_port}?origin=http://lab.example")
    sink.start(info, "m")
    yield sink, f"ws://127.0.0.1:{free_port}"
    sink.close()


def put_when_connected(sink: Sink, update: LiveUpdate) -> None:
    """A client's thread may not wait yet when the client believes to be connected: what came before it is not sent."""
    time.sleep(0.05)
    sink.put(update)


def test_each_client_gets_what_is_new(served: tuple[Sink, str], update: Callable[..., LiveUpdate]) -> None:
    sink, url = served
    sink.put(update(0))  # nobody is there
    with connect(url) as one, connect(url) as two:
        put_when_connected(sink, update(1, valid=False))
        for client in (one, two):
            values = json.loads(client.recv(WAIT_S))
            assert (values["number"], values["status"], values["magnitude_n"]) == (1, "stale", None)
        sink.close()
        with pytest.raises(ConnectionClosed):
            one.recv(WAIT_S)


def test_a_slow_client_gets_the_newest_and_holds_nobody_up(
    served: tuple[Sink, str], update: Callable[..., LiveUpdate]
) -> None:
    sink, url = served
    with connect(url, max_queue=1) as slow, connect(url) as fast:
        time.sleep(0.05)
        base, count = update(0), 3000
        updates = [
            LiveUpdate(n, base.estimate, base.clinical, {}, base.captured_ns, base.published_ns, base.health)
            for n in range(count)
        ]
        start = time.monotonic()
        for each in updates:
            sink.put(each)
        assert time.monotonic() - start < WAIT_S
        last = 0
        while last < count - 1:
            number = json.loads(fast.recv(WAIT_S))["number"]
            assert number >= last
            last = number
        seen = [json.loads(slow.recv(WAIT_S))["number"]]
        while seen[-1] < count - 1:
            seen.append(json.loads(slow.recv(WAIT_S))["number"])
        assert seen == sorted(set(seen))


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
