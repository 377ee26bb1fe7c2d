"""Lab Streaming Layer: one irregular stream of doubles, whose channels are described with their units."""

import time
from collections.abc import Iterable
from typing import Any

from ..._system.extras import import_extra
from ...errors import InputError
from ...types import SessionInfo, Status
from .._update import LiveUpdate
from ._address import Address

STATUS_CODES = {status: number for number, status in enumerate(Status)}
"""Number of each status: 0 is valid. The description of the stream states them."""
CHANNELS: tuple[tuple[str, str, str], ...] = (
    *((f"f{axis}_n", "N", "Force") for axis in "xyz"),
    *((f"f{axis}_{end}_n", "N", "ForceInterval90") for axis in "xyz" for end in ("low", "high")),
    ("magnitude_n", "N", "Force"),
    ("magnitude_low_n", "N", "ForceInterval90"),
    ("magnitude_high_n", "N", "ForceInterval90"),
    ("contact", "probability", "Probability"),
    ("status", "code", "Status"),
    ("latency_s", "s", "Latency"),
    ("max_age_s", "s", "Validity"),
    *((f"zero_{axis}_n", "N", "SubtractedForce") for axis in "xyz"),
    ("zero_n", "N", "SubtractedForce"),
)
"""Label, unit and type of each channel."""
_DEFAULT_NAME = "tipforce"
BUFFERED_HUNDREDS = 1
"""Hundreds of samples that the outlet keeps for a reader that does not read."""


class LabStreamingLayer:
    """An outlet with one sample per update, stamped with mid-exposure on LSL's clock. NaN: unknown or not valid.

    A sample is valid until its stamp plus ``max_age_s``. `keeps_all`, because the programs that read LSL record.
    """

    keeps_all = True

    def __init__(self, address: Address) -> None:
        """Raises MissingExtraError without pylsl."""
        address.only()
        if address.port is not None or address.path not in ("", "/"):
            raise InputError(f"out={address.text}: expected lsl://NAME, as in lsl://{_DEFAULT_NAME}")
        self.name = address.text
        self._stream = address.place or _DEFAULT_NAME
        self._lsl = import_extra("pylsl", "stream")
        self._outlet: Any = None

    def start(self, info: SessionInfo, model: str) -> None:
        """Announces the stream; see `Sink.start`."""
        lsl = self._lsl
        described = lsl.StreamInfo(
            self._stream, "Force", len(CHANNELS), lsl.IRREGULAR_RATE, "double64", source_id=f"tipforce-{self._stream}"
        )
        about = described.desc()
        for name, value in _facts(info, model):
            about.append_child_value(name, value)
        channels = about.append_child("channels")
        for label, unit, kind in CHANNELS:
            channel = channels.append_child("channel")
            for name, value in (("label", label), ("unit", unit), ("type", kind)):
                channel.append_child_value(name, value)
        codes = about.append_child("status_codes")
        for status, number in STATUS_CODES.items():
            codes.append_child_value(status.value, str(number))
        self._outlet = lsl.StreamOutlet(described, max_buffered=BUFFERED_HUNDREDS)

    def put(self, update: LiveUpdate) -> None:
        """Pushes one sample."""
        estimate = update.estimate
        sample = [
            *estimate.force_n.tolist(),
            *estimate.interval_n.ravel().tolist(),
            estimate.magnitude_n,
            *estimate.magnitude_interval_n.tolist(),
            estimate.contact,
            float(STATUS_CODES[estimate.status]),
            update.latency_s,
            update.max_age_s,
            *([0.0] * 4 if update.zero is None else [*update.zero.offset_n.tolist(), update.zero.magnitude_n]),
        ]
        age_s = (time.time_ns() - update.captured_unix_ns) * 1e-9
        self._outlet.push_sample(sample, self._lsl.local_clock() - age_s)

    def close(self) -> None:
        """Withdraws the stream."""
        self._outlet = None


def _facts(info: SessionInfo, model: str) -> Iterable[tuple[str, str]]:
    return (
        ("manufacturer", "tipforce, research use only"),
        ("session", info.name),
        ("model", model),
        ("quantity", "force of the tissue on the catheter's tip, base frame; intervals hold 90 %"),
    )
