"""Runs the web server of a page on a thread of its own."""

import asyncio
import ipaddress
import logging
import mimetypes
import secrets
import socket
import threading
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from importlib import resources
from typing import Any

import uvicorn
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route
from starlette.types import ASGIApp

from ...errors import InputError
from .guard import Guard

_log = logging.getLogger(__name__)

LOCAL_HOST = "127.0.0.1"
MIN_TOKEN_LETTERS = 16
"""Least number of letters of a token; shorter ones may be guessed."""
_TOKEN_BYTES = 24
_START_S = 10.0
_STOP_S = 5.0


@dataclass(frozen=True, slots=True, eq=False)
class RunningServer:
    """A server that runs.

    Attributes:
        address: address for a browser, with the token if one is required.
        port: port on which the server listens.
    """

    address: str
    port: int
    _server: uvicorn.Server
    _thread: threading.Thread

    @property
    def running(self) -> bool:
        """Whether the server has not ended."""
        return self._thread.is_alive()

    def close(self) -> None:
        """Ends the server. May be called more than once."""
        self._server.should_exit = True
        self._thread.join(_STOP_S)
        if self._thread.is_alive():
            _log.warning("the page's server did not end within %g s", _STOP_S)


def start_server(
    make_app: Callable[[], ASGIApp],
    *,
    host: str = LOCAL_HOST,
    port: int = 0,
    token: str | None = None,
    config: dict[str, Any] | None = None,
) -> RunningServer:
    """Starts a server on a thread of its own; a `Guard` checks each request.

    Args:
        make_app: makes the application; called inside the server's event loop.
        host: name or address to listen on; by default only this machine can reach the page.
        port: port to listen on; 0: any free port.
        token: required from a browser; None: none is required on this machine, and a random one otherwise.
        config: further options of ``uvicorn.Config``.

    Returns:
        The server, which accepts connections.

    Raises:
        InputError: the server cannot listen there, or ``token`` is too short.
    """
    if token is not None and len(token) < MIN_TOKEN_LETTERS:
        raise InputError(f"token: expected at least {MIN_TOKEN_LETTERS} letters, got {len(token)}")
    if token is None and not _is_local(host):
        token = secrets.token_urlsafe(_TOKEN_BYTES)
    listening = _listen(host, port)
    port = listening.getsockname()[1]
    started: threading.Event = threading.Event()
    made: list[uvicorn.Server] = []
    failed: list[BaseException] = []

    async def main() -> None:
        app = Guard(make_app(), {host, socket.gethostname()}, token, f"tipforce-{port}")
        settings = uvicorn.Config(
            app,
            log_config=None,
            access_log=False,
            lifespan="off",
            server_header=False,
            proxy_headers=False,
            timeout_graceful_shutdown=1,
            **(config or {}),
        )
        made.append(uvicorn.Server(settings))
        asyncio.get_running_loop().call_soon(started.set)
        await made[0].serve(sockets=[listening])

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
    query = "" if token is None else f"?token={token}"
    return RunningServer(f"http://{_shown(host)}:{port}/{query}", port, made[0], thread)


def page_routes(package: str) -> list[Route]:
    """Returns a route for every file in the folder ``page`` of ``package``; no other file is served."""
    routes: list[Route] = []
    for entry in (resources.files(package) / "page").iterdir():
        kind = mimetypes.guess_type(entry.name)[0]
        if entry.is_file() and kind is not None:
            path = "/" if entry.name == "index.html" else f"/{entry.name}"
            routes.append(Route(path, _file(entry.read_bytes(), kind)))
    return routes


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
