"""The loop's panel: commands over the real socket, stop before all else, and a run in the browser."""

import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace

import pytest
from playwright.sync_api import Page, sync_playwright

from tipforce.live import LoopStatus
from tipforce.live.server import PageServer, serve
from tipforce.types import Image

from .test_server import Client, opened  # type: ignore[import-not-found]
from .updates import FakeEngine, FakeLoop, Publisher, eventually  # type: ignore[import-not-found]


@pytest.fixture(scope="module")
def _served() -> Iterator[tuple[PageServer, FakeLoop, FakeEngine]]:
    engine, loop = FakeEngine(), FakeLoop()
    with serve(engine, settings=engine.settings(loop=loop)) as server:
        yield server, loop, engine


@pytest.fixture
def server(_served: tuple[PageServer, FakeLoop, FakeEngine]) -> PageServer:
    eventually(lambda: _served[0].pages == 0)
    return _served[0]


@pytest.fixture
def loop(_served: tuple[PageServer, FakeLoop, FakeEngine], monkeypatch: pytest.MonkeyPatch) -> FakeLoop:
    """As new for each test."""
    made = FakeLoop()
    monkeypatch.setattr(_served[1], "__dict__", made.__dict__)
    return made


@pytest.fixture
def engine(_served: tuple[PageServer, FakeLoop, FakeEngine]) -> FakeEngine:
    return _served[2]


def heard(client: Client, state: str) -> dict:
    """The next word of the loop with this state."""
    while True:
        told = client.text()
        if told["answer"] == "loop" and told["state"] == state:
            return told


def test_commands_are_carried_out_acknowledged_and_refused_with_a_sentence(server: PageServer, loop: FakeLoop) -> None:
    with opened(server) as client:
        assert client.state["can_hold"]
        first = heard(client, "idle")
        assert (first["target_n"], first["wanted_n"], first["moves"]) == (0.2, None, False)
        for number, do in enumerate(("mark_start", "mark_goal", "start", "retract", "stop")):
            assert client.ask(command="loop", id=number, do=do) == {
                "answer": "command", "id": number, "ok": True, "message": "",
            }  # fmt: skip
        assert heard(client, "stopped")["reason"] == "the stop key was pressed"
        refused = client.ask(command="loop", id=7, do="start")
        assert (refused["ok"], refused["message"]) == (False, "stopped (the stop key was pressed); release it first")
        assert client.ask(command="loop", id=8, do="release")["ok"]
        assert heard(client, "idle")
        assert client.ask(command="loop", id=9, do="jump")["answer"] == "refused"
    assert loop.told == ["mark_start", "mark_goal", "start", "retract", "stop", "release"]


def test_without_a_loop_its_commands_are_refused() -> None:
    engine = FakeEngine()
    with serve(engine, settings=engine.settings()) as server, opened(server) as client:
        assert not client.state["can_hold"]
        assert client.ask(command="loop", id=1, do="stop")["message"] == "no force is held in this run"


def test_stop_passes_what_the_engine_is_busy_with_and_a_video_that_stalls(
    server: PageServer, loop: FakeLoop, engine: FakeEngine, image: Image
) -> None:
    engine.free.clear()
    try:
        with opened(server) as client, opened(server) as other:
            Publisher(server, image).put()  # its frame is never acknowledged: no more come
            for each in (client, other):
                for number in range(6):  # more than may wait
                    each.send(command="zero", id=number)
            begin = time.monotonic()
            client.send(command="loop", id=99, do="stop")
            eventually(lambda: loop.told == ["stop"])
            assert time.monotonic() - begin < 0.5
    finally:
        engine.free.set()


def test_a_second_stop_does_not_wait_for_a_first_that_hangs(server: PageServer, loop: FakeLoop, monkeypatch) -> None:
    free, told = threading.Event(), []

    def hang() -> None:
        told.append(1)
        free.wait(5.0)

    loop.stop = hang  # the loop that is served shares its attributes
    with opened(server) as client:
        client.send(command="loop", id=1, do="stop")
        client.send(command="loop", id=2, do="stop")
        eventually(lambda: len(told) == 2)
        free.set()


def test_a_page_is_heard_as_long_as_it_sends_something(server: PageServer, loop: FakeLoop) -> None:
    with opened(server) as client:
        client.send(command="ping", sent_ms=1.0)
        eventually(lambda: server.silent_s < 0.05)
        time.sleep(0.06)
        assert server.silent_s > 0.05  # an open socket alone is nobody who could press stop


def test_a_status_says_null_for_what_is_not_known() -> None:
    text = LoopStatus().text()
    assert "NaN" not in text
    assert '"place_mm": null' in text
    assert LoopStatus(resumes=True).moves
    assert not LoopStatus(state="stopped").moves


