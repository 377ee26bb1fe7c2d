"""Sends estimates to other programs: OpenIGTLink, Foxglove, Lab Streaming Layer, JSON, a recording; docs/streams.md.

Each output is a `Sink`. An invalid estimate is sent as NaN (JSON: null) with its status and reason, never as an old
number.
"""

from ._message import SCHEMA_VERSION, LiveMessage
from ._open import KINDS, open_sink

__all__ = ["KINDS", "SCHEMA_VERSION", "LiveMessage", "open_sink"]
