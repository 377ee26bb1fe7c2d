"""Estimates into a recording (.mcap), with the images that they are of."""

from itertools import count
from pathlib import Path

from ...errors import InputError
from ...io import RecordingWriter, check_target
from ...types import Frame, SessionInfo
from .._update import LiveUpdate
from ._address import Address

__all__ = ["RecordingSink"]


class RecordingSink:
    """Writes every estimate, and the images that were estimated unless ``frames=no``, on the camera's own clock.

    Images that gave way to newer ones are not in it: `tipforce record` keeps those. After an error the engine starts a
    sink again; that goes on in FILE-2.mcap, and what was written before stays.
    """

    keeps_all = True

    def __init__(self, address: Address) -> None:
        """Raises InputError: no name of a recording, or it stands already."""
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
        self._numbers = count(1)
        self._writer: RecordingWriter | None = None
        self._last_ns = -1

    def start(self, info: SessionInfo, model: str) -> None:
        """Begin a file. Raises InputError where it stands already, OSError where it cannot be written."""
        number = next(self._numbers)
        path = self._path if number == 1 else self._path.with_stem(f"{self._path.stem}-{number}")
        self._writer = RecordingWriter(path, info, origin="live")
        self._writer.note("tipforce.live", {"model": model})
        self._last_ns = -1

    def put(self, update: LiveUpdate) -> None:
        """Write one update. Raises OSError where the disk is full."""
        assert self._writer is not None
        stamp_ns = update.estimate.stamp_ns
        if self._frames and update.frames and stamp_ns > self._last_ns:  # a notice has none
            for view, image in update.frames.items():
                self._writer.write(Frame(stamp_ns, image, view))
            self._last_ns = stamp_ns
        self._writer.write_estimate(update.estimate)

    def close(self) -> None:
        """Finish the file. What an error leaves as .part is recovered when it is opened next."""
        writer, self._writer = self._writer, None
        if writer is not None:
            writer.close()
