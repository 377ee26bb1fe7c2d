"""Runs the page's server on a thread of its own; contains the sink that feeds it."""

import asyncio
from collections import deque

from starlette.applications import Starlette
from starlette.routing import WebSocketRoute
from starlette.types import ASGIApp
from starlette.websockets import WebSocket

from ..._system.contexts import ClosedAtExit
from ..._system.web.server import LOCAL_HOST, RunningServer, page_routes, start_server
from ...types import SessionInfo
from .._update import LiveUpdate
from ._commands import MAX_COMMAND_BYTES
from ._hub import Hub, PageState
from ._messages import EncodedUpdate, Point, point_of
from ._session import PageSession
from ._settings import Commands, PageSettings

PING_INTERVAL_S = 5.0
"""Interval between the pings of a socket; one that does not answer within the same time is closed."""
RECENT_POINTS = 30
"""Number of points of the trace in each message, so that a second without messages leaves no gap in it."""
_TRY_LATER = 1013


class PageSink:
    """A `Sink` for the pages. The newest update replaces older ones; nothing is kept for slow pages."""

    name = "page"
    keeps_all = False

    def __init__(self, hub: Hub) -> None:
        self._hub = hub
        self._recent: deque[Point] = deque(maxlen=RECENT_POINTS)

    def start(self, info: SessionInfo, model: str) -> None:
        """Shows the names of session and model on the pages; see `Sink.start`."""
        self._hub.change(model=model, session=info.name, simulated=info.simulated)

    def put(self, update: LiveUpdate) -> None:
        """Replaces the preceding update, and returns immediately."""
        self._hub.publish(EncodedUpdate(update, self._hub.settings.jpeg_quality, tuple(self._recent)))
        self._recent.append(point_of(update))

    def close(self) -> None:
        """Does nothing: pages notice by themselves that nothing new comes."""


class PageServer(ClosedAtExit):
    """A running server. A context manager: leaving it closes the server.

    Attributes:
        address: address for a browser, with the token if one is required.
        port: port on which the server listens.
        sink: takes the updates.
    """

    def __init__(self, running: RunningServer, sink: PageSink, hub: Hub) -> None:
        self.address, self.port, self.sink = running.address, running.port, sink
        self._hub, self._running = hub, running

    @property
    def pages(self) -> int:
        """Number of open pages."""
        return self._hub.pages

    @property
    def silent_s(self) -> float:
        """Time in seconds since a page last sent something; an open page whose script runs sends each second."""
        return self._hub.silent_s

    @property
    def state(self) -> PageState:
        """State that all pages show."""
        return self._hub.state

    def show_starting(self, doing: str) -> None:
        """Shows on the pages the work of the program before the run begins."""
        self._hub.change(starting=doing)

    def begin(self, commands: Commands, settings: PageSettings) -> None:
        """Begins the run.

        Args:
            commands: the engine's buttons.
            settings: clock, force window and limit, and the rights of the page; ``most_pages`` stays as it was in
                `serve`.
        """
        self._hub.begin(commands, settings)

    def latencies_s(self) -> list[float]:
        """Returns the times from mid-exposure until a message was passed to a page's socket, of the last messages."""
        return list(self._hub.latencies_s)

    def page_ages_s(self) -> list[float]:
        """Returns the ages of the last images when they were drawn, as upper limits that the pages measured."""
        return list(self._hub.page_ages_s)

    def show_recording(self, on: bool, message: str = "") -> None:
        """Shows on the pages that a recording began or ended without use of their button.

        Args:
            on: whether a recording runs.
            message: reason for the end of a recording, or "".
        """
        self._hub.change(recording=on, recording_message=message)

    def close(self) -> None:
        """Ends the server; pages show that they are disconnected. May be called more than once."""
        if self._running.running:
            self._hub.close()
            self._running.close()


def serve(
    commands: Commands | None,
    *,
    host: str = LOCAL_HOST,
    port: int = 0,
    token: str | None = None,
    settings: PageSettings | None = None,
) -> PageServer:
    """Starts the server of the live page.

    Args:
        commands: the engine's buttons; None: there is no engine yet, and `PageServer.begin` sets it.
        host: name or address to listen on; by default only this machine can reach the page.
        port: port to listen on; 0: any free port.
        token: required from a browser; None: none is required on this machine, and a random one otherwise.
        settings: clock, force window and limit, and the rights of the page.

    Returns:
        The running server.

    Raises:
        InputError: the server cannot listen there, or ``token`` is too short.
    """
    settings = settings or PageSettings()
    made: list[Hub] = []

    def make_app() -> ASGIApp:
        hub = Hub(asyncio.get_running_loop(), settings)
        if commands is not None:
            hub.begin(commands, settings)
        made.append(hub)
        return _app(hub, settings.most_pages)

    config = {
        "ws_max_size": MAX_COMMAND_BYTES,
        "ws_ping_interval": PING_INTERVAL_S,
        "ws_ping_timeout": PING_INTERVAL_S,
        "ws_per_message_deflate": False,  # JPEG does not get smaller
    }
    running = start_server(make_app, host=host, port=port, token=token, config=config)
    hub = made[0]
    return PageServer(running, PageSink(hub), hub)


def _app(hub: Hub, most_pages: int) -> Starlette:
    """Returns the application with its routes: the files of the page, and its socket."""

    async def page(socket: WebSocket) -> None:
        if hub.pages >= most_pages or hub.closing:
            await socket.accept()
            await socket.close(_TRY_LATER, f"{most_pages} pages are open already, and no more are served")
            return
        await PageSession(socket, hub).run()

    return Starlette(routes=[*page_routes("tipforce.live"), WebSocketRoute("/live", page)])
