"""Video files: true stamps in, H.264 that plays in a browser out."""

import warnings
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Self

import av
import av.error
import numpy as np
from av.container import InputContainer, OutputContainer

from .._atomic import atomic_path, check_output_file
from ..errors import FileFormatError, InputError, TimeError
from ..types import Frame, Image
from ._image_size import check_pixels, max_pixels

__all__ = ["VideoWriter", "read_video", "video_size", "write_video"]

_TICKS = 90_000
"""Ticks a second of the files we write: 11 microseconds, the clock of broadcast video."""


def _said(error: Exception) -> str:
    return str(error).split("] ", 1)[-1].split(":")[0].strip()


def _open(path: Path) -> InputContainer:
    if not path.exists():
        raise FileFormatError(f"{path}: there is no such file")
    if path.stat().st_size == 0:
        raise FileFormatError(f"{path}: the file is empty, not a video")
    try:
        container = av.open(str(path), metadata_errors="replace")
    except av.error.FFmpegError as error:
        if path.suffix.lower() in (".mp4", ".mov", ".m4v"):
            raise FileFormatError(
                f"{path}: cannot be opened as a video ({_said(error)}): an .mp4 whose recording was cut off has no "
                "index; record again, or repair it from an intact file of the same camera"
            ) from None
        raise FileFormatError(f"{path}: is no video that FFmpeg can read ({_said(error)})") from None
    if not container.streams.video:
        container.close()
        raise FileFormatError(f"{path}: holds no video stream")
    stream = container.streams.video[0]
    try:
        if not getattr(stream, "codec_context", None):
            raise FileFormatError(f"{path}: no decoder here knows its kind of video; convert it, for example to H.264")
        check_pixels(stream.width, stream.height, str(path))
    except FileFormatError:
        container.close()
        raise
    missing = _missing_bytes(path) if container.format.name.startswith("mov") else 0
    if missing:
        container.close()
        raise FileFormatError(f"{path}: is cut off: its last {missing} bytes are missing; {_REMEDY}")
    return container


def _missing_bytes(path: Path) -> int:
    """By how much the boxes that an .mp4 consists of reach beyond the end of the file."""
    size, at = path.stat().st_size, 0
    with path.open("rb") as stream:
        while at + 8 <= size:
            stream.seek(at)
            head = stream.read(16)
            length = int.from_bytes(head[:4], "big")
            if length == 1:  # the length stands behind the name, in 64 bits
                length = int.from_bytes(head[8:], "big")
            if length < 8:  # 0: the last box reaches to the end, however far that is
                return 0
            at += length
    return max(0, at - size)


def video_size(path: Path) -> int:
    """Frames that the file says it holds; 0 where it does not say."""
    with _open(path) as container:
        stream = container.streams.video[0]
        if stream.frames:
            return stream.frames
        rate = stream.average_rate
        seconds = (container.duration or 0) / 1_000_000
        return round(seconds * float(rate)) if rate else 0


def read_video(path: Path, view: str = "camera") -> Iterator[Frame]:
    """All frames with their own stamps, taken as mid-exposure, the right way up; grey where the file is, else RGB.

    Of a damaged frame, and of those up to the next key frame, which are made from it, only the number is told, as a
    warning. Raises FileFormatError for what is no video, breaks off or is mostly damaged, TimeError where stamps are
    missing, repeated or run backwards.
    """
    with _open(path) as container:
        stream = container.streams.video[0]
        stream.thread_type = "AUTO"
        # a frame within may claim another size than the file's header, which was checked
        stream.codec_context.options = {"max_pixels": str(max_pixels())}
        count, last, hurt, hurt_at_s, damaged = 0, None, 0, 0.0, False
        try:
            for decoded in _decoded(container, stream):
                if decoded is None:
                    count, hurt, damaged = count + 1, hurt + 1, True
                    hurt_at_s = hurt_at_s if hurt > 1 else (last or 0) * 1e-9
                    continue
                if decoded.pts is None or decoded.time_base is None:
                    raise TimeError(f"{path}: frame {count} has no time stamp; write the video with time stamps")
                stamp_ns = round(decoded.pts * decoded.time_base * 1_000_000_000)
                if last is not None and stamp_ns <= last:
                    what = "repeats the stamp of" if stamp_ns == last else "is stamped before"
                    raise TimeError(
                        f"{path}: frame {count} ({stamp_ns * 1e-9:.6f} s) {what} the frame before it "
                        f"({last * 1e-9:.6f} s); write the video with rising stamps, or as images with a stamps.csv"
                    )
                count, last = count + 1, stamp_ns
                damaged = decoded.is_corrupt or (damaged and not decoded.key_frame)
                if damaged:
                    hurt, hurt_at_s = hurt + 1, hurt_at_s if hurt else stamp_ns * 1e-9
                    continue
                yield Frame(stamp_ns, _upright(decoded), view)
        except av.error.FFmpegError as error:
            raise FileFormatError(f"{path}: cannot be read beyond frame {count} ({_said(error)}); {_REMEDY}") from None
        if count == 0:
            raise FileFormatError(f"{path}: not one frame can be read; the video is cut off or damaged")
        if stream.frames and count < 0.98 * stream.frames:
            raise FileFormatError(f"{path}: is cut off: {count} of {stream.frames} frames can be read; {_REMEDY}")
        if hurt > 0.5 * count:
            raise FileFormatError(f"{path}: is damaged: {count - hurt} of {count} frames are whole; copy it again")
        if hurt:
            warnings.warn(
                f"{path}: {hurt} damaged frames were left out, the first at {hurt_at_s:.3f} s; copy the file again if "
                "it has an intact original",
                stacklevel=2,
            )


