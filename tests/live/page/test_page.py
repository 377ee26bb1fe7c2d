"""The live page in a browser: what it shows, what it never shows as live, and what its buttons do."""

import base64
import os
import re
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from playwright.sync_api import Browser, Page, Route, sync_playwright

from tipforce.errors import ZeroInContactError
from tipforce.live import Zero
from tipforce.live.server import PageServer, PageState, serve
from tipforce.types import ForceEstimate, Image, Status

from .updates import (  # type: ignore[import-not-found]
    CLOCK,
    FakeEngine,
    FakeLoop,
    Publisher,
    estimate_in_space,
    eventually,
)

OLDEST_S = 0.3
SLACK_S = 0.1
"""The veil falls in 20 ms, a browser draws every 16 ms, and a busy machine lets both wait."""
PERIOD_S = 0.05


@pytest.fixture(scope="module")
def browser(chromium: str) -> Iterator[Browser]:
    with sync_playwright() as playwright:
        arguments = ["--no-sandbox", "--autoplay-policy=no-user-gesture-required"]
        browser = playwright.chromium.launch(executable_path=chromium, args=arguments)
        yield browser
        browser.close()


class OpenPage:
    """A page that is open, and what went wrong in it."""

    def __init__(self, page: Page) -> None:
        self.page = page
        self.patient: bool | None = None
        self.errors: list[str] = []
        self.requests: list[str] = []
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("console", lambda line: self.errors.append(line.text) if line.type in ("error", "warning") else None)
        page.on("request", lambda request: self.requests.append(request.url))

    def text(self, selector: str) -> str:
        return self.page.inner_text(selector)

    def wait(self, kind: str) -> None:
        """Until the strip says so."""
        self.page.wait_for_selector(f"body[data-kind={kind}]", timeout=10_000)


@pytest.fixture(scope="module")
def _tab(browser: Browser) -> Iterator[OpenPage]:
    tab = OpenPage(browser.new_page(viewport={"width": 640, "height": 480}))
    yield tab
    tab.page.close()


def _patient(route: Route) -> None:
    text = route.fetch().text()
    assert "OLDEST_MS = 300;" in text
    route.fulfill(body=text.replace("OLDEST_MS = 300;", "OLDEST_MS = 30_000;"), content_type="text/javascript")


@pytest.fixture
def server(_running: tuple[PageServer, FakeEngine], engine: FakeEngine, monkeypatch: pytest.MonkeyPatch) -> PageServer:
    """The one that the pages are open on."""
    server, pressed = _running
    monkeypatch.setattr(pressed, "__dict__", engine.__dict__)
    server._hub.state = PageState(can_record=True, can_set_limits=True)
    server._hub.wake()
    return server


@pytest.fixture
def page(_tab: OpenPage, server: PageServer, publisher: Publisher) -> OpenPage:
    """A page that lets frames grow old: a busy machine then changes nothing of what it shows."""
    return _opened(_tab, server, publisher, patient=True)


@pytest.fixture
def live(_tab: OpenPage, server: PageServer, publisher: Publisher) -> OpenPage:
    """The page as it is."""
    return _opened(_tab, server, publisher, patient=False)


def _opened(tab: OpenPage, server: PageServer, publisher: Publisher, *, patient: bool) -> OpenPage:
    if tab.patient is not patient:
        tab.page.unroute_all()
        if patient:
            tab.page.route("**/freshness.js", _patient)
        tab.page.goto(server.address)
        tab.patient = patient
    publisher.number = time.monotonic_ns() // 1_000_000 % (1 << 31)  # beyond those of the tests before
    tab.errors.clear()
    return tab


@contextmanager
def feeding(put: Callable[[], Any], period_s: float = PERIOD_S) -> Iterator[None]:
    """``put`` is called again and again while the block lasts."""
    stop = threading.Event()

    def run() -> None:
        while not stop.is_set():
            put()
            stop.wait(period_s)

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


