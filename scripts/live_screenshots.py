"""Screenshots of the live page in every state, from the simulated bench, through Chromium.

    python -m scripts.live_screenshots [--output build/live] [--seconds S] [--figures docs/figures]

One session of bench-2021 with the estimates of ``fusion``, at the frame rate of its camera. Every state is one that a
bench can reach: for a force above the limit the limit is set lower, "no catheter" is an image without one,
"stale" is a camera that stops, "disconnected" is a server that ends.
"""

import argparse
import base64
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

import cv2
import numpy as np
from PIL import Image as PILImage
from playwright.sync_api import Page, sync_playwright

from tipforce.alignment import observations
from tipforce.clinical import ContactMonitor, ContactSettings
from tipforce.estimators import load_model
from tipforce.live import LiveHealth, LiveUpdate, Zero
from tipforce.live.server import PageServer, PageSettings, serve
from tipforce.simulation import PRESETS, SimulatedBench
from tipforce.types import ForceEstimate, Image, Observation, SessionInfo, Status, SystemClock
from tipforce.vision import shaft_mask

CHROMIUM = "/usr/bin/chromium"
SIZES = {
    "desktop": (1600, 900), "tablet": (1024, 768), "upright": (820, 1180), "phone": (390, 844), "zoom200": (683, 384),
}  # fmt: skip
"""CSS pixels; zoom200 is a display of 1366x768 at 200 %."""
SCALE = {"phone": 2, "zoom200": 2}
"""Pixels of the display for each CSS pixel, where it is not one."""
LATENCY_NS = 14_000_000
"""From mid-exposure to the estimate, as a fast method has it; the replay estimates nothing anew."""
TRIES = 40
FIGURES = {
    "live-in-window": "desktop-in-window",
    "live-not-valid": "desktop-no-catheter",
    "live-too-hard": "tablet-too-hard",
}
FIGURE_WIDTH = 1100
COLOURS = 256
VEIL_BGR = (0x4D, 0x42, 0x39)
"""One of the two colours of the veil of the strip."""


@dataclass(frozen=True, slots=True)
class Shown:
    """One frame of the session and its estimate."""

    image: Image
    estimate: ForceEstimate


