"""Driver of cameras through OpenCV: V4L2, DirectShow, AVFoundation, or an address that OpenCV opens."""

import os
import sys
import time
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from .._system.arrival_clock import ClockReport
from ..errors import DeviceError
from ..types import Clock, Event, Frame, Image
from ._arrival import MAX_WAIT_NS, ArrivalWait, LatenessCheck
from ._driver import DeclaredStream, DeviceConfig, Driver, Number, Setting, monotonic_to
from ._fields import FieldCheck
from ._stream import NetworkStream, size_of

MAX_WAIT_MS = 2000
"""Longest wait for a camera to open or to give an image, on systems where OpenCV has this setting."""
MAX_STAMP_AHEAD_S, MAX_STAMP_AGE_S = 1e-3, 1.0
"""A stamp of the driver is on the monotonic clock if it is at most this much in its future or in its past."""
MIN_STAMPED_IMAGES = 5
"""Number of successive images with such a stamp after which the stamps of the driver are used."""
_UNUSABLE = -1
"""Count of valid stamps after an invalid one: the stamps are not used again before the camera is connected anew."""
DELAY_SHARE = 0.02
"""Weight of a new image in the mean delay: the mean is over the last 50 images."""
MIN_SLEEP_NS = 50_000_000
"""Smallest jump of the clock of the host against the monotonic one, which stops in Linux while the computer sleeps."""


class OpenCvCameraConfig(DeviceConfig, frozen=True):
    """``[hardware.cameras.VIEW]`` with ``driver = "opencv"``.

    Attributes:
        device: number, path as "/dev/video0", or address, which FFmpeg opens as with ``driver = "video"``. The camera
            at an address determines size and rate; the stated values are compared with them.
        width: requested width, px.
        height: requested height, px.
        fps: requested rate, Hz.
        fourcc: pixel format, as "MJPG".
        auto_exposure: number of the driver.
        exposure: number of the driver.
        gain: number of the driver.
        grey: whether images are converted to grey.
        deinterlace: whether each image is made of its even rows alone, for a camera whose even and odd rows are taken
            at two instants.
        latency_ms: time from mid-exposure to the arrival of the image, ms; it is subtracted from the arrival where the
            driver gives no stamps.
        stamp_latency_ms: time from mid-exposure to the stamp of the driver, ms (negative where it stamps the start of
            the exposure).
    """

    driver: Literal["opencv"] = "opencv"
    device: Annotated[int, Field(ge=0, le=1000)] | str
    width: Annotated[int, Field(gt=0, le=65_535)] | None = None
    height: Annotated[int, Field(gt=0, le=65_535)] | None = None
    fps: Annotated[float, Field(gt=0, le=10_000)] | None = None
    fourcc: Annotated[str, Field(min_length=4, max_length=4)] | None = None
    auto_exposure: Number | None = None
    exposure: Number | None = None
    gain: Number | None = None
    grey: bool = False
    deinterlace: bool = False
    latency_ms: Annotated[float, Field(ge=0.0, le=900.0)] = 0.0
    stamp_latency_ms: Annotated[float, Field(ge=-500.0, le=900.0)] = 0.0


def upright_image(image: Any, grey: bool, where: str) -> Image:
    """Converts an image of OpenCV.

    Args:
        image: grey or BGR, 8 bits.
        grey: whether colours are converted to grey.
        where: the camera, for the message.

    Returns:
        (h, w) grey or (h, w, 3) RGB.

    Raises:
        DeviceError: the image has another type.
    """
    import cv2

    if image.dtype != np.uint8 or image.ndim not in (2, 3):
        raise DeviceError(f"{where}: gives {image.dtype} {image.shape}; expected 8 bits, grey or colour; set fourcc")
    if image.ndim == 2 or image.shape[2] == 1:
        return np.ascontiguousarray(image.reshape(image.shape[:2]))
    return cv2.cvtColor(image, cv2.COLOR_BGR2GRAY if grey else cv2.COLOR_BGR2RGB)  # type: ignore[return-value]