def _decoded(container: InputContainer, stream: av.VideoStream) -> Iterator[av.VideoFrame | None]:
    """The decoded images, and None for a packet that cannot be decoded."""
    for packet in container.demux(stream):  # one by one: where an error shows hangs on the threads of the decoder
        try:
            found = packet.decode()
        except av.error.InvalidDataError:
            yield None
        else:
            yield from found


def _upright(decoded: av.VideoFrame) -> Image:
    """The pixels as a player shows them: cameras that are held upright note a turn instead of making it."""
    grey = decoded.format.name.startswith("gray")
    image = decoded.to_ndarray(format="gray" if grey else "rgb24")
    quarters = round(decoded.rotation / 90)  # counter-clockwise
    return np.ascontiguousarray(np.rot90(image, quarters) if quarters else image, dtype=np.uint8)


_REMEDY = "to use what is there, cut it out first: ffmpeg -i VIDEO -c copy WHOLE.mp4"


class VideoWriter:
    """An ``.mp4``, H.264 yuv420p, index in front; a context manager. The name appears when it closes without an error.

    ``fps``: the nominal rate; every frame is shown at its own stamp minus ``zero_ns`` (None: the first frame's stamp).
    ``crf``: quality, 0 to 51; ``preset``: x264's, a faster one makes larger files. The bytes depend on ``threads`` (0:
    as x264 likes). ``lossless``: every pixel comes back as it was, which needs RGB in place of yuv420p, and browsers do
    not show that. Sizes that are odd are widened by one pixel. Grey frames become RGB and stay neutral.
    """

    def __init__(
        self,
        path: Path | str,
        fps: float,
        *,
        crf: int = 20,
        preset: str = "veryfast",
        threads: int = 0,
        lossless: bool = False,
        zero_ns: int | None = None,
        overwrite: bool = True,
    ) -> None:
        self.path = Path(path)
        check_output_file(self.path)
        self._file = ExitStack()
        if self.path.exists() and not overwrite:
            raise FileFormatError(f"{self.path}: exists already; choose another name or state overwrite=True")
        if not 0.01 <= fps <= 10_000:
            raise InputError(f"{self.path}: {fps} frames a second is no rate for a video")
        self._rate = Fraction(fps).limit_denominator(1001)
        self._zero_ns = zero_ns
        self._lossless = lossless
        self._options = {"crf": "0" if lossless else str(crf), "preset": preset, "bf": "0"} | (
            {"threads": str(threads)} if threads else {}
        )
        self._container: OutputContainer | None = None
        self._stream: av.VideoStream | None = None
        self._last_ticks = -1
        self._size: tuple[int, int] | None = None

    def write(self, frame: Frame) -> None:
        """One frame. Raises TimeError where its stamp is not later than the last, InputError where its size changed."""
        image = _even(frame.image)
        if self._lossless and image.ndim == 2:
            image = np.ascontiguousarray(np.broadcast_to(image[..., None], (*image.shape, 3)))
        if self._zero_ns is None:
            self._zero_ns = frame.stamp_ns
        ticks = round((frame.stamp_ns - self._zero_ns) * _TICKS / 1_000_000_000)
        if ticks <= self._last_ticks:
            raise TimeError(f"{self.path}: the stamp {frame.stamp_ns} ns is not later than the one before it")
        stream, container = self._opened(image)
        if self._size != image.shape[:2]:
            raise InputError(f"{self.path}: a frame of {image.shape[:2]} pixels follows frames of {self._size}")
        raw = av.VideoFrame.from_ndarray(image, format="gray" if image.ndim == 2 else "rgb24")
        raw.pts, raw.time_base = ticks, Fraction(1, _TICKS)
        container.mux(stream.encode(raw))
        self._last_ticks = ticks

    def _opened(self, image: Image) -> tuple[av.VideoStream, OutputContainer]:
        if self._container is None or self._stream is None:
            # a first frame later than zero is told in the file's own timescale, which would be milliseconds
            part = self._file.enter_context(atomic_path(self.path))
            flags = {"movflags": "faststart", "movie_timescale": str(_TICKS)}
            container = av.open(str(part), "w", format="mp4", options=flags)
            codec = "libx264rgb" if self._lossless else "libx264"
            stream = container.add_stream(codec, rate=self._rate, options=self._options)
            stream.height, stream.width = image.shape[:2]
            stream.pix_fmt = "rgb24" if self._lossless else "yuv420p"
            stream.time_base = stream.codec_context.time_base = Fraction(1, _TICKS)
            self._container, self._stream, self._size = container, stream, image.shape[:2]
        return self._stream, self._container

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
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
    """All ``frames`` as an ``.mp4``: see `VideoWriter`."""
    with VideoWriter(path, fps, preset=preset, threads=threads, lossless=lossless, zero_ns=zero_ns) as video:
        for frame in frames:
            video.write(frame)