@pytest.mark.parametrize(
    ("force_n", "half_n", "kind", "word", "alarm"),
    [
        (0.005, 0.004, "no_contact", "NO CONTACT", "off"),
        (0.05, 0.02, "too_light", "TOO LIGHT", "off"),
        (0.2, 0.02, "in_window", "IN WINDOW", "off"),
        (0.39, 0.02, "may_be_too_hard", "MAY BE TOO HARD", "on"),
        (0.45, 0.02, "too_hard", "TOO HARD", "on"),
    ],
)
def test_the_strip_says_what_the_force_amounts_to(
    page: OpenPage, publisher: Publisher, force_n: float, half_n: float, kind: str, word: str, alarm: str
) -> None:
    with feeding(lambda: publisher.put(force_n, half_n=half_n)):
        page.wait(kind)
        page.page.wait_for_selector(f"body[data-alarm={alarm}]", timeout=5_000)
        eventually(lambda: page.text("#newtons") == f"{force_n:.3f} N")
        assert page.text("#title") == word
        assert page.text("#grams") == f"{force_n / 9.80665e-3:.1f}"
        assert page.text("#axial").startswith("+")
    assert not page.errors


def test_an_invalid_estimate_shows_its_reason_and_no_number(page: OpenPage, publisher: Publisher) -> None:
    with feeding(lambda: publisher.put_invalid(Status.NO_CATHETER, "nothing dark enters at the left border")):
        page.wait("invalid")
        eventually(lambda: page.text("#grams") == "– –")
        assert page.text("#title") == "NOT VALID: no catheter"
        assert page.text("#detail") == "nothing dark enters at the left border"
        assert page.text("#newtons") == "no valid force"
        assert page.text("#axial") == "–"


def test_the_clock_of_the_engine_is_never_taken_for_older_than_it_may_be(page: OpenPage) -> None:
    found = page.page.evaluate("""async () => {
      const { EngineClock } = await import('/clock.js');
      const clock = new EngineClock();
      const unknown = clock.age(0, 0, 0);
      clock.answered(0, 40, 1020, 0);      // engine time minus page time: 980 to 1020
      clock.answered(100, 104, 1101, 104);  // 997 to 1001
      const known = clock.age(1050, 110, 110);
      const silent = clock.age(1050, 9000, 9000);   // no answer for long
      const asleep = clock.age(1050, 120, 60_000);  // the page's clock stood still
      clock.answered(200, 204, 5000, 204);  // the engine's clock has jumped
      return [unknown, known, silent, asleep, clock.latest(204, 204)];
    }""")
    assert found[1] == 61.0
    assert (found[0], found[2], found[3]) == (float("inf"),) * 3
    assert found[4] == 5004.0


def test_the_alarm_keeps_to_the_habits_of_iec_60601_1_8(page: OpenPage) -> None:
    pulses, period, hertz, harmonics = page.page.evaluate("""async () => {
      const alarm = await import('/alarm.js');
      return [alarm.burst(), alarm.burstPeriod(), alarm.FUNDAMENTAL_HZ, alarm.HARMONICS];
    }""")
    length = pulses[0]["length"]
    gaps = [after["start"] - before["start"] - length for before, after in pairwise(pulses)]
    assert len(pulses) == 10
    assert 0.075 <= length <= 0.2
    x = gaps[0]
    assert 0.05 <= x <= 0.125
    long = 2 * x + length
    assert gaps[:4] + gaps[5:] == pytest.approx([x, x, long, x] * 2)
    assert 0.35 <= gaps[4] <= 1.3
    assert 2.5 <= period - (pulses[-1]["start"] + length) <= 15.0
    assert 150 <= hertz <= 1000
    audible = [level for k, level in enumerate(harmonics) if 300 <= k * hertz <= 4000]
    assert len(audible) >= 4
    assert min(audible) >= 10 ** (-15 / 20) * max(audible)
    flash = page.page.evaluate("""() => {
      document.body.dataset.alarm = 'on';
      return getComputedStyle(document.querySelector('#alarm-frame')).animationDuration;
    }""")
    assert 1.4 <= 1.0 / float(flash.removesuffix("s")) <= 2.8


def test_an_alarm_stays_a_moment_outlasts_a_lost_force_and_is_paused_for_two_minutes(page: OpenPage) -> None:
    found = page.page.evaluate("""async () => {
      const { Alarm } = await import('/alarm.js');
      const alarm = new Alarm();
      const at = (high, ms) => {
        alarm.update(high === null ? null : { magnitude_n: 0.3, interval_n: [0.2, high] }, 0.4, ms);
        return alarm.on;
      };
      const seen = [at(0.39, 0), at(0.41, 100), at(0.35, 900), at(0.35, 1200), at(0.41, 2000), at(null, 30_000)];
      seen.push(alarm.held, at(null, 70_000), at(0.41, 80_000), at(0.2, 82_000));
      alarm.togglePause(0);
      seen.push(alarm.pausedFor(1000), alarm.pausedFor(120_000));
      alarm.update({ magnitude_n: 0.5, interval_n: [null, null] }, 0.4, 90_000);
      return [...seen, alarm.on];
    }""")
    assert found == [False, True, True, False, True, True, True, False, True, False, 119_000, 0, True]


