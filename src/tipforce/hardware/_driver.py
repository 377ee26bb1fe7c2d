"""What every driver is: a typed config, streams that it declares, settings read back, and readings when asked."""

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
        """Returns the config with its files relative to ``folder``, in which ``bench.toml`` is."""
        return self.model_copy(update={name: folder / value for name, value in self if isinstance(value, Path)})


class EndOfStream(Exception):
    """A device that can end, such as a video file, has ended."""


@dataclass(frozen=True, slots=True)
class DeclaredStream:
    """A stream that a device will give.

    ``name``: as in a recording: a view, "force", "joints" or "stage". ``rate_hz``: as asked for, None where it comes
    when it comes. ``clock``: one line on what its stamps are.
    """

    name: str
    kind: StreamKind
    rate_hz: float | None
    clock: str


@dataclass(frozen=True, slots=True)
class Setting:
    """A setting of a device: what was asked for (None: nothing), and what the device has."""

    name: str
    requested: float | str | None
    actual: float | str

    @property
    def differs(self) -> bool:
        """Whether the device has another value than was asked for; numbers may differ by a thousandth.

        >>> Setting("fps", 60, 59.97).differs, Setting("fps", 60, 30.0).differs
        (False, True)
        """
        if self.requested is None:
            return False
        if isinstance(self.requested, str) or isinstance(self.actual, str):
            return str(self.requested) != str(self.actual)
        return not math.isclose(self.requested, self.actual, rel_tol=1e-3, abs_tol=1e-9)


class Driver(ABC):
    """One device. All calls come from one thread, but for ``counts``, ``clocks`` and what a driver adds to them.

    A driver of ``bench.toml`` is made as ``Driver(config, name)``, where ``config`` is an instance of its
    ``config_type``, and ``name`` that of its table: "force", "stage" or "knob", and the view of a camera.

    ``name``: its table in ``bench.toml``, as "force" or "cameras.a". ``counts``: what went wrong how often, by name,
    over all connections. ``remark``: one sentence on what is wrong with a device that answers, or empty.
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
        """What it will give."""

    @abstractmethod
    def connect(self, clock: Clock) -> tuple[Setting, ...]:
        """Open the device; stamps are on ``clock``. Returns the settings as the device has them. Raises DeviceError."""

    @abstractmethod
    def read(self, timeout_s: float) -> Sequence[Event]:
        """Readings that have come, or that come within ``timeout_s``; may be none.

        Raises DeviceError where the device is lost, to be connected anew, and EndOfStream.
        """

    @abstractmethod
    def close(self) -> None:
        """Let go of the device, whatever state it is in."""

    def clocks(self) -> Mapping[str, ClockReport]:
        """How the clock of each stream lies; without an entry its stamps are those of the arrival."""
        return {}


def stream_of(event: Event) -> str:
    """The name of the stream that ``event`` belongs to."""
    if isinstance(event, Frame):
        return event.view
    return "force" if isinstance(event, Wrench) else event.stream


def monotonic_to(clock: Clock) -> int:
    """What to add to nanoseconds of the system's monotonic clock for those of ``clock``."""
    return clock.now_ns() - time.monotonic_ns()
