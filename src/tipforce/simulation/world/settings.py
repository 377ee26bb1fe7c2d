"""Settings of the parts of a simulated bench; the defaults are the preset ``bench-2021``."""

import operator
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from .._fields import NotNegative, Number, Positive, Range, Settings, Share, standard_uncertainty


class ShaftSettings(Settings):
    """The catheter beyond the mouth of the sheath, where it is clamped."""

    name: str = "7F ablation catheter with 8 mm tip"
    diameter_m: Range = (2.33e-3, 2.33e-3)
    rigid_length_m: Positive = 8e-3
    flexible_length_m: Range = (39e-3, 41e-3)
    stiffness_nm2: Range = (4.3e-4 * 0.97, 4.3e-4 * 1.03)
    """Instantaneous EI of the nearly straight shaft, without creep."""
    nominal_flexible_length_m: Positive | None = 40e-3
    nominal_stiffness_nm2: Positive | None = 4.3e-4
    """Nominal values of the manufacturer. None: the true value is measured, see ``known_to``."""
    diameter_known_to: Share = Field(default=0.0, exclude_if=operator.not_)
    """The measured diameter has a uniform error of at most +- this share."""
    known_to: Share = 0.0
    """If there is no nominal value: the measured one has a uniform error of at most +- this share."""
    stiffening_curvature_per_m: Positive = 40.0
    """EI grows as 1 + (curvature / this)^2."""
    proximal_stiffer: NotNegative = 0.05
    """EI is higher by this share over the third next to the sheath."""
    stiffness_knots: tuple[tuple[Share, Positive], ...] = Field(default=(), exclude_if=operator.not_)
    """Factor on EI along the flexible part: (share of its length, factor), linear between these; none: 1."""
    rest_curvature_per_m: tuple[Number, ...] = Field(default=(), exclude_if=operator.not_)
    """Curvature of the flexible part without load, at even distances from base to tip, beside that of the knob, 1/m;
    none: 0."""
    torsion_over_bending: Positive = 1.0
    """GJ / EI."""
    out_of_plane_per_m: Range = (-1.5, 1.5)
    """Curvature of the unloaded shaft out of its plane of bending."""
    creep_share: Share = 0.03
    creep_s: Positive = 2.0
    """Under a constant moment the bend grows by this share of itself, with this time constant."""
    sessions_per_catheter: Annotated[int, Field(ge=1, le=1_000_000)] = 1
    """Consecutive sessions that share one draw of the catheter."""

    def uncertainties(self) -> tuple[float | None, float | None]:
        """Returns the relative standard uncertainties of nominal length and stiffness; None: exact."""
        of_length = self._uncertainty(self.flexible_length_m, self.nominal_flexible_length_m)
        return of_length, self._uncertainty(self.stiffness_nm2, self.nominal_stiffness_nm2)

    def _uncertainty(self, drawn: Range, nominal: float | None) -> float | None:
        if nominal is None:
            return standard_uncertainty(self.known_to)
        return standard_uncertainty(*(value / nominal - 1.0 for value in drawn))


class ActuationSettings(Settings):
    """Knob to curvature."""

    knob_deg: Range = (10.0, 10.0)
    """Angle of the knob; the range of its motion if it moves."""
    knob_deg_per_s: NotNegative = 0.0
    """Largest speed of the knob during a session; 0: it does not move."""
    gain_per_m_deg: NotNegative = 0.533
    """Nominal curvature per degree of the knob; 90 degrees are a full bend. 0: a device without a knob."""
    play_deg: NotNegative = 1.0
    """Width of the backlash."""
    factor: Range = (0.98, 1.02)
    """Ratio of the true gain of the session to the nominal one."""
    drift_rms: NotNegative = 0.01
    drift_s: Positive = 20.0
    """Slow relative drift of the curvature: its standard deviation and correlation time."""


