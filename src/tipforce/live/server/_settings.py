"""What the page's server needs from outside: the engine's buttons, and what else an operator may do."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

from ...clinical import ContactSettings
from ...types import Clock, SystemClock
from .._loop import LoopCommands


class Commands(Protocol):
    """The buttons of a live engine. May be called from any thread; what they raise is shown on the page."""

    def zero(self, *, by: str, confirmed_n: float | None) -> None:
        """Subtract the force that is read now from then on; see `tipforce.live.Engine.zero`."""
        ...

    def clear_zero(self) -> None:
        """Subtract nothing any more."""
        ...

    def start_integral(self) -> None:
        """Begin the force-time integral, and the times beside it, anew."""
        ...

    def stop_integral(self) -> None:
        """Let the force-time integral stay as it is."""
        ...


@dataclass(frozen=True, slots=True)
class PageSettings:
    """How a page is served.

    ``clock``: that of the engine: frame ages are measured against it. ``contact``: window and limit at the start.
    ``on_contact``: takes a new window and limit; None: they cannot be set on the page. ``on_record``: begins (True) or
    ends a recording; None: the page has no record button. Both run on a thread of their own; what they raise is shown.
    ``loop``: commands and state of a loop that holds a force; None: the page has no panel for one.
    ``jpeg_quality``: 1 to 100. ``most_pages``: so many may be open at once.
    """

    clock: Clock = field(default_factory=SystemClock)
    contact: ContactSettings = field(default_factory=ContactSettings)
    on_contact: Callable[[ContactSettings], None] | None = None
    on_record: Callable[[bool], None] | None = None
    loop: LoopCommands | None = None
    jpeg_quality: int = 82
    most_pages: int = 8
