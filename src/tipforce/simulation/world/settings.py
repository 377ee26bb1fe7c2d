"""What a simulated bench is made of, part by part; the defaults are the preset ``bench-2021``."""

import operator
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from .._fields import NotNegative, Number, Positive, Range, Settings, Share, standard_uncertainty


class ShaftSettings(Settings):
    """The catheter in front of the sheath's mouth, where it is clamped."""

    name: str = "7F ablation catheter with 8 mm tip"
    diameter_m: Range = (2.33e-3, 2.33e-3)
    rigid_length_m: Positive = 8e-3
    flexible_length_m: Range = (39e-3, 41e-3)
    stiffness_nm2: Range = (4.3e-4 * 0.97, 4.3e-4 * 1.03)
    """EI of the nearly straight shaft, as it answers at once."""
    nominal_flexible_length_m: Positive | None = 40e-3
    nominal_stiffness_nm2: Positive | None = 4.3e-4
    """What the maker states. None: a measurement of the true one, see ``known_to``."""
    diameter_known_to: Share = Field(default=0.0, exclude_if=operator.not_)
    """The measured diameter is off by a uniform share within +- this."""
    known_to: Share = 0.0
    """Where there is no nominal value: the measured one is off by a uniform share within +- this."""
    stiffening_curvature_per_m: Positive = 40.0
    """EI grows as 1 + (curvature / this)^2."""
    proximal_stiffer: NotNegative = 0.05
    """EI is higher by this share over the third next to the sheath."""
    stiffness_knots: tuple[tuple[Share, Positive], ...] = Field(default=(), exclude_if=operator.not_)
    """What EI is multiplied with along the flexible part: (share of its length, factor), linear between; none: 1."""
    torsion_over_bending: Positive = 1.0
    """GJ / EI."""
    out_of_plane_per_m: Range = (-1.5, 1.5)
    """Curvature of the unloaded shaft out of the plane of its bending."""
    creep_share: Share = 0.03
    creep_s: Positive = 2.0
    """Under a steady moment the bend grows by this share of itself, with this time constant."""
    sessions_per_catheter: Annotated[int, Field(ge=1, le=1_000_000)] = 1
    """Consecutive sessions that share one draw of the catheter."""

    def uncertainties(self) -> tuple[float | None, float | None]:
        """Relative standard uncertainties of nominal length and stiffness, as a person states them; None: exact."""
        of_length = self._uncertainty(self.flexible_length_m, self.nominal_flexible_length_m)
        return of_length, self._uncertainty(self.stiffness_nm2, self.nominal_stiffness_nm2)

    def _uncertainty(self, drawn: Range, nominal: float | None) -> float | None:
        if nominal is None:
            return standard_uncertainty(self.known_to)
        return standard_uncertainty(*(value / nominal - 1.0 for value in drawn))


class ActuationSettings(Settings):
    """Knob to curvature."""

    knob_deg: Range = (10.0, 10.0)
    """Where the knob stands; where it moves, the range it moves in."""
    knob_deg_per_s: NotNegative = 0.0
    """Fastest movement of the knob during a session; 0: it stands still."""
    gain_per_m_deg: NotNegative = 0.533
    """Nominal map: curvature for each degree; 90 degrees are a full bend. 0: a device without a knob."""
    play_deg: NotNegative = 1.0
    """Width of the backlash."""
    factor: Range = (0.98, 1.02)
    """What the session's knob does, over what it should."""
    drift_rms: NotNegative = 0.01
    drift_s: Positive = 20.0
    """Slow relative drift of the curvature: its standard deviation and correlation time."""