class WallSettings(Settings):
    """The tissue."""

    contact_angle_deg: Range = (0.0, 75.0)
    """From the unloaded tip's axis to the direction into the wall, in the plane of bending. 0: the tip points at it."""
    either_side: bool = False
    """False: the wall is on the side to which the knob bends; True: on either side."""
    tilt_deg: Range = (-5.0, 5.0)
    """Angle of the wall's normal out of the plane of bending."""
    stiffness_n_per_m: Range = (96.0, 144.0)
    loss_factor: NotNegative = 0.175
    loss_hz: Positive = 1.2
    friction: Range = (0.05, 0.3)
    log_stiffness: bool = Field(default=False, exclude_if=operator.not_)
    """Whether the logarithm of the stiffness is uniform in its range, in place of the stiffness."""
    laws: tuple[Literal["linear", "hertz", "exponential"], ...] = Field(default=(), exclude_if=operator.not_)
    """One is drawn, each as likely: force with depth, depth^1.5, or exp(depth / ``law_depth_m``) - 1; none: linear."""
    law_depth_m: Positive = Field(default=2e-3, exclude_if=(2e-3).__eq__)
    """If a law is not linear, the stiffness is that of its secant at this depth."""
    stated_within: NotNegative | None = Field(default=None, exclude_if=lambda within: within is None)
    """Relative standard deviation of the stiffness that the session metadata state, as if it had been measured before.
    None: they do not state it."""
    loss_factors: Range | None = Field(default=None, exclude_if=operator.not_)
    """Range from which the loss factor is drawn, in place of ``loss_factor``."""
    faces: tuple[Literal["flat", "convex", "concave"], ...] = Field(default=(), exclude_if=operator.not_)
    """One is drawn, with equal probability; none: flat."""
    face_radius_m: Range = Field(default=(15e-3, 60e-3), exclude_if=(15e-3, 60e-3).__eq__)
    """Radius of a convex or concave face."""
    side_stiffness_n_per_m2: NotNegative = Field(default=0.0, exclude_if=operator.not_)
    """Stiffness per metre of the shaft's side that touches the tissue; 0: only the electrode's dome touches."""


class MotionSettings(Settings):
    """The stage that moves the wall along its nominal normal and across. Amplitudes are half of peak to peak."""

    beat_hz: Range = (1.0, 1.5)
    half_wave_share: Share = 0.25
    """Share of the sessions with the half-wave PQRST as heart beat, in place of a sine."""
    by_hand_share: Share = Field(default=0.0, exclude_if=operator.not_)
    """Share of the sessions in which a hand moves the stage, without heart beat and breathing; see `hand_wave`."""
    amplitude_m: Range = (0.5e-3, 10e-3)
    """Amplitude along the normal; it is solved for the peak force."""
    lateral_share: Range = (0.2, 1.0)
    """Ratio of the lateral amplitude to that along the normal; its phase is drawn, too."""
    respiration_m: Range = (0.0, 2e-3)
    respiration_hz: Positive = 0.25
    peak_force_n: Range = (0.15, 0.35)
    same_peak: Annotated[int, Field(ge=1, le=400)] = Field(default=1, exclude_if=(1).__eq__)
    """Draws in a row with the same peak force: forces that are hard to reach would otherwise be rarer than drawn."""
    peak_within_n: NotNegative = Field(default=0.0, exclude_if=operator.not_)
    """Largest difference of the largest force from the drawn one; 0: the amplitude is solved to 10 um (slower)."""
    free_share: Range = (0.05, 0.20)
    """Share of the time without contact after the approach; the standoff of the stage is solved for it."""
    least_force_n: Range | None = Field(default=None, exclude_if=operator.not_)
    """Smallest force after the approach: the tip never leaves the wall; the standoff is solved for this
    force, not for ``free_share``. Both forces are solved to within ``peak_within_n``, which must then be stated."""
    step_m: Positive = 2.5e-6
    """One microstep."""
    max_speed_m_per_s: Positive = 0.20
    max_acceleration_m_per_s2: Positive = 10.0
    delay_s: NotNegative = 4e-3
    """Time from a command to the start of the motion."""
    lag_s: NotNegative = Field(default=0.0, exclude_if=operator.not_)
    """Time constant with which the tissue follows the motor."""
    travel_m: Range = Field(default=(-0.1, 0.1), exclude_if=lambda travel: travel == (-0.1, 0.1))
    """Travel of both axes, from the position in which the tissue just touches the tip."""

    @model_validator(mode="after")
    def _solved_within(self) -> Self:
        if self.least_force_n and not self.peak_within_n:
            raise ValueError(
                "least_force_n needs peak_within_n: the largest difference of both forces from those drawn, in N"
            )
        return self


