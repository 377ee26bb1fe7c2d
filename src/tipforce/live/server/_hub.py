"""Shares the newest update and the common state of the pages between the engine's thread and the pages."""

import asyncio
import json
import math
import threading
import time
from collections import deque
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from ...clinical import ContactSettings
from ._messages import EncodedUpdate
from ._settings import Commands, PageSettings

KEPT_VALUES = 1000
"""Number of latencies and frame ages that are kept."""
STOP_THREADS = 2
"""Number of threads for the stop key: a first stop that hangs in a driver does not delay the second one."""


@dataclass(frozen=True, slots=True)
class PageState:
    """State that all pages show; it is sent to them when it changes.

    Attributes:
        model: name of the model.
        session: name of the session.
        simulated: whether the session is simulated.
        starting: work of the program before the first image; "" when the run has begun.
        contact: force window, limit and contact threshold.
        can_record: whether the page has a record button.
        can_set_limits: whether window and limit can be set on the page.
        can_hold: whether there is a loop that holds a force.
        recording: whether a recording runs.
        recording_message: reason why a requested recording does not run, or "".
    """

    model: str = ""
    session: str = ""
    simulated: bool = False
    starting: str = ""
    contact: ContactSettings = field(default_factory=ContactSettings)
    can_record: bool = False
    can_set_limits: bool = False
    can_hold: bool = False
    recording: bool = False
    recording_message: str = ""

    def text(self) -> str:
        """Returns the JSON text that pages get."""
        values: dict[str, Any] = asdict(self) | {
            "answer": "state",
            "contact": self.contact.model_dump(mode="json", include={"contact_n", "window_n", "limit_n"}),
        }
        return json.dumps(values)


class Hub:
    """Holds the newest update and the common state of the pages, and wakes the pages.

    `begin`, `publish` and `change` may be called from any thread; all other methods only from the server's event loop.

    Args:
        loop: event loop of the server.
        settings: settings of the pages.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop, settings: PageSettings) -> None:
        self.settings = settings
        self.commands: Commands | None = None
        """The engine's buttons; None before the run begins."""
        self.state = PageState(contact=settings.contact)
        self.newest: EncodedUpdate | None = None
        self.latencies_s: deque[float] = deque(maxlen=KEPT_VALUES)
        """Times from mid-exposure until the message was passed to a socket."""
        self.page_ages_s: deque[float] = deque(maxlen=KEPT_VALUES)
        """Ages of images when they were drawn, as the pages measured them."""
        self.limits = threading.Lock()
        """Held while a page sets window and limit, so that all pages get the values that were set last."""
        self.closing = False
        self.urgent = ThreadPoolExecutor(STOP_THREADS, "tipforce-stop")
        """Runs stop commands, on threads that no other work uses."""
        self._heard_s = -math.inf
        self._named = 0
        self._loop = loop
        self._changing = threading.Lock()
        self._pages: set[asyncio.Event] = set()

    @property
    def pages(self) -> int:
        """Number of open pages."""
        return len(self._pages)

    @property
    def silent_s(self) -> float:
        """Time in seconds since a page last sent something; infinite if none has."""
        return time.monotonic() - self._heard_s

    def heard(self) -> None:
        """Notes that a page has sent something, so its script runs."""
        self._heard_s = time.monotonic()

    def publish(self, update: EncodedUpdate) -> None:
        """Replaces the newest update by ``update`` and wakes the pages."""
        self.newest = update
        self.wake()

    def begin(self, commands: Commands, settings: PageSettings) -> None:
        """Begins the run: the buttons work from now on.

        Args:
            commands: the engine's buttons.
            settings: clock, force window and limit, and the rights of the page.
        """
        self.settings, self.commands = settings, commands
        self.change(
            starting="",
            contact=settings.contact,
            can_record=settings.on_record is not None,
            can_set_limits=settings.on_contact is not None,
            can_hold=settings.loop is not None,
        )

    def change(self, **changes: Any) -> None:
        """Changes fields of ``state`` and sends the state to all pages."""
        with self._changing:
            self.state = replace(self.state, **changes)
        self.wake()

    def close(self) -> None:
        """Ends the connections of all pages."""
        self.closing = True
        self.urgent.shutdown(wait=False)
        self.wake()

    def wake(self) -> None:
        """Makes every page check for news; may be called from any thread."""
        with suppress(RuntimeError):  # the loop has ended, and all pages with it
            self._loop.call_soon_threadsafe(self._wake)

    def _wake(self) -> None:
        for event in self._pages:
            event.set()

    def next_name(self) -> int:
        """Returns a number for a page, from 1 on; each number is given once."""
        self._named += 1
        return self._named

    def join(self) -> asyncio.Event:
        """Adds a page; returns the event that is set when there is news for it."""
        event = asyncio.Event()
        event.set()
        self._pages.add(event)
        return event

    def leave(self, event: asyncio.Event) -> None:
        """Removes a page."""
        self._pages.discard(event)
