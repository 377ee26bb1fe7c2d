"""Writing a recording so that a kill -9 costs at most its last second."""

from pathlib import Path
from types import TracebackType
from typing import Self

from ..types import Clock, Context, Event, FloatArray, IntArray, SystemClock
from ._facts import ClockOffset, SensorPose, Tare

__all__ = ["RecordingWriter", "write_force_csv"]


class RecordingWriter:
    """Writes ``path + ".part"``, renamed to ``path`` when closed without an error."""

    def __init__(
        self,
        path: Path | str,
        context: Context,
        *,
        lossless: bool = False,
        jpeg_quality: int = 90,
        clock: Clock | None = None,
        overwrite: bool = False,
    ) -> None:
        self._clock = clock or SystemClock()
        raise NotImplementedError

    def write(self, event: Event) -> None:
        """One event; frames are compressed here."""
        raise NotImplementedError

    def state(self, fact: ClockOffset | Tare | SensorPose) -> None:
        """A fact about the run; the last one of its kind holds."""
        raise NotImplementedError

    def close(self) -> None:
        """Finish the file and give it its name."""
        raise NotImplementedError

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        raise NotImplementedError


def write_force_csv(path: Path | str, stamps_ns: IntArray, force_n: FloatArray) -> None:
    """A force log ``stamp_ns,fx_n,fy_n,fz_n``: stamps (n,), force (n, 3)."""
    raise NotImplementedError