class ClampSettings(Settings):
    """The motor that advances the catheter's clamp along the base tangent; the free length does not change."""

    step_m: Positive = 2.5e-6
    travel_m: Range = (-20e-3, 20e-3)
    """Travel from the position of the clamp without commands."""
    home_m: Number = Field(default=0.0, exclude_if=operator.not_)
    """Reading of its scale there: ``advance_mm`` is 0 where the base has the position of the session metadata."""
    max_speed_m_per_s: Positive = 0.05
    max_acceleration_m_per_s2: Positive = 1.0
    delay_s: NotNegative = 8e-3
    """Time from a command to the start of the motion."""
    lag_s: NotNegative = 10e-3
    """Time constant with which the clamp follows the motor: belt, coupling and catheter are elastic."""
    logged: bool = False
    """Whether recordings contain ``advance_mm`` in addition to ``knob_deg``."""


class KnobDriveSettings(Settings):
    """The motor at the knob; at its first command it takes over from the hand that set the knob."""

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
    """Mass of tissue and plate above the sensor: their inertia and weight are part of the readings."""
    pose_error_deg: Range = (-1.0, 1.0)
    """Rotation from the nominal to the true pose, about each axis."""
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
    """Standard deviation of a frame's time from the regular one, limited to three times this value."""
    dropped_share: Share = 0.005
    images_from_s: NotNegative = Field(default=0.0, exclude_if=operator.not_)
    """The camera starts this time after the recording: there is no image before."""
    camera_delay_s: NotNegative = Field(default=15e-3, exclude_if=lambda delay: delay == 15e-3)
    """Time from the end of an exposure until its image can be processed; in a live bench only."""
    force_delay_s: NotNegative = Field(default=3e-3, exclude_if=lambda delay: delay == 3e-3)
    drive_delay_s: NotNegative = Field(default=5e-3, exclude_if=lambda delay: delay == 5e-3)
    """The same delay of force readings, and of the readings of stage and knob."""
    force_offset_ms: Range = (-80.0, 80.0)
    """Camera time = time in the force log + this value, at the start of the log."""
    force_drift_ppm: Range = (-20.0, 20.0)


def _is_default(part: Settings) -> bool:
    return part == type(part)()


class WorldSettings(Settings):
    """A catheter that is held at its base presses on a moving wall; a force sensor is under the wall."""

    seconds: Annotated[float, Field(ge=8, le=3600)] = 60.0
    """Length of a session."""
    tare_s: NotNegative = 5.0
    """Time at the start in which the stage is out of the tip's reach."""
    sessions_per_bench: Annotated[int, Field(ge=1, le=1_000_000)] = Field(default=1, exclude_if=(1).__eq__)
    """Consecutive sessions that share one draw of the wall, of the shaft's out-of-plane curvature, and of camera and
    scene. Each session has its own motion, knob, force sensor and clocks."""
    shaft: ShaftSettings = ShaftSettings()
    actuation: ActuationSettings = ActuationSettings()
    wall: WallSettings = WallSettings()
    motion: MotionSettings = MotionSettings()
    clamp: ClampSettings = Field(default=ClampSettings(), exclude_if=_is_default)
    knob_drive: KnobDriveSettings = Field(default=KnobDriveSettings(), exclude_if=_is_default)
    sensor: SensorSettings = SensorSettings()
    clock: ClockSettings = ClockSettings()
