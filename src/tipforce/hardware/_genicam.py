"""GenICam cameras (GigE Vision, USB3 Vision) through harvesters and the GenTL producer of the camera's maker."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from .._system.arrival_clock import ArrivalClock, ClockReport
from .._system.extras import import_extra
from ..errors import DeviceError
from ..types import Clock, Event, Frame, Image
from ._arrival import MAX_WAIT_NS, ArrivalWait, LatenessCheck
from ._driver import DeclaredStream, DeviceConfig, Driver, Number, Setting
from ._stream import size_of

MAX_SILENCE_S = 2.0
MAX_STEP_NS = 1_000_000_000
_BAYER = {"BayerRG8": "BayerRGGB", "BayerGB8": "BayerGBRG", "BayerGR8": "BayerGRBG", "BayerBG8": "BayerBGGR"}
"""Name by the colours of the first two rows -> name of OpenCV."""


class GenICamCameraConfig(DeviceConfig, frozen=True):
    """``[hardware.cameras.VIEW]`` with ``driver = "genicam"``.

    Attributes:
        producer: GenTL producer (.cti) of the camera's maker.
        serial_number: serial number of the camera; None for the first one.
        fps: requested rate, Hz.
        nodes: features to set, by their GenICam names, as { ExposureTime = 4000.0 }; they are read back.
        grey: whether images are converted to grey.
        latency_ms: shortest time from mid-exposure to the arrival of an image, ms.
    """

    driver: Literal["genicam"] = "genicam"
    producer: Path
    serial_number: str | None = None
    fps: Annotated[float, Field(gt=0, le=10_000)] | None = None
    nodes: dict[str, Number | str | bool] = Field(default_factory=dict)
    grey: bool = False
    latency_ms: Annotated[float, Field(ge=0.0, le=900.0)] = 0.0


class GenICamCamera(Driver):
    """Driver of one camera.

    Args:
        config: settings of the device.
        view: name of its view.
    """

    config_type = GenICamCameraConfig

    def __init__(self, config: GenICamCameraConfig, view: str = "camera") -> None:
        super().__init__(f"cameras.{view}")
        self.config, self.view = config, view
        self._harvester: Any = None
        self._acquirer: Any = None
        self._clock: Clock | None = None
        self._map, self._wait, self._late = ArrivalClock(), ArrivalWait(local=True), LatenessCheck()
        self._size = ""
        self._stamped = True
        self._heard_ns = self._asked_ns = 0

    @property
    def streams(self) -> tuple[DeclaredStream, ...]:
        """The view."""
        clock = (
            f"the camera's, brought to the host's by the least delay, minus latency_ms = {self.config.latency_ms:g}; "
            "the arrival where it gives no stamps"
        )
        return (DeclaredStream(self.view, "frame", self.config.fps, clock),)

    def connect(self, clock: Clock) -> tuple[Setting, ...]:
        """Finds the camera, sets and reads back its features, and starts it."""
        harvesters = import_extra("harvesters.core", "hardware")
        config = self.config
        if not config.producer.is_file():
            raise DeviceError(f"{self._where}: there is no GenTL producer {config.producer}")
        self._clock, self._stamped, self._size = clock, True, ""
        self._map, self._wait, self._late = ArrivalClock(MAX_STEP_NS), ArrivalWait(local=True), LatenessCheck()
        self._heard_ns, self._asked_ns = clock.now_ns(), 0
        try:
            self._harvester = harvesters.Harvester()
            self._harvester.add_file(str(config.producer))
            self._harvester.update()
            numbers = [info.serial_number for info in self._harvester.device_info_list]
            if config.serial_number is not None and config.serial_number not in numbers:
                raise DeviceError(f"{self._where}: is not there; there are {', '.join(map(str, numbers)) or 'none'}")
            if not numbers:
                raise DeviceError(f"{self._where}: the producer finds no camera")
            device = 0 if config.serial_number is None else {"serial_number": config.serial_number}
            self._acquirer = self._harvester.create(device)
            settings = self._set_nodes(self._acquirer.remote_device.node_map)
            self._acquirer.start()
        except DeviceError:
            raise
        except Exception as error:  # each producer raises its own kinds of errors
            raise DeviceError(f"{self._where}: {error}") from None
        return settings

    def _set_nodes(self, nodes: Any) -> tuple[Setting, ...]:
        """Sets the requested features of the camera; returns requested and actual values, also of size and format."""
        requested = dict(self.config.nodes)
        if self.config.fps is not None:
            requested.setdefault("AcquisitionFrameRate", self.config.fps)
        settings: list[Setting] = []
        for name, value in requested.items():
            node = getattr(nodes, name, None)
            if node is None:
                raise DeviceError(f"{self._where}: has no feature {name}; see nodes")
            node.value = value
            settings.append(Setting(name, _plain(value), _plain(node.value)))
        for name in ("Width", "Height", "PixelFormat"):
            node = getattr(nodes, name, None)
            if node is not None and name not in requested:
                settings.append(Setting(name, None, _plain(node.value)))
        return tuple(settings)

    def read(self, timeout_s: float) -> Sequence[Event]:
        """Returns the next complete image, copied from the buffer of the producer.

        Raises DeviceError where the camera is lost, or its images change their size or stay late by a second.
        """
        assert self._clock is not None
        self._asked_ns = self._asked_ns or self._clock.now_ns()
        try:
            buffer = self._acquirer.try_fetch(timeout=timeout_s)
            arrival = self._clock.now_ns()
            if buffer is None:
                if arrival - self._heard_ns > MAX_SILENCE_S * 1e9:
                    raise DeviceError(f"{self._where}: has given no image for {MAX_SILENCE_S:g} s")
                return ()
            self._heard_ns = arrival
            with buffer:
                if not buffer.payload.components:
                    self.counts["incomplete"] += 1
                    return ()
                component = buffer.payload.components[0]
                width, height = int(component.width), int(component.height)
                image = self._image(component.data, width, height, str(component.data_format))
                device_ns = self._device_ns(buffer)
        except DeviceError:
            raise
        except Exception as error:  # each producer raises its own kinds of errors
            raise DeviceError(f"{self._where}: is lost: {error}") from None
        self._size = self._size or size_of(image)
        if size_of(image) != self._size:
            raise DeviceError(f"{self._where}: the size of its images changed from {self._size} to {size_of(image)}")
        latency_ns = round(self.config.latency_ms * 1e6)
        wait_ns, self._asked_ns = self._wait.wait_ns(self._asked_ns, arrival), 0
        if device_ns is not None:  # the stamp of the camera states the wait more precisely
            wait_ns = arrival - self._map.host_ns(device_ns, arrival)
        self._late.check(self._where, wait_ns, arrival)
        if device_ns is not None:
            return (Frame(arrival - wait_ns - latency_ns, image, self.view),)
        if wait_ns > MAX_WAIT_NS:
            self.counts["discarded, for they had waited in a buffer"] += 1
            return ()
        return (Frame(arrival - latency_ns, image, self.view, wait_ns),)

    def _device_ns(self, buffer: Any) -> int | None:
        """Returns the stamp of the camera; None where it gives none."""
        if self._stamped:
            try:
                return int(buffer.timestamp_ns)
            except Exception:  # the producer's own kind of "not available"
                self._stamped = False
                self.remark = f"{self._where}: gives no stamps; those of the arrival are taken"
        return None

    def _image(self, data: Any, width: int, height: int, form: str) -> Image:
        """Copies an image of 8 bits out of the producer's buffer, as grey (h, w) or RGB (h, w, 3).

        Args:
            data: (h w channels,) pixels, uint8.
            width: width w, px.
            height: height h, px.
            form: pixel format by its GenICam name, as "BayerRG8".
        """
        import cv2

        if data.dtype != np.uint8:
            raise DeviceError(f"{self._where}: gives {form}; set PixelFormat to one of 8 bits in nodes")
        if form == "Mono8":
            return data.reshape(height, width).copy()
        target = "GRAY" if self.config.grey else "RGB"
        if form in _BAYER:
            return cv2.cvtColor(data.reshape(height, width), getattr(cv2, f"COLOR_{_BAYER[form]}2{target}"))
        channels = {"RGB8": 3, "BGR8": 3, "RGBa8": 4, "BGRa8": 4}.get(form)
        if channels is None:
            raise DeviceError(
                f"{self._where}: gives {form}; expected Mono8, RGB8, BGR8, RGBa8, BGRa8 or an 8-bit Bayer"
            )
        image = data.reshape(height, width, channels)
        order = ("RGB" if form.startswith("RGB") else "BGR") + ("A" if channels == 4 else "")
        return image.copy() if order == target else cv2.cvtColor(image, getattr(cv2, f"COLOR_{order}2{target}"))

    def close(self) -> None:
        """Stops the camera and releases the producer."""
        acquirer, self._acquirer = self._acquirer, None
        harvester, self._harvester = self._harvester, None
        try:
            if acquirer is not None:
                acquirer.stop()
                acquirer.destroy()
            if harvester is not None:
                harvester.reset()
        except Exception as error:  # a camera that was pulled out cannot be stopped
            self.remark = f"{self._where}: {error}"

    def clocks(self) -> Mapping[str, ClockReport]:
        """Returns the report on the clock of the camera, compared with the clock of the host."""
        return {self.view: self._map.report()} if self._stamped else {}

    @property
    def _where(self) -> str:
        return f"hardware.{self.name}: GenICam camera {self.config.serial_number or ''}".rstrip()


def _plain(value: object) -> float | str:
    return float(value) if isinstance(value, int | float) else str(value)
