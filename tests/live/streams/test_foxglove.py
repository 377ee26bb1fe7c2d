"""A client that speaks foxglove.sdk.v1 by hand: nothing of foxglove-sdk is on its side."""

import contextlib
import json
import struct
import time
from collections.abc import Callable, Iterator

import cv2
import numpy as np
import pytest
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin, Subprotocol

from tipforce.live import LiveUpdate, Sink
from tipforce.live.streams import LiveMessage, open_sink
from tipforce.live.streams._foxglove import APP, FoxgloveServer
from tipforce.types import SessionInfo

WAIT_S = 5.0
SDK = [Subprotocol("foxglove.sdk.v1")]
MESSAGE_DATA = struct.Struct("<BIQ")


@pytest.fixture
def served(info: SessionInfo, free_port: int) -> Iterator[tuple[Sink, str]]:
    sink = open_sink(f"foxglove://127.0.0.1:{free_port}")
    sink.start(info, "pretrained/fusion")
    yield sink, f"ws://127.0.0.1:{free_port}"
    sink.close()


def advertised(client: ClientConnection, count: int) -> dict[str, dict[str, str | int]]:
    found: dict[str, dict[str, str | int]] = {}
    while len(found) < count:
        said = json.loads(client.recv(WAIT_S))
        if said["op"] == "advertise":
            found |= {each["topic"]: each for each in said["channels"]}
    return found


def test_an_independent_client_reads_images_estimates_and_json(
    served: tuple[Sink, str], update: Callable[..., LiveUpdate]
) -> None:
    sink, url = served
    sink.put(update(0))  # makes the channel of the view
    with connect(url, subprotocols=SDK) as client:
        assert client.subprotocol == SDK[0]
        assert json.loads(client.recv(WAIT_S))["op"] == "serverInfo"
        channels = advertised(client, 3)
        assert set(channels) == {"/live", "/estimate", "/camera/compressed"}
        topics = dict(enumerate(channels))
        wanted = [{"id": number, "channelId": channels[topic]["id"]} for number, topic in topics.items()]
        client.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
        for valid in (True, False):
            found: dict[str, tuple[int, bytes]] = {}
            expected = 3 if valid else 2  # a notice has no image
            deadline = time.monotonic() + WAIT_S
            while len(found) < expected:  # the server reads the subscription when it comes to it
                assert time.monotonic() < deadline
                sink.put(update(1, valid=valid))
                found = dict(_burst(client, topics))
                found = found if _statuses(found, valid) else {}
            at, raw = found["/live"]
            message = LiveMessage.model_validate_json(raw)
            assert message.magnitude_n == (0.25 if valid else None)
            assert at * 1e-9 == pytest.approx(message.captured_unix_s, abs=0.05)
            channel = channels["/estimate"]
            described = Schema(1, str(channel["schema"]).encode(), "ros2msg", str(channel["schemaName"]))
            decode = DecoderFactory().decoder_for("cdr", described)
            assert decode is not None
            estimate = decode(found["/estimate"][1])
            assert (estimate.status, estimate.magnitude_n == 0.25) == ("valid" if valid else "stale", valid)
            assert np.isnan(estimate.force_n).all() == (not valid)
            if valid:
                _, raw = found["/camera/compressed"]
                jpeg = np.frombuffer(raw[raw.index(b"\xff\xd8") :], np.uint8)
                assert cv2.imdecode(jpeg, cv2.IMREAD_UNCHANGED).shape[:2] == (48, 64)


def _statuses(found: dict[str, tuple[int, bytes]], valid: bool) -> bool:
    """Whether this is the update that was just sent, and not what was still on its way."""
    return "/live" in found and (json.loads(found["/live"][1])["status"] == "valid") == valid


def _burst(client: ClientConnection, topics: dict[int, str]) -> Iterator[tuple[str, tuple[int, bytes]]]:
    """What comes until nothing more comes for a while."""
    while True:
        try:
            data = client.recv(0.1)
        except TimeoutError:
            return
        if isinstance(data, bytes):
            kind, subscription, log_time = MESSAGE_DATA.unpack_from(data)
            assert kind == 1
            yield topics[subscription], (log_time, data[MESSAGE_DATA.size :])


def test_a_client_that_stops_reading_gets_a_few_old_messages_then_the_newest_and_the_last_one(
    served: tuple[Sink, str], update: Callable[..., LiveUpdate]
) -> None:
    sink, url = served
    sink.put(update(0))
    with connect(url, subprotocols=SDK, max_queue=1) as client:
        client.recv(WAIT_S)
        channel = advertised(client, 3)["/live"]["id"]
        client.send(json.dumps({"op": "subscribe", "subscriptions": [{"id": 0, "channelId": channel}]}))
        deadline, first = time.monotonic() + WAIT_S, None
        while first is None:
            assert time.monotonic() < deadline
            sink.put(update(0))
            with contextlib.suppress(TimeoutError):
                first = client.recv(0.1)
        for number in range(1, 150):
            sink.put(update(number))
            time.sleep(0.005)
        time.sleep(0.2)
        seen = [number_in(client.recv(WAIT_S))]
        while seen[-1] < 149:
            seen.append(number_in(client.recv(WAIT_S)))
        assert seen == sorted(seen)
        assert len([number for number in seen if 0 < number < 149]) <= 10, "of 148"
        sink.put(update(150, valid=False))
        sink.close()
        assert number_in(client.recv(WAIT_S)) == 150
        with pytest.raises(ConnectionClosed):
            client.recv(WAIT_S)


def number_in(data: str | bytes) -> int:
    assert isinstance(data, bytes)
    return json.loads(data[MESSAGE_DATA.size :])["number"]


def test_foreign_web_pages_are_refused_and_foxgloves_own_is_not(served: tuple[Sink, str]) -> None:
    _, url = served
    with (
        pytest.raises(InvalidStatus, match="403"),
        connect(url, subprotocols=SDK, origin=Origin("http://evil.example")),
    ):
        pass
    with connect(url, subprotocols=SDK, origin=Origin(APP)) as client:
        assert json.loads(client.recv(WAIT_S))["op"] == "serverInfo"


def test_the_server_behind_cannot_be_found_at_the_usual_address(served: tuple[Sink, str]) -> None:
    sink, _ = served
    assert isinstance(sink, FoxgloveServer)
    host, port = sink._behind
    assert host != "127.0.0.1"
    with pytest.raises(ConnectionRefusedError), connect(f"ws://127.0.0.1:{port}"):
        pass


def test_the_server_ends_and_starts_again(
    served: tuple[Sink, str], info: SessionInfo, update: Callable[..., LiveUpdate]
) -> None:
    sink, url = served
    sink.close()
    with pytest.raises(OSError, match="refused"), connect(url):
        pass
    sink.start(info, "m")
    sink.put(update(0))
    with connect(url, subprotocols=SDK) as client:
        assert json.loads(client.recv(WAIT_S))["op"] == "serverInfo"
