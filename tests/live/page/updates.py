"""Updates as an engine publishes them, and the buttons of a fake engine."""

import threading
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from tipforce.clinical import ContactMonitor, ContactSettings
from tipforce.errors import InputError
from tipforce.live import LiveHealth, LiveUpdate, LoopStatus, Zero
from tipforce.live.server import PageServer, PageSettings
from tipforce.types import (
    BasePose,
    CentrelinePx,
    DetectedShape,
    ForceEstimate,
    Image,
    ShapeBeside,
    Status,
    SystemClock,
)

CLOCK = SystemClock()


class FakeEngine:
    """The buttons of an engine: counts what was pressed; raises ``error`` where there is one; waits for ``free``."""

    def __init__(self) -> None:
        self.pressed: list[str] = []
        self.contact = ContactSettings()
        self.error: Exception | None = None
        self.free = threading.Event()
        self.free.set()

    def _press(self, name: str) -> None:
        self.free.wait(10.0)
        if self.error is not None:
            raise self.error
        self.pressed.append(name)

    def zero(self, *, by: str, confirmed_n: float | None) -> None:
        self._press("zero" if confirmed_n is None else f"zero {confirmed_n:g} by {by}")

    def clear_zero(self) -> None:
        self._press("undo")

    def start_integral(self) -> None:
        self._press("start")

    def stop_integral(self) -> None:
        self._press("stop")

    def record(self, on: bool) -> None:
        self._press(f"record {on}")

    def set_contact(self, contact: ContactSettings) -> None:
        self._press("contact")
        self.contact = contact

    def settings(self, **more: Any) -> PageSettings:
        return PageSettings(clock=CLOCK, on_contact=self.set_contact, on_record=self.record, **more)


class FakeLoop:
    """The commands of a loop: does as it is told at once; refuses a start while it is stopped, as the real one."""

    def __init__(self) -> None:
        self.told: list[str] = []
        self.status = LoopStatus(
            reason="the operator ended the run", target_n=0.2, limit_n=0.4, force_n=0.15, upper_n=0.2, place_mm=5.0,
            length_mm=20.0, axes={"advance_mm": 5.0}, start={"advance_mm": 0.0}, goal={"advance_mm": 20.0},
            peak_n=0.25, above_limit_s=0.0, true_peak_n=0.41, true_above_limit_s=0.13,
        )  # fmt: skip

    def _go(self, what: str, **changes: Any) -> None:
        self.told.append(what)
        self.status = replace(self.status, **changes)

    def mark_start(self) -> None:
        self._go("mark_start", start=self.status.axes)

    def mark_goal(self) -> None:
        self._go("mark_goal", goal=self.status.axes)

    def start(self) -> None:
        if self.status.state == "stopped":
            raise InputError("stopped (the stop key was pressed); release it first")
        self._go("start", state="hold", wanted_n=0.18)

    def retract(self) -> None:
        self._go("retract", state="retract")

    def stop(self) -> None:
        self._go("stop", state="stopped", reason="the stop key was pressed")

    def release(self) -> None:
        self._go("release", state="idle", reason="")


def shape_along(angle_rad: float = 0.0) -> DetectedShape:
    """A straight catheter from (40, 120) px, in the base frame's x direction turned by ``angle_rad`` in the image."""
    base = BasePose(np.array([40.0, 120.0]), angle_rad)
    points = base.to_image(np.column_stack([np.linspace(0.0, 150.0, 61), np.zeros(61)]))
    return DetectedShape(Status.VALID, centreline=CentrelinePx(points), base=base, diameter_px=8.0, confidence=1.0)


def estimate_of(
    force_n: tuple[float, float], half_n: float = 0.02, shape: DetectedShape | None = None
) -> ForceEstimate:
    """A valid one, in the plane, with a magnitude known to +- ``half_n``."""
    x, y = force_n
    size = float(np.hypot(x, y))
    ends = np.array([[x - half_n, x + half_n], [y - half_n, y + half_n], [np.nan, np.nan]])
    covariance = np.full((3, 3), np.nan)
    covariance[:2, :2] = np.eye(2) * (half_n / 1.645) ** 2
    return ForceEstimate(
        CLOCK.now_ns(), np.array([x, y, np.nan]), np.array([True, True, False]), covariance, ends, size,
        np.array([max(0.0, size - half_n), size + half_n]), shape=shape,
    )  # fmt: skip


def estimate_in_space() -> ForceEstimate:
    """0.2 N along -x and along z, from the views a and b; b shows x along the image's rows, and z upward."""
    force = np.array([-0.2, 0.0, 0.2])
    ends = np.column_stack([force - 0.02, force + 0.03])
    beside = ShapeBeside("b", shape_along(), np.array([[1.0, 0.0], [0.0, 0.05], [0.0, -1.0]]))
    size = float(np.linalg.norm(force))
    return ForceEstimate(
        CLOCK.now_ns(), force, np.ones(3, np.bool_), 1e-4 * np.eye(3), ends, size, np.array([size - 0.02, size + 0.02]),
        shape=shape_along(), shapes_beside=(beside,),
    )  # fmt: skip


class Publisher:
    """Makes updates with rising numbers, and puts them into the sink of ``server``."""

    def __init__(self, server: PageServer, image: Image) -> None:
        self.server, self.image, self.number = server, image, 0
        self.zero: Zero | None = None
        self._monitor = ContactMonitor()

    def update(
        self,
        estimate: ForceEstimate,
        *,
        age_s: float = 0.0,
        image: Image | None = None,
        views: Any = None,
        beside: Any = None,
        reads: tuple[str, ...] = (),
    ) -> LiveUpdate:
        now = CLOCK.now_ns()
        frames = {"camera": self.image if image is None else image} if views is None else views
        self.number += 1
        return LiveUpdate(
            self.number, estimate, self._monitor.update(estimate), frames, now - round(age_s * 1e9), now,
            LiveHealth(20.0, self.number, 0, 0.012, 0.015, "running"), self.zero,
            beside=beside or {}, reads=reads,
        )  # fmt: skip

    def put(self, force_n: float = 0.2, **more: Any) -> int:
        """The number of an update of a force along -x, which was put."""
        half_n = more.pop("half_n", 0.02)
        update = self.update(estimate_of((-force_n, 0.0), half_n, shape_along()), **more)
        self.server.sink.put(update)
        return update.number

    def put_invalid(self, status: Status, detail: str, **more: Any) -> int:
        update = self.update(ForceEstimate.invalid(CLOCK.now_ns(), status, detail), **more)
        self.server.sink.put(update)
        return update.number


def eventually(true: Callable[[], Any], seconds: float = 5.0) -> None:
    """Waits until ``true()``; fails when it does not come true in time."""
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end, "it did not come true in time"
        time.sleep(0.005)
