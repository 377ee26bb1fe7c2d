"""The interface of a sink, which takes updates."""

from typing import Protocol

from ..types import SessionInfo
from ._update import LiveUpdate


class Sink(Protocol):
    """Takes updates: a page, a recording, a stream to another program, a controller.

    Each sink runs on a thread of its own and cannot stop the others. While it is busy, its newest update waits
    (``keeps_all`` False), or up to a bounded number of updates (True); the others are dropped and counted.
    """

    name: str
    """Name of the sink in health and reports."""
    keeps_all: bool
    """True: a bounded queue, in order. False: only the newest update."""

    def start(self, info: SessionInfo, model: str) -> None:
        """Starts the sink; called before the first update, and again after an error.

        Args:
            info: metadata of the session.
            model: name of the model.
        """

    def put(self, update: LiveUpdate) -> None:
        """Takes one update; may block or raise.

        After an error the sink is closed and started again, after a wait that grows. After an `InputError` it is not
        started again, because that would fail, too.
        """

    def close(self) -> None:
        """Closes the sink; called at the end and after each error, and possibly more than once."""