@pytest.fixture(scope="module")
def page(chromium: str, _served: tuple[PageServer, FakeLoop, FakeEngine]) -> Iterator[Page]:
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1024, "height": 768})
        page.goto(_served[0].address)
        yield page
        browser.close()


def shows(page: Page, state: str) -> None:
    page.wait_for_selector(f"#loop[data-state={state}]", timeout=5_000)


def test_a_run_is_started_stopped_and_released_in_the_page(page: Page, loop: FakeLoop) -> None:
    shows(page, "idle")
    page.click("#mark-goal")
    page.click("#loop-begin")  # asks first
    eventually(lambda: page.inner_text("#loop-begin-note") == "moves: again")
    assert loop.told == ["mark_goal"]
    page.click("#loop-begin")
    shows(page, "hold")
    eventually(lambda: page.inner_text("#loop-wanted") == "18.4 g")
    page.keyboard.press("l")  # a dialog with a number in it
    page.focus("#limit")
    page.keyboard.press(" ")  # stops wherever the focus is while the drives move
    shows(page, "stopped")
    page.keyboard.press("Escape")  # closes the dialog now
    page.wait_for_selector("#limits", state="hidden")
    page.click("#loop-release")
    shows(page, "idle")
    page.keyboard.press("?")  # a dialog covers the panel: it has a stop of its own
    page.click("#help .stop")
    shows(page, "stopped")
    page.keyboard.press("Escape")
    page.wait_for_selector("#help", state="hidden")
    page.click("#loop-release")
    shows(page, "idle")
    page.focus("#loop-begin")
    page.keyboard.press(" ")  # presses no button that has the focus
    shows(page, "stopped")
    page.click("#loop-release")
    shows(page, "idle")
    page.click("#loop-stop")
    shows(page, "stopped")
    assert loop.told == ["mark_goal", "start", "stop", *["release", "stop"] * 3]


def test_a_force_of_the_loop_is_shown_for_at_most_a_second_after_it_was_heard(page: Page, loop: FakeLoop) -> None:
    def shown() -> list[str | None]:
        force, state = (
            "document.querySelector('#loop-force').innerText",
            "document.querySelector('#loop').dataset.state",
        )
        return page.evaluate(f"[{force}, {state}]")

    loop.release()
    eventually(lambda: shown() == ["15.3 g", "idle"])
    status, loop.status = loop.status, SimpleNamespace(text=str)
    eventually(lambda: shown() == ["\N{EN DASH}", "idle"])
    loop.status = status
    eventually(lambda: shown() == ["15.3 g", "idle"])


def test_a_difference_is_within_90_percent_only_of_a_force_with_an_interval(page: Page, loop: FakeLoop) -> None:
    loop.status = replace(loop.status, state="hold", wanted_n=0.16)
    eventually(lambda: page.inner_text("#loop-off-note") == "within 90 %")
    loop.status = replace(loop.status, upper_n=float("nan"))
    eventually(lambda: page.inner_text("#loop-off-note") == "" and page.inner_text("#loop-off") == "−1.0 g")


def test_only_a_force_at_the_target_is_called_held(page: Page, loop: FakeLoop) -> None:
    loop.status = replace(loop.status, state="hold", reason="not held yet: brought to 0.20 N (20 g)")
    eventually(lambda: page.inner_text("#loop-word") == "HOLD")
    loop.status = replace(loop.status, held=True, reason="the force is held at 0.20 N (20 g)")
    eventually(lambda: page.inner_text("#loop-word") == "HELD")
    loop.status = replace(loop.status, state="retract")
    eventually(lambda: page.inner_text("#loop-word") == "RETRACT")


def test_peak_and_time_above_the_limit_of_the_run_are_shown(page: Page, loop: FakeLoop) -> None:
    eventually(lambda: page.inner_text("#loop-peak") == "peak 25.5 g, 0.0 s above the limit")
    assert page.inner_text("#loop-true-peak") == "true force: peak 41.8 g, 0.1 s above the limit"
    loop.status = replace(loop.status, true_peak_n=float("nan"), true_above_limit_s=float("nan"))
    eventually(lambda: page.inner_text("#loop-true-peak") == "")


def test_a_stop_that_is_not_answered_is_told(page: Page, loop: FakeLoop) -> None:
    loop.release()
    free = threading.Event()
    loop.stop = lambda: free.wait(5.0)
    page.keyboard.press("Escape")
    eventually(lambda: page.inner_text("#notice").startswith("STOP is not confirmed: no answer yet"))
    free.set()
