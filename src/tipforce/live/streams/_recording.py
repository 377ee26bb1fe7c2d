"""Writes estimates into a recording (.mcap), with their images."""

import json
from pathlib import Path

from ...errors import InputError, OutputError
from ...io import SUBTRACTED_FORCE, RecordingWriter, check_target
from ...types import Frame, SessionInfo
from .._numbers import number
from .._update import LiveUpdate, Zero
from ._address import Address


class RecordingSink:
    """Writes every estimate, and its images unless ``frames=no``, on the camera's own clock.

    Images that were replaced by newer ones are left out: `tipforce record` keeps those. If the file can no longer be
    written, the recording ends with an OutputError that states the kept part and its file; it is not started again.
    """

    keeps_all = True

    def __init__(self, address: Address) -> None:
        """Raises InputError if the name is not a recording's, the file exists already, or it cannot be written."""
        address.only("frames")
        self.name = address.text
        self._path = Path(address.path)
        if address.place or self._path.suffix != ".mcap":
            raise InputError(f"out={address.text}: expected recording:FILE.mcap")
        chosen = address.options.get("frames", ("yes",))[-1]
        if chosen not in ("yes", "no"):
            raise InputError(f"out={address.text}: frames={chosen}: expected yes or no")
        self._frames = chosen == "yes"
        check_target(self._path, overwrite=False, origin="live")
        self._writer: RecordingWriter | None = None
        self._last_ns = -1
        self._zero_ns: int | None = None
        self._zeros = 0

    def start(self, info: SessionInfo, model: str) -> None:
        """Creates the file; see `Sink.start`. Raises InputError if it exists already or cannot be written."""
        self._writer = RecordingWriter(self._path, info, origin="live")
        self._writer.note("tipforce.live", {"model": model})
        self._last_ns, self._zero_ns, self._zeros = -1, None, 0

    def put(self, update: LiveUpdate) -> None:
        """Writes one update. Raises OutputError if the file can no longer be written."""
        assert self._writer is not None
        try:
            self._put(self._writer, update)
        except OutputError:
            self._writer.leave_part()
            self._writer = None
            raise

    def _put(self, writer: RecordingWriter, update: LiveUpdate) -> None:
        stamp_ns = update.estimate.stamp_ns
        self._note_zero(writer, update)
        if self._frames and update.frames and stamp_ns > self._last_ns:  # a notice has no images
            for view, image in update.frames.items():
                writer.write(Frame(stamp_ns, image, view))
            self._last_ns = stamp_ns
        writer.write_estimate(update.estimate)

    def _note_zero(self, writer: RecordingWriter, update: LiveUpdate) -> None:
        """Writes a record for each zero that was set or removed, before the first estimate that it affects."""
        zero = update.zero
        since_ns = None if zero is None else zero.since_ns
        if since_ns == self._zero_ns:
            return
        self._zero_ns, self._zeros = since_ns, self._zeros + 1
        writer.note(f"{SUBTRACTED_FORCE}.{self._zeros}", _zero_record(update.estimate.stamp_ns, zero))

    def close(self) -> None:
        """Finishes the file; does nothing after an error.

        Raises:
            OutputError: the file could not be finished; it stays as .part, and is recovered when it is opened.
        """
        writer, self._writer = self._writer, None
        if writer is not None:
            writer.close()


def _zero_record(stamp_ns: int, zero: Zero | None) -> dict[str, str]:
    """Returns the record of the force that is subtracted from the estimates from ``stamp_ns`` on."""
    if zero is None:
        return {"stamp_ns": str(stamp_ns), "magnitude_n": "0.0", "by": ""}
    return {
        "stamp_ns": str(stamp_ns),
        "magnitude_n": repr(zero.magnitude_n),
        "offset_n": json.dumps([number(value) for value in zero.offset_n.tolist()]),
        "since_unix_s": repr(zero.since_unix_s),
        "by": zero.by,
        "confirmed": "yes" if zero.confirmed else "no",
    }