def estimated(seconds: float) -> tuple[SessionInfo, list[Shown], ForceEstimate, Image]:
    """The session, its frames with their estimates, and an image without a catheter with its own."""
    preset = PRESETS["bench-2021"]
    settings = preset.model_copy(update={"world": preset.world.model_copy(update={"seconds": seconds})})
    fusion = load_model("fusion")
    with SimulatedBench(settings, 0, 1) as bench:
        seen = list(observations(bench, fusion.views))
        info = bench.session_info
    images = [np.asarray(each.views["camera"], np.uint8) for each in seen]
    stream = fusion.start(info, images[:: max(1, len(images) // 20)])
    shown = [Shown(image, stream.update(each)) for image, each in zip(images, seen, strict=True)]
    # The bench without its catheter: painted over from both sides, in an image in which it touches nothing.
    free = next(each for each in shown if each.estimate.shape is not None and each.estimate.magnitude_n < 0.002)
    assert free.estimate.shape is not None
    mask = shaft_mask(free.estimate.shape, free.image.shape[:2]).astype(np.uint8)
    empty = cv2.inpaint(free.image, cv2.dilate(mask, np.ones((23, 23), np.uint8)), 9, cv2.INPAINT_TELEA).astype(
        np.uint8
    )
    last = seen[-1]
    nothing = stream.update(Observation(last.stamp_ns + 40_000_000, {"camera": empty}, last.actuation))
    return info, shown, nothing, empty


class Replay:
    """An engine that publishes the stored estimates, again and again, at the rate of their stamps."""

    def __init__(self, shown: Sequence[Shown]) -> None:
        self.shown = shown
        self.clock = SystemClock()
        self.publish: Callable[[LiveUpdate], None] = lambda _: None
        self.monitor = ContactMonitor()
        self.running = False
        self.silent = threading.Event()
        self.notice: ForceEstimate | None = None
        self.captured_ns = 0
        self.instead: tuple[ForceEstimate, Image] | None = None
        self._zero: Zero | None = None
        self._hold: int | None = None
        self._stop = threading.Event()
        self._number = 0
        self._thread = threading.Thread(target=self._run, daemon=True)

    def zero(self, *, by: str, confirmed_n: float | None) -> None:
        """Sets the time of the zero; the drift is the reading without contact."""
        del confirmed_n  # this engine takes every zero immediately
        self._zero = Zero(
            np.array([0.004, 0.0, 0.0]), 0.004, self.clock.now_ns(), time.time(), by, drift_n=0.003,
            drift_ns=self.clock.now_ns(),
        )  # fmt: skip

    def clear_zero(self) -> None:
        """Nothing is subtracted any more."""
        self._zero = None

    def start_integral(self) -> None:
        """Times and integral begin anew."""
        self.monitor.reset()
        self.running = True

    def stop_integral(self) -> None:
        """The integral is shown as stopped."""
        self.running = False

    def hold(self, wanted: Callable[[ForceEstimate], bool] | None) -> None:
        """Goes on with the first frame alone whose estimate is as ``wanted``; None: with all again."""
        fitting = (k for k, each in enumerate(self.shown) if wanted and each.estimate.valid and wanted(each.estimate))
        self._hold = next(fitting, None)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        step_s = 1.0 / 24.0
        at = 0
        while not self._stop.wait(step_s):
            if self.silent.is_set():
                if self.notice is not None:
                    self.send(self.notice, {})
                continue
            self.captured_ns = self.clock.now_ns() - LATENCY_NS
            at = (at + 1) % len(self.shown) if self._hold is None else self._hold
            each = self.shown[at]
            found, image = (each.estimate, each.image) if self.instead is None else self.instead
            self.send(found, {"camera": image})

    def send(self, estimate: ForceEstimate, frames: dict[str, Image]) -> None:
        """One update of now."""
        now = self.clock.now_ns()
        captured = self.captured_ns
        values = {name: getattr(estimate, name) for name in ForceEstimate.__dataclass_fields__}
        estimate = ForceEstimate(**values | {"stamp_ns": captured})
        health = LiveHealth(24.0, self._number, 0, LATENCY_NS * 1e-9, 1.3e-9 * LATENCY_NS, "running")
        self._number += 1
        self.publish(
            LiveUpdate(
                self._number, estimate, self.monitor.update(estimate), frames, captured, now, health,
                self._zero, self.running,
            )
        )  # fmt: skip


def main() -> None:
    """Reads the options, estimates, and takes all screenshots."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path("build/live"))
    parser.add_argument("--seconds", type=float, default=12.0)
    parser.add_argument("--figures", type=Path, help="also write those of the documentation, smaller, into this folder")
    chosen = parser.parse_args()
    take_all(chosen.output, *estimated(chosen.seconds))
    if chosen.figures is not None:
        write_figures(chosen.output, chosen.figures)


def write_figures(taken: Path, figures: Path, chosen: Mapping[str, str] = FIGURES) -> None:
    """Figures of docs/live.md and docs/control.md, name there -> screenshot.

    They are narrower and have fewer colours, since git keeps every version of them.
    """
    for name, of in chosen.items():
        with PILImage.open(taken / f"{of}.png") as image:
            width = min(image.width, FIGURE_WIDTH)
            small = image.convert("RGB").resize(
                (width, round(image.height * width / image.width)), PILImage.Resampling.LANCZOS
            )
            method = PILImage.Quantize.MAXCOVERAGE
            few = small.quantize(COLOURS, method=method, kmeans=2, dither=PILImage.Dither.NONE)
            few.save(figures / f"{name}.png", optimize=True)


def take_all(output: Path, info: SessionInfo, shown: Sequence[Shown], nothing: ForceEstimate, empty: Image) -> None:
    """All states in all sizes, into ``output``."""
    output.mkdir(parents=True, exist_ok=True)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=CHROMIUM, args=["--no-sandbox", "--autoplay-policy=no-user-gesture-required"]
        )
        for name, (width, height) in SIZES.items():
            page = browser.new_page(viewport={"width": width, "height": height}, device_scale_factor=SCALE.get(name, 1))
            with Replay(shown) as engine:
                take(page, engine, info, nothing, empty, output, name)
            page.close()
        browser.close()


def take(
    page: Page, engine: Replay, info: SessionInfo, nothing: ForceEstimate, empty: Image, output: Path, size: str
) -> None:
    """All states of one page."""

    def set_contact(contact: ContactSettings) -> None:
        engine.monitor.settings = contact

    def shot(state: str, kind: str, wait_s: float = 0.6) -> None:
        time.sleep(wait_s)
        veiled = kind in ("stale", "disconnected", "waiting")
        for _ in range(TRIES):  # on a busy machine the page may be stale for a moment, and then says so
            page.wait_for_selector(f"body[data-kind='{kind}']", timeout=120_000)
            taken = base64.b64decode(devtools.send("Page.captureScreenshot", {"optimizeForSpeed": True})["data"])
            image = cv2.imdecode(np.frombuffer(taken, np.uint8), cv2.IMREAD_COLOR)
            if is_veiled(image, page) == veiled and page.evaluate("document.body.dataset.kind") == kind:
                break
        cv2.imwrite(str(output / f"{size}-{state}.png"), image, [cv2.IMWRITE_PNG_COMPRESSION, 9])
        print(f"{size}-{state}.png", "as wanted" if is_veiled(image, page) == veiled else "NOT AS WANTED", flush=True)

    devtools = page.context.new_cdp_session(page)
    settings = PageSettings(clock=engine.clock, on_contact=set_contact, on_record=lambda _: None)
    with serve(None) as server:
        server.show_starting("drawing a session of bench-2021, which takes up to a minute")
        page.goto(server.address)
        shot("starting", "waiting")
        server.begin(engine, settings)
        start(server, engine, info)
        page.mouse.click(5, 5)
        page.wait_for_selector("body[data-kind='no_contact']", timeout=120_000)
        page.keyboard.press("z")
        page.keyboard.press("i")
        time.sleep(11.0)  # a whole trace
        engine.hold(lambda found: 0.18 < found.magnitude_n < 0.24)
        shot("in-window", "in_window", 0.1)
        engine.hold(lambda found: 0.03 < found.magnitude_n < 0.08)
        shot("too-light", "too_light")
        engine.hold(lambda found: found.magnitude_n < 0.002)
        shot("no-contact", "no_contact")
        page.keyboard.press("l")
        shot("limits", "no_contact")
        for name, value in (("window-low", 0.05), ("window-high", 0.15), ("limit", 0.2)):
            page.fill(f"#{name}", str(value))
        page.keyboard.press("Enter")
        engine.hold(None)
        page.keyboard.press("r")
        time.sleep(8.0)
        engine.hold(lambda found: found.magnitude_n > 0.25)
        shot("too-hard", "too_hard", 0.2)
        server.show_recording(
            False,
            "recording stopped: live-20260101-120000.mcap: cannot be written any more, there is no space left on the "
            "device; make room or choose another place; 7.8 s of this recording are kept in "
            "live-20260101-120000.mcap.part",
        )
        shot("recording-stopped", "too_hard", 0.2)
        server.show_recording(False)
        engine.hold(lambda found: 0.17 < found.magnitude_n < 0.19 and found.magnitude_interval_n[1] > 0.2)
        shot("may-be-too-hard", "may_be_too_hard", 1.2)
        engine.hold(lambda found: 0.08 < found.magnitude_n < 0.14)
        time.sleep(1.5)
        engine.instead = (nothing, empty)
        shot("no-catheter", "invalid")
        print(nothing.status, nothing.detail)
        engine.instead = None
        engine.silent.set()
        lost = ForceEstimate.invalid(0, Status.STALE, "the camera has sent no image for 0.5 s")
        engine.notice = lost
        shot("not-valid", "invalid", 1.0)
        engine.notice = None
        engine.silent.clear()
        time.sleep(0.5)
        engine.silent.set()
        shot("stale", "stale", 1.0)
        engine.silent.clear()
        page.keyboard.press("t")
        shot("light", "in_window", 1.0)
        page.keyboard.press("t")
        page.keyboard.press("?")
        shot("help", "in_window")
        page.keyboard.press("Escape")
    shot("disconnected", "disconnected", 1.0)


def is_veiled(image: Image, page: Page) -> bool:
    """Whether the strip is under its veil: the colours of the hatching are nowhere else."""
    box = page.locator("#strip").bounding_box()
    assert box is not None
    scale = image.shape[1] / page.evaluate("innerWidth")
    x, y, width, height = (round(scale * box[name]) for name in ("x", "y", "width", "height"))
    strip = image[y : y + height, x + 3 * width // 4 : x + width].reshape(-1, 3)
    return bool((np.abs(strip.astype(int) - VEIL_BGR) <= 2).all(axis=1).mean() > 0.2)


def start(server: PageServer, engine: Replay, info: SessionInfo) -> None:
    """Starts the sink of the page, and connects the engine to it."""
    server.sink.start(info, "fusion")
    engine.publish = server.sink.put


if __name__ == "__main__":
    main()
