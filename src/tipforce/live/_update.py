"""The updates of the live engine: an estimate with its images, its age, the contact and the health of the run."""

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
"""No image yet; images come; they are too old; the same image comes repeatedly; images are black; their size changed;
the source ended, failed or has sent nothing for seconds. Of several cameras the worst state is reported."""


@dataclass(frozen=True, slots=True)
class SinkHealth:
    """Health of one sink.

    Attributes:
        taken: number of updates that it took.
        dropped: number of updates that were dropped.
        failures: number of errors that it raised.
        hung: whether it has been busy with one update for seconds.
        ended: whether it failed in such a way that starting it again does not help, for example because a disk is full.
        message: reason of the last failure, or "".
    """

    taken: int = 0
    dropped: int = 0
    failures: int = 0
    hung: bool = False
    ended: bool = False
    message: str = ""


@dataclass(frozen=True, slots=True)
class LiveHealth:
    """Health of the run.

    Attributes:
        frames_per_s: rate at which frames of the first view arrived in the last second.
        frames_in: number of frames of the first view that arrived.
        dropped: number of frames that were replaced by a newer one before the estimator took them.
        latency_p50_s: median latency from mid-exposure to the estimate in the last 10 s; NaN without an estimate.
        latency_p99_s: 99th percentile of that latency.
        camera: state of the cameras.
        reconnects: number of times that the source was opened again.
        message: one sentence that states the fault, or "".
        starting: whether no image has been estimated yet.
        sinks: health of each sink.
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
    """The force that is subtracted from every estimate since the operator pressed the zero button.

    Attributes:
        offset_n: (3,) the subtracted force, base frame; components that the method did not estimate are NaN, and
            nothing is subtracted from them.
        magnitude_n: magnitude of the subtracted force.
        since_ns: time at which the button was pressed, on the engine's clock.
        since_unix_s: the same time in seconds since 1970.
        by: name of the page or person that pressed it.
        confirmed: whether it was pressed although the tip may have been in contact.
        contact: probability of contact that the method stated at that time; NaN if it states none.
        drift_n: magnitude of the estimates in moments without contact since then; NaN if there was no such moment. Only
            for methods that state the probability of contact.
        drift_ns: time of the last such moment, on the engine's clock.
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
    """One output of the engine: an estimate for a frame, or a notice of the watchdog. Read-only, shared by all sinks.

    Attributes:
        number: counts from 0 and never decreases.
        estimate: the estimate after the zero was subtracted, with the detected shape; invalid if the camera is late,
            lost, frozen or black.
        clinical: contact state after this estimate.
        frames: view -> image of the estimate; empty for a notice.
        captured_ns: mid-exposure on the engine's clock; the earliest possible time where the driver states a bound. Of
            a notice, that of the last image.
        published_ns: time at which the estimate was ready, on the engine's clock.
        health: health of the run.
        zero: the subtracted force; None before the button is pressed.
        integral_running: whether the force-time integral of ``clinical`` runs; before its start it is 0, after its stop
            it is constant.
        max_age_s: age of the image at which the estimate expires.
        beside: view -> newest image of each other view, to be shown; of about the same time.
        reads: names of the views that the method reads.
        published_unix_ns: ``published_ns`` in nanoseconds since 1970 by this machine's clock.
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
    beside: Mapping[str, Image] = field(default_factory=lambda: MappingProxyType({}))
    reads: tuple[str, ...] = ()

    @property
    def expires_ns(self) -> int:
        """Time from which the estimate is no longer valid, on the engine's clock."""
        return self.captured_ns + round(self.max_age_s * 1e9)

    @property
    def captured_unix_ns(self) -> int:
        """``captured_ns`` in nanoseconds since 1970 by this machine's clock."""
        return self.published_unix_ns - (self.published_ns - self.captured_ns)

    def as_of(self, now_ns: int) -> "LiveUpdate":
        """Returns the update as it is at ``now_ns`` on the engine's clock: without a force if it has expired."""
        if not self.estimate.valid or now_ns <= self.expires_ns:
            return self
        age_ms = (now_ns - self.captured_ns) * 1e-6
        estimate = ForceEstimate.invalid(
            self.estimate.stamp_ns, Status.STALE, f"the image is {age_ms:.0f} ms old", self.estimate.shape
        )
        return replace(self, estimate=estimate, clinical=None)

    @property
    def latency_s(self) -> float:
        """Time from mid-exposure to the output; of a notice, the age of the last image."""
        return (self.published_ns - self.captured_ns) * 1e-9
