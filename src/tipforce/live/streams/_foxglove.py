"""A live Foxglove server: images and estimates as in our recordings, and the whole message as JSON."""

import contextlib
import secrets
import sys
import threading
from typing import Any

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
from websockets.sync.connection import Connection
from websockets.sync.server import ServerConnection

from ...io import COMPRESSED_IMAGE, ESTIMATE, FORCE_ESTIMATE, SCHEMAS, encode_image, pack_estimate, pack_image
from ...types import Image, SessionInfo
from .._update import LiveUpdate
from ._address import Address, import_extra
from ._message import LiveMessage, message_of, wall_ns
from ._server import OriginServer

__all__ = ["FoxgloveServer"]

PORT = 8765
SUBPROTOCOLS = ("foxglove.sdk.v1", "foxglove.websocket.v1")
APP = "https://app.foxglove.dev"
"""The page that shows such streams; the desktop program has an origin of its own."""
DESKTOP = "foxglove://"
_BACKLOG = 8
"""Messages that a slow client may lag behind; the oldest give way."""
_QUALITY = 80


class FoxgloveServer:
    """Topics: ``/VIEW/compressed`` (CompressedImage), ``/estimate`` (ForceEstimate), ``/live`` (`LiveMessage`).

    Stamps are mid-exposure in nanoseconds since 1970. Images are encoded only while somebody looks. foxglove-sdk lets
    every web page in; so it listens on an address of this machine that nobody knows, and clients come through an
    `OriginServer`.
    """

    keeps_all = False

    def __init__(self, address: Address) -> None:
        """Raises MissingExtraError without foxglove-sdk."""
        address.only("origin")
        self.name = address.text
        self._target = address.with_port(PORT)
        self._origins = (APP, DESKTOP, *address.options.get("origin", ()))
        self._foxglove = import_extra("foxglove")
        self._session, self._model = SessionInfo(), ""
        self._context: Any = None
        self._server: Any = None
        self._door: OriginServer | None = None
        self._upstream = ""
        self._channels: dict[str, Any] = {}

    def start(self, info: SessionInfo, model: str) -> None:
        """Listen. Raises OSError where the port is in use."""
        self._session, self._model = info, model
        foxglove = self._foxglove
        self._context, self._channels = foxglove.Context(), {}
        host = _unknown_loopback()
        self._server = foxglove.start_server(
            name=f"tipforce {info.name}".strip(),
            host=host,
            port=0,
            context=self._context,
            message_backlog_size=_BACKLOG,
        )
        self._upstream = f"ws://{host}:{self._server.port}"
        self._door = OriginServer(*self._target, self._relay, origins=self._origins, subprotocols=SUBPROTOCOLS)
        self._live = foxglove.Channel("/live", schema=LiveMessage.model_json_schema(), context=self._context)
        self._estimate = self._ros2(f"/{ESTIMATE}", FORCE_ESTIMATE)

    def put(self, update: LiveUpdate) -> None:
        """Publish one update."""
        at = wall_ns(update)
        for view, image in update.frames.items():
            self._publish(view, image, at)
        self._estimate.log(pack_estimate(at, update.estimate), log_time=at)
        text = message_of(update, self._session, self._model).model_dump_json(by_alias=True)
        self._live.log(text.encode(), log_time=at)

    def close(self) -> None:
        """End all connections."""
        if self._door is not None:
            self._door.close()
        if self._server is not None:
            self._server.stop()
        self._door = self._server = None

    def _publish(self, view: str, image: Image, stamp_ns: int) -> None:
        topic = f"/{view}/compressed"
        channel = self._channels.get(topic)
        if channel is None:
            channel = self._channels[topic] = self._ros2(topic, COMPRESSED_IMAGE)
        if channel.has_sinks():
            encoding, data = encode_image(image, lossless=False, jpeg_quality=_QUALITY)
            channel.log(pack_image(stamp_ns, view, encoding, data), log_time=stamp_ns)

    def _ros2(self, topic: str, schema: str) -> Any:
        described = self._foxglove.Schema(name=schema, encoding="ros2msg", data=SCHEMAS[schema].encode())
        return self._foxglove.Channel(topic, schema=described, message_encoding="cdr", context=self._context)

    def _relay(self, client: ServerConnection) -> None:
        """Join a client with the server behind."""
        chosen = [client.subprotocol] if client.subprotocol else None
        with connect(self._upstream, subprotocols=chosen, compression=None, max_size=None, max_queue=1) as server:
            back = threading.Thread(target=_pump, args=(client, server), name="foxglove-requests", daemon=True)
            back.start()
            _pump(server, client)
            client.close()
            back.join()


def _pump(source: Connection, target: Connection) -> None:
    """All messages of ``source`` to ``target``, until one of them ends."""
    with contextlib.suppress(ConnectionClosed):
        for message in source:
            target.send(message)
    source.close()
    target.close()


def _unknown_loopback() -> str:
    """An address of this machine that a web page would have to guess among millions, where there are such."""
    if sys.platform != "linux":
        return "127.0.0.1"
    return ".".join(["127", *(str(1 + secrets.randbelow(253)) for _ in range(3))])
