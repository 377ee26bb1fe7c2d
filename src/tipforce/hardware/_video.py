"""Driver of a video file in real time, or of a network stream (RTSP and other protocols of FFmpeg), as a camera."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, ValidationInfo, field_validator

from .._system.arrival_clock import ClockReport
from ..errors import DeviceError
from ..io import open_source
from ..types import Clock, Event, Frame
from ._driver import DeclaredStream, DeviceConfig, Driver, EndOfStream, Setting
from ._stream import NetworkStream, grey_image


class VideoConfig(DeviceConfig, frozen=True):
    """``[hardware.cameras.VIEW]`` with ``driver = "video"``.

    Attributes:
        source: a file, or an address as "rtsp://10.0.0.7/stream".
        grey: whether images are converted to grey.
        deinterlace: whether each image is made of its even rows alone, for a stream whose even and odd rows are taken
            at two instants (both fields of a file are read as images of their own).
        latency_ms: shortest time from mid-exposure to the arrival of an image of a stream, ms.
        options: options of FFmpeg, as { rtsp_transport = "udp" }.
    """

    driver: Literal["video"] = "video"
    source: str
    grey: bool = False
    deinterlace: bool = False
    latency_ms: Annotated[float, Field(ge=0.0, le=900.0)] = 0.0
    options: dict[str, str] = Field(default_factory=dict)

    @field_validator("deinterlace")
    @classmethod
    def _goes_with_a_stream(cls, deinterlace: bool, info: ValidationInfo) -> bool:
        if deinterlace and "://" not in info.data.get("source", "://"):
            raise ValueError("it is for streams; both fields of a video file are read as images anyway")
        return deinterlace

    @property
    def is_file(self) -> bool:
        """Whether the source is a file, which ends."""
        return "://" not in self.source

    def located(self, folder: Path) -> Self:
        """See `DeviceConfig`; an address is not changed."""
        return self.model_copy(update={"source": str(folder / self.source)}) if self.is_file else self


class Video(Driver):
    """Driver of a file or a stream.

    Args:
        config: settings of the device.
        view: name of its view.
    """

    config_type = VideoConfig

    def __init__(self, config: VideoConfig, view: str = "camera") -> None:
        super().__init__(f"cameras.{view}")
        self.config, self.view = config, view
        self._stream = NetworkStream(
            config.source, view, self._where, self.counts, grey=config.grey, deinterlace=config.deinterlace,
            latency_ns=round(config.latency_ms * 1e6), options=config.options,
        )  # fmt: skip
        self._frames: Iterator[tuple[int, Any]] = iter(())
        self._pending: tuple[int, Any] | None = None
        self._clock: Clock | None = None
        self._zero_ns = 0

    @property
    def streams(self) -> tuple[DeclaredStream, ...]:
        """The view."""
        clock = "the file's, from when the source began"
        if not self.config.is_file:
            late = f"minus latency_ms = {self.config.latency_ms:g}"
            clock = f"the stream's, brought to the host's by the least delay, or the arrival where it has none, {late}"
        return (DeclaredStream(self.view, "frame", None, clock),)

    def connect(self, clock: Clock) -> tuple[Setting, ...]:
        """Opens the file or stream."""
        self._clock, self._pending = clock, None
        if self.config.is_file:
            file = open_source(Path(self.config.source))
            frames = (event for event in file if isinstance(event, Frame))
            first = next(frames, None)
            if first is None:
                raise DeviceError(f"{self._where}: holds no image")
            self._zero_ns = clock.now_ns() - first.stamp_ns
            self._pending = first.stamp_ns, first.image
            self._frames = ((frame.stamp_ns, frame.image) for frame in frames)
            height, width = first.image.shape[:2]
            return (Setting("width", None, width), Setting("height", None, height))
        return self._stream.open(clock)

    def read(self, timeout_s: float) -> Sequence[Event]:
        """Returns the next image; that of a file at its time."""
        assert self._clock is not None
        if self.config.is_file:
            return self._played(timeout_s)
        frame = self._stream.read()
        return () if frame is None else (frame,)

    def _played(self, timeout_s: float) -> Sequence[Event]:
        """Returns the next image of a file when it is due; nothing if that is later than ``timeout_s`` from now."""
        assert self._clock is not None
        if self._pending is None:
            self._pending = next(self._frames, None)
        if self._pending is None:
            raise EndOfStream
        stamp, image = self._pending
        due_ns, end_ns = self._zero_ns + stamp, self._clock.now_ns() + round(timeout_s * 1e9)
        self._clock.sleep_until_ns(min(due_ns, end_ns))
        if due_ns > end_ns:
            return ()
        self._pending = None
        if self.config.grey and image.ndim == 3:
            image = grey_image(image)
        return (Frame(due_ns, image, self.view),)

    def close(self) -> None:
        """Closes the stream."""
        self._stream.close()

    def clocks(self) -> Mapping[str, ClockReport]:
        """Returns the report on the stamps of the stream, compared with the clock of the host."""
        report = self._stream.clock_report()
        return {} if self.config.is_file or report is None else {self.view: report}

    @property
    def _where(self) -> str:
        return f"hardware.{self.name}: {self.config.source}"
