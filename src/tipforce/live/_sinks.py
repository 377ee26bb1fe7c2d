"""Where updates go: the face of a sink."""

from typing import Protocol

from ..types import SessionInfo
from ._update import LiveUpdate


class Sink(Protocol):
    """Takes updates: a page, a recording, a stream to another program, a controller.

    Each sink runs on a thread of its own. What it does there stops nobody else: while it is busy, its newest update
    waits (``keeps_all`` False), or up to a bounded number of them (True); the others are dropped and counted.
    """

    name: str
    """What health and reports call it."""
    keeps_all: bool
    """True: a bounded queue, in order. False: the newest alone."""

    def start(self, info: SessionInfo, model: str) -> None:
        """Called before the first update, and again after an error."""
        ...

    def put(self, update: LiveUpdate) -> None:
        """One update; may block or raise.

        After an error the sink is closed and started again, later and later; after an `InputError` it is not, for that
        would fail again.
        """
        ...

    def close(self) -> None:
        """Called at the end and after each error; may be called more than once."""
        ...
