"""OpenIGTLink client: sends pose of the tip and force to 3D Slicer, PLUS or any OpenIGTLink server.

pyigtl packs the messages. Its client is not used: it polls every 10 ms, keeps a hundred old messages for a
server that reconnects, and prints tracebacks.
"""

import contextlib
import json
import math
import socket
import time

import numpy as np

from ..._system.extras import import_extra
from ...types import FloatArray, SessionInfo
from .._update import LiveUpdate
from ._address import Address
from ._message import message_of
from ._tip import tip_pose

TIP_DEVICE, FORCE_DEVICE = "TipToBase", "TipForce"
"""Names of the transform and of the string; they become names of nodes in Slicer."""
PORT = 18944
TIMEOUT_S = 2.0
LAST_MESSAGE_S = 1.0
"""Longest wait at the end of the run for a slow server, so that the last message reaches it."""
READ_BYTES = 1 << 16
SEND_BUFFER_BYTES = 4096
"""Bytes that wait on this machine for a slow server: some updates. Linux uses twice this size."""
SENT_FIELDS = (
    *("status", "detail", "expires_unix_s"),
    *("force_n", "magnitude_n", "magnitude_interval_n", "interval_n", "magnitude_g", "zero"),
)
"""Fields of the JSON message that the string contains."""
_UNKNOWN = np.array([[math.nan] * 4] * 3 + [[0.0, 0.0, 0.0, 1.0]])


class OpenIGTLink:
    """Sends a TRANSFORM and a STRING (JSON) with the same time stamp for each update.

    The transform is NaN without a pose, because the last pose would look like a live one. Not `keeps_all`: Slicer shows
    the newest. While the server does not read, updates are left out.
    """

    keeps_all = False

    def __init__(self, address: Address) -> None:
        """Raises MissingExtraError without pyigtl."""
        address.only()
        self.name = address.text
        self._target = address.with_port(PORT)
        self._igtl = import_extra("pyigtl", "stream")
        self._session, self._model = SessionInfo(), ""
        self._socket: socket.socket | None = None
        self._unsent = b""
        self._left_out: LiveUpdate | None = None
        """The newest update, if the server had not taken the one before."""
        self._taken_s = 0.0

    def start(self, info: SessionInfo, model: str) -> None:
        """Connects to the server; see `Sink.start`. Raises OSError if no server answers."""
        self._session, self._model = info, model
        self._socket = socket.create_connection(self._target, TIMEOUT_S)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        self._socket.setblocking(False)
        self._unsent, self._left_out, self._taken_s = b"", None, time.monotonic()

    def put(self, update: LiveUpdate) -> None:
        """Sends both messages. Raises OSError if the server is gone, or takes nothing for two seconds.

        While bytes of an earlier update wait for the server, this one is only kept: a later one replaces it.
        """
        assert self._socket is not None
        self._refuse_end(self._socket)
        self._send(self._socket)
        if self._unsent:
            self._left_out = update
            if time.monotonic() - self._taken_s > TIMEOUT_S:
                raise TimeoutError(f"the OpenIGTLink server has taken nothing for {TIMEOUT_S:g} s")
            return
        self._unsent, self._left_out = self._packed(update), None
        self._taken_s = time.monotonic()
        self._send(self._socket)

    def _packed(self, update: LiveUpdate) -> bytes:
        """Returns the bytes of TRANSFORM (pose of the tip) and STRING (force as JSON), both stamped mid-exposure."""
        message = message_of(update, self._session, self._model).model_dump(mode="json")
        text = json.dumps({name: message[name] for name in SENT_FIELDS})  # ASCII: pyigtl packs nothing else
        pose = tip_pose(update, self._session)
        stamp_s = update.captured_unix_ns * 1e-9
        transform: bytes = self._transform(_UNKNOWN if pose is None else pose.matrix, stamp_s)
        return transform + self._igtl.StringMessage(text, timestamp=stamp_s, device_name=FORCE_DEVICE).pack()

    def _send(self, connection: socket.socket) -> None:
        """Sends the bytes that the socket takes without waiting."""
        try:
            while self._unsent:
                self._unsent = self._unsent[connection.send(self._unsent) :]
                self._taken_s = time.monotonic()
        except BlockingIOError:
            pass

    def _transform(self, matrix: FloatArray, stamp_s: float) -> bytes:
        return self._igtl.TransformMessage(matrix, timestamp=stamp_s, device_name=TIP_DEVICE).pack()

    @staticmethod
    def _refuse_end(connection: socket.socket) -> None:
        """Reads and drops the server's data. Raises ConnectionError if it closed, which a first send would not show."""
        try:
            while connection.recv(READ_BYTES):
                pass
            raise ConnectionError("the OpenIGTLink server closed the connection")
        except BlockingIOError:
            pass  # nothing more to read: the server is connected

    def close(self) -> None:
        """Closes the connection, after the last message."""
        connection, self._socket = self._socket, None
        if connection is None:
            return
        with contextlib.closing(connection), contextlib.suppress(OSError):  # the server may be gone
            last = b"" if self._left_out is None else self._packed(self._left_out)
            connection.settimeout(LAST_MESSAGE_S)
            connection.sendall(self._unsent + last)
