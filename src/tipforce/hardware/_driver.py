"""Interface of all drivers: a typed config, declared streams, settings that are read back, and readings on request."""

import math
import time
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Literal, Self

from pydantic import BaseModel, ConfigDict, Field

from .._system.arrival_clock import ClockReport
from ..types import Clock, Event, Frame, Wrench

StreamKind = Literal["frame", "wrench", "actuation"]
Number = Annotated[float, Field(ge=-1e12, le=1e12)]
"""A number in the units of a device."""


class DeviceTable(BaseModel, frozen=True):
    """A table of ``bench.toml`` within ``[hardware]``; unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


class DeviceConfig(DeviceTable, frozen=True):
    """A table of ``bench.toml`` that describes a device.

    Attributes:
        driver: name of the driver in its table, as "net-ft".
    """

    driver: str = ""

    def located(self, folder: Path) -> Self:
        """Returns the config with its files relative to ``folder``, the folder of ``bench.toml``."""
        return self.model_copy(update={name: folder / value for name, value in self if isinstance(value, Path)})


class EndOfStream(Exception):
    """A device that can end, such as a video file, has ended."""


@dataclass(frozen=True, slots=True)
class DeclaredStream:
    """A stream that a device will give.

    Attributes:
        name: its name in a recording: a view, "force", "joints" or "stage".
        kind: kind of its events.
        rate_hz: requested rate, Hz; None where it is irregular.
        clock: one line on the meaning of its stamps.
    """

    name: str
    kind: StreamKind
    rate_hz: float | None
    clock: str


@dataclass(frozen=True, slots=True)
class Setting:
    """A setting of a device.

    Attributes:
        name: its name.
        requested: the value in ``bench.toml``; None if none was requested.
        actual: the value that the device has.
    """

    name: str
    requested: float | str | None
    actual: float | str

    @property
    def differs(self) -> bool:
        """Whether the device has another value than the requested one; numbers may differ by a thousandth.

        >>> Setting("fps", 60, 59.97).differs, Setting("fps", 60, 30.0).differs
        (False, True)
        """
        if self.requested is None:
            return False
        if isinstance(self.requested, str) or isinstance(self.actual, str):
            return str(self.requested) != str(self.actual)
        return not math.isclose(self.requested, self.actual, rel_tol=1e-3, abs_tol=1e-9)


class Driver(ABC):
    """One device. All calls come from one thread, but for ``counts``, ``clocks`` and methods that a driver adds.

    A driver of ``bench.toml`` is made as ``Driver(config, name)``, where ``config`` is an instance of its
    ``config_type``, and ``name`` that of its table: "force", "stage" or "knob", and the view of a camera.

    Attributes:
        name: its table in ``bench.toml``, as "force" or "cameras.a".
        counts: fault -> number of times, over all connections.
        remark: one sentence on a fault of a device that responds, or empty.
    """

    config_type: ClassVar[type[DeviceConfig]] = DeviceConfig
    """The type of its table in ``bench.toml``."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.counts: Counter[str] = Counter()
        self.remark = ""

    @property
    @abstractmethod
    def streams(self) -> tuple[DeclaredStream, ...]:
        """The streams that it will give."""

    @abstractmethod
    def connect(self, clock: Clock) -> tuple[Setting, ...]:
        """Opens the device, with stamps on ``clock``. Returns the settings of the device. Raises DeviceError."""

    @abstractmethod
    def read(self, timeout_s: float) -> Sequence[Event]:
        """Returns the readings that have come, or that come within ``timeout_s``, if any.

        Raises DeviceError where the device is lost and must be connected again, and EndOfStream.
        """

    @abstractmethod
    def close(self) -> None:
        """Releases the device, in any state."""

    def clocks(self) -> Mapping[str, ClockReport]:
        """Returns the report on the clock of each stream; the stamps of other streams are those of the arrival."""
        return {}


def stream_of(event: Event) -> str:
    """Returns the name of the stream of ``event``."""
    if isinstance(event, Frame):
        return event.view
    return "force" if isinstance(event, Wrench) else event.stream


def monotonic_to(clock: Clock) -> int:
    """Returns the nanoseconds of ``clock`` minus those of the monotonic clock of the system."""
    return clock.now_ns() - time.monotonic_ns()
