"""A server with a fake engine behind it."""

from collections.abc import Iterator

import numpy as np
import pytest

from tipforce.live.server import PageServer, PageState, serve
from tipforce.types import Image

from .updates import FakeEngine, Publisher, eventually  # type: ignore[import-not-found]


@pytest.fixture(scope="session")
def image() -> Image:
    """(240, 320) grey."""
    return np.tile(np.linspace(60, 200, 320).astype(np.uint8), (240, 1))


@pytest.fixture
def engine() -> FakeEngine:
    return FakeEngine()


@pytest.fixture(scope="module")
def _running() -> Iterator[tuple[PageServer, FakeEngine]]:
    engine = FakeEngine()
    with serve(engine, settings=engine.settings()) as server:
        yield server, engine


@pytest.fixture
def server(_running: tuple[PageServer, FakeEngine], engine: FakeEngine, monkeypatch: pytest.MonkeyPatch) -> PageServer:
    """One for all tests of a file, for it takes a while to end: each finds it without pages and as it began."""
    server, pressed = _running
    monkeypatch.setattr(pressed, "__dict__", engine.__dict__)  # its buttons are those of the test's engine
    eventually(lambda: server.pages == 0)
    server._hub.newest = None
    server._hub.latencies_s.clear()
    server._hub.page_ages_s.clear()
    server._hub.state = PageState(can_record=True, can_set_limits=True)
    server._hub.wake()
    return server


@pytest.fixture
def publisher(server: PageServer, image: Image) -> Publisher:
    return Publisher(server, image)
