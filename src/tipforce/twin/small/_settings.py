"""The one model of settings of the small bench. Ranges are (low, high): one uniform draw a session."""

from typing import Annotated

from pydantic import Field

from .._ranges import NotNegative, Positive, Range, Settings

__all__ = ["SmallBenchSettings"]


class SmallBenchSettings(Settings):
    """A catheter held at its base presses on a wall that beats; a camera looks on, a force sensor sits under the wall.

    The defaults are a 7F ablation catheter on silicone tissue. Left out, beside what the defaults of real hardware
    bring: motion out of the plane, the stage's inertia in the sensor, hysteresis of the knob, lens distortion,
    dropped frames.
    """

    seconds: Annotated[float, Field(ge=8, le=3600)] = 30.0
    """Length of a session."""
    tare_s: NotNegative = 5.0
    """At the start, with the wall moving but out of reach."""

    diameter_m: Positive = 2.33e-3
    rigid_length_m: Positive = 8e-3
    flexible_length_m: Range = (39e-3, 41e-3)
    stiffness_nm2: Range = (4.17e-4, 4.43e-4)
    stiffening_curvature_per_m: Positive = 40.0
    """EI grows as 1 + (curvature / this)^2."""
    knob_deg: NotNegative = 10.0
    knob_gain_per_m_deg: NotNegative = 0.533
    """Curvature of the unloaded shaft for each degree of the knob."""
    knob_factor: Range = (0.98, 1.02)
    """What the session's knob does, over what it should."""

    contact_angle_deg: Range = (0.0, 75.0)
    """From the unloaded tip's axis to the direction into the wall, counter-clockwise. 0: the tip points at the wall."""
    wall_stiffness_n_per_m: Range = (96.0, 144.0)
    loss_factor: NotNegative = 0.175
    """Of the tissue, at 1.2 Hz."""
    friction: Range = (0.05, 0.3)
    beat_hz: Range = (1.0, 1.5)
    lateral_share: Range = (0.2, 1.0)
    """Amplitude along the wall over the amplitude into it; the phase between them is drawn too."""
    respiration_m: Range = (0.0, 2e-3)
    """Amplitude at 0.25 Hz, into the wall."""
    amplitude_m: Range = (1e-3, 10e-3)
    """Into the wall, solved for the peak force; a session that cannot reach it within these is drawn again."""
    peak_force_n: Range = (0.15, 0.35)
    free_share: Range = (0.05, 0.20)
    """Share of the time without contact, after the tare."""

    sensor_noise_n: NotNegative = 3e-3
    sensor_step_n: tuple[Positive, Positive, Positive] = (5e-3, 5e-3, 10e-3)
    """Quantisation of x, y, z."""
    sensor_bias_n: Range = (-0.2, 0.2)
    sensor_drift_n_per_min: Range = (-2e-3, 2e-3)
    sensor_angle_error_deg: Range = (-1.0, 1.0)
    clock_offset_ms: Range = (-80.0, 80.0)
    """Camera time = time in the force log + this."""

    width: Annotated[int, Field(ge=160, le=4096, multiple_of=2)] = 640
    height: Annotated[int, Field(ge=120, le=4096, multiple_of=2)] = 480
    fps: Annotated[float, Field(gt=0, le=240)] = 24.0
    metres_per_px: Range = (0.19e-3, 0.21e-3)
    scale_error: Range = (-0.01, 0.01)
    """Of the scale that is measured and written beside the video."""
    base_shift_m: Range = (-1e-3, 1e-3)
    base_turn_deg: Range = (-2.0, 2.0)
    exposure_s: NotNegative = 8e-3
    blur_px: Range = (0.8, 1.2)
    noise_grey: NotNegative = 3.0
    """Standard deviation of the noise at mid grey; dark parts have less, bright ones more."""
    light: Range = (0.88, 1.12)
