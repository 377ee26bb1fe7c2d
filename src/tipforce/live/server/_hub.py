"""Between the engine's thread and the pages: the newest update, and what all pages share."""

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

_KEPT = 1000
"""Latencies and frame ages that are kept."""
_URGENT = 2
"""Threads of the stop key: a first stop that hangs in a driver does not hold up the second."""


@dataclass(frozen=True, slots=True)
class PageState:
    """What all pages show alike, and hear of when it changes.

    ``starting``: what the program does before the first image, empty once the run has begun.
    ``can_hold``: there is a loop that holds a force.
    ``recording_message``: why there is no recording although one was wanted, else empty.
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
        """As the JSON text that pages get."""
        values: dict[str, Any] = asdict(self) | {
            "answer": "state",
            "contact": self.contact.model_dump(mode="json", include={"contact_n", "window_n", "limit_n"}),
        }
        return json.dumps(values)


class Hub:
    """Holds the newest update and the pages' common state; wakes the pages. ``loop`` is that of the server.

    `begin`, `publish` and `change` may be called from any thread, all else belongs to the loop's own.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop, settings: PageSettings) -> None:
        self.settings = settings
        self.commands: Commands | None = None
        """The engine's buttons; None before the run begins."""
        self.state = PageState(contact=settings.contact)
        self.newest: EncodedUpdate | None = None
        self.latencies_s: deque[float] = deque(maxlen=_KEPT)
        """From mid-exposure until the message was handed to a socket."""
        self.page_ages_s: deque[float] = deque(maxlen=_KEPT)
        """Ages of images when they were drawn, as the pages measured them."""
        self.limits = threading.Lock()
        """Held while a page sets window and limit: the last one that is set is also the last that all hear of."""
        self.closing = False
        self.urgent = ThreadPoolExecutor(_URGENT, "tipforce-stop")
        """Where the stop key is served: on threads that nothing else can keep busy."""
        self._heard_s = -math.inf
        self._named = 0
        self._loop = loop
        self._changing = threading.Lock()
        self._pages: set[asyncio.Event] = set()

    @property
    def pages(self) -> int:
        """So many are open."""
        return len(self._pages)

    @property
    def silent_s(self) -> float:
        """So long ago any page was heard, seconds; infinite where none was."""
        return time.monotonic() - self._heard_s

    def heard(self) -> None:
        """A page has sent something: its script runs."""
        self._heard_s = time.monotonic()

    def publish(self, update: EncodedUpdate) -> None:
        """``update`` takes the place of the one before it."""
        self.newest = update
        self.wake()

    def begin(self, commands: Commands, settings: PageSettings) -> None:
        """The run begins: buttons work from now on.

        Args:
            commands: the engine's buttons.
            settings: clock, window and limit, and what the page may do.
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
        """Changes fields of ``state``; all pages hear of it."""
        with self._changing:
            self.state = replace(self.state, **changes)
        self.wake()

    def close(self) -> None:
        """All pages are told to go."""
        self.closing = True
        self.urgent.shutdown(wait=False)
        self.wake()

    def wake(self) -> None:
        """Every page looks for what is new; from any thread."""
        with suppress(RuntimeError):  # the loop has ended, and all pages with it
            self._loop.call_soon_threadsafe(self._wake)

    def _wake(self) -> None:
        for event in self._pages:
            event.set()

    def next_name(self) -> int:
        """A number for a page: the first one is 1, and none is given twice."""
        self._named += 1
        return self._named

    def join(self) -> asyncio.Event:
        """One more page: the event that is set when there is something new."""
        event = asyncio.Event()
        event.set()
        self._pages.add(event)
        return event

    def leave(self, event: asyncio.Event) -> None:
        """One page fewer."""
        self._pages.discard(event)
