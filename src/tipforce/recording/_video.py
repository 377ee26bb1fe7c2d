"""Video files: true stamps in, H.264 that plays in a browser out."""

from collections.abc import Iterable
from pathlib import Path
from types import TracebackType
from typing import Self

from ..types import Frame

__all__ = ["VideoWriter", "write_video"]


class VideoWriter:
    """An ``.mp4``, H.264 yuv420p, index in front; the name appears when it is closed without an error."""

    def __init__(
        self, path: Path | str, fps: float, *, crf: int = 20, zero_ns: int | None = None, overwrite: bool = True
    ) -> None:
        raise NotImplementedError

    def write(self, frame: Frame) -> None:
        """One frame, shown at its stamp minus ``zero_ns`` (None: the first frame's stamp)."""
        raise NotImplementedError

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        raise NotImplementedError


def write_video(path: Path | str, frames: Iterable[Frame], fps: float) -> None:
    """All ``frames`` as an ``.mp4``."""
    with VideoWriter(path, fps) as video:
        for frame in frames:
            video.write(frame)
