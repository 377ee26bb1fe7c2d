"""A camera, a method and sinks that do what a test says, with periods of milliseconds."""

import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from pydantic import BaseModel

from tipforce.estimators import Estimator
from tipforce.live import Engine, LiveSettings, LiveUpdate
from tipforce.types import Event, ForceEstimate, Frame, SessionInfo, Source, Status, SystemClock

FAST = LiveSettings(
    stale_s=0.06, stale_periods=2.5, lost_s=0.3, notice_s=0.02, reconnect_s=0.02, reconnect_max_s=0.04, hung_s=0.1,
    zero_s=0.3, detect=False,
)  # fmt: skip
"""An image is stale after 60 ms in place of 200 ms, and all else in proportion."""
PERIOD_S = 0.004


def force_estimate(stamp_ns: int, fx_n: float, contact: float = float("nan")) -> ForceEstimate:
    """A valid planar estimate (fx, 0) with 90 % intervals of 10 mN to both sides."""
    return ForceEstimate(
        stamp_ns,
        np.array([fx_n, 0.0, np.nan]),
        np.array([True, True, False]),
        np.diag([3.7e-5, 3.7e-5, np.nan]),
        np.array([[fx_n - 0.01, fx_n + 0.01], [-0.01, 0.01], [np.nan, np.nan]]),
        abs(fx_n),
        np.array([max(0.0, abs(fx_n) - 0.01), abs(fx_n) + 0.01]),
        contact=contact,
    )


class Camera:
    """A source whose images carry their number; ``script`` may change, drop or delay each, or raise."""

    def __init__(
        self, frames: int, script: Callable[[int, np.ndarray], np.ndarray | None] | None = None, views=("camera",)
    ) -> None:
        self.clock = SystemClock()
        self.session_info = SessionInfo("scripted")
        self.frames, self.script, self.views = frames, script, views
        self.number = 0
        self.opened = 0
        self.stamps_ns: dict[int, int] = {}

    def image(self, number: int) -> np.ndarray:
        image = np.full((32, 48), 120, np.uint8)
        image[0, :4] = np.frombuffer(np.uint32(number).tobytes(), np.uint8)
        image[8, 8] = number % 200  # in the sample that tells two images apart
        return image

    def before(self) -> Iterator[Event]:
        yield from ()

    def __iter__(self) -> Iterator[Event]:
        yield from self.before()
        next_ns = self.clock.now_ns()
        while self.number < self.frames:
            number, self.number = self.number, self.number + 1
            next_ns = max(next_ns + round(PERIOD_S * 1e9), self.clock.now_ns() - round(PERIOD_S * 1e9))
            self.clock.sleep_until_ns(next_ns)
            self.stamps_ns[number] = next_ns
            image = self.image(number)
            if self.script is not None:
                image = self.script(number, image)
            if image is not None:
                for view in self.views:
                    yield Frame(next_ns, image, view)

    def __enter__(self) -> "Camera":
        self.opened += 1
        return self

    def __exit__(self, *_: Any) -> None:
        pass


class NoSettings(BaseModel):
    pass


class Method(Estimator):
    """Answers with the force that ``force_of`` gives for the number of each image."""

    name = "scripted"
    settings_type = NoSettings

    def __init__(self, force_of: Callable[[int], float] = lambda _: 0.1, contact: float = float("nan")) -> None:
        super().__init__()
        self.force_of, self.contact = force_of, contact
        self.started = 0
        self.observations: list[Any] = []
        self.wanted_views: tuple[str, ...] = ("camera",)
        self.wanted_actuation: tuple[str, ...] = ()

    def start(self, info, images=()):
        self.started += 1
        return self

    def update(self, observation) -> ForceEstimate:
        self.observations.append(observation)
        image = observation.views.get(self.views[0])
        if set(self.required_actuation) - set(observation.actuation):
            return ForceEstimate.invalid(observation.stamp_ns, Status.MISSING_INPUT, "a drive is absent")
        number = int(np.frombuffer(image[0, :4].tobytes(), np.uint32)[0])
        return force_estimate(observation.stamp_ns, self.force_of(number), self.contact)

    @property
    def views(self):
        return self.wanted_views

    @property
    def required_actuation(self):
        return self.wanted_actuation


class Notes:
    """A sink that keeps what it gets."""

    keeps_all = True

    def __init__(self, name: str = "notes") -> None:
        self.name = name
        self.updates: list[LiveUpdate] = []
        self.started = self.closed = 0

    def start(self, info, model) -> None:
        self.started += 1

    def put(self, update: LiveUpdate) -> None:
        self.updates.append(update)

    def close(self) -> None:
        self.closed += 1

    def told(self, words: str) -> LiveUpdate:
        return next(each for each in self.updates if words in each.estimate.detail)

    def valid_since(self, at_ns: int) -> LiveUpdate:
        return next(each for each in self.updates if each.published_ns >= at_ns and each.estimate.valid)


def wait_until(condition: Callable[[], object], seconds: float = 5.0) -> None:
    """Raises AssertionError where ``condition`` does not come true."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.001)


@pytest.fixture
def engine() -> Iterator[Callable[..., Engine]]:
    """(source, method, *sinks, ...) -> an engine on the source's clock, stopped at the end of the test."""
    made: list[Engine] = []

    def make(source: Source, method: Method, *sinks: Any, settings: LiveSettings = FAST, **more: Any) -> Engine:
        made.append(Engine(source, method, sinks, settings=settings, clock=source.clock, **more))
        return made[-1]

    yield make
    for each in made:
        each.stop()


@pytest.fixture
def gate() -> Iterator[threading.Event]:
    """Something to hang on; opened at the end of the test."""
    event = threading.Event()
    yield event
    event.set()
