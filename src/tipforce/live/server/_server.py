"""Runs the page's server on a thread of its own; contains the sink that feeds it."""

import asyncio
import ipaddress
import logging
import mimetypes
import secrets
import socket
import threading
from collections import deque
from collections.abc import Awaitable, Callable
from importlib import resources

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket

from ..._system.contexts import ClosedAtExit
from ...errors import InputError
from ...types import SessionInfo
from .._update import LiveUpdate
from ._commands import MAX_COMMAND_BYTES
from ._guard import Guard
from ._hub import Hub, PageState
from ._messages import EncodedUpdate, Point, point_of
from ._session import PageSession
from ._settings import Commands, PageSettings

_log = logging.getLogger(__name__)

LOCAL_HOST = "127.0.0.1"
MIN_TOKEN_LETTERS = 16
"""Least number of letters of a token; shorter ones may be guessed."""
_TOKEN_BYTES = 24
_START_S = 10.0
_STOP_S = 5.0
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
        """Shows the names of session and model on the pages."""
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

    def __init__(
        self, address: str, port: int, sink: PageSink, hub: Hub, server: uvicorn.Server, thread: threading.Thread
    ) -> None:
        self.address, self.port, self.sink = address, port, sink
        self._hub, self._server, self._thread = hub, server, thread

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
        if self._thread.is_alive():
            self._hub.close()
            self._server.should_exit = True
            self._thread.join(_STOP_S)
            if self._thread.is_alive():
                _log.warning("the page's server did not end within %g s", _STOP_S)


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

    Raises:
        InputError: the server cannot listen there, or ``token`` is too short.
    """
    settings = settings or PageSettings()
    if token is not None and len(token) < MIN_TOKEN_LETTERS:
        raise InputError(f"token: expected at least {MIN_TOKEN_LETTERS} letters, got {len(token)}")
    if token is None and not _is_local(host):
        token = secrets.token_urlsafe(_TOKEN_BYTES)
    listening = _listen(host, port)
    port = listening.getsockname()[1]
    started: threading.Event = threading.Event()
    made: list[tuple[Hub, uvicorn.Server]] = []
    failed: list[BaseException] = []

    async def main() -> None:
        hub = Hub(asyncio.get_running_loop(), settings)
        if commands is not None:
            hub.begin(commands, settings)
        app = Guard(_app(hub, settings.most_pages), {host, socket.gethostname()}, token, f"tipforce-{port}")
        server = uvicorn.Server(
            uvicorn.Config(
                app,
                log_config=None,
                access_log=False,
                lifespan="off",
                server_header=False,
                proxy_headers=False,
                ws_max_size=MAX_COMMAND_BYTES,
                ws_ping_interval=PING_INTERVAL_S,
                ws_ping_timeout=PING_INTERVAL_S,
                ws_per_message_deflate=False,  # JPEG does not get smaller
                timeout_graceful_shutdown=1,
            )
        )
        made.append((hub, server))
        asyncio.get_running_loop().call_soon(started.set)
        await server.serve(sockets=[listening])

    def run() -> None:
        try:
            asyncio.run(main())
        except BaseException as error:
            failed.append(error)
            _log.exception("the page's server has failed")
        finally:
            listening.close()
            started.set()

    thread = threading.Thread(target=run, name="tipforce-page", daemon=True)
    thread.start()
    if not started.wait(_START_S) or failed or not made:
        raise InputError(f"the page's server could not start on {host}:{port}") from (failed[0] if failed else None)
    hub, server = made[0]
    query = "" if token is None else f"?token={token}"
    address = f"http://{_shown(host)}:{port}/{query}"
    return PageServer(address, port, PageSink(hub), hub, server, thread)


def _app(hub: Hub, most_pages: int) -> Starlette:
    """Returns the application with its routes: the files of the page, and its socket."""

    async def page(socket: WebSocket) -> None:
        if hub.pages >= most_pages or hub.closing:
            await socket.accept()
            await socket.close(_TRY_LATER, f"{most_pages} pages are open already, and no more are served")
            return
        await PageSession(socket, hub).run()

    routes = [Route(path, _file(*content)) for path, content in _page_files().items()]
    return Starlette(routes=[*routes, WebSocketRoute("/live", page)])


def _page_files() -> dict[str, tuple[bytes, str]]:
    """Returns path -> content and media type of every file of the page; no other file is served."""
    files: dict[str, tuple[bytes, str]] = {}
    for entry in (resources.files("tipforce.live") / "page").iterdir():
        kind = mimetypes.guess_type(entry.name)[0]
        if entry.is_file() and kind is not None:
            path = "/" if entry.name == "index.html" else f"/{entry.name}"
            files[path] = (entry.read_bytes(), kind)
    return files


def _file(content: bytes, kind: str) -> Callable[[Request], Awaitable[Response]]:
    async def answer(_: Request) -> Response:
        return Response(content, media_type=kind)

    return answer


def _is_local(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _listen(host: str, port: int) -> socket.socket:
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        listening = socket.socket(family, kind, protocol)
    except (OSError, OverflowError, UnicodeError) as error:
        raise InputError(f"nothing can listen on {host}:{port}: {error}") from None
    try:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind(address)
        listening.listen()
    except (OSError, OverflowError) as error:
        listening.close()
        raise InputError(f"nothing can listen on {host}:{port}: {error}; choose another port") from None
    listening.setblocking(False)
    return listening


def _shown(host: str) -> str:
    """Returns the host for the address of the page; for "all addresses" the one that other machines can reach."""
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        return host
    if address.is_unspecified:
        address = ipaddress.ip_address(_outward(address.version))
    return f"[{address}]" if address.version == 6 else str(address)


def _outward(version: int) -> str:
    """Returns the address at which other machines reach this machine; nothing is sent for it."""
    family, beyond = (socket.AF_INET6, "2001:db8::1") if version == 6 else (socket.AF_INET, "192.0.2.1")
    with socket.socket(family, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((beyond, 9))
            return probe.getsockname()[0]
        except OSError:
            return "::1" if version == 6 else LOCAL_HOST
