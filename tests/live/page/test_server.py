"""The page's server, spoken to without a browser: one frame in flight, who may speak, and what is answered."""

import asyncio
import http.client
import json
import re
import socket
import struct
import threading
import time
from collections.abc import Iterator, MutableMapping
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from starlette.websockets import WebSocket
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from tipforce.errors import InputError
from tipforce.live.server import PageServer, PageSettings, serve
from tipforce.live.server._messages import GAP_PX, EncodedUpdate
from tipforce.live.server._session import PageSession
from tipforce.types import Image, SessionInfo, Status

from .updates import (  # type: ignore[import-not-found]
    CLOCK,
    FakeEngine,
    FakeLoop,
    Publisher,
    estimate_in_space,
    estimate_of,
    eventually,
)

TOKEN = "a-token-of-some-length"
QUIET_S = 0.08


class Client:
    """A page without a browser."""

    def __init__(self, socket: ClientConnection) -> None:
        self.socket = socket
        self.state = self.text()

    def text(self, seconds: float = 5.0) -> dict[str, Any]:
        received = self.socket.recv(timeout=seconds)
        assert isinstance(received, str)
        return json.loads(received)

    def frame(self, seconds: float = 5.0) -> tuple[int, dict[str, Any], bytes]:
        """Number, values and JPEG of the next message, which must be a frame."""
        received = self.socket.recv(timeout=seconds)
        assert isinstance(received, bytes)
        magic, version, header, number, _, _, json_bytes, jpeg_bytes = struct.unpack_from("<4sHHIqqII", received)
        assert (magic, version, header) == (b"TIPF", 1, 36)
        assert len(received) == header + json_bytes + jpeg_bytes
        return number, json.loads(received[header : header + json_bytes]), received[header + json_bytes :]

    def quiet(self) -> bool:
        try:
            self.socket.recv(timeout=QUIET_S)
        except TimeoutError:
            return True
        return False

    def send(self, **values: Any) -> None:
        self.socket.send(json.dumps(values))

    def ack(self, number: int) -> None:
        self.send(command="ack", number=number)

    def ask(self, **values: Any) -> dict[str, Any]:
        """Sends a command; returns its answer."""
        self.send(**values)
        while True:
            answer = self.text()
            if answer["answer"] in ("command", "refused"):
                return answer


@contextmanager
def opened(server: PageServer, path: str = "/live", **more: Any) -> Iterator[Client]:
    with connect(f"ws://127.0.0.1:{server.port}{path}", proxy=None, **more) as socket:
        yield Client(socket)


def request(
    server: PageServer, method: str = "GET", path: str = "/", **headers: str
) -> tuple[int, dict[str, str], bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=5.0)
    connection.request(method, path, headers={name.replace("_", "-"): value for name, value in headers.items()})
    answer = connection.getresponse()
    content = answer.read()
    connection.close()
    return answer.status, {name.lower(): value for name, value in answer.getheaders()}, content


def test_no_second_frame_before_the_first_is_acknowledged_and_then_the_newest(
    server: PageServer, publisher: Publisher
) -> None:
    with opened(server) as client:
        first = publisher.put(0.1)
        assert client.frame()[0] == first
        for force in (0.2, 0.3):
            last = publisher.put(force)
        assert client.quiet()
        client.ack(last)  # of a frame that this page has not got
        assert client.quiet()
        client.ack(first)
        number, values, _ = client.frame()
        assert number == last
        assert values["magnitude_n"] == 0.3
        client.ack(last)
        assert client.quiet()  # nothing new


def test_a_page_that_is_slow_keeps_no_other_waiting(server: PageServer, publisher: Publisher) -> None:
    with opened(server) as slow, opened(server) as fast:
        first = publisher.put()
        assert slow.frame()[0] == first
        for number in (first, first + 1, first + 2):
            assert fast.frame()[0] == number
            fast.ack(number)
            publisher.put()
        assert slow.quiet()
        eventually(lambda: server.pages == 2)
    eventually(lambda: server.pages == 0)


def test_a_page_that_comes_late_gets_the_newest(server: PageServer, publisher: Publisher) -> None:
    for _ in range(3):
        last = publisher.put()
    with opened(server) as client:
        assert client.frame()[0] == last


