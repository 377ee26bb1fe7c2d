"""What a control run is told: the target, the controller, the limits, and what is known of delays and rates."""

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
"""A limit that no force reaches: for baselines in simulation."""


class SafetySettings(_Settings):
    """What the layer between controller and drives holds to, whatever the controller wants."""

    limit_n: _Positive = LIMIT_N
    """The upper end of the force's interval stays below; above it the catheter is drawn back."""
    release_share: Annotated[float, Field(gt=0, lt=1)] = 0.9
    """The controller has the drives again once the upper end is below this share of the limit."""
    max_above_s: _Seconds = 1.0
    """Longer above the limit, although it is drawn back: all the way to the start."""
    max_advance_mm_per_s: _Positive = 30.0
    max_knob_deg_per_s: _Positive = 90.0
    reaction_s: _Seconds = 50e-3
    """From a command until the clamp moves back: delay and lag of the drives, and the time in which they brake."""
    noise_n: _Positive = 0.02
    """A change between two estimates that is smaller counts as noise, not as a rise of the force."""
    rise_memory_s: _Seconds = 2.0
    """While no estimate comes, the force may rise as fast as its fastest rise within this time."""
    least_rise_n_per_s: _Positive = 0.5
    """While no estimate comes, the force may rise at least so fast."""
    coast_s: _Seconds = 0.2
    """So long without any interval the controller goes on with what it knows; then the catheter is drawn back."""
    abstained_s: _Seconds = 1.0
    """The same where estimates abstain because their interval is too wide, with its upper end below the limit: how
    large the force can be is known then, and a retraction costs what was learnt of the wall."""
    least_stale_s: _Seconds = 0.2
    stale_frames: _Positive = 2.5
    """An estimate is stale after the longer of ``least_stale_s`` and so many frame periods since its mid-exposure,
    not counting the usual delay from mid-exposure to estimate; with that delay, never after more than
    `tipforce.types.MAX_AGE_S`."""


class ObserverSettings(_Settings):
    """Model of the wall: a constant, the breath, and harmonics of the heart's rate. Lengths in mm of the path."""

    harmonics: Annotated[int, Field(ge=1, le=6)] = 3
    heart_hz: tuple[_Positive, _Positive] = (0.8, 2.2)
    """Where the rate is looked for."""
    rates: Annotated[int, Field(ge=2, le=200)] = 29
    """Rates that are tried at once, evenly spaced, until the most likely one is chosen."""
    respiration_hz: _Positive = 0.25
    """As the ventilator is set."""
    gain_n_per_mm: _Positive = 0.06
    """Force for each mm of the path, as known beforehand; stiff tissue met at a right angle has 0.12."""
    gain_factor: Annotated[float, Field(gt=1, le=100)] = 2.0
    """Standard deviation of that knowledge, as a factor."""
    gain_range: tuple[_Positive, _Positive] = (0.008, 0.4)
    wall_mm: _Positive = 4.0
    """Standard deviation beforehand of the first harmonic's amplitude; those above fall as 1 / their number squared."""
    breath_mm: _Positive = 2.0
    wander_mm: _Positive = 0.5
    """The constant's random walk over a second; it is the integral action."""
    swing_mm: _Positive = 0.25
    """The same of each amplitude."""
    rate_wander_hz: _Positive = 0.01
    gain_wander: _Positive = 0.15
    noise_n: _Positive = 6e-3
    """Least standard deviation of an estimate about the model."""


class ControlSettings(_Settings):
    """How a target force is held."""

    target_n: Annotated[float, Field(gt=0, le=5)] = 0.2
    controller: ControllerName = "periodic"
    contact_n: _Positive = 2 * CONTACT_N
    """Above it the tip has met the tissue."""
    period_s: Annotated[float, Field(gt=0, le=0.1)] = 5e-3
    """Between two commands."""
    approach_mm_per_s: _Positive = 1.5
    retract_mm_per_s: _Positive = 20.0
    recoil_mm: Annotated[float, Field(ge=0, le=100)] = 3.0
    """So far the tip is drawn back at once, as fast as it may, where it first meets the tissue: a wall that comes
    toward it goes on while images and drives are late."""
    touch_n: _Positive = 0.08
    """Largest force of a beat that is aimed at while the wall's motion is learnt."""
    touch_mm_per_s: _Positive = 1.5
    """How fast the tip is brought nearer meanwhile; it is drawn back up to five times as fast."""
    learn_s: _Seconds = 4.0
    """Time in contact before a controller that rejects the heart's motion begins to follow the wall, at first as far
    as it is sure of it."""
    learn_at_most_s: _Seconds = 12.0
    """Then the hold begins, sure or not; where the tip may go is bounded by every wall that is still plausible."""
    settle_s: _Seconds = 12.0
    """Controller ``none``: the time in which the mean force is brought to the target, before the drives rest."""
    ramp_n_per_s: _Positive = 0.08
    """How fast the wanted force rises to the target; it falls five times as fast."""
    reserve: _Positive = 1.3
    """The wanted force is so low that so many times the last seconds' largest excess still stay below the limit; and no
    plausible wall may make more force than the limit over this."""
    drive_delay_s: _Seconds = 30e-3
    """From a command until the tip's clamp is there, delay and lag together: what is compensated."""
    loop_delay_s: _Positive = 0.12
    """From the wall's motion to the clamp's answer to it: what bounds the gains of ``pi`` and ``admittance``."""
    dither_n: Annotated[float, Field(ge=0, le=0.05)] = 4e-3
    """Size of the test motion from which the gain is identified, by the force that it makes."""
    restarts: Annotated[int, Field(ge=0, le=100)] = 3
    """How often a run that was drawn back begins its approach again by itself, after ``restart_valid_s`` of valid
    estimates."""
    restart_valid_s: _Seconds = 1.0
    safety: SafetySettings = SafetySettings()
    observer: ObserverSettings = ObserverSettings()

    @model_validator(mode="after")
    def _below_the_limit(self) -> Self:
        if self.target_n >= self.safety.limit_n:
            limit = self.safety.limit_n
            raise ValueError(f"expected target_n below safety.limit_n = {limit:g}, got {self.target_n:g}")
        return self
