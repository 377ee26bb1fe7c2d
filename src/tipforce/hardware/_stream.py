"""Reads a camera at an address of the network through FFmpeg: RTSP, motion JPEG and other protocols of FFmpeg."""

from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any

from .._system.arrival_clock import ArrivalClock, ClockReport
from ..errors import DeviceError, FileFormatError
from ..io import shown_image
from ..types import Clock, Frame, Image
from ._arrival import MAX_WAIT_NS, ArrivalWait, LatenessCheck
from ._driver import Setting
from ._fields import FieldCheck

TIMEOUT_S = 2.0
_NO_TIMESTAMPS = 0x80
"""FFmpeg's AVFMT_NOTIMESTAMPS: the format has no stamps, and FFmpeg counts 25 images a second for any camera."""
SETTLE_NS = 500_000_000
"""Images that come within this time after the first one may have waited for this connection."""


def size_of(image: Image) -> str:
    """Returns the size of an image as text.

    >>> import numpy as np
    >>> size_of(np.zeros((480, 640), np.uint8))
    '640x480'
    """
    return f"{image.shape[1]}x{image.shape[0]}"


def grey_image(image: Image) -> Image:
    """Returns an RGB image (h, w, 3) in grey (h, w)."""
    import cv2

    return cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)  # type: ignore[return-value]


class NetworkStream:
    """One connection to a camera. Its images are current, or their age is known: see `read`.

    Args:
        source: the address.
        view: view of the frames.
        where: the camera, for messages.
        counts: counter of faults by name, which is updated.
        grey: whether images are converted to grey.
        deinterlace: whether images are made of their even rows alone.
        latency_ns: shortest time from mid-exposure to the arrival of an image, ns.
        options: options of FFmpeg.
    """

    def __init__(
        self,
        source: str,
        view: str,
        where: str,
        counts: Counter[str],
        *,
        grey: bool,
        deinterlace: bool,
        latency_ns: int,
        options: Mapping[str, str],
    ) -> None:
        """Prepares the connection; `open` makes it. See the class for the arguments."""
        self._source, self._view, self._where, self._counts = source, view, where, counts
        self._grey, self._latency_ns, self._options = grey, latency_ns, dict(options)
        self._deinterlace = deinterlace
        self._container: Any = None
        self._clock: Clock | None = None
        self._frames: Iterator[tuple[int | None, Image]] = iter(())
        self._size = ""
        self._map, self._wait, self._late = ArrivalClock(), ArrivalWait(local=False), LatenessCheck()
        self._stamped = False

    def open(self, clock: Clock) -> tuple[Setting, ...]:
        """Connects, and skips images that may have waited for this connection.

        Returns codec, width and height. Raises DeviceError where it fails.
        """
        import av
        import av.error

        self._clock, self._size = clock, ""
        self._map, self._wait, self._late = ArrivalClock(1_000_000_000), ArrivalWait(local=False), LatenessCheck()
        options = {"fflags": "nobuffer", "flags": "low_delay"}
        if self._source.startswith("rtsp"):
            options["rtsp_transport"] = "tcp"
        try:
            self._container = av.open(self._source, options=options | self._options, timeout=(TIMEOUT_S, TIMEOUT_S))
        except (av.error.FFmpegError, OSError) as error:
            raise DeviceError(f"{self._where}: cannot be opened: {error}") from None
        streams = self._container.streams.video
        if not streams:
            raise DeviceError(f"{self._where}: holds no video")
        self._stamped = not self._container.format.flags & _NO_TIMESTAMPS
        self._frames = self._decoded(streams[0])
        context = streams[0].codec_context
        self.read()  # connects
        settled_ns = clock.now_ns() + SETTLE_NS
        while clock.now_ns() < settled_ns:
            self.read()
        return (
            Setting("codec", None, str(context.name)),
            Setting("width", None, context.width),
            Setting("height", None, context.height),
        )

    def _decoded(self, stream: Any) -> Iterator[tuple[int | None, Image]]:
        """Yields images as a player shows them, with the stamps of their stream, None where it has none."""
        import av.error

        fields = FieldCheck(self._view, self._where, deinterlace=self._deinterlace)
        try:
            for frame in self._container.decode(stream):
                if self._stamped and frame.pts is None:
                    self._counts["stampless"] += 1
                    continue
                image = shown_image(frame, stream, self._where, self._unknown_depth, fields.one_instant)
                if self._grey and image.ndim == 3:
                    image = grey_image(image)
                yield round(frame.pts * frame.time_base * 1_000_000_000) if self._stamped else None, image
        except (av.error.FFmpegError, OSError) as error:
            raise DeviceError(f"{self._where}: is lost: {error}") from None
        except FileFormatError as error:
            raise DeviceError(str(error)) from None

    def _unknown_depth(self) -> int:
        raise DeviceError(
            f"{self._where}: sends pixels of 16 bits and does not state how many of them are in use; set the camera to "
            "8 bits"
        )

    def read(self) -> Frame | None:
        """Returns the next image; None for one that is not current.

        An image of a stream with stamps has its own stamp, even if it arrives late. An image without one has the stamp
        of its arrival, with a bound on the time for which it waited before; it is discarded where that is more than 200
        ms.

        Raises:
            DeviceError: the stream is lost or has ended, or its images change their size or stay late by a second.
        """
        assert self._clock is not None
        asked_ns = self._clock.now_ns()
        following = next(self._frames, None)
        arrival_ns = self._clock.now_ns()
        if following is None:
            raise DeviceError(f"{self._where}: has ended")
        stamp, image = following
        self._refuse_other_size(image)
        if stamp is None:
            wait_ns = self._wait.wait_ns(asked_ns, arrival_ns)
        else:
            wait_ns = arrival_ns - self._map.host_ns(stamp, arrival_ns)
        self._late.check(self._where, wait_ns, arrival_ns)
        if stamp is not None:
            return Frame(arrival_ns - wait_ns - self._latency_ns, image, self._view)
        if wait_ns > MAX_WAIT_NS:
            self._counts["discarded, for they had waited in a buffer"] += 1
            return None
        return Frame(arrival_ns - self._latency_ns, image, self._view, wait_ns)

    def _refuse_other_size(self, image: Image) -> None:
        size = size_of(image)
        self._size = self._size or size
        if size != self._size:
            raise DeviceError(f"{self._where}: the size of its images changed from {self._size} to {size}")

    def close(self) -> None:
        """Ends the connection."""
        if self._container is not None:
            self._container.close()
            self._container = None

    def clock_report(self) -> ClockReport | None:
        """Returns the report on the stamps of the stream, compared with the clock of the host; None without stamps."""
        return self._map.report() if self._stamped else None