def test_an_image_is_encoded_once_for_all_pages_of_its_size(
    publisher: Publisher, monkeypatch: pytest.MonkeyPatch
) -> None:
    encoded: list[int] = []
    original = cv2.imencode
    monkeypatch.setattr(cv2, "imencode", lambda *given: encoded.append(given[1].shape[1]) or original(*given))
    update = publisher.update(estimate_of((-0.2, 0.0)), image=np.zeros((960, 1280, 3), np.uint8))
    messages = EncodedUpdate(update, 80)
    threads = [threading.Thread(target=messages.message, args=("camera", pixels)) for pixels in (630, 640, 600, 900)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(encoded) == [640, 960]
    assert messages.message("", 601) is messages.message("camera", 640)
    assert len(encoded) == 2


@pytest.mark.parametrize(("pixels", "width"), [(100, 320), (500, 640), (5000, 800)])
def test_an_image_is_scaled_to_what_the_page_asks_for_and_never_enlarged(
    server: PageServer, publisher: Publisher, pixels: int, width: int
) -> None:
    image = np.zeros((600, 800, 3), np.uint8)
    image[:, 400:, 0] = 255  # red in RGB
    with opened(server) as client:
        client.send(command="display", view="camera", width_px=pixels)
        client.send(command="ping", sent_ms=1.0)
        client.text()  # the page's wish has been read
        publisher.put(image=image)
        _, values, jpeg = client.frame()
    assert values["size"] == [800, 600]
    shown = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert shown.shape == (width * 3 // 4, width, 3)
    assert (np.abs(shown[10, -10].astype(int) - [0, 0, 255]) < 12).all()


def test_the_page_chooses_among_views_and_gets_all_side_by_side_where_it_chooses_none(
    server: PageServer, publisher: Publisher, image: Image
) -> None:
    with opened(server) as client:
        for wanted, got, width in (("b", "b", 320), ("", "", 320 + GAP_PX + 768)):
            client.send(command="display", view=wanted, width_px=320)
            client.send(command="ping", sent_ms=1.0)
            client.text()
            publisher.put(views={"a": image, "b": image[:100]})
            number, values, _ = client.frame()
            assert (values["view"], values["views"], values["read"]) == (got, ["a", "b"], ["a", "b"])
            assert values["size"][0] == width
            begins = [panel["begins_px"] for panel in values["panels"]]
            assert begins == ([] if got else [0, 320 + GAP_PX])
            client.ack(number)


def test_a_view_that_the_method_does_not_read_is_shown_beside(
    server: PageServer, publisher: Publisher, image: Image
) -> None:
    with opened(server) as client:
        publisher.put(views={"b": image}, beside={"a": np.dstack([image] * 3)})
        _, values, jpeg = client.frame()
    assert (values["views"], values["read"], values["view"]) == (["b", "a"], ["b"], "")
    assert [panel["view"] for panel in values["panels"]] == ["b", "a"]
    assert (
        cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR).shape[1] == 640
    )  # the width that pages begin with


def test_views_that_are_exposed_in_turn_keep_their_places_and_their_shapes(
    server: PageServer, publisher: Publisher, image: Image
) -> None:
    small = np.ascontiguousarray(image[:120, :160])
    with opened(server) as client:
        for views, beside in (({"a": image}, {"b": small}), ({"b": small}, {"a": image})):
            update = publisher.update(estimate_in_space(), views=views, beside=beside, reads=("a", "b"))
            server.sink.put(update)
            _, values, _ = client.frame()
            assert (values["views"], values["read"]) == (["a", "b"], ["a", "b"])
            assert values["panels"] == [
                {"view": "a", "begins_px": 0, "scale": 1.0},
                {"view": "b", "begins_px": 328, "scale": 2.0},
            ]
            client.ack(update.number)
    assert values["shapes_beside"]["b"]["axes_px"] == [[1.0, 0.0], [0.0, 0.05], [0.0, -1.0]]
    assert values["shapes_beside"]["b"]["centreline_px"][0] == [40.0, 120.0]
    assert (values["force_n"], values["component_intervals_n"][2]) == ([-0.2, 0.0, 0.2], [0.18, 0.23])


def test_an_invalid_update_holds_no_number_and_a_notice_no_image(server: PageServer, publisher: Publisher) -> None:
    with opened(server) as client:
        publisher.put_invalid(Status.STALE, "the camera is silent", views={})
        _, values, jpeg = client.frame()
    assert (values["status"], values["detail"]) == ("stale", "the camera is silent")
    assert values["magnitude_n"] is None
    assert values["interval_n"] == [None, None]
    assert (values["tip"], values["shape"], values["size"], jpeg) == (None, None, None, b"")
    assert values["clinical"]["contact"] == "unknown"


def test_values_are_those_of_the_update(server: PageServer, publisher: Publisher) -> None:
    with opened(server) as client:
        publisher.put(0.2)
        _, values, _ = client.frame()
    assert values["force_n"] == [-0.2, 0.0, None]
    assert values["interval_n"] == [0.18, 0.22]
    assert values["tip"]["axial_n"] == 0.2
    assert values["tip"]["lateral_n"] == 0.0
    assert values["tip"]["angle_deg"] == 0.0
    assert values["shape"]["centreline_px"][0] == [40.0, 120.0]
    assert values["shape"]["centreline_px"][-1] == [190.0, 120.0]
    assert values["health"]["latency_p50_ms"] == 12.0


def test_pages_learn_session_model_and_limits(server: PageServer) -> None:
    server.sink.start(SessionInfo("pig 4", simulated=True), "fusion")
    with opened(server) as client:
        state = client.state
    assert (state["session"], state["model"], state["simulated"]) == ("pig 4", "fusion", True)
    assert state["contact"] == {"contact_n": 0.01, "window_n": [0.1, 0.3], "limit_n": 0.4}


def test_a_ping_is_answered_with_the_engines_clock(server: PageServer) -> None:
    with opened(server) as client:
        before = CLOCK.now_ns() * 1e-6
        client.send(command="ping", sent_ms=12.5)
        answer = client.text()
        after = CLOCK.now_ns() * 1e-6
    assert answer["answer"] == "pong"
    assert answer["sent_ms"] == 12.5
    assert before - 0.01 <= answer["clock_ms"] <= after + 0.01


def test_latency_to_the_socket_and_ages_in_pages_are_kept(server: PageServer, publisher: Publisher) -> None:
    with opened(server) as client:
        number = publisher.put(age_s=0.05)
        client.frame()
        client.send(command="ack", number=number, age_ms=61.5)
        eventually(server.page_ages_s)
    assert server.page_ages_s() == [0.0615]
    [latency] = server.latencies_s()
    assert 0.05 <= latency < 5.0


# What an operator may do


def test_buttons_reach_the_engine(server: PageServer, engine: FakeEngine) -> None:
    with opened(server) as client:
        for number, (command, pressed) in enumerate(
            [
                ({"command": "zero"}, "zero"),
                ({"command": "integral", "on": True}, "start"),
                ({"command": "integral", "on": False}, "stop"),
                ({"command": "record", "on": True}, "record True"),
                ({"command": "record", "on": False}, "record False"),
            ]
        ):
            assert client.ask(**command, id=number) == {"answer": "command", "id": number, "ok": True, "message": ""}
            assert engine.pressed[-1] == pressed


def test_new_limits_reach_the_engine_and_all_pages(server: PageServer, engine: FakeEngine) -> None:
    with opened(server) as one, opened(server) as other:
        assert one.ask(command="limits", id=1, window_n=[0.05, 0.15], limit_n=0.25)["ok"]
        state = other.text()
    assert state["contact"] == {"contact_n": 0.01, "window_n": [0.05, 0.15], "limit_n": 0.25}
    assert engine.contact.window_n == (0.05, 0.15)
    assert engine.contact.limit_n == 0.25


@pytest.mark.parametrize(
    ("window", "limit", "message"),
    [
        ([0.4, 0.1], 0.4, "window_n[0] < window_n[1]"),
        ([0.1, 0.4], 0.05, "limit_n"),
        ([0.1, 0.4], -1.0, "greater than 0"),
    ],
)
def test_limits_that_make_no_sense_are_refused(
    server: PageServer, engine: FakeEngine, window: list[float], limit: float, message: str
) -> None:
    with opened(server) as client:
        answer = client.ask(command="limits", id=1, window_n=window, limit_n=limit)
    assert not answer["ok"]
    assert message in answer["message"]
    assert "\n" not in answer["message"]
    assert "pydantic" not in answer["message"]
    assert not engine.pressed


def test_an_engine_that_refuses_is_quoted_and_one_that_fails_is_not(server: PageServer, engine: FakeEngine) -> None:
    with opened(server) as client:
        engine.error = InputError("nothing valid was read")
        assert client.ask(command="zero", id=1) == {
            "answer": "command", "id": 1, "ok": False, "message": "nothing valid was read",
        }  # fmt: skip
        engine.error = OSError("/secret/path")
        answer = client.ask(command="zero", id=2)
        assert not answer["ok"]
        assert "/secret" not in answer["message"]


def test_a_recording_that_fails_or_ends_by_itself_is_told_to_all_pages(server: PageServer, engine: FakeEngine) -> None:
    with opened(server) as client, opened(server) as other:
        engine.error = InputError("the disk is full")
        assert not client.ask(command="record", id=1, on=True)["ok"]
        told = other.text()
        while not told["recording_message"]:  # before that it has begun, for a moment
            told = other.text()
        assert (told["recording"], told["recording_message"]) == (False, "the disk is full")
        engine.error = None
        assert client.ask(command="record", id=2, on=True)["ok"]
        assert other.text()["recording"] is True
        server.show_recording(False, "the disk is full")
        assert other.text()["recording"] is False
    assert server.state.recording_message == "the disk is full"


def test_what_a_run_cannot_do_is_refused(engine: FakeEngine) -> None:
    with serve(engine, settings=PageSettings(clock=CLOCK)) as server, opened(server) as client:
        assert (client.state["can_record"], client.state["can_set_limits"]) == (False, False)
        assert not client.ask(command="record", id=1, on=True)["ok"]
        assert not client.ask(command="limits", id=2, window_n=[0.1, 0.2], limit_n=0.2)["ok"]


def test_a_busy_engine_holds_up_neither_frames_nor_pings_and_commands_do_not_pile_up(
    server: PageServer, publisher: Publisher, engine: FakeEngine
) -> None:
    engine.free.clear()
    try:
        with opened(server) as client:
            for number in range(4):
                client.send(command="zero", id=number)
            refused = client.ask(command="zero", id=4)
            assert (refused["id"], refused["ok"]) == (4, False)
            client.send(command="ping", sent_ms=0.0)
            assert client.text()["answer"] == "pong"
            number = publisher.put()
            assert client.frame()[0] == number
            assert not engine.pressed
            engine.free.set()
            assert sorted(client.text()["id"] for _ in range(4)) == [0, 1, 2, 3]
    finally:
        engine.free.set()


BAD = [
    "", "null", "[]", "not json", '"zero"', "{}", '{"command": "zero"}', '{"command": "reboot", "id": 1}',
    '{"command": "zero", "id": -1}', '{"command": "zero", "id": 1, "more": 2}', '{"command": "ack"}',
    '{"command": "ack", "number": "x"}', '{"command": "record", "id": 1}', '{"command": "ping", "sent_ms": NaN}',
    '{"command": "display", "width_px": 1e9}', '{"command": "limits", "id": 1, "window_n": [1], "limit_n": 1}',
]  # fmt: skip


def test_bad_commands_are_refused_and_the_page_goes_on(
    server: PageServer, publisher: Publisher, engine: FakeEngine
) -> None:
    with opened(server) as client:
        for text in BAD:
            client.socket.send(text)
            answer = client.text()
            assert answer["answer"] == "refused", text
            assert len(answer["message"]) < 300
        number = publisher.put()
        assert client.frame()[0] == number
    assert not engine.pressed


@pytest.mark.parametrize("what", ["x" * 5000, b"bytes"])
def test_what_is_too_long_or_no_text_ends_the_socket(server: PageServer, what: str | bytes) -> None:
    with opened(server) as client:
        client.socket.send(what)
        with pytest.raises(ConnectionClosed):
            client.text()
    eventually(lambda: server.pages == 0)


def test_there_are_not_more_pages_than_are_allowed_and_one_too_many_hears_why(engine: FakeEngine) -> None:
    with serve(engine, settings=engine.settings(most_pages=1)) as server, opened(server):
        eventually(lambda: server.pages == 1)
        with pytest.raises(ConnectionClosed) as closed, opened(server):
            pass
        assert closed.value.rcvd is not None
        assert (closed.value.rcvd.code, closed.value.rcvd.reason[:24]) == (1013, "1 pages are open already")
        assert server.pages == 1


def test_a_page_is_served_before_there_is_an_engine_and_hears_what_the_program_does(
    engine: FakeEngine, image: Image
) -> None:
    loop = FakeLoop()
    with serve(None) as server, opened(server) as client:
        assert (client.state["can_record"], client.state["can_hold"]) == (False, False)
        server.show_starting("loading fusion")
        assert client.text()["starting"] == "loading fusion"
        assert client.ask(command="zero", id=1)["message"] == "the run has not begun yet"
        server.begin(engine, engine.settings(loop=loop))
        state = client.text()
        assert (state["starting"], state["can_record"], state["can_hold"]) == ("", True, True)
        assert client.text()["answer"] == "loop"
        assert client.ask(command="zero", id=2)["ok"]
        number = Publisher(server, image).put()
        while isinstance(received := client.socket.recv(timeout=5.0), str):
            pass
        assert struct.unpack_from("<4sHHI", received)[3] == number


# Who may speak


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "https://127.0.0.1.evil.example", "http://127.0.0.1:1"]
)
def test_a_foreign_origin_gets_no_socket_and_no_post(server: PageServer, origin: str) -> None:
    with pytest.raises(InvalidStatus) as refusal, opened(server, origin=origin):
        pass
    assert refusal.value.response.status_code == 403
    assert request(server, "POST", "/", Origin=origin)[0] == 403
    assert server.pages == 0


