"""How long a value counts, and what is done where something fails."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from ..clinical import ContactSettings
from ..types import MAX_AGE_S

_Seconds = Annotated[float, Field(gt=0, le=60)]


class LiveSettings(BaseModel):
    """Settings of the live engine."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    stale_s: Annotated[float, Field(gt=0, le=MAX_AGE_S)] = 0.2
    """An older image gives no valid force, unless ``stale_periods`` is longer: so the hazard analysis has it."""
    stale_periods: Annotated[float, Field(ge=1, le=10)] = 2.5
    """The same in periods of the camera, for slow ones; at most `MAX_AGE_S`."""
    lost_s: _Seconds = 2.0
    """A camera that sends nothing for so long is lost, not late."""
    notice_s: _Seconds = 0.1
    """While there is no valid force, the watchdog says so this often."""
    actuation_age_s: _Seconds = 0.5
    """An older reading of a drive is none: as long as files may leave a drive without one."""
    black_level: Annotated[int, Field(ge=0, le=254)] = 20
    """An image whose 99th percentile is no lighter is black: above the noise and the black of video (16)."""
    reconnect_s: _Seconds = 0.5
    """First wait before a source or sink that failed is started again; it doubles each time."""
    reconnect_max_s: _Seconds = 10.0
    """Longest such wait."""
    max_reconnects: Annotated[int, Field(ge=0, le=1_000_000)] | None = None
    """So often a source that failed is opened again in a row; None: for ever."""
    reopen_ended: bool = False
    """Whether a source that ends has failed: true of a camera, not of a file."""
    queue: Annotated[int, Field(ge=1, le=10_000)] = 256
    """Most updates that wait for a sink that keeps all: four seconds at 60 Hz."""
    hung_s: _Seconds = 2.0
    """A sink that is busy with one update for so long is told as hanging; at the end nobody waits longer for it."""
    zero_s: _Seconds = 1.0
    """The zero button takes the mean over so many last seconds."""
    zero_max_n: Annotated[float, Field(gt=0, le=10)] = 0.1
    """More than this (the lower end of the force window) is no zero error but a contact: the button refuses it."""
    detect: bool = True
    """Whether the catheter is detected for page and recording where the method detects none."""
    contact: ContactSettings = ContactSettings()
    """Force window, limit, and what counts as contact."""
