"""Settings of a control run: the target, the controller, the limits, and the known delays and rates."""

from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from ..clinical import CONTACT_N, LIMIT_N

ControllerName = Literal["none", "pi", "periodic", "admittance"]
CONTROLLERS: tuple[ControllerName, ...] = ("none", "pi", "periodic", "admittance")

_Positive = Annotated[float, Field(gt=0, le=1e6)]
_Seconds = Annotated[float, Field(ge=0, le=600)]


class _Settings(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


LIFTED_LIMIT_N = 1000.0
"""A limit that no force reaches, for baselines in simulation."""


class SafetySettings(_Settings):
    """Limits that the layer between controller and drives holds, for every command of the controller."""

    limit_n: _Positive = LIMIT_N
    """Limit of the force: where the upper end of its interval is above, the catheter is drawn back."""
    release_share: Annotated[float, Field(gt=0, lt=1)] = 0.9
    """The controller commands the drives again once the upper end is below this share of the limit."""
    max_above_s: _Seconds = 1.0
    """After this time above the limit, although it is drawn back, the catheter returns all the way to the start."""
    max_advance_mm_per_s: _Positive = 30.0
    max_knob_deg_per_s: _Positive = 90.0
    reaction_s: _Seconds = 50e-3
    """Time from a command until the clamp moves back: delay and lag of the drives, and the time to brake."""
    noise_n: _Positive = 0.02
    """A smaller change between two estimates counts as noise, not as a rise of the force."""
    rise_memory_s: _Seconds = 2.0
    """While no estimate comes, the force may rise as fast as its fastest rise within this time."""
    least_rise_n_per_s: _Positive = 0.5
    """While no estimate comes, the force may rise at least at this rate."""
    coast_s: _Seconds = 0.2
    """For this time without an interval the controller continues with its model; then the catheter is drawn back."""
    abstained_s: _Seconds = 1.0
    """The same time where estimates abstain because their interval is too wide, with its upper end below the limit: the
    largest possible force is known then, and a retraction would discard the learnt model of the wall."""
    least_stale_s: _Seconds = 0.2
    stale_frames: _Positive = 2.5
    """An estimate is stale after the longer of ``least_stale_s`` and this number of frame periods since its
    mid-exposure, not counting the usual delay from mid-exposure to estimate; with that delay, never after more than
    `tipforce.types.MAX_AGE_S`."""


class ObserverSettings(_Settings):
    """Model of the wall: a constant, the breath, and harmonics of the heart rate. Lengths are in mm of the path."""

    harmonics: Annotated[int, Field(ge=1, le=6)] = 3
    heart_hz: tuple[_Positive, _Positive] = (0.8, 2.2)
    """Range of the heart rate, in Hz."""
    rates: Annotated[int, Field(ge=2, le=200)] = 29
    """Number of rates that are tried at the same time, evenly spaced, until the most likely one is chosen."""
    respiration_hz: _Positive = 0.25
    """Rate that is set at the ventilator, in Hz."""
    gain_n_per_mm: _Positive = 0.06
    """Force for each mm of the path, as known beforehand; stiff tissue at a right angle has 0.12."""
    gain_factor: Annotated[float, Field(gt=1, le=100)] = 2.0
    """Standard deviation of ``gain_n_per_mm``, as a factor."""
    gain_range: tuple[_Positive, _Positive] = (0.008, 0.4)
    wall_mm: _Positive = 4.0
    """Standard deviation beforehand of the first harmonic's amplitude; that of harmonic n is divided by n squared."""
    breath_mm: _Positive = 2.0
    wander_mm: _Positive = 0.5
    """Random walk of the constant over a second, in mm; it is the integral action."""
    swing_mm: _Positive = 0.25
    """Random walk of each amplitude over a second, in mm."""
    rate_wander_hz: _Positive = 0.01
    gain_wander: _Positive = 0.15
    noise_n: _Positive = 6e-3
    """Smallest standard deviation of an estimate about the model."""


class ControlSettings(_Settings):
    """Target force, controller, and the way to hold the force."""

    target_n: Annotated[float, Field(gt=0, le=5)] = 0.2
    controller: ControllerName = "periodic"
    contact_n: _Positive = 2 * CONTACT_N
    """Force above which the tip has met the tissue."""
    period_s: Annotated[float, Field(gt=0, le=0.1)] = 5e-3
    """Time between two commands."""
    approach_mm_per_s: _Positive = 1.5
    retract_mm_per_s: _Positive = 20.0
    recoil_mm: Annotated[float, Field(ge=0, le=100)] = 3.0
    """Distance by which the tip is drawn back, immediately and at full speed, where it first meets the tissue: a wall
    that moves toward the tip moves on during the delay of images and drives."""
    touch_n: _Positive = 0.08
    """Wanted largest force of a beat while the motion of the wall is learnt."""
    touch_mm_per_s: _Positive = 1.5
    """Speed toward the wall meanwhile; the tip is drawn back up to five times as fast."""
    learn_s: _Seconds = 4.0
    """Time in contact before a controller that rejects the heart's motion begins to follow the wall, at first only the
    part of the motion that it knows with certainty."""
    learn_at_most_s: _Seconds = 12.0
    """The hold begins after this time in contact at the latest; every plausible wall limits the position of the tip."""
    settle_s: _Seconds = 12.0
    """Controller ``none``: the time in which the mean force is brought to the target, before the drives rest."""
    ramp_n_per_s: _Positive = 0.08
    """Rate at which the wanted force rises to the target; it falls five times as fast."""
    reserve: _Positive = 1.3
    """The largest excess of the force in the last seconds, times this factor, must fit between the wanted force and the
    limit; and no plausible wall may make more force than the limit divided by this factor."""
    drive_delay_s: _Seconds = 30e-3
    """Time from a command until the clamp is at its position, delay and lag together; the controller compensates it."""
    loop_delay_s: _Positive = 0.12
    """Time from the motion of the wall to the response of the clamp; it limits ``pi`` and ``admittance``."""
    dither_n: Annotated[float, Field(ge=0, le=0.05)] = 4e-3
    """Amplitude of the force of the test motion from which the gain is identified."""
    restarts: Annotated[int, Field(ge=0, le=100)] = 3
    """Number of times that a run that was drawn back begins its approach again by itself, after ``restart_valid_s`` of
    valid estimates."""
    restart_valid_s: _Seconds = 1.0
    safety: SafetySettings = SafetySettings()
    observer: ObserverSettings = ObserverSettings()

    @model_validator(mode="after")
    def _below_the_limit(self) -> Self:
        if self.target_n >= self.safety.limit_n:
            limit = self.safety.limit_n
            raise ValueError(f"expected target_n below safety.limit_n = {limit:g}, got {self.target_n:g}")
        return self