class WallSettings(Settings):
    """The tissue."""

    contact_angle_deg: Range = (0.0, 75.0)
    """From the unloaded tip's axis to the direction into the wall, in the plane of bending. 0: the tip points at it."""
    either_side: bool = False
    """False: the wall stands on the side to which the knob bends; True: on either."""
    tilt_deg: Range = (-5.0, 5.0)
    """Out of the plane of bending."""
    stiffness_n_per_m: Range = (96.0, 144.0)
    loss_factor: NotNegative = 0.175
    loss_hz: Positive = 1.2
    friction: Range = (0.05, 0.3)
    log_stiffness: bool = Field(default=False, exclude_if=operator.not_)
    """Whether the stiffness's logarithm is uniform within its range, not the stiffness."""
    laws: tuple[Literal["linear", "hertz", "exponential"], ...] = Field(default=(), exclude_if=operator.not_)
    """One of these, each as likely: force with depth, depth^1.5, or exp(depth / ``law_depth_m``) - 1; none: linear."""
    law_depth_m: Positive = Field(default=2e-3, exclude_if=(2e-3).__eq__)
    """Where a law is not linear, the stiffness is its secant's at this depth."""
    stated_within: NotNegative | None = Field(default=None, exclude_if=lambda within: within is None)
    """Standard deviation of the stiffness that the session metadata state, as a share: somebody pressed on the tissue
    before. None: they do not state it."""
    loss_factors: Range | None = Field(default=None, exclude_if=operator.not_)
    """Drawn from here instead of ``loss_factor``, where it is stated."""
    faces: tuple[Literal["flat", "convex", "concave"], ...] = Field(default=(), exclude_if=operator.not_)
    """One of these, each as likely; none: flat."""
    face_radius_m: Range = Field(default=(15e-3, 60e-3), exclude_if=(15e-3, 60e-3).__eq__)
    """Of a convex or concave face."""
    side_stiffness_n_per_m2: NotNegative = Field(default=0.0, exclude_if=operator.not_)
    """Spring for each metre of the shaft's side that touches the tissue; 0: only the electrode's dome touches."""


class MotionSettings(Settings):
    """The stage that moves the wall, along its nominal normal and across. Amplitudes are half of peak to peak."""

    beat_hz: Range = (1.0, 1.5)
    half_wave_share: Share = 0.25
    """Share of the sessions that beat like the half-wave PQRST instead of a sine."""
    by_hand_share: Share = Field(default=0.0, exclude_if=operator.not_)
    """Share of the sessions in which a hand moves the stage: no beat and no breath, see `hand_wave`."""
    amplitude_m: Range = (0.5e-3, 10e-3)
    """Along the normal; solved for the peak force."""
    lateral_share: Range = (0.2, 1.0)
    """Lateral amplitude over that along the normal; its phase is drawn too."""
    respiration_m: Range = (0.0, 2e-3)
    respiration_hz: Positive = 0.25
    peak_force_n: Range = (0.15, 0.35)
    same_peak: Annotated[int, Field(ge=1, le=400)] = Field(default=1, exclude_if=(1).__eq__)
    """Draws in a row that share their peak force: what is hard to reach would else be rarer than it is drawn."""
    peak_within_n: NotNegative = Field(default=0.0, exclude_if=operator.not_)
    """How near the largest force comes to the drawn one; 0: as near as an amplitude to 10 um brings it, which takes
    longer."""
    free_share: Range = (0.05, 0.20)
    """Share of the time without contact, once the approach is over; solved by the stage's stand-off."""
    least_force_n: Range | None = Field(default=None, exclude_if=operator.not_)
    """Smallest force once the approach is over: the tip never leaves the wall, and the stage's stand-off is solved for
    this instead of ``free_share``. Both forces are solved to within ``peak_within_n``, which must then be stated."""
    step_m: Positive = 2.5e-6
    """One microstep."""
    max_speed_m_per_s: Positive = 0.20
    max_acceleration_m_per_s2: Positive = 10.0
    delay_s: NotNegative = 4e-3
    """From a command to its movement."""
    lag_s: NotNegative = Field(default=0.0, exclude_if=operator.not_)
    """Time constant with which the tissue follows the motor."""
    travel_m: Range = Field(default=(-0.1, 0.1), exclude_if=lambda travel: travel == (-0.1, 0.1))
    """Of both axes, from where the tissue just meets the tip."""

    @model_validator(mode="after")
    def _solved_within(self) -> Self:
        if self.least_force_n and not self.peak_within_n:
            raise ValueError("least_force_n needs peak_within_n: how near both forces shall come to those drawn, in N")
        return self


