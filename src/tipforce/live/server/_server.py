"""The page's server in a thread of its own, and the sink that feeds it."""

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
from types import TracebackType
from typing import Self

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket

from ...errors import InputError
from ...types import SessionInfo
from .._update import LiveUpdate
from ._commands import LONGEST
from ._guard import Guard
from ._hub import Hub, PageState
from ._messages import EncodedUpdate, Point, point_of
from ._session import PageSession
from ._settings import Commands, PageSettings

_log = logging.getLogger(__name__)

LOCAL_HOST = "127.0.0.1"
_SHORTEST_TOKEN = 16
"""Letters of a token; shorter ones may be guessed."""
_TOKEN_BYTES = 24
_START_S = 10.0
_STOP_S = 5.0
_PING_S = 5.0
"""So often a socket is tried; one that does not answer for as long again is closed."""
_RECENT = 30
"""So many points of the trace go with each frame: a second that did not reach a page leaves no gap."""
_TRY_LATER = 1013


class PageSink:
    """A `Sink` for the pages: the newest update wins, and nothing is kept for pages that are slow."""

    name = "page"
    keeps_all = False

    def __init__(self, hub: Hub) -> None:
        self._hub = hub
        self._recent: deque[Point] = deque(maxlen=_RECENT)

    def start(self, info: SessionInfo, model: str) -> None:
        """Pages show session and model by name."""
        self._hub.change(model=model, session=info.name, simulated=info.simulated)

    def put(self, update: LiveUpdate) -> None:
        """Takes the place of the update before it, and returns at once."""
        self._hub.publish(EncodedUpdate(update, self._hub.settings.jpeg_quality, tuple(self._recent)))
        self._recent.append(point_of(update))

    def close(self) -> None:
        """Nothing: pages find out by themselves that nothing new comes."""


class PageServer:
    """A running server. A context manager: leaving it closes the server.

    ``address``: what to open in a browser, with the token where one is needed. ``port``: that it listens
    on. ``sink``: takes the updates.
    """

    def __init__(
        self, address: str, port: int, sink: PageSink, hub: Hub, server: uvicorn.Server, thread: threading.Thread
    ) -> None:
        self.address, self.port, self.sink = address, port, sink
        self._hub, self._server, self._thread = hub, server, thread

    @property
    def pages(self) -> int:
        """So many are open."""
        return self._hub.pages

    @property
    def silent_s(self) -> float:
        """So long ago any page was heard, seconds; an open one whose script runs is heard each second."""
        return self._hub.silent_s

    @property
    def state(self) -> PageState:
        """What all pages show alike."""
        return self._hub.state

    def show_starting(self, doing: str) -> None:
        """Tells the pages what the program does before the run begins."""
        self._hub.change(starting=doing)

    def begin(self, commands: Commands, settings: PageSettings) -> None:
        """The run begins.

        Args:
            commands: the engine's buttons.
            settings: clock, window and limit, and what the page may do; ``most_pages`` stays as `serve` got it.
        """
        self._hub.begin(commands, settings)

    def latencies_s(self) -> list[float]:
        """From mid-exposure until the message was handed to a page's socket, of the last messages."""
        return list(self._hub.latencies_s)

    def page_ages_s(self) -> list[float]:
        """Ages of the last images when they were drawn, as the pages measured them: upper ends."""
        return list(self._hub.page_ages_s)

    def show_recording(self, on: bool, message: str = "") -> None:
        """Tells the pages that a recording began or ended otherwise than by their button; ``message`` says why."""
        self._hub.change(recording=on, recording_message=message)

    def close(self) -> None:
        """Ends the server; pages show that they are disconnected. May be called more than once."""
        if self._thread.is_alive():
            self._hub.close()
            self._server.should_exit = True
            self._thread.join(_STOP_S)
            if self._thread.is_alive():
                _log.warning("the page's server did not end within %g s", _STOP_S)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def serve(
    commands: Commands | None,
    *,
    host: str = LOCAL_HOST,
    port: int = 0,
    token: str | None = None,
    settings: PageSettings | None = None,
) -> PageServer:
    """Begins to serve the live page.

    Args:
        commands: the engine's buttons; None: there is no engine yet, and `PageServer.begin` brings it.
        host: name or address to listen on; by default nobody but this machine can reach the page.
        port: 0: any that is free.
        token: that a browser has to show; None: none is needed on this machine, and a random one elsewhere.
        settings: clock, window and limit, and what the page may do.

    Raises:
        InputError: nothing can listen there, or ``token`` is too short.
    """
    settings = settings or PageSettings()
    if token is not None and len(token) < _SHORTEST_TOKEN:
        raise InputError(f"token: expected at least {_SHORTEST_TOKEN} letters, got {len(token)}")
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
                ws_max_size=LONGEST,
                ws_ping_interval=_PING_S,
                ws_ping_timeout=_PING_S,
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
    """Routes: the files of the page, and its socket."""

    async def page(socket: WebSocket) -> None:
        if hub.pages >= most_pages or hub.closing:
            await socket.accept()
            await socket.close(_TRY_LATER, f"{most_pages} pages are open already, and no more are served")
            return
        await PageSession(socket, hub).run()

    routes = [Route(path, _file(*content)) for path, content in _page_files().items()]
    return Starlette(routes=[*routes, WebSocketRoute("/live", page)])


def _page_files() -> dict[str, tuple[bytes, str]]:
    """Path -> content and media type of every file of the page; nothing else can be asked for."""
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
    """What to put into an address: of "all addresses" the one that leads out of this machine."""
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        return host
    if address.is_unspecified:
        address = ipaddress.ip_address(_outward(address.version))
    return f"[{address}]" if address.version == 6 else str(address)


def _outward(version: int) -> str:
    """The address that others reach this machine at; nothing is sent for it."""
    family, beyond = (socket.AF_INET6, "2001:db8::1") if version == 6 else (socket.AF_INET, "192.0.2.1")
    with socket.socket(family, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((beyond, 9))
            return probe.getsockname()[0]
        except OSError:
            return "::1" if version == 6 else LOCAL_HOST