def test_the_alarm_sounds_in_bursts_unless_it_is_paused(page: OpenPage, publisher: Publisher) -> None:
    page.page.evaluate("""() => {
      globalThis.pulses = [];
      const start = AudioScheduledSourceNode.prototype.start;
      AudioScheduledSourceNode.prototype.start = function (at) {
        if (this.frequency.value > 500) globalThis.pulses.push(at);
        return start.call(this, at);
      };
    }""")
    page.page.keyboard.press("a")  # a browser lets a page sound from its first key on
    with feeding(lambda: publisher.put(0.5)):
        page.wait("too_hard")
        page.page.wait_for_selector("body[data-alarm=on]", timeout=5_000)
        assert page.page.evaluate("globalThis.pulses") == []
        page.page.keyboard.press("a")
        eventually(lambda: len(page.page.evaluate("globalThis.pulses")) >= 10)
        eventually(lambda: page.text("#pause small") == "sound on")
    pulses = page.page.evaluate("globalThis.pulses")[:10]
    planned = page.page.evaluate("import('/alarm.js').then((alarm) => alarm.burst())")
    assert [at - pulses[0] for at in pulses] == pytest.approx([pulse["start"] for pulse in planned])


def test_a_zero_in_contact_says_what_it_would_subtract_and_asks(
    page: OpenPage, publisher: Publisher, engine: FakeEngine
) -> None:
    with feeding(lambda: publisher.put(0.077)):
        page.wait("too_light")
        engine.error = ZeroInContactError("the tip may be in contact: 7.9 g (77 mN) would be subtracted", 0.077)
        for answer, pressed in (("Cancel", []), ("Subtract 7.9 g", ["zero 0.077 by page 1 at 127.0.0.1"])):
            page.page.keyboard.press("z")
            page.page.wait_for_selector("#confirm-zero:visible", timeout=5_000)
            eventually(lambda: "7.9 g (77 mN) would be subtracted" in page.text("#confirm-zero"))
            engine.error = engine.error if answer == "Cancel" else None
            page.page.click(f"#confirm-zero >> text={answer}")
            page.page.wait_for_selector("#confirm-zero", state="hidden", timeout=5_000)
            eventually(
                lambda pressed=pressed: [re.sub(r"page \d+", "page 1", each) for each in engine.pressed] == pressed
            )


def test_the_subtracted_force_is_shown_and_can_be_undone(
    page: OpenPage, publisher: Publisher, engine: FakeEngine
) -> None:
    publisher.zero = Zero(
        np.array([0.077, 0.0, np.nan]), 0.077, CLOCK.now_ns(), time.time(), "page 2 at 10.0.0.7", confirmed=True
    )
    with feeding(lambda: publisher.put(0.2)):
        page.wait("in_window")
        page.page.wait_for_selector("#zeroed:visible", timeout=5_000)
        assert page.text("#zeroed-amount") == "ZERO 7.9 g"
        assert "by page 2 at 10.0.0.7 · pressed in possible contact" in page.text("#zeroed-about")
        assert page.text("#undo-zero small") == "adds 7.9 g again"
        page.page.keyboard.press("u")
        eventually(lambda: engine.pressed == ["undo"])
        publisher.zero = None
        page.page.wait_for_selector("#undo-zero", state="hidden", timeout=5_000)


def test_a_number_never_appears_before_the_zero_that_was_subtracted_from_it(
    page: OpenPage, publisher: Publisher
) -> None:
    forces_n = [0.03, 0.15, 0.04, 0.16, 0.05, 0.17, 0.06, 0.18, 0.07, 0.19]  # each has another word on the strip
    with feeding(lambda: publisher.put(0.2)):
        page.wait("in_window")
        page.page.wait_for_selector("#zeroed", state="hidden", timeout=5_000)
    page.page.evaluate("""() => {
      globalThis.zeroShown = {};
      globalThis.watch = new MutationObserver(() => {
        const newtons = document.querySelector('#newtons').textContent;
        globalThis.zeroShown[newtons] ??= !document.querySelector('#undo-zero').hidden;
      });
      globalThis.watch.observe(document.querySelector('#newtons'), { childList: true });
    }""")
    for number, force in enumerate(forces_n):
        amount = np.array([0.03, 0.0, np.nan])
        publisher.zero = Zero(amount, 0.03, CLOCK.now_ns(), time.time(), "page 1") if number % 2 else None
        with feeding(lambda force=force: publisher.put(force)):
            eventually(lambda force=force: page.text("#newtons") == f"{force:.3f} N")
    shown = page.page.evaluate("() => { globalThis.watch.disconnect(); return globalThis.zeroShown; }")
    assert shown == {f"{force:.3f} N": number % 2 == 1 for number, force in enumerate(forces_n)}