class OpenCvCamera(Driver):
    """Driver of one camera.

    The queue of OpenCV holds old images. Therefore the thread of the driver reads each image as soon as it is there,
    and a slow reader gets the newest one (`HardwareSource`).

    Args:
        config: settings of the device.
        view: name of its view.
        open_capture: replaces ``cv2.VideoCapture``.
    """

    config_type = OpenCvCameraConfig

    def __init__(self, config: OpenCvCameraConfig, view: str = "camera", open_capture: Any = None) -> None:
        """Prepares the driver; `connect` opens the camera. An address is read through FFmpeg."""
        super().__init__(f"cameras.{view}")
        self.config, self.view = config, view
        self._open = open_capture
        self._capture: Any = None
        self._clock: Clock | None = None
        self._size = ""
        self._valid_stamps = 0
        """Number of successive images with a stamp on the monotonic clock, at most `MIN_STAMPED_IMAGES`; `_UNUSABLE`
        after an invalid one."""
        self._delay_s = 0.0
        """Mean age in seconds of the driver's stamps when an image is read."""
        self._wait, self._late = ArrivalWait(local=True), LatenessCheck()
        self._host_ahead_ns = 0
        """Time by which the clock of the host is ahead of the monotonic one."""
        self._awake_ns: int | None = None
        """Time of the last wake-up of the computer, on the clock of the host: images taken before it are older than
        their stamps show. None if it has not slept."""
        self._fields = FieldCheck(view, self._where, deinterlace=config.deinterlace)
        self._stream: NetworkStream | None = None
        if open_capture is None and isinstance(config.device, str) and "://" in config.device:
            self._stream = NetworkStream(
                config.device, view, self._where, self.counts, grey=config.grey, deinterlace=config.deinterlace,
                latency_ns=round(config.latency_ms * 1e6), options={},
            )  # fmt: skip

    @property
    def streams(self) -> tuple[DeclaredStream, ...]:
        """The view."""
        config = self.config
        clock = (
            f"the driver's (V4L2, monotonic) minus stamp_latency_ms = {config.stamp_latency_ms:g}, or where it gives "
            f"none the arrival minus latency_ms = {config.latency_ms:g}"
        )
        return (DeclaredStream(self.view, "frame", config.fps, clock),)

    def connect(self, clock: Clock) -> tuple[Setting, ...]:
        """Opens the camera, makes the requested settings, takes an image, and reads the settings back."""
        if self._stream is not None:
            return self._connect_stream(self._stream, clock)
        import cv2

        config = self.config
        self._capture = self._opened()
        if not self._capture.isOpened():
            raise DeviceError(f"{self._where}: cannot be opened; is it there, and does nobody else use it?")
        requested: list[tuple[str, int, float | None]] = [
            ("fourcc", cv2.CAP_PROP_FOURCC, None if config.fourcc is None else _code(config.fourcc)),
            ("width", cv2.CAP_PROP_FRAME_WIDTH, config.width),
            ("height", cv2.CAP_PROP_FRAME_HEIGHT, config.height),
            ("fps", cv2.CAP_PROP_FPS, config.fps),
            ("auto_exposure", cv2.CAP_PROP_AUTO_EXPOSURE, config.auto_exposure),
            ("exposure", cv2.CAP_PROP_EXPOSURE, config.exposure),
            ("gain", cv2.CAP_PROP_GAIN, config.gain),
        ]
        for _, number, value in requested:
            if value is not None:
                self._capture.set(number, value)
        self._capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        self._clock, self._valid_stamps = clock, 0
        self._fields = FieldCheck(self.view, self._where, deinterlace=config.deinterlace)
        self._wait, self._late = ArrivalWait(local=True), LatenessCheck()
        self._host_ahead_ns, self._awake_ns = monotonic_to(clock), None
        has_image, image = self._capture.read()
        if not has_image:
            raise DeviceError(f"{self._where}: gives no image")
        self._size = size_of(image)
        settings: list[Setting] = []
        for name, number, value in requested:
            actual = float(self._capture.get(number))
            if name == "fourcc":
                settings.append(Setting(name, config.fourcc, _letters(actual)))
            elif name in ("width", "height"):  # of the image; the driver may report other values
                settings.append(Setting(name, value, float(image.shape[1 if name == "width" else 0])))
            else:
                settings.append(Setting(name, value, actual))
        return tuple(settings)

    def _connect_stream(self, stream: NetworkStream, clock: Clock) -> tuple[Setting, ...]:
        """Opens an address; the requested settings are compared with those of the images."""
        requested = {"width": self.config.width, "height": self.config.height}
        return tuple(Setting(each.name, requested.get(each.name), each.actual) for each in stream.open(clock))

    def read(self, timeout_s: float) -> Sequence[Event]:
        """Returns the next image; waits as long as OpenCV does. An image that waited too long in a buffer is left out.

        Raises DeviceError where the camera gives none, or one of another size.
        """
        del timeout_s
        if self._stream is not None:
            frame = self._stream.read()
            return () if frame is None else (frame,)
        assert self._clock is not None
        asked_ns = self._clock.now_ns()
        has_image, image = self._capture.read()
        arrival_ns = self._clock.now_ns()
        if not has_image:
            raise DeviceError(f"{self._where}: gives no image any more")
        if size_of(image) != self._size:
            raise DeviceError(f"{self._where}: the size of its images changed from {self._size} to {size_of(image)}")
        wait_ns = self._wait.wait_ns(asked_ns, arrival_ns)
        taken_ns = self._taken_ns()
        self._late.check(self._where, wait_ns if taken_ns is None else arrival_ns - taken_ns, arrival_ns)
        # an image from before a sleep of the computer is older than its stamp shows
        slept = taken_ns is not None and self._awake_ns is not None and taken_ns < self._awake_ns
        if slept or (taken_ns is None and wait_ns > MAX_WAIT_NS):
            self.counts["discarded, for they had waited in a buffer"] += 1
            return ()
        upright = self._fields.one_instant(upright_image(image, self.config.grey, self._where))
        if taken_ns is None:
            return (Frame(arrival_ns - round(self.config.latency_ms * 1e6), upright, self.view, wait_ns),)
        return (Frame(taken_ns - round(self.config.stamp_latency_ms * 1e6), upright, self.view),)

    def _taken_ns(self) -> int | None:
        """Returns when the newest image was taken, in ns on the clock of the host; None without a valid stamp.

        V4L2 stamps an image with the monotonic time of its exposure. Updates the mean delay and the last wake-up.
        """
        import cv2

        assert self._clock is not None
        taken_s = 1e-3 * float(self._capture.get(cv2.CAP_PROP_POS_MSEC))
        age_s = time.monotonic() - taken_s
        if not self._trusts_stamps(age_s):
            return None
        self._delay_s += DELAY_SHARE * (age_s - self._delay_s)
        ahead_ns = monotonic_to(self._clock)
        if ahead_ns - self._host_ahead_ns > MIN_SLEEP_NS:
            self._awake_ns = self._clock.now_ns()
        self._host_ahead_ns = ahead_ns
        return round(taken_s * 1e9) + ahead_ns

    def _trusts_stamps(self, age_s: float) -> bool:
        """Takes the stamp of the next image; returns whether the driver's stamps are used.

        They are used after `MIN_STAMPED_IMAGES` successive images whose stamps are on the monotonic clock. After an
        invalid one they are not used until `connect`. Before that many images a stamp is also invalid if it is too old:
        it is on another clock. Later an old stamp is valid: its image has waited in a buffer.

        Args:
            age_s: age of the stamp on the monotonic clock, s; negative if it is in the future.
        """
        if self._valid_stamps == _UNUSABLE:
            return False
        if self._valid_stamps < MIN_STAMPED_IMAGES:
            on_this_clock = -MAX_STAMP_AHEAD_S <= age_s <= MAX_STAMP_AGE_S
            self._valid_stamps = self._valid_stamps + 1 if on_this_clock else _UNUSABLE
        elif age_s < -MAX_STAMP_AHEAD_S:
            self.counts["stampless"] += 1
            self._valid_stamps = _UNUSABLE
        return self._valid_stamps >= MIN_STAMPED_IMAGES

    def close(self) -> None:
        """Releases the camera."""
        if self._stream is not None:
            self._stream.close()
        if self._capture is not None:
            self._capture.release()
            self._capture = None

    def clocks(self) -> Mapping[str, ClockReport]:
        """Returns the report on the clock: that of the network stream, or the monotonic clock of the host."""
        report = None if self._stream is None else self._stream.clock_report()
        if report is not None:
            return {self.view: report}
        return {self.view: ClockReport(0.0, self._delay_s)} if self._valid_stamps >= MIN_STAMPED_IMAGES else {}

    @property
    def _where(self) -> str:
        return f"hardware.{self.name}: camera {self.config.device}"

    def _opened(self) -> Any:
        """Opens the camera with OpenCV; on Linux with V4L2, whose wait for an image is limited."""
        import cv2

        device = self.config.device
        if self._open is not None:
            return self._open(device)
        if sys.platform == "linux":
            os.environ.setdefault("OPENCV_VIDEOIO_V4L_SELECT_TIMEOUT", str(MAX_WAIT_MS // 1000))
            return cv2.VideoCapture(device, cv2.CAP_V4L2)
        return cv2.VideoCapture(device)


def _code(letters: str) -> float:
    return float(sum(ord(letter) << 8 * place for place, letter in enumerate(letters)))


def _letters(code: float) -> str:
    return "".join(chr(int(code) >> 8 * place & 0xFF) for place in range(4)).strip("\0")
