"""Writes video: H.264 that plays in a browser, with every frame at its own stamp."""

from collections.abc import Iterable
from contextlib import ExitStack
from fractions import Fraction
from pathlib import Path
from typing import Any, Self

import av
import numpy as np
from av.container import OutputContainer

from ..._system.atomic import atomic_path, check_output_file
from ...errors import InputError, TimeError
from ...types import Frame, Image

TICKS_PER_S = 90_000
"""Ticks per second of the files: 11 microseconds each, the clock of broadcast video."""
CRF = 20
"""Quality of x264, 0 to 51; a smaller number is better."""


class VideoWriter:
    """Writes an ``.mp4``: H.264 yuv420p, index in front; a context manager.

    The file gets its name when it closes without an error. Odd sizes are widened by one pixel. Grey frames become RGB
    and stay neutral.

    Args:
        path: the file.
        fps: nominal rate, frames per second.
        preset: preset of x264; a faster one makes larger files.
        threads: number of threads, 0 for the default of x264; the bytes depend on it.
        lossless: whether every pixel is restored exactly; this needs RGB in place of yuv420p, which browsers do not
            show.
        zero_ns: every frame is shown at its own stamp minus this; None: the stamp of the first frame.
    """

    def __init__(
        self,
        path: Path | str,
        fps: float,
        *,
        preset: str = "veryfast",
        threads: int = 0,
        lossless: bool = False,
        zero_ns: int | None = None,
    ) -> None:
        """Checks path and rate; the first frame opens the file and gives its size."""
        self.path = Path(path)
        check_output_file(self.path)
        self._file = ExitStack()
        if not 0.01 <= fps <= 10_000:
            raise InputError(f"{self.path}: {fps} frames a second is no rate for a video")
        self._rate = Fraction(fps).limit_denominator(1001)
        self._zero_ns = zero_ns
        self._lossless = lossless
        self._options = {"crf": "0" if lossless else str(CRF), "preset": preset, "bf": "0"} | (
            {"threads": str(threads)} if threads else {}
        )
        self._container: OutputContainer | None = None
        self._stream: av.VideoStream | None = None
        self._last_ticks = -1
        self._size: tuple[int, int] | None = None

    def write(self, frame: Frame) -> None:
        """Writes a frame. Raises TimeError unless its stamp is later than the last, InputError if its size differs."""
        image = _even(frame.image)
        if self._lossless and image.ndim == 2:
            image = np.ascontiguousarray(np.broadcast_to(image[..., None], (*image.shape, 3)))
        if self._zero_ns is None:
            self._zero_ns = frame.stamp_ns
        ticks = round((frame.stamp_ns - self._zero_ns) * TICKS_PER_S / 1_000_000_000)
        if ticks <= self._last_ticks:
            raise TimeError(f"{self.path}: the stamp {frame.stamp_ns} ns is not later than the one before it")
        stream, container = self._opened(image)
        if self._size != image.shape[:2]:
            raise InputError(f"{self.path}: a frame of {image.shape[:2]} pixels follows frames of {self._size}")
        raw = av.VideoFrame.from_ndarray(image, format="gray" if image.ndim == 2 else "rgb24")
        raw.pts, raw.time_base = ticks, Fraction(1, TICKS_PER_S)
        container.mux(stream.encode(raw))
        self._last_ticks = ticks

    def _opened(self, image: Image) -> tuple[av.VideoStream, OutputContainer]:
        """Returns stream and file; the first image, (h, w) or (h, w, 3), opens them and gives the size."""
        if self._container is None or self._stream is None:
            # the offset of a first frame later than zero is in the timescale of the file, which would be milliseconds
            part = self._file.enter_context(atomic_path(self.path))
            flags = {"movflags": "faststart", "movie_timescale": str(TICKS_PER_S)}
            container = av.open(str(part), "w", format="mp4", options=flags)
            codec = "libx264rgb" if self._lossless else "libx264"
            stream = container.add_stream(codec, rate=self._rate, options=self._options)
            stream.height, stream.width = image.shape[:2]
            stream.pix_fmt = "rgb24" if self._lossless else "yuv420p"
            stream.time_base = stream.codec_context.time_base = Fraction(1, TICKS_PER_S)
            self._container, self._stream, self._size = container, stream, image.shape[:2]
        return self._stream, self._container

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: Any, error: BaseException | None, trace: Any) -> None:
        """Finishes the file and gives it its name; after an error removes it."""
        if self._container is None or self._stream is None:
            if error is None:
                raise InputError(f"{self.path}: there is not one frame to write")
            return
        try:
            if error is None:
                self._container.mux(self._stream.encode(None))
            self._container.close()
        except BaseException as failure:
            self._file.__exit__(type(failure), failure, failure.__traceback__)
            raise
        self._file.__exit__(kind, error, trace)


def _even(image: Image) -> Image:
    height, width = image.shape[:2]
    if height % 2 == 0 and width % 2 == 0:
        return np.ascontiguousarray(image)
    return np.pad(image, ((0, height % 2), (0, width % 2), *(((0, 0),) * (image.ndim - 2))), mode="edge")


def write_video(
    path: Path | str,
    frames: Iterable[Frame],
    fps: float,
    preset: str = "veryfast",
    threads: int = 0,
    *,
    lossless: bool = False,
    zero_ns: int | None = None,
) -> None:
    """Writes ``frames`` as an ``.mp4``.

    Args:
        path: the file.
        frames: the frames in the order of their stamps.
        fps: nominal rate, frames per second.
        preset: preset of x264; a faster one makes larger files.
        threads: number of threads, 0 for the default of x264.
        lossless: see `VideoWriter`.
        zero_ns: see `VideoWriter`.

    Raises:
        TimeError: the stamps do not rise.
        InputError: the sizes differ, or there are no frames.
    """
    with VideoWriter(path, fps, preset=preset, threads=threads, lossless=lossless, zero_ns=zero_ns) as video:
        for frame in frames:
            video.write(frame)
