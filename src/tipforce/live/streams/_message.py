"""The JSON message of one update; its schema is the contract with other programs."""

import math
from collections.abc import Sequence
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from ...clinical import ClinicalState, ContactClass, ContactState
from ...types import SessionInfo, Status
from ...units import newtons_to_grams
from .._update import CameraState, LiveHealth, LiveUpdate, Zero
from ._tip import TipPose, tip_pose

SCHEMA_VERSION = "tipforce.live/1"
"""The number increases if a field changes its meaning or is removed; new fields may be added without that."""

Vector = tuple[float | None, float | None, float | None]
Interval = tuple[float | None, float | None]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, json_schema_serialization_defaults_required=True)


class TipMessage(_Part):
    """Position and direction of the tip in the plane in which the catheter bends."""

    position_mm: tuple[float, float] = Field(description="x, y of the tip in the base frame")
    direction: tuple[float, float] = Field(description="unit vector along the tip, base frame")


class ContactMessage(_Part):
    """Contact state for an ablation. Times and integral count since the first image or the integral's start."""

    state: ContactState
    class_: ContactClass = Field(alias="class", description="of the last seconds")
    in_contact: float | None = Field(description="probability")
    in_window: float | None = Field(description="probability that the force is in the window")
    above_limit: float | None = Field(description="probability that the force is above the limit")
    elapsed_s: float
    window_s: float = Field(description="time with the force in the window")
    limit_s: float = Field(description="time above the limit")
    unknown_s: float = Field(description="time without a valid estimate; it counts as nothing else")
    integral_n_s: float = Field(description="force-time integral over the known time")
    integral_interval_n_s: Interval


class ZeroMessage(_Part):
    """The force that the zero button subtracts; the intervals span the force with and without it."""

    offset_n: Vector = Field(description="subtracted force, base frame: x, y, z")
    magnitude_n: float = Field(description="magnitude of the subtracted force")
    since_unix_s: float | None = Field(description="when the button was pressed, seconds since 1970")
    by: str = Field(description="who pressed it")
    confirmed: bool = Field(description="pressed although the tip may have been in contact")


class HealthMessage(_Part):
    """Health of the run."""

    camera: CameraState
    frames_per_s: float
    frames_in: int
    dropped: int = Field(description="images that gave way to a newer one")
    latency_p50_s: float | None
    latency_p99_s: float | None
    reconnects: int
    message: str


class LiveMessage(_Part):
    """One estimate. null: unknown; where "status" is not "valid", all numbers of the force are null."""

    schema_: Literal["tipforce.live/1"] = Field(default=SCHEMA_VERSION, alias="schema")
    number: int = Field(description="of this output; counts from 0 and never goes back")
    session: str
    model: str
    stamp_ns: int = Field(description="mid-exposure, on the camera's own clock")
    captured_unix_s: float = Field(description="mid-exposure, seconds since 1970 by the sender's clock")
    expires_unix_s: float = Field(
        description="after this time the force is not valid any more, seconds since 1970 by the sender's clock"
    )
    latency_s: float = Field(description="from mid-exposure to the estimate; without a new image, the last one's age")
    status: Status
    detail: str = Field(description="why there is no force, or empty")
    force_n: Vector = Field(description="of the tissue on the tip, base frame: x, y, z")
    interval_n: tuple[Interval, Interval, Interval] = Field(description="90 % intervals of x, y, z: low, high")
    magnitude_n: float | None
    magnitude_interval_n: Interval = Field(description="90 % interval: low, high")
    magnitude_g: float | None = Field(description="the same in grams-force")
    tip: TipMessage | None = Field(description="null where the tip is not detected or the scale is not stated")
    contact: ContactMessage | None
    zero: ZeroMessage | None = Field(description="null where nothing is subtracted")
    health: HealthMessage


def message_of(update: LiveUpdate, info: SessionInfo, model: str) -> LiveMessage:
    """Returns ``update`` as a message.

    Args:
        update: the update.
        info: session metadata.
        model: name of the model.
    """
    estimate = update.estimate
    low, high = (_known(end) for end in estimate.magnitude_interval_n.tolist())
    x, y, z = ((_known(least), _known(most)) for least, most in estimate.interval_n.tolist())
    pose = tip_pose(update, info)
    return LiveMessage(
        number=update.number,
        session=info.name,
        model=model,
        stamp_ns=estimate.stamp_ns,
        captured_unix_s=update.captured_unix_ns * 1e-9,
        expires_unix_s=update.captured_unix_ns * 1e-9 + update.max_age_s,
        latency_s=update.latency_s,
        status=estimate.status,
        detail=estimate.detail,
        force_n=_vector(estimate.force_n.tolist()),
        interval_n=(x, y, z),
        magnitude_n=_known(estimate.magnitude_n),
        magnitude_interval_n=(low, high),
        magnitude_g=_known(newtons_to_grams(estimate.magnitude_n)),
        tip=None if pose is None else _tip(pose),
        contact=None if update.clinical is None else _contact(update.clinical),
        zero=None if update.zero is None else _zero(update.zero),
        health=_health(update.health),
    )


def _known(value: float) -> float | None:
    """Returns ``value``, or None if JSON has no such number."""
    return value if math.isfinite(value) else None


def _vector(values: Sequence[float]) -> Vector:
    x, y, z = values
    return _known(x), _known(y), _known(z)


def _tip(pose: TipPose) -> TipMessage:
    (x, y), (along, across) = pose.position_mm, pose.direction
    return TipMessage(position_mm=(x, y), direction=(along, across))


def _contact(state: ClinicalState) -> ContactMessage:
    low, high = state.integral_interval_n_s
    values: dict[str, Any] = {
        "state": state.contact,
        "class": state.contact_class,
        "in_contact": _known(state.in_contact),
        "in_window": _known(state.in_window),
        "above_limit": _known(state.above_limit),
        "elapsed_s": state.elapsed_s,
        "window_s": state.window.seconds,
        "limit_s": state.limit.seconds,
        "unknown_s": state.unknown_s,
        "integral_n_s": state.integral_n_s,
        "integral_interval_n_s": (_known(low), _known(high)),
    }
    return ContactMessage(**values)


def _zero(zero: Zero) -> ZeroMessage:
    return ZeroMessage(
        offset_n=_vector(zero.offset_n.tolist()),
        magnitude_n=zero.magnitude_n,
        since_unix_s=_known(zero.since_unix_s),
        by=zero.by,
        confirmed=zero.confirmed,
    )


def _health(health: LiveHealth) -> HealthMessage:
    return HealthMessage(
        camera=health.camera,
        frames_per_s=health.frames_per_s,
        frames_in=health.frames_in,
        dropped=health.dropped,
        latency_p50_s=_known(health.latency_p50_s),
        latency_p99_s=_known(health.latency_p99_s),
        reconnects=health.reconnects,
        message=health.message,
    )