def test_keys_press_buttons(page: OpenPage, publisher: Publisher, engine: FakeEngine) -> None:
    press = page.page.keyboard.press
    with feeding(lambda: publisher.put(0.2)):
        page.wait("in_window")
        press("z")
        eventually(lambda: engine.pressed == ["zero"])
        press("i")
        press("r")
        eventually(lambda: engine.pressed == ["zero", "start", "record True"])
        page.page.wait_for_selector("#recording:visible", timeout=5_000)
        press("r")
        eventually(lambda: engine.pressed[-1] == "record False")
        press("s")
        assert page.page.get_attribute("#tone", "aria-pressed") in ("true", "false")
        page.page.wait_for_selector("#tone[aria-pressed=true]", timeout=5_000)
        press("s")
        press("a")
        page.page.wait_for_selector("#pause[aria-pressed=true]", timeout=5_000)
        assert page.text("#pause small").startswith("sound paused 1:5")
        press("a")


def test_limits_are_set_in_a_dialog_which_shows_why_they_are_refused(
    page: OpenPage, publisher: Publisher, engine: FakeEngine
) -> None:
    with feeding(lambda: publisher.put(0.2)):
        page.wait("in_window")
        page.page.keyboard.press("l")
        page.page.fill("#window-low", "0,3")
        assert page.page.inner_text("label[for=window-low] + input + span") == "N = 30.6 g"
        page.page.fill("#window-high", "0.2")
        page.page.keyboard.press("Enter")
        eventually(lambda: "window_n[0] < window_n[1]" in page.text("#limits .error"))
        page.page.fill("#window-low", "0.05")
        page.page.fill("#window-high", "0.1")
        page.page.fill("#limit", "0.15")
        page.page.keyboard.press("Enter")
        page.wait("too_hard")
        assert engine.contact.limit_n == 0.15
        page.page.wait_for_selector("#limits", state="hidden", timeout=5_000)


def test_nothing_is_asked_for_elsewhere(page: OpenPage, server: PageServer) -> None:
    assert page.requests
    assert {url.split("/")[2] for url in page.requests if not url.startswith("blob:")} == {f"127.0.0.1:{server.port}"}


def test_a_server_that_ends_is_told_and_one_that_comes_back_is_found(browser: Browser, image: Image) -> None:
    engine = FakeEngine()
    page = OpenPage(browser.new_page())
    page.page.route("**/freshness.js", _patient)
    with serve(engine, settings=engine.settings()) as server:
        page.page.goto(server.address)
        publisher = Publisher(server, image)
        with feeding(lambda: publisher.put(0.2)):
            page.wait("in_window")
    page.wait("disconnected")
    assert page.text("#force .veil-title") == "DISCONNECTED"
    eventually(lambda: _opacity(page, "#force") == 1.0)
    with serve(engine, port=server.port, settings=engine.settings()) as server:
        publisher = Publisher(server, image)
        with feeding(lambda: publisher.put(0.2)):
            page.wait("in_window")
            assert server.page_ages_s()
            assert max(server.page_ages_s()) < 5.0
            assert CLOCK.now_ns() > 0
    page.page.close()


def test_before_the_run_begins_the_page_says_what_the_program_does(browser: Browser) -> None:
    engine = FakeEngine()
    page = OpenPage(browser.new_page())
    with serve(None) as server:
        server.show_starting("drawing a session of bench-2021")
        page.page.goto(server.address)
        page.wait("waiting")
        eventually(lambda: page.text("#title") == "STARTING")
        assert page.text("#detail") == "drawing a session of bench-2021"
        server.begin(engine, engine.settings())
        eventually(lambda: page.text("#title") == "WAITING")
    page.page.close()


