"""A WebSocket server on threads of its own that refuses web pages of other origins."""

import threading
from collections.abc import Callable, Sequence

from websockets.sync.server import Server, ServerConnection, serve
from websockets.typing import Origin, Subprotocol

__all__ = ["OriginServer"]

_LARGEST_REQUEST = 1 << 16
"""Bytes: clients of ours send subscriptions and the like."""


class OriginServer:
    """Serves each connection with ``handler`` on a thread of its own, until `close`.

    A program sends no Origin and is let in. A web page sends one, whichever address it connects to: without this check
    any page that is open in a browser on this machine could read the stream.
    """

    def __init__(
        self,
        host: str,
        port: int,
        handler: Callable[[ServerConnection], None],
        *,
        origins: Sequence[str] = (),
        subprotocols: Sequence[str] | None = None,
    ) -> None:
        """``origins``: those that are let in, as in ``http://127.0.0.1:8000``. Raises OSError: the port is in use."""
        self._server: Server = serve(
            handler,
            host,
            port,
            origins=[None, *map(Origin, origins)],
            subprotocols=None if subprotocols is None else [Subprotocol(each) for each in subprotocols],
            max_size=_LARGEST_REQUEST,
            compression=None,  # costs more time than a local network
        )
        self._thread = threading.Thread(target=self._server.serve_forever, name=f"serve-{port}", daemon=True)
        self._thread.start()

    @property
    def port(self) -> int:
        """The port that it listens on."""
        return self._server.socket.getsockname()[1]

    def close(self) -> None:
        """Stop listening. Open connections end with their handlers."""
        self._server.shutdown()
        self._thread.join()
