"""Settings of the live engine: time limits, and the reactions to failures."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from ..clinical import ContactSettings
from ..types import MAX_AGE_S

_Seconds = Annotated[float, Field(gt=0, le=60)]


class LiveSettings(BaseModel):
    """Settings of the live engine."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    stale_s: Annotated[float, Field(gt=0, le=MAX_AGE_S)] = 0.2
    """An older image gives no valid force, unless ``stale_periods`` is longer; the hazard analysis requires this."""
    stale_periods: Annotated[float, Field(ge=1, le=10)] = 2.5
    """The same limit in periods of the camera, for slow cameras; at most `MAX_AGE_S`."""
    lost_s: _Seconds = 2.0
    """A camera that sends nothing for longer is lost, not late."""
    notice_s: _Seconds = 0.1
    """While there is no valid force, the watchdog publishes a notice at this interval."""
    actuation_age_s: _Seconds = 0.5
    """An older reading of a drive is ignored; a file may leave a drive without a reading for the same time."""
    black_level: Annotated[int, Field(ge=0, le=254)] = 20
    """An image is black if its 99th percentile is at most this: more than the noise and the black of video (16)."""
    reconnect_s: _Seconds = 0.5
    """First wait before a source or sink that failed is started again; it doubles each time."""
    reconnect_max_s: _Seconds = 10.0
    """Largest such wait."""
    max_reconnects: Annotated[int, Field(ge=0, le=1_000_000)] | None = None
    """A source that fails repeatedly is opened again at most this number of times in a row; None: without limit."""
    reopen_ended: bool = False
    """Whether the end of a source is a failure: true for a camera, not for a file."""
    queue: Annotated[int, Field(ge=1, le=10_000)] = 256
    """Largest number of updates that wait for a sink that keeps all: four seconds at 60 Hz."""
    hung_s: _Seconds = 2.0
    """A sink that is busy with one update for longer hangs; at the end nothing waits longer for it."""
    zero_s: _Seconds = 1.0
    """The zero button takes the mean of the estimates of this last time."""
    zero_max_n: Annotated[float, Field(gt=0, le=10)] = 0.1
    """The button rejects a larger force (lower end of the force window): it is a contact, not an error of the zero."""
    detect: bool = True
    """Whether the catheter is detected for page and recording if the method detects none."""
    contact: ContactSettings = ContactSettings()
    """Force window, limit and contact threshold."""