def test_while_the_method_has_not_answered_yet_the_page_says_so(
    page: OpenPage, publisher: Publisher, server: PageServer
) -> None:
    detail = "the method has not answered yet (4 s)"

    def put() -> None:
        update = publisher.update(ForceEstimate.invalid(CLOCK.now_ns(), Status.STALE, detail), views={})
        server.sink.put(replace(update, health=replace(update.health, starting=True)))

    with feeding(put):
        page.wait("waiting")
        assert (page.text("#title"), page.text("#detail")) == ("STARTING", detail)
    with feeding(lambda: publisher.put_invalid(Status.STALE, "the method has not answered for 3 s", views={})):
        page.wait("invalid")
        assert page.text("#title") == "NOT VALID: no new estimate"


def test_one_page_too_many_says_so_and_takes_the_place_of_one_that_closes(browser: Browser, image: Image) -> None:
    engine = FakeEngine()
    with serve(engine, settings=engine.settings(most_pages=1)) as server:
        first, second = (OpenPage(browser.new_page()) for _ in range(2))
        first.page.goto(server.address)
        eventually(lambda: server.pages == 1)
        second.page.goto(server.address)
        second.wait("refused")
        assert second.text("#title") == "TOO MANY PAGES"
        assert second.text("#detail").startswith("1 pages are open already")
        first.page.close()
        second.wait("waiting")
        second.page.close()


def test_a_recording_that_stops_by_itself_says_why_and_what_is_kept(
    page: OpenPage, publisher: Publisher, server: PageServer
) -> None:
    why = "recording stopped: run.mcap: there is no space left; 12.3 s of this recording are kept in run.mcap.part"
    with feeding(lambda: publisher.put(0.2)):
        page.wait("in_window")
        server.show_recording(True)
        page.page.wait_for_selector("#recording:visible", timeout=5_000)
        server.show_recording(False, why)
        page.page.wait_for_selector("#recording", state="hidden", timeout=5_000)
        eventually(lambda: page.text("#warning") == f"⚠ {why}")
        assert page.text("#record small") == "stopped, see above"


def test_the_trace_is_hatched_from_the_last_value_on_also_long_after_the_server_has_ended(page: OpenPage) -> None:
    """Hatching as rectangles of time: from, to, in seconds before the right edge."""
    found = page.page.evaluate("""async () => {
      const { Trace } = await import('/trace.js');
      const canvas = document.createElement('canvas');
      Object.defineProperties(canvas, { clientWidth: { value: 800 }, clientHeight: { value: 150 } });
      const context = canvas.getContext('2d');
      const contact = { window_n: [0.1, 0.4], limit_n: 0.4 };
      const trace = new Trace();
      const drawn = (nowMs) => {
        const areas = [];
        const rect = context.rect;
        context.rect = (x, y, width, height) => {
          areas.push([x, x + width]);
          rect.call(context, x, y, width, height);
        };
        trace.draw(canvas, contact, nowMs);
        context.rect = rect;
        const [left, right] = areas.shift(); // the clip of the whole plot
        return areas.map((area) => area.map((x) => Math.round((10 * (right - x)) / (right - left))));
      };
      const none = drawn(0);
      for (let at = 0; at <= 20_000; at += 50) {
        const values = { status: 'valid', magnitude_n: 0.2, interval_n: [0.1, 0.3], recent: [] };
        trace.add({ capturedMs: at, values });
      }
      return [none, drawn(20_000), drawn(24_000), drawn(50_000)];
    }""")
    assert found == [[[10, 0]], [], [[4, 0]], [[10, 0]]]


def test_number_and_arrow_are_of_one_estimate(page: OpenPage, publisher: Publisher) -> None:
    page.page.evaluate("""() => {
      globalThis.told = [];
      const write = CanvasRenderingContext2D.prototype.fillText;
      CanvasRenderingContext2D.prototype.fillText = function (text, ...more) {
        if (/^[\\d.]+ g$/.test(text) && this.canvas.id === 'video') {
          globalThis.told.push([text, document.querySelector('#grams').textContent + ' g']);
        }
        return write.call(this, text, ...more);
      };
    }""")
    forces = iter(0.11 + 0.001 * number for number in range(10_000))
    with feeding(lambda: publisher.put(next(forces)), 0.02):
        page.wait("in_window")
        eventually(lambda: len(page.page.evaluate("globalThis.told")) > 20)
    told = page.page.evaluate("globalThis.told")
    page.patient = None  # the next test loads the page anew, without what was put into it
    assert len({arrow for arrow, _ in told}) > 3
    assert all(arrow == number for arrow, number in told)


