"""What the live engine publishes: an estimate with its images, its age, the contact and the health of the run."""

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Literal

from ..clinical import ClinicalState
from ..types import MAX_AGE_S, FloatArray, ForceEstimate, Image, Status, frozen

CameraState = Literal["waiting", "running", "late", "frozen", "black", "wrong_size", "lost"]
CAMERA_STATES: tuple[CameraState, ...] = ("waiting", "running", "late", "frozen", "black", "wrong_size", "lost")
"""No image yet; images come; they are too old; the same one comes again and again; nothing is on them; their size
changed; the source ended, failed or is silent for seconds. Of several cameras the state is that of the worst."""


@dataclass(frozen=True, slots=True)
class SinkHealth:
    """How one sink does.

    ``failures`` counts what it raised; ``hung``: it has been busy with one update for seconds; ``ended``: it failed in
    a way that starting it again does not mend, such as a full disk.
    """

    taken: int = 0
    dropped: int = 0
    failures: int = 0
    hung: bool = False
    ended: bool = False
    message: str = ""


@dataclass(frozen=True, slots=True)
class LiveHealth:
    """How the run does.

    ``frames_per_s``: of the first view, as they arrive, over the last second. ``frames_in``: so many arrived.
    ``dropped``: so many gave way to a newer one before the estimator took them. ``latency_p50_s`` and
    ``latency_p99_s``: from mid-exposure to the estimate, over the last 10 s; NaN without any. ``reconnects``: so often
    the source was opened again. ``message``: one sentence where something is not as it should be, else empty.
    ``starting``: no image has been estimated yet.
    """

    frames_per_s: float = 0.0
    frames_in: int = 0
    dropped: int = 0
    latency_p50_s: float = math.nan
    latency_p99_s: float = math.nan
    camera: CameraState = "waiting"
    reconnects: int = 0
    message: str = ""
    starting: bool = False
    sinks: Mapping[str, SinkHealth] = field(default_factory=lambda: MappingProxyType({}))


@dataclass(frozen=True, slots=True, eq=False)
class Zero:
    """What the operator's zero button subtracts from every estimate since.

    ``offset_n`` (3,): force that was read then, base frame; components that the method left unknown are NaN, and
    nothing is subtracted from them.
    ``magnitude_n``: its magnitude. ``since_ns``: when, on the engine's clock; ``since_unix_s``: the same in seconds
    since 1970. ``by``: who pressed it, as the page says it. ``confirmed``: whether it was pressed although the tip may
    have been in contact. ``contact``: probability of contact that the method stated then, NaN from methods that state
    none. ``drift_n``: magnitude that is read now at moments without contact, NaN while there was none since; only a
    method that states the probability of contact knows such moments. ``drift_ns``: the last of them.
    """

    offset_n: FloatArray
    magnitude_n: float
    since_ns: int
    since_unix_s: float = math.nan
    by: str = ""
    confirmed: bool = False
    contact: float = math.nan
    drift_n: float = math.nan
    drift_ns: int | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "offset_n", frozen("offset_n", self.offset_n, (3,)))


@dataclass(frozen=True, slots=True, eq=False)
class LiveUpdate:
    """One output of the engine: of a frame, or a notice of the watchdog.

    ``number`` counts from 0 and never goes back. ``estimate``: invalid where the camera is late, lost, frozen or black.
    ``clinical``: the contact with it. ``frames``: view -> image that the estimate is of; empty for a notice. Its shape
    is ``estimate.shape``. ``captured_ns``: mid-exposure, of a notice that of the last image, or the earliest time at
    which it can have been where the driver states a bound; ``published_ns``: when the estimate was ready; both on the
    engine's clock. ``published_unix_ns``: the same in nanoseconds since 1970 by this machine's clock. ``max_age_s``:
    age of the image at which the estimate expires. ``zero``: what was subtracted, None before the button is pressed.
    ``integral_running``: whether the force-time integral of ``clinical`` counts; before its start it is 0, after its
    stop it stays. Read-only, and shared by all sinks.
    """

    number: int
    estimate: ForceEstimate
    clinical: ClinicalState | None
    frames: Mapping[str, Image]
    captured_ns: int
    published_ns: int
    health: LiveHealth
    zero: Zero | None = None
    integral_running: bool = False
    max_age_s: float = MAX_AGE_S
    published_unix_ns: int = field(default_factory=time.time_ns)

    @property
    def expires_ns(self) -> int:
        """When the estimate is no longer valid, on the engine's clock."""
        return self.captured_ns + round(self.max_age_s * 1e9)

    @property
    def captured_unix_ns(self) -> int:
        """``captured_ns`` in nanoseconds since 1970 by this machine's clock."""
        return self.published_unix_ns - (self.published_ns - self.captured_ns)

    def as_of(self, now_ns: int) -> "LiveUpdate":
        """What the update says at ``now_ns`` of the engine's clock: no force once it has expired."""
        if not self.estimate.valid or now_ns <= self.expires_ns:
            return self
        age_ms = (now_ns - self.captured_ns) * 1e-6
        estimate = ForceEstimate.invalid(
            self.estimate.stamp_ns, Status.STALE, f"the image is {age_ms:.0f} ms old", self.estimate.shape
        )
        return replace(self, estimate=estimate, clinical=None)

    @property
    def latency_s(self) -> float:
        """From mid-exposure to the output; of a notice, the age of the last image."""
        return (self.published_ns - self.captured_ns) * 1e-9
