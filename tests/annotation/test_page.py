"""The page in a browser: marking with mouse and keys, saving, training, and how it looks on a tablet."""

import shutil
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, Page, sync_playwright

from tipforce.annotation import (
    AnnotationImages,
    AnnotationServer,
    AnnotationSession,
    AnnotationStore,
    MarkedFrame,
    curve_through,
    serve_annotation,
)
from tipforce.annotation._training import TrainingStatus
from tipforce.errors import MissingExtraError, OutputError
from tipforce.types import FloatArray

from .conftest import (  # type: ignore[import-not-found]
    NOTHING,
    SIZE_PX,
    FakeDetector,
    FakeLeftOut,
    bends,
    shape_along,
    true_line,
)

MARGIN_PX = 14
"""Margin of the image in the page's canvas."""


@pytest.fixture(scope="module")
def browser(chromium: str) -> Iterator[Browser]:
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        yield browser
        browser.close()


class Trainer:
    """A fake training, which waits for its gate and may fail."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.gate, self.error = folder, threading.Event(), None

    def __call__(self, annotations, images, report):
        if self.error:
            raise self.error
        while not self.gate.wait(0.01):
            report("step 30 of 100", 0.3)
        left = FakeLeftOut(annotations[0].image, true_line(0.2)[::12], true_line(bends()[0])[::12])
        return FakeDetector(self.folder, 2.0, (left,))


@dataclass(frozen=True)
class Opened:
    server: AnnotationServer
    store: AnnotationStore
    trainer: Trainer


class User:
    """A person at the page."""

    def __init__(self, page: Page, store: AnnotationStore, trainer: Trainer) -> None:
        self.page, self.trainer, self._store = page, trainer, store
        self.errors: list[str] = []
        page.on("pageerror", lambda error: self.errors.append(str(error)))

    def screen(self, point: FloatArray) -> tuple[float, float]:
        """Where an image point is on the screen while the whole image is shown."""
        box = self.page.locator("#image").bounding_box()
        assert box is not None
        width, height = SIZE_PX
        scale = min((box["width"] - 2 * MARGIN_PX) / width, (box["height"] - 2 * MARGIN_PX) / height)
        u, v = (float(value) + 0.5 for value in point)
        left, top = (box["width"] - width * scale) / 2, (box["height"] - height * scale) / 2
        return box["x"] + left + u * scale, box["y"] + top + v * scale

    def click(self, *points: FloatArray) -> None:
        for point in points:
            self.page.mouse.click(*self.screen(point))

    def drag(self, start: FloatArray, end: FloatArray) -> None:
        mouse = self.page.mouse
        mouse.move(*self.screen(start))
        mouse.down()
        mouse.move(*self.screen((start + end) / 2))
        mouse.move(*self.screen(end))
        mouse.up()

    def keys(self, *keys: str) -> None:
        for key in keys:
            self.page.keyboard.press(key)

    def points(self, index: int = 0) -> FloatArray:
        """The points of a frame in the file, after all changes were saved."""
        return np.array(self.saved(index)["points_px"])

    def saved(self, index: int = 0) -> dict[str, object]:
        self.page.wait_for_selector("#saved[data-state=saved]", timeout=5000)
        return AnnotationStore(self._store.file.with_name("frames")).frames[f"img{index:03d}.png"].values()

    def text(self, selector: str) -> str:
        return self.page.inner_text(selector)


SHAPES = [shape_along(true_line(bends()[0])), *[NOTHING] * 5]


@pytest.fixture(scope="module")
def opened_server(shared_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Opened]:
    """One server for all tests of this file: each finds it as it began."""
    folder = tmp_path_factory.mktemp("page") / "frames"
    shutil.copytree(shared_folder, folder)
    store, trainer = AnnotationStore(folder), Trainer(folder.with_name("detector"))
    names = [f"img{k:03d}.png" for k in range(len(SHAPES))]
    store.add(MarkedFrame.empty(name) for name in names)
    session = AnnotationSession(store, AnnotationImages(folder).read(names), [0] * len(names), SHAPES)
    with serve_annotation(session, trainer, title="frames") as server:
        yield Opened(server, store, trainer)


@pytest.fixture
def opened(opened_server: Opened) -> Iterator[Opened]:
    """The server, with no frame marked and no training done."""
    server, store, trainer = opened_server.server, opened_server.store, opened_server.trainer
    trainer.gate.clear()
    trainer.error = None
    server.finished.clear()
    server.training._status = TrainingStatus()
    store.add(MarkedFrame.empty(name) for name in store.frames)
    yield opened_server
    trainer.gate.set()


@pytest.fixture(scope="module")
def tab(browser: Browser) -> Iterator[Page]:
    page = browser.new_context(viewport={"width": 1280, "height": 800}).new_page()
    page.set_default_timeout(5000)
    yield page
    page.context.close()


def show(page: Page, opened: Opened) -> User:
    user = User(page, opened.store, opened.trainer)
    page.goto(opened.server.address)
    page.wait_for_selector("body[data-ready]")
    return user


@pytest.fixture
def user(tab: Page, opened: Opened) -> Iterator[User]:
    user = show(tab, opened)
    yield user
    assert not user.errors


def test_the_proposed_line_is_confirmed_with_one_key(user: User) -> None:
    assert user.text("#origin") == "Line of the detector. Correct it, or press Done."
    user.keys("Enter")
    assert user.saved()["done"]
    assert np.abs(curve_through(user.points(), 50) - curve_through(true_line(bends()[0]), 50)).max() < 1.5
    assert user.text("#position") == "Frame 2 of 6"
    assert user.text("#count") == "1 of 6 done"
    assert user.page.get_attribute(".thumbnail >> nth=0", "aria-label") == "Frame 1: done"


def test_points_are_dragged_inserted_and_deleted_and_each_change_undone(user: User) -> None:
    line = true_line(bends()[0])
    user.drag(line[-1], line[-1] + [0.0, -40.0])
    dragged = user.points()
    assert dragged[-1] == pytest.approx(line[-1] + [0.0, -40.0], abs=1.0)
    user.keys("z")
    assert len(user.points()) == 0  # the proposal again, as nothing was marked
    user.keys("y")
    assert user.points().tolist() == dragged.tolist()
    middle = curve_through(dragged[:2], 3)[1]
    user.drag(middle, middle + np.array([0.0, 25.0]))
    assert len(user.points()) == len(dragged) + 1
    user.keys("Delete")
    assert user.points().tolist() == dragged.tolist()
    user.page.mouse.click(*user.screen(dragged[1]), button="right")
    assert len(user.points()) == len(dragged) - 1
    user.keys("Control+z", "Control+z", "Control+z", "Control+z")
    assert len(user.points()) == 0


def test_a_line_is_drawn_with_clicks_and_carried_to_the_next_frames(user: User) -> None:
    user.keys("ArrowRight")
    line = true_line(bends()[1])
    assert user.text("#origin").startswith("No catheter was detected. Click its base")
    user.click(*line[::40], line[-1])
    assert user.points(1) == pytest.approx(np.array([*line[::40], line[-1]]), abs=1.0)
    user.keys("Enter")
    assert user.text("#position") == "Frame 3 of 6"
    user.page.wait_for_selector("#origin:has-text('Line carried over from frame 2')")
    user.keys("Enter")
    carried = curve_through(user.points(2), 200)
    assert max(np.linalg.norm(true_line(bends()[2]) - point, axis=1).min() for point in carried) < 3.0


def test_a_wrong_line_is_drawn_again(user: User) -> None:
    user.keys("r")
    user.click(np.array([20.0, 30.0]), np.array([100.0, 40.0]), np.array([200.0, 90.0]))
    user.keys("Enter")
    assert user.points() == pytest.approx(np.array([[20.0, 30.0], [100.0, 40.0], [200.0, 90.0]]), abs=1.0)


def test_hidden_tip_and_no_catheter_are_stated_with_keys(user: User) -> None:
    user.keys("h", "Enter")
    assert user.saved()["tip_hidden"]
    user.keys("n")
    assert user.page.is_visible("#none-cover")
    assert user.page.get_attribute("#none", "aria-pressed") == "true"
    user.keys("Enter")
    saved = user.saved(1)
    assert (saved["points_px"], saved["present"], saved["done"]) == ([], False, True)
    assert user.page.get_attribute(".thumbnail >> nth=1", "aria-label") == "Frame 2: no catheter"
    user.keys("z")
    assert user.text("#position") == "Frame 2 of 6"  # undo shows the frame that it changes
    assert not user.saved(1)["done"]


def test_a_frame_without_a_line_cannot_be_finished(user: User) -> None:
    user.keys("ArrowRight", "Enter")
    assert "at least two points, base and tip" in user.text("#message")
    assert user.text("#position") == "Frame 2 of 6"


def test_points_are_moved_with_the_keyboard_alone(user: User) -> None:
    user.keys("[", "Shift+ArrowUp", "Shift+ArrowUp", "Shift+ArrowLeft")
    assert user.points()[-1] == pytest.approx(true_line(bends()[0])[-1] + [-1.0, -2.0], abs=0.01)
    before = len(user.points())
    user.keys("i")
    assert len(user.points()) == before + 1


def test_a_point_stays_under_the_mouse_after_zoom_and_pan(user: User) -> None:
    tip = true_line(bends()[0])[-1]
    at = user.screen(tip)
    user.page.mouse.move(*at)
    user.page.mouse.wheel(0, -600)
    user.page.mouse.down(button="middle")
    user.page.mouse.move(at[0] - 60, at[1] + 20, steps=4)
    user.page.mouse.up(button="middle")
    user.page.mouse.down()
    user.page.mouse.move(at[0] - 60, at[1] - 30, steps=4)
    user.page.mouse.up()
    moved = user.points()[-1]
    assert moved[0] == pytest.approx(tip[0], abs=0.3)
    assert 3.0 < tip[1] - moved[1] < 30.0  # zoomed: 50 px of the screen are fewer of the image
    user.keys("0")
    assert user.screen(moved) == pytest.approx(user.screen(user.points()[-1]))


def test_a_training_shows_progress_and_before_and_after(user: User) -> None:
    assert user.page.is_disabled("#train")
    user.keys("Enter")
    user.click(*true_line(bends()[1])[::60])
    user.keys("Enter")
    user.page.wait_for_selector("#train:enabled")
    user.page.click("#train")
    user.page.wait_for_selector("#step:has-text('step 30 of 100')")
    user.trainer.gate.set()
    user.page.wait_for_selector("#result[open]")
    assert "9" not in user.text("#result-figures").partition("before, ")[2]
    assert user.text("#result-figures").endswith("px after.")
    assert user.page.locator("#result-cards canvas").count() == 1
    assert user.text("#result-place").endswith("detector")


def test_a_training_can_be_cancelled(user: User) -> None:
    user.keys("Enter")
    user.click(*true_line(bends()[1])[::60])
    user.keys("Enter")
    user.page.wait_for_selector("#train:enabled")
    user.page.click("#train")
    user.page.wait_for_selector("#step:has-text('step 30 of 100')")
    user.page.click("#cancel")
    user.page.wait_for_selector("#message:has-text('Training cancelled. The annotations are saved.')")


def test_without_torch_the_page_shows_the_install_line(user: User) -> None:
    user.trainer.error = MissingExtraError("torch", extra="train")
    user.keys("Enter")
    user.click(*true_line(bends()[1])[::60])
    user.keys("Enter")
    user.page.wait_for_selector("#train:enabled")
    user.page.click("#train")
    user.page.wait_for_selector("#message:has-text('pip install')")
    assert "the annotations are saved" in user.text("#message")
    assert user.saved()["done"]


def test_a_change_that_is_not_saved_is_shown_and_saved_later(user: User, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:

        def fail(*_: object) -> None:
            raise OutputError("frames.annotations.json: cannot be written, there is no space left on the device")

        patch.setattr("tipforce.annotation._store.write_atomic", fail)
        user.keys("h")
        user.page.wait_for_selector("#saved[data-state=unsaved]")
        assert "no space left" in user.text("#message")
    assert user.saved()["tip_hidden"]
    assert not user.page.is_visible("#message")


def test_the_marks_are_there_when_the_page_is_opened_again(user: User) -> None:
    user.keys("Enter", "n", "Enter")
    user.saved(1)
    user.page.reload()
    user.page.wait_for_selector("body[data-ready]")
    assert user.text("#count") == "2 of 6 done"
    assert user.text("#position") == "Frame 3 of 6"


def test_finish_asks_where_frames_are_open(user: User, opened: Opened) -> None:
    user.page.click("#finish")
    user.page.wait_for_selector("#leave[open]")
    assert not opened.server.finished.is_set()
    user.page.click("#leave-now")
    user.page.wait_for_selector("#closed[open]")
    assert opened.server.finished.is_set()


@pytest.mark.parametrize(("width", "height"), [(1280, 800), (820, 1180), (1024, 768)])
def test_everything_is_in_view_and_has_a_name(user: User, width: int, height: int) -> None:
    page = user.page
    page.set_viewport_size({"width": width, "height": height})
    overflow = page.evaluate("[document.documentElement.scrollWidth, document.documentElement.scrollHeight]")
    assert overflow[0] <= width
    assert overflow[1] <= height
    buttons = page.evaluate(
        "[...document.querySelectorAll('button')].filter((b) => b.offsetParent)"
        ".map((b) => [b.ariaLabel || b.textContent.trim(), b.offsetHeight])"
    )
    assert all(name and tall >= 36 for name, tall in buttons), buttons
    for button in ("#done", "#train", "#hidden", "#undo"):
        box = page.locator(button).bounding_box()
        assert box is not None
        assert box["y"] + box["height"] <= height
    page.set_viewport_size({"width": 1280, "height": 800})


def test_the_page_draws_the_curve_that_the_training_gets(user: User) -> None:
    points = np.array([[10.0, 20.0], [60.0, 22.0], [75.0, 60.0], [120.0, 90.0], [121.0, 130.0]])
    script = "async (points) => (await import('./spline.js')).curveThrough(points, 40)"
    drawn = np.array(user.page.evaluate(script, points.tolist()))[:, :2]
    ours = curve_through(points, 2000)
    assert max(np.linalg.norm(ours - point, axis=1).min() for point in drawn) < 0.1


def test_a_finger_drags_a_point(browser: Browser, opened: Opened) -> None:
    page = browser.new_context(viewport={"width": 820, "height": 1180}, has_touch=True).new_page()
    user = show(page, opened)
    start, end = user.screen(true_line(bends()[0])[-1]), user.screen(true_line(bends()[0])[-1] + [10.0, -30.0])
    session = page.context.new_cdp_session(page)
    for kind, places in (("touchStart", [start]), ("touchMove", [end]), ("touchEnd", [])):
        points = [{"x": x, "y": y} for x, y in places]
        session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    assert user.points()[-1] == pytest.approx(true_line(bends()[0])[-1] + [10.0, -30.0], abs=1.5)
    page.context.close()
