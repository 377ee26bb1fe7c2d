"""Settings of the page's server: the engine's buttons, and the other rights of an operator."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

from ...clinical import ContactSettings
from ...types import Clock, SystemClock
from .._loop import LoopCommands


class Commands(Protocol):
    """The buttons of a live engine. May be called from any thread; the page shows the errors that they raise."""

    def zero(self, *, by: str, confirmed_n: float | None) -> None:
        """Subtracts the present force from then on; see `tipforce.live.Engine.zero`."""

    def clear_zero(self) -> None:
        """Removes the zero: nothing is subtracted any more."""

    def start_integral(self) -> None:
        """Starts the force-time integral and the contact times from 0."""

    def stop_integral(self) -> None:
        """Stops the force-time integral; its value stays."""


@dataclass(frozen=True, slots=True)
class PageSettings:
    """Settings of the pages.

    ``on_contact`` and ``on_record`` run on a thread of their own; the page shows the errors that they raise.

    Attributes:
        clock: clock of the engine; frame ages are measured against it.
        contact: force window, limit and contact threshold at the start.
        on_contact: takes new values of these; None: they cannot be set on the page.
        on_record: starts (True) or stops a recording; None: the page has no record button.
        loop: commands and state of a loop that holds a force; None: the page has no panel for one.
        jpeg_quality: 1 to 100.
        most_pages: largest number of pages that may be open at the same time.
    """

    clock: Clock = field(default_factory=SystemClock)
    contact: ContactSettings = field(default_factory=ContactSettings)
    on_contact: Callable[[ContactSettings], None] | None = None
    on_record: Callable[[bool], None] | None = None
    loop: LoopCommands | None = None
    jpeg_quality: int = 82
    most_pages: int = 8