def test_the_own_origin_gets_a_socket(server: PageServer) -> None:
    origin = f"http://127.0.0.1:{server.port}"
    with opened(server, origin=origin) as client:
        assert client.state["answer"] == "state"
    assert request(server, "POST", "/", Origin=origin)[0] == 405  # nothing takes one


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1.evil.example", "localhost@evil", "", "a b", "127.0.0.1:x"])
def test_a_name_that_is_not_ours_is_refused(server: PageServer, host: str) -> None:
    status, _, content = request(server, Host=host)
    assert status in (400, 421)
    assert b"<html" not in content


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost:80", "[::1]:9", "192.168.7.7:8000", socket.gethostname()])
def test_addresses_in_numbers_and_own_names_are_taken(server: PageServer, host: str) -> None:
    assert request(server, Host=host)[0] == 200


def test_a_socket_by_a_name_that_is_not_ours_is_refused(server: PageServer) -> None:
    raw = socket.create_connection(("127.0.0.1", server.port), timeout=5.0)
    with raw:
        raw.sendall(
            b"GET /live HTTP/1.1\r\nHost: evil.example\r\nOrigin: http://evil.example\r\nUpgrade: websocket\r\n"
            b"Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
        )
        assert b" 403 " in raw.recv(200)


@pytest.fixture
def guarded(engine: FakeEngine) -> Iterator[PageServer]:
    with serve(engine, token=TOKEN, settings=engine.settings()) as running:
        yield running