# Where the page is small, and for those who hear it

SIZES = {
    "zoom 200 %": (683, 384),
    "zoom 400 %": (320, 256),
    "phone": (390, 844),
    "tablet": (820, 1180),
    "tablet on its side": (1024, 768),
    "laptop": (1366, 768),
}
CUT = """() => [...document.querySelectorAll('button, b, dd, dt, small, h1, .badge, .big, .beside, #title, canvas')]
  .filter((e) => e.checkVisibility() && e.closest('dialog') === null && e.className !== 'unseen')
  .filter((e) => {
    const box = e.getBoundingClientRect();
    const hides = getComputedStyle(e).overflow !== 'visible' && e.scrollWidth > e.clientWidth + 1;
    return hides || box.left < 0 || box.right > innerWidth + 1 || box.width < 1 || box.height < 1;
  }).map((e) => e.id || e.textContent)"""
REACHED = """(selector) => {
  const e = document.querySelector(selector);
  e.scrollIntoView({ block: 'center' });
  const box = e.getBoundingClientRect();
  const top = document.elementFromPoint(box.x + box.width / 2, box.y + box.height / 2);
  return box.top >= 0 && box.bottom <= innerHeight && (e.contains(top) || top?.classList.contains('veil'));
}"""


@pytest.mark.parametrize(
    "size", [size if size in ("phone", "zoom 400 %") else pytest.param(size, marks=pytest.mark.slow) for size in SIZES]
)
def test_at_every_size_all_can_be_reached_and_nothing_is_cut(browser: Browser, image: Image, size: str) -> None:
    engine, loop = FakeEngine(), FakeLoop()
    loop.start()
    width, height = SIZES[size]
    page = OpenPage(browser.new_page(viewport={"width": width, "height": height}))
    page.page.route("**/freshness.js", _patient)
    with serve(engine, settings=engine.settings(loop=loop)) as server:
        page.page.goto(server.address)
        publisher = Publisher(server, image)
        publisher.zero = Zero(
            np.array([0.03, 0.0, np.nan]), 0.03, CLOCK.now_ns(), time.time(), "page 1", confirmed=True
        )
        with feeding(lambda: publisher.put(0.2)):
            page.wait("in_window")
            page.page.wait_for_selector("#loop:visible", timeout=5_000)
            eventually(lambda: page.page.evaluate(CUT) == [])
            assert page.page.evaluate("document.documentElement.scrollWidth <= innerWidth")
            if min(width, height) >= 768:  # all at a glance
                assert page.page.evaluate("document.documentElement.scrollHeight <= innerHeight")
            for selector in (
                "#research",
                "#gauge",
                "#trace",
                "#grams",
                "#undo-zero",
                "#loop-off",
                "#loop-true-peak",
                "#loop-retract",
                "#more",
            ):
                assert page.page.evaluate(REACHED, selector), selector
            for place in (0, 100_000):  # STOP is in sight wherever the page is scrolled to
                page.page.evaluate("(y) => scrollTo(0, y)", place)
                box = page.page.locator("#loop-stop").bounding_box()
                assert box is not None
                assert height < 600 or box["y"] + box["height"] <= height or width > 760
            strip = page.page.locator("#strip").bounding_box()
            assert strip is not None
            assert 0 <= strip["y"] < height
    assert not page.errors
    page.page.close()


