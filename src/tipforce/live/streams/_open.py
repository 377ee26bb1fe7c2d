"""From the text of ``--out`` to a sink."""

from collections.abc import Callable, Mapping

from ...errors import InputError
from .._sinks import Sink
from ._address import Address
from ._foxglove import FoxgloveServer
from ._igtl import OpenIGTLink
from ._json import JsonUdp, JsonWebSocket
from ._lsl import LabStreamingLayer
from ._recording import RecordingSink

KINDS: Mapping[str, tuple[Callable[[Address], Sink], str]] = {
    "json-udp": (JsonUdp, "json-udp://127.0.0.1:8766"),
    "json-ws": (JsonWebSocket, "json-ws://127.0.0.1:8767"),
    "igtl": (OpenIGTLink, "igtl://127.0.0.1:18944"),
    "foxglove": (FoxgloveServer, "foxglove://127.0.0.1:8765"),
    "lsl": (LabStreamingLayer, "lsl://tipforce"),
    "recording": (RecordingSink, "recording:run.mcap"),
}
"""Kind -> constructor of the sink, and an example of its address."""


def open_sink(text: str) -> Sink:
    """Creates the sink for the address ``text``; it connects, listens or writes when it is started.

    Args:
        text: an address as in `KINDS`, with options after "?", as in ``recording:run.mcap?frames=no``.

    Raises:
        InputError: the kind or an option does not exist, the host is missing, or the recording exists already.
        MissingExtraError: the package for it is not installed.

    >>> open_sink("json-udp://127.0.0.1:8766").name
    'json-udp://127.0.0.1:8766'
    """
    address = Address.of(text)
    if address.kind not in KINDS:
        examples = ", ".join(example for _, example in KINDS.values())
        raise InputError(f"out={text}: there is no such kind of output; there are {examples}")
    return KINDS[address.kind][0](address)
