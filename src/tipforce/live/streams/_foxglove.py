"""Live Foxglove server: images and estimates as in the recordings of tipforce, and the whole message as JSON."""

import secrets
import sys
import time
from typing import Any

from ..._system.extras import import_extra
from ...io import COMPRESSED_IMAGE, ESTIMATE, FORCE_ESTIMATE, SCHEMAS, encode_image, pack_estimate, pack_image
from ...types import Image, SessionInfo
from .._update import LiveUpdate
from ._address import Address
from ._message import LiveMessage, message_of
from ._server import OriginDoor

PORT = 8765
APP = "https://app.foxglove.dev"
"""The web page that shows such streams; the desktop program has an origin of its own."""
DESKTOP = "foxglove://"
MAX_WAITING_MESSAGES = 8
"""Number of messages that wait in foxglove-sdk; the oldest are dropped."""
FLUSH_S = 0.2
"""Waiting time before the stop: foxglove-sdk sends in the background, and its stop does not wait for that."""
_SUBPROTOCOL = "foxglove.sdk.v1"
_MESSAGE_DATA = 1
"""First byte of a message of a channel; the number of the subscription follows in four bytes."""
_QUALITY = 80


class FoxgloveServer:
    """Topics: ``/VIEW/compressed`` (CompressedImage), ``/estimate`` (ForceEstimate), ``/live`` (`LiveMessage`).

    Stamps are mid-exposure in nanoseconds since 1970. Images are encoded only for clients that show them. foxglove-sdk
    accepts every web page; so it listens on a random address of this machine, and clients connect through an
    `OriginDoor`.
    """

    keeps_all = False

    def __init__(self, address: Address) -> None:
        """Raises MissingExtraError without foxglove-sdk."""
        address.only("origin")
        self.name = address.text
        self._target = address.with_port(PORT)
        self._origins = (APP, DESKTOP, *address.options.get("origin", ()))
        self._foxglove = import_extra("foxglove", "stream", package="foxglove-sdk")
        self._session, self._model = SessionInfo(), ""
        self._context: Any = None
        self._server: Any = None
        self._door: OriginDoor | None = None
        self._behind = "", 0
        self._channels: dict[str, Any] = {}

    def start(self, info: SessionInfo, model: str) -> None:
        """Begins to listen; see `Sink.start`. Raises OSError if the port is in use."""
        self._session, self._model = info, model
        foxglove = self._foxglove
        self._context, self._channels = foxglove.Context(), {}
        host = _unknown_loopback()
        self._server = foxglove.start_server(
            name=f"tipforce {info.name}".strip(),
            host=host,
            port=0,
            context=self._context,
            message_backlog_size=MAX_WAITING_MESSAGES,
        )
        self._behind = host, self._server.port
        self._door = OriginDoor(
            *self._target, self._behind, origins=self._origins, subprotocol=_SUBPROTOCOL, key_of=_subscription
        )
        self._live = foxglove.Channel("/live", schema=LiveMessage.model_json_schema(), context=self._context)
        self._estimate = self._ros2(f"/{ESTIMATE}", FORCE_ESTIMATE)

    def put(self, update: LiveUpdate) -> None:
        """Publishes one update."""
        at = update.captured_unix_ns
        for view, image in update.frames.items():
            self._publish(view, image, at)
        self._estimate.log(pack_estimate(at, update.estimate), log_time=at)
        text = message_of(update, self._session, self._model).model_dump_json(by_alias=True)
        self._live.log(text.encode(), log_time=at)

    def close(self) -> None:
        """Ends all connections, after the last messages."""
        if self._server is not None:
            time.sleep(FLUSH_S)
            self._server.stop()
        if self._door is not None:
            self._door.close()
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


def _subscription(message: str | bytes) -> bytes | None:
    """Returns the subscription of a message of a channel, of which the newest is kept; None for other messages."""
    return message[:5] if isinstance(message, bytes) and message[:1] == bytes([_MESSAGE_DATA]) else None


def _unknown_loopback() -> str:
    """Returns a random address of this machine, which a web page would have to guess among millions (Linux only)."""
    if sys.platform != "linux":
        return "127.0.0.1"
    return ".".join(["127", *(str(1 + secrets.randbelow(253)) for _ in range(3))])