def axe() -> str:
    """The script of axe-core; it is read from outside of the project, where it is installed."""
    found = os.environ.get("TIPFORCE_AXE", "")
    if not Path(found).is_file():
        pytest.skip("TIPFORCE_AXE does not name axe.min.js (npm pack axe-core)")
    return Path(found).read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("size", "theme"),
    [
        ("phone", "dark"),
        ("laptop", "light"),
        *(pytest.param(*more, marks=pytest.mark.slow) for more in (("phone", "light"), ("laptop", "dark"))),
    ],
)
def test_axe_finds_nothing_in_any_state(browser: Browser, image: Image, size: str, theme: str) -> None:
    script = axe()
    engine, loop = FakeEngine(), FakeLoop()
    width, height = SIZES[size]
    page = OpenPage(browser.new_page(viewport={"width": width, "height": height}))
    page.page.route("**/freshness.js", _patient)
    found: dict[str, list[str]] = {}

    def check(state: str) -> None:
        results = page.page.evaluate("axe.run({ resultTypes: ['violations'] })")
        broken = [f"{each['impact']}: {each['id']}" for each in results["violations"]]
        found[state] = broken + [str(node["target"]) for each in results["violations"] for node in each["nodes"]]

    with serve(None) as server:
        page.page.goto(server.address)
        page.page.evaluate(script)
        if theme == "light":
            page.page.keyboard.press("t")
        server.show_starting("loading fusion")
        page.wait("waiting")
        check("starting")
        server.begin(engine, engine.settings())
        publisher = Publisher(server, image)
        with feeding(lambda: publisher.put(0.2)):
            page.wait("in_window")
            check("valid")
            server.show_recording(True)
            page.page.wait_for_selector("#recording:visible", timeout=5_000)
            check("recording")
            server.show_recording(False, "recording stopped: run.mcap: there is no space left")
            page.page.wait_for_selector("#warning:visible", timeout=5_000)
            check("recording stopped")
            publisher.zero = Zero(np.zeros(3), 0.03, CLOCK.now_ns(), time.time(), "page 1", confirmed=True)
            page.page.wait_for_selector("#zeroed:visible", timeout=5_000)
            check("zeroed")
            page.page.keyboard.press("l")
            check("limits")
            page.page.keyboard.press("Escape")
            page.page.keyboard.press("?")
            check("help")
            page.page.keyboard.press("Escape")
        for force_n, kind in ((0.05, "too_light"), (0.0, "no_contact"), (0.5, "too_hard")):
            with feeding(lambda force_n=force_n: publisher.put(force_n)):
                page.wait(kind)
                check(kind)
        with feeding(lambda: publisher.put_invalid(Status.NO_CATHETER, "nothing dark enters at the left border")):
            page.wait("invalid")
            check("not valid, alarm held")
        server.begin(engine, engine.settings(loop=loop))
        for what in ("start", "retract", "stop"):
            getattr(loop, what)()
            with feeding(lambda: publisher.put(0.2)):
                page.page.wait_for_selector(f"#loop[data-state={loop.status.state}]", timeout=5_000)
                check(f"loop: {what}")
        with feeding(lambda: publisher.put(0.2, age_s=31.0)):
            page.wait("stale")
            check("stale")
    page.wait("disconnected")
    check("disconnected")
    page.page.close()
    assert {state: broken for state, broken in found.items() if broken} == {}
    assert len(found) == 16


# The page as it is: what is never shown as live


def test_a_notice_without_an_image_says_why_although_the_last_image_is_old(
    live: OpenPage, publisher: Publisher
) -> None:
    with feeding(lambda: publisher.put_invalid(Status.STALE, "the camera is silent", age_s=0.6, views={})):
        live.wait("invalid")
        eventually(lambda: live.text("#detail") == "the camera is silent")
        eventually(lambda: _opacity(live, "#scene") == 1.0)


def test_what_is_captured_too_long_ago_is_stale_however_fast_it_comes(live: OpenPage, publisher: Publisher) -> None:
    with feeding(lambda: publisher.put(0.2, age_s=0.35)):
        live.wait("stale")
        eventually(lambda: _opacity(live, "#force") == 1.0)
        for _ in range(10):
            assert live.page.get_attribute("body", "data-kind") == "stale"


WATCH = """() => {
  const samples = (globalThis.samples = []);
  // By the time that the compositor goes by: that of the script's frames stands still while the script does.
  const veil = (id) => document.querySelector(`${id} .veil`).getAnimations()[0];
  const young = (id) => {
    const { startTime, effect } = veil(id);
    return startTime === null || performance.now() - startTime < effect.getComputedTiming().duration;
  };
  const sample = () => {
    const live = young('#force') && young('#strip') && document.body.dataset.kind !== 'invalid';
    samples.push([Date.now(), live, Number(document.querySelector('#newtons').innerText.split(' ')[0])]);
    globalThis.watching = requestAnimationFrame(sample);
  };
  globalThis.watching = requestAnimationFrame(sample);
}"""
BLOCK = "(ms) => { const end = performance.now() + ms; while (performance.now() < end); }"


