"""The page of a live run: it is served immediately, and shows the program's steps until the run begins."""

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

from ..clinical import ContactSettings
from ..errors import InputError, OutputError
from ..live import Engine, Sink
from ..live.streams import open_sink
from ..types import Clock
from ._live_control import LiveControl

if TYPE_CHECKING:
    from ..live.server import PageServer


@dataclass(frozen=True, slots=True)
class PageAddress:
    """Address at which the page is served.

    Attributes:
        host: name or address.
        port: port; 0: any free port.
        token: see `tipforce.live.server.serve`.
    """

    host: str = "127.0.0.1"
    port: int = 0
    token: str | None = None


class LivePage:
    """The page of one run. A context manager: inside it the page is served, also before `begin`.

    Args:
        at: address at which it is served.
    """

    def __init__(self, at: PageAddress) -> None:
        self._at = at
        self._server: PageServer | None = None

    def __enter__(self) -> Self:
        from ..live.server import serve  # a web server is loaded where there is a page

        self._server = serve(None, host=self._at.host, port=self._at.port, token=self._at.token)
        return self

    def __exit__(self, *_: object) -> None:
        self.server.close()

    @property
    def server(self) -> "PageServer":
        """The running server. Raises RuntimeError outside of the ``with`` block."""
        if self._server is None:
            raise RuntimeError("the page is served inside its with block only")
        return self._server

    @property
    def address(self) -> str:
        """Address to open in a browser."""
        return self.server.address

    def show_starting(self, doing: str) -> None:
        """Shows the program's present step before the run begins."""
        self.server.show_starting(doing)

    def begin(self, engine: Engine, clock: Clock, control: LiveControl | None) -> None:
        """Shows the updates of ``engine``, and lets its buttons work.

        Args:
            engine: the engine that will run; the page becomes one of its sinks.
            clock: the engine's clock.
            control: a loop that holds a force, or None.
        """
        from ..live.server import PageSettings

        server = self.server

        def set_contact(contact: ContactSettings) -> None:
            if control is not None:
                control.set_limit(contact.limit_n)  # before the alarm's, so that one it refuses is none for the alarm
            engine.contact = contact

        settings = PageSettings(
            clock=clock,
            contact=engine.contact,
            on_contact=set_contact,
            on_record=_Recorder(engine, server).switch,
            loop=control,
        )
        engine.add_sink(server.sink)
        if control is not None:
            control.silent_s = lambda: server.silent_s
            engine.add_sink(control.sink)
        server.begin(engine if control is None else _Buttons(engine, control), settings)


class _Buttons:
    """The engine's buttons while a loop may hold a force."""

    def __init__(self, engine: Engine, control: LiveControl) -> None:
        self._control = control
        self.start_integral, self.stop_integral = engine.start_integral, engine.stop_integral
        self._engine = engine

    def zero(self, *, by: str, confirmed_n: float | None) -> None:
        """Raises while a force is held: the loop would compensate the subtracted force."""
        if self._control.running:
            raise InputError("no zero while the loop has the drives: it would press as much harder; retract first")
        self._engine.zero(by=by, confirmed_n=confirmed_n)

    def clear_zero(self) -> None:
        """Raises while a force is held: the loop would compensate the force that is no longer subtracted."""
        if self._control.running:
            raise InputError("the zero stays while the loop has the drives; retract first")
        self._engine.clear_zero()


class _Recorder:
    """The page's record button: each time a file of its own in the current folder, named by the time of the day."""

    def __init__(self, engine: Engine, server: "PageServer") -> None:
        self._engine, self._server = engine, server
        self._sink: Sink | None = None
        self._ended = False

    def switch(self, on: bool) -> None:
        """Begins or ends a recording, which is a sink of the engine.

        Args:
            on: whether a recording shall run; nothing happens where that is so already.

        Raises:
            InputError: the file cannot be made.
            OutputError: the recording that is ended here had failed.
        """
        if self._sink is not None and (not on or self._ended):
            sink, self._sink = self._sink, None
            health = self._engine.remove_sink(sink)
            if health.failures and not on:
                raise OutputError(f"recording stopped: {health.message}")
        if on and self._sink is None:
            self._ended = False
            self._sink = open_sink(f"recording:{time.strftime('live-%Y%m%d-%H%M%S')}.mcap")
            self._engine.add_sink(self._sink, self._end)

    def _end(self, why: str) -> None:
        self._ended = True
        self._server.show_recording(False, f"recording stopped: {why}")
