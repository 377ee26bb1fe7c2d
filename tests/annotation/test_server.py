"""The page's server, without a browser: what it answers, and what it refuses."""

import http.client
import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tipforce.annotation import AnnotationServer, AnnotationSession, AnnotationStore, serve_annotation
from tipforce.annotation._server import MAX_BODY_BYTES
from tipforce.types import DetectedShape

from .conftest import (  # type: ignore[import-not-found]
    NOTHING,
    FakeDetector,
    FakeLeftOut,
    bends,
    shape_along,
    true_line,
)

Make = Callable[[list[DetectedShape]], AnnotationSession]
LINE = {"points_px": true_line(0.5)[::50].tolist(), "done": True}


class Answer:
    """Answer to a request."""

    def __init__(self, status: int, headers: dict[str, str], content: bytes) -> None:
        self.status, self.headers, self.content = status, headers, content

    def json(self) -> Any:
        return json.loads(self.content)


class Client:
    """A page without a browser."""

    def __init__(self, server: AnnotationServer) -> None:
        self.server = server

    def get(self, path: str, **headers: str) -> Answer:
        return self.ask("GET", path, None, headers)

    def post(self, path: str, **headers: str) -> Answer:
        return self.ask("POST", path, None, headers)

    def put(self, path: str, body: str, **headers: str) -> Answer:
        return self.ask("PUT", path, body, headers)

    def ask(self, method: str, path: str, body: str | None, headers: dict[str, str]) -> Answer:
        connection = http.client.HTTPConnection("127.0.0.1", self.server.port, timeout=5.0)
        connection.request(method, path, body, headers)
        answer = connection.getresponse()
        content = answer.read()
        connection.close()
        return Answer(answer.status, {name.lower(): value for name, value in answer.getheaders()}, content)


@pytest.fixture
def client(make_session: Make, tmp_path: Path) -> Iterator[Client]:
    session = make_session([shape_along(true_line(bends()[0])), NOTHING, NOTHING])

    def fine_tune(annotations, images, report):
        report("training", 0.5)
        line = true_line(0.6)[::12]
        left = FakeLeftOut(annotations[-1].image, line, line, before_present=0.2)
        return FakeDetector(tmp_path / "detector", 2.0, (left,))

    with serve_annotation(session, fine_tune, title="frames") as server:
        yield Client(server)


def frames(client: Client) -> list[dict[str, Any]]:
    return client.get("/state").json()["frames"]


def test_the_page_and_its_files_are_served(client: Client) -> None:
    page = client.get("/")
    assert page.headers["content-type"].startswith("text/html")
    assert "script-src 'self'" in page.headers["content-security-policy"]
    for name in ("main.js", "editor.js", "spline.js", "style.css"):
        assert client.get(f"/{name}").status == 200
    assert client.get("/_server.py").status == 404


def test_the_state_holds_frames_and_proposals(client: Client) -> None:
    first, second, _ = frames(client)
    assert (first["image"], first["width"], first["height"]) == ("img000.png", 320, 240)
    assert len(first["proposal"]["points_px"]) >= 4
    assert second["proposal"] == {"points_px": [], "carried_from": "", "detail": "no shaft reaches a border"}


def test_images_are_sent_in_their_size_and_as_thumbnails(client: Client) -> None:
    for path, size in (("/images/1", (240, 320, 3)), ("/thumbnails/1", (120, 160, 3))):
        data = np.frombuffer(client.get(path).content, np.uint8)
        assert cv2.imdecode(data, cv2.IMREAD_COLOR).shape == size
    assert client.get("/images/3").status == 404


def test_marks_are_saved_and_carried(client: Client, folder: Path) -> None:
    answered = client.put("/frames/1", json.dumps(LINE)).json()["frames"]
    assert answered[1]["done"]
    assert answered[2]["proposal"]["carried_from"] == "img001.png"
    assert AnnotationStore(folder).frames["img001.png"].done


@pytest.mark.parametrize(
    ("path", "body", "status", "message"),
    [
        ("/frames/1", "{", 400, "is no JSON"),
        ("/frames/1", "[]", 400, "expected an object"),
        ("/frames/1", '{"done": true}', 400, "expected at least 2 points"),
        ("/frames/1", '{"points_px": [[1, NaN]]}', 400, "points_px"),
        ("/frames/9", "{}", 404, "there is no frame 9"),
        ("/frames/1", "x" * (MAX_BODY_BYTES + 1), 413, "too long"),
    ],
)
def test_marks_that_cannot_be_are_refused(client: Client, path: str, body: str, status: int, message: str) -> None:
    before = frames(client)
    answer = client.put(path, body)
    assert answer.status == status
    assert message in answer.json()["error"]
    assert frames(client) == before


def test_a_foreign_page_can_change_nothing(client: Client) -> None:
    assert client.put("/frames/1", json.dumps(LINE), origin="http://elsewhere.example").status == 403
    assert client.post("/train", origin="http://elsewhere.example").status == 403
    assert client.get("/state", host="rebound.example").status == 421


def test_a_training_shows_the_frames_that_were_left_out(client: Client) -> None:
    refused = client.post("/train")
    assert refused.status == 400
    assert "a training needs at least 2" in refused.json()["error"]
    for index in (1, 2):
        client.put(f"/frames/{index}", json.dumps(LINE))
    assert client.post("/train").json()["state"] in ("running", "done")
    end = time.monotonic() + 5.0
    while (values := client.get("/training").json())["state"] != "done":
        assert time.monotonic() < end
    (left,) = values["left_out"]
    assert left["index"] == 2
    assert left["before_px"] == []  # nothing was found
    assert len(left["after_px"]) == 17
    assert values["message"].endswith("detector")


def test_finish_ends_the_program(client: Client) -> None:
    assert client.post("/finish").json() == {}
    assert client.server.finished.is_set()
