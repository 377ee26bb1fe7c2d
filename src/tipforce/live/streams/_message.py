"""The JSON message of one update; its schema is the contract with other programs."""

import math
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from ...clinical import ClinicalState, ContactClass, ContactState
from ...types import SessionInfo, Status
from ...units import newtons_to_grams
from .._update import CameraState, LiveUpdate, Zero
from ._tip import tip_pose

SCHEMA_VERSION = "tipforce.live/1"
"""The number increases if a field changes its meaning or is removed; new fields may be added without that."""


def _known(value: object) -> object:
    """Returns ``value``, or None for a number that JSON does not have."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


Known = Annotated[float | None, BeforeValidator(_known)]
"""A number; null if it is not known."""
Vector = tuple[Known, Known, Known]
Interval = tuple[Known, Known]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, from_attributes=True, json_schema_serialization_defaults_required=True)


class TipMessage(_Part):
    """Position and direction of the tip in the plane in which the catheter bends."""

    position_mm: tuple[float, float] = Field(description="x, y of the tip in the base frame")
    direction: tuple[float, float] = Field(description="unit vector along the tip, base frame")


class ContactMessage(_Part):
    """Contact state for an ablation. Times and integral count since the first image or the integral's start."""

    state: ContactState
    class_: ContactClass = Field(alias="class", description="of the last seconds")
    in_contact: Known = Field(description="probability")
    in_window: Known = Field(description="probability that the force is in the window")
    above_limit: Known = Field(description="probability that the force is above the limit")
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
    since_unix_s: Known = Field(description="when the button was pressed, seconds since 1970")
    by: str = Field(description="who pressed it")
    confirmed: bool = Field(description="pressed although the tip may have been in contact")


class HealthMessage(_Part):
    """Health of the run."""

    camera: CameraState
    frames_per_s: float
    frames_in: int
    dropped: int = Field(description="images that gave way to a newer one")
    latency_p50_s: Known
    latency_p99_s: Known
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
    magnitude_n: Known
    magnitude_interval_n: Interval = Field(description="90 % interval: low, high")
    magnitude_g: Known = Field(description="the same in grams-force")
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
    values: dict[str, Any] = {
        "number": update.number,
        "session": info.name,
        "model": model,
        "stamp_ns": estimate.stamp_ns,
        "captured_unix_s": update.captured_unix_ns * 1e-9,
        "expires_unix_s": update.captured_unix_ns * 1e-9 + update.max_age_s,
        "latency_s": update.latency_s,
        "status": estimate.status,
        "detail": estimate.detail,
        "force_n": estimate.force_n.tolist(),
        "interval_n": estimate.interval_n.tolist(),
        "magnitude_n": estimate.magnitude_n,
        "magnitude_interval_n": estimate.magnitude_interval_n.tolist(),
        "magnitude_g": newtons_to_grams(estimate.magnitude_n),
        "tip": tip_pose(update, info),
        "contact": None if update.clinical is None else _contact(update.clinical),
        "zero": None if update.zero is None else _zero(update.zero),
        "health": update.health,
    }
    return LiveMessage.model_validate(values)


def _contact(state: ClinicalState) -> dict[str, Any]:
    """Returns the values of a `ContactMessage`."""
    return {
        "state": state.contact,
        "class": state.contact_class,
        "in_contact": state.in_contact,
        "in_window": state.in_window,
        "above_limit": state.above_limit,
        "elapsed_s": state.elapsed_s,
        "window_s": state.window.seconds,
        "limit_s": state.limit.seconds,
        "unknown_s": state.unknown_s,
        "integral_n_s": state.integral_n_s,
        "integral_interval_n_s": state.integral_interval_n_s,
    }


def _zero(zero: Zero) -> dict[str, Any]:
    """Returns the values of a `ZeroMessage`."""
    return {
        "offset_n": zero.offset_n.tolist(),
        "magnitude_n": zero.magnitude_n,
        "since_unix_s": zero.since_unix_s,
        "by": zero.by,
        "confirmed": zero.confirmed,
    }