def test_a_page_that_is_held_up_never_shows_a_frame_older_than_300_ms_as_live(
    live: OpenPage, publisher: Publisher
) -> None:
    """Each frame's force tells when it was captured: what the page shows is judged by the wall clock alone."""
    captured: dict[float, float] = {}

    def put() -> None:
        force = round(0.101 + 0.001 * (len(captured) % 250), 3)
        captured[force] = time.time()
        publisher.put(force)

    with feeding(put):
        live.wait("in_window")
        live.page.evaluate(WATCH)
        for _ in range(2):
            live.page.evaluate(BLOCK, 1000)
            time.sleep(0.4)
        live.wait("in_window")
        samples = live.page.evaluate("() => { cancelAnimationFrame(globalThis.watching); return globalThis.samples; }")
    shown = [(at * 1e-3 - captured[force]) for at, is_live, force in samples if is_live and force in captured]
    assert shown
    assert max(shown) <= OLDEST_S + SLACK_S
    assert any(not is_live for _, is_live, _ in samples)  # of the frames that came while it was held up


def test_the_veil_falls_while_the_script_is_held_up(live: OpenPage, publisher: Publisher) -> None:
    """What is on the display, as the compositor hands it out, while no script runs for 1.5 s."""
    with feeding(lambda: publisher.put(0.2)):
        # A busy machine may keep the compositor waiting, too: that it once went on alone is proof enough.
        assert any(_falls_alone(live) for _ in range(3))


def test_a_force_in_space_has_an_arrow_in_both_views_and_its_three_components(
    page: OpenPage, publisher: Publisher, image: Image
) -> None:
    def put() -> None:
        update = publisher.update(estimate_in_space(), views={"a": image}, beside={"b": image}, reads=("a", "b"))
        publisher.server.sink.put(update)

    with feeding(put):
        page.wait("in_window")
        page.page.wait_for_selector("#components", state="visible")
        page.page.wait_for_function("document.getElementById('force-z').textContent.startsWith('+20.4')")
        assert page.text("#force-z-ends") == "+18.4 to +23.5"
        arrows = page.page.evaluate(ARROWS)
    assert min(arrows) > 100, "pixels of the arrow's colour in the left and in the right half of the image"
    assert page.errors == []


ARROWS = """() => {
  const canvas = document.getElementById("video");
  const { width, height } = canvas;
  const { data } = canvas.getContext("2d").getImageData(0, 0, width, height);
  const halves = [0, 0];
  for (let k = 0; k < data.length; k += 4) {
    if (data[k] < 40 && data[k + 1] > 200 && data[k + 2] > 220) halves[(k / 4) % width < width / 2 ? 0 : 1] += 1;
  }
  return halves;
}"""


def _falls_alone(live: OpenPage) -> bool:
    devtools = live.page.context.new_cdp_session(live.page)
    frames: list[tuple[float, str]] = []

    def keep(frame: dict[str, Any]) -> None:
        frames.append((frame["metadata"]["timestamp"], frame["data"]))
        devtools.send("Page.screencastFrameAck", {"sessionId": frame["sessionId"]})

    devtools.on("Page.screencastFrame", keep)
    live.wait("in_window")
    devtools.send("Page.startScreencast", {"format": "png"})
    end = time.monotonic() + 5.0
    while not (frames and _blue(_strip(frames[-1][1]))) and time.monotonic() < end:
        live.page.wait_for_timeout(10)
    begin = time.time()
    live.page.evaluate(BLOCK, 1500)
    end = time.time()
    devtools.send("Page.stopScreencast")
    devtools.detach()
    during = [_blue(_strip(data)) for at, data in frames if begin <= at < end]
    before = [_blue(_strip(data)) for at, data in frames if at < begin]
    # IN WINDOW before; STALE at the end. Where nothing moves any more no further frame is handed out.
    return bool(before and before[-1] and during and not during[-1])


def _opacity(page: OpenPage, selector: str) -> float:
    return float(page.page.evaluate(f"getComputedStyle(document.querySelector('{selector} .veil')).opacity"))


def _blue(colour: tuple[int, int, int]) -> bool:
    blue, _, red = colour
    return blue > 100 and blue > 2 * red


def _strip(png: str) -> tuple[int, int, int]:
    """Mean blue, green, red near the right end of the strip."""
    shown = cv2.imdecode(np.frombuffer(base64.b64decode(png), np.uint8), cv2.IMREAD_COLOR)
    height, width = shown.shape[:2]
    patch = shown[round(0.125 * height) : round(0.155 * height), round(0.8 * width) : round(0.95 * width)]
    blue, green, red = patch.reshape(-1, 3).mean(axis=0)
    return round(blue), round(green), round(red)