@pytest.mark.parametrize("path", ["/", "/main.js", "/?token=wrong", "/?token=", "/?token=%ff%00", f"/?Token={TOKEN}"])
def test_without_the_token_there_is_nothing(guarded: PageServer, path: str) -> None:
    status, headers, content = request(guarded, path=path)
    assert status == 403
    assert TOKEN.encode() not in content
    assert "set-cookie" not in headers


@pytest.mark.parametrize("more", [{}, {"additional_headers": {"Cookie": "tipforce-1=x"}}])
def test_without_the_token_there_is_no_socket(guarded: PageServer, more: dict[str, Any]) -> None:
    for path in ("/live", "/live?token=wrong"):
        with pytest.raises(InvalidStatus), opened(guarded, path, **more):
            pass


def test_the_token_becomes_a_cookie_and_leaves_the_address(guarded: PageServer) -> None:
    status, headers, _ = request(guarded, path=guarded.address.partition(str(guarded.port))[2])
    assert (status, headers["location"]) == (303, "/")
    cookie = headers["set-cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=lax" in cookie
    shown = cookie.partition(";")[0]
    assert request(guarded, path="/main.js", Cookie=shown)[0] == 200
    with opened(guarded, additional_headers={"Cookie": shown}) as client:
        assert client.state["answer"] == "state"
    with opened(guarded, f"/live?token={TOKEN}") as client:
        assert client.state["answer"] == "state"


def test_beyond_this_machine_there_is_always_a_token_and_it_is_random(engine: FakeEngine) -> None:
    with serve(engine, host="0.0.0.0") as one, serve(engine, host="0.0.0.0") as other:
        tokens = [re.fullmatch(r"http://[\d.]+:\d+/\?token=([\w-]{32})", each.address) for each in (one, other)]
        assert all(tokens)
        assert len({found.group(1) for found in tokens if found}) == 2
        assert request(one)[0] == 403


@pytest.mark.parametrize("token", ["", "short"])
def test_a_token_that_can_be_guessed_is_refused(engine: FakeEngine, token: str) -> None:
    with pytest.raises(InputError, match="at least 16"):
        serve(engine, token=token)


def test_every_answer_carries_a_strict_policy_and_files_hold_nothing_from_elsewhere(server: PageServer) -> None:
    _, headers, page = request(server)
    policy = headers["content-security-policy"]
    assert "default-src 'none'; script-src 'self'; style-src 'self'" in policy
    assert "unsafe" not in policy
    assert headers["x-content-type-options"] == "nosniff"
    text = page.decode()
    assert not re.findall(r"<script(?![^>]*\bsrc=)|\sstyle=|\son\w+=", text)
    todo, read = set(re.findall(r'(?:href|src)="([^"]+)"', text)), {"/": text}
    while todo:
        name = todo.pop()
        status, headers, content = request(server, path=f"/{name}")
        assert status == 200, name
        assert headers["content-security-policy"] == policy
        read[name] = content.decode()
        todo |= set(re.findall(r'from "\./([^"]+)"', read[name])) - set(read)
    assert {"main.js", "style.css", "icon.svg", "sound.js"} <= set(read)
    for name, content in read.items():
        assert not re.findall(r"(?:https?:)?//(?!www\.w3\.org/2000/svg)[\w-]+\.\w+/", content), name
    assert request(server, path="/../server/_guard.py")[0] == 404
    assert request(server, path="/nothing.js")[0] == 404


# From start to end


def test_a_port_that_is_taken_or_a_host_that_is_none_is_refused(server: PageServer, engine: FakeEngine) -> None:
    with pytest.raises(InputError, match=f"127.0.0.1:{server.port}"):
        serve(engine, port=server.port)
    with pytest.raises(InputError, match="nothing can listen"):
        serve(engine, host="192.0.2.1")


def test_closing_ends_pages_and_frees_the_port_and_what_comes_later_harms_nothing(
    engine: FakeEngine, image: Image
) -> None:
    server = serve(engine, settings=engine.settings())
    publisher = Publisher(server, image)
    with opened(server) as client:
        begin = time.monotonic()
        server.close()
        assert time.monotonic() - begin < 2.0
        with pytest.raises(ConnectionClosed) as closed:
            client.text()
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code == 1001
    publisher.put()
    server.close()
    with serve(engine, port=server.port):
        pass


def test_a_page_that_goes_in_mid_frame_leaves_nothing_behind(server: PageServer, publisher: Publisher) -> None:
    with opened(server) as client:
        publisher.put()
        client.frame()
        client.socket.socket.shutdown(socket.SHUT_RDWR)
    eventually(lambda: server.pages == 0)
    publisher.put()
    with opened(server) as client:
        client.frame()


def test_a_socket_that_the_server_has_closed_gets_no_more_of_the_loop() -> None:
    async def receive() -> dict[str, str]:
        return {"type": "websocket.connect"}

    sent: list[str] = []

    async def send(message: MutableMapping[str, Any]) -> None:
        sent.append(message["type"])

    async def run() -> None:
        socket = WebSocket({"type": "websocket", "client": None}, receive, send)
        session = PageSession(socket, SimpleNamespace(next_name=lambda: 1))  # type: ignore[arg-type]
        await socket.accept()
        await session._send_text("{}")
        await socket.close()
        await session._send_text("{}")  # would raise, and print the traceback

    asyncio.run(run())
    assert sent == ["websocket.accept", "websocket.send", "websocket.close"]