class ClampSettings(Settings):
    """The motor that advances the catheter's clamp along the base tangent; the free length stays."""

    step_m: Positive = 2.5e-6
    travel_m: Range = (-20e-3, 20e-3)
    """From where the clamp stands while nobody commands it."""
    home_m: Number = Field(default=0.0, exclude_if=operator.not_)
    """What its scale says there: ``advance_mm`` is 0 where the base lies as the session metadata have it."""
    max_speed_m_per_s: Positive = 0.05
    max_acceleration_m_per_s2: Positive = 1.0
    delay_s: NotNegative = 8e-3
    """From a command to its movement."""
    lag_s: NotNegative = 10e-3
    """Time constant with which the clamp follows the motor: belt, coupling and catheter give way."""
    logged: bool = False
    """Whether recordings hold ``advance_mm`` beside ``knob_deg``."""


class KnobDriveSettings(Settings):
    """The motor at the knob; it takes over from the hand that set it when it is first commanded."""

    step_deg: Positive = 0.1125
    """One of 3,200 microsteps a turn."""
    travel_deg: Range = (-90.0, 90.0)
    max_speed_deg_per_s: Positive = 90.0
    max_acceleration_deg_per_s2: Positive = 1800.0
    delay_s: NotNegative = 8e-3
    lag_s: NotNegative = 20e-3


class SensorSettings(Settings):
    """Six-axis force sensor under the tissue; it moves with the stage and reads tip-on-tissue in its own frame."""

    rate_hz: Positive = 1000.0
    moving_mass_kg: NotNegative = 0.05
    """Tissue and plate above the sensor: their inertia and weight are read too."""
    pose_error_deg: Range = (-1.0, 1.0)
    """Between the nominal and the true pose, about each axis."""
    noise_n: NotNegative = 3e-3
    step_n: tuple[Positive, Positive, Positive] = (5e-3, 5e-3, 10e-3)
    """Quantisation of x, y, z."""
    drift_n_per_min: Range = (-2e-3, 2e-3)
    bias_n: Range = (-0.2, 0.2)
    torque_noise_nm: NotNegative = 5e-5
    torque_step_nm: Positive = 2.5e-4


class ClockSettings(Settings):
    """Time at the bench: the camera's clock is the recording's."""

    fps: Annotated[float, Field(gt=0, le=240)] = 24.0
    jitter_s: NotNegative = 2e-3
    """Standard deviation of a frame's instant about its place in the row, cut at three of them."""
    dropped_share: Share = 0.005
    images_from_s: NotNegative = Field(default=0.0, exclude_if=operator.not_)
    """The camera is started so long after the recording: no image before."""
    camera_delay_s: NotNegative = Field(default=15e-3, exclude_if=lambda delay: delay == 15e-3)
    """From the end of an exposure until its image is there to be worked on; a live bench only."""
    force_delay_s: NotNegative = Field(default=3e-3, exclude_if=lambda delay: delay == 3e-3)
    drive_delay_s: NotNegative = Field(default=5e-3, exclude_if=lambda delay: delay == 5e-3)
    """The same of force readings, and of the readings of stage and knob."""
    force_offset_ms: Range = (-80.0, 80.0)
    """Camera time = time in the force log + this, at the log's start."""
    force_drift_ppm: Range = (-20.0, 20.0)


def _is_default(part: Settings) -> bool:
    return part == type(part)()


class WorldSettings(Settings):
    """A catheter held at its base presses on a wall that beats; a force sensor sits under the wall."""

    seconds: Annotated[float, Field(ge=8, le=3600)] = 60.0
    """Length of a session."""
    tare_s: NotNegative = 5.0
    """At the start: the stage moves out of the tip's reach."""
    sessions_per_bench: Annotated[int, Field(ge=1, le=1_000_000)] = Field(default=1, exclude_if=(1).__eq__)
    """Consecutive sessions that share one draw of the wall, of how the shaft leaves the plane, and of the camera with
    all that it shows. Motion, knob, force sensor and clocks remain each session's own."""
    shaft: ShaftSettings = ShaftSettings()
    actuation: ActuationSettings = ActuationSettings()
    wall: WallSettings = WallSettings()
    motion: MotionSettings = MotionSettings()
    clamp: ClampSettings = Field(default=ClampSettings(), exclude_if=_is_default)
    knob_drive: KnobDriveSettings = Field(default=KnobDriveSettings(), exclude_if=_is_default)
    sensor: SensorSettings = SensorSettings()
    clock: ClockSettings = ClockSettings()
