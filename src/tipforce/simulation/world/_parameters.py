"""The parameters of one session, drawn from the settings of a bench."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...mechanics import HEART_WAVES
from .._fields import Range
from .settings import WorldSettings

BY_HAND = "by hand"
"""Wave of a stage that is moved by hand."""


@dataclass(frozen=True, slots=True)
class DeviceProperties:
    """The true and the nominal values of one catheter."""

    diameter_m: float
    flexible_length_m: float
    stiffness_nm2: float
    nominal_flexible_length_m: float
    nominal_stiffness_nm2: float
    nominal_diameter_m: float | None = None
    """None: equal to ``diameter_m``."""


@dataclass(frozen=True, slots=True)
class SessionParameters:
    """The parameters of one session, except the wall's motion, which is solved afterwards. Angles in the base frame.

    The motion is solved for ``peak_force_n`` and ``free_share`` (or ``least_force_n``). None: the preset does not draw
    the value.
    """

    device: DeviceProperties
    out_of_plane_per_m: float
    knob_factor: float
    play_start_deg: float
    """Position of the mechanism in its backlash at the start, from the middle."""
    knob_low_deg: float
    knob_high_deg: float
    knob_speed_deg_per_s: float
    contact_angle_deg: float
    tilt_deg: float
    wall_stiffness_n_per_m: float
    friction: float
    wave: str
    beat_hz: float
    lateral_share: float
    lateral_phase: float
    respiration_m: float
    respiration_phase: float
    peak_force_n: float
    free_share: float
    law: str | None = None
    loss_factor: float | None = None
    face: str | None = None
    face_radius_m: float | None = None
    least_force_n: float | None = None


def sample_device(settings: WorldSettings, seed: int, session: int, redraw: int = 0) -> DeviceProperties:
    """Samples the catheter of a session.

    Args:
        settings: settings of the world.
        seed: seed of all random numbers.
        session: number of the session; ``sessions_per_catheter`` sessions in a row have the same catheter.
        redraw: number of catheters that were rejected before.

    Returns:
        The catheter.
    """
    shaft = settings.shaft
    key = [seed, session // shaft.sessions_per_catheter, 0]  # the same for all sessions of a catheter
    rng = np.random.default_rng([*key, redraw] if redraw else key)
    length, stiffness = rng.uniform(*shaft.flexible_length_m), rng.uniform(*shaft.stiffness_nm2)
    diameter = rng.uniform(*shaft.diameter_m)
    diameter_error = shaft.diameter_known_to
    measured_over_true = 1.0 + rng.uniform(-shaft.known_to, shaft.known_to, 2)
    return DeviceProperties(
        diameter_m=float(diameter),
        flexible_length_m=float(length),
        stiffness_nm2=float(stiffness),
        nominal_flexible_length_m=shaft.nominal_flexible_length_m or float(length * measured_over_true[0]),
        nominal_stiffness_nm2=shaft.nominal_stiffness_nm2 or float(stiffness * measured_over_true[1]),
        nominal_diameter_m=float(diameter * (1.0 + rng.uniform(-diameter_error, diameter_error)))
        if diameter_error
        else None,
    )


def sample_parameters(settings: WorldSettings, device: DeviceProperties, rng: np.random.Generator) -> SessionParameters:
    """Samples the parameters of one session.

    Args:
        settings: settings of the world.
        device: the catheter.
        rng: random numbers.

    Returns:
        The parameters.
    """

    def uniform(bounds: Range) -> float:
        return float(rng.uniform(*bounds))

    def angle_rad() -> float:
        return uniform((0.0, 2 * math.pi))

    actuation, wall, motion = settings.actuation, settings.wall, settings.motion
    knob_range_deg = sorted(rng.uniform(*actuation.knob_deg, 2).tolist())
    bend_side = -1.0 if wall.either_side and rng.random() < 0.5 else 1.0
    names = list(HEART_WAVES)
    parameters = SessionParameters(
        device=device,
        out_of_plane_per_m=uniform(settings.shaft.out_of_plane_per_m),
        knob_factor=uniform(actuation.factor),
        play_start_deg=uniform((-actuation.play_deg / 2, actuation.play_deg / 2)),
        knob_low_deg=knob_range_deg[0],
        knob_high_deg=knob_range_deg[1],
        knob_speed_deg_per_s=actuation.knob_deg_per_s * uniform((0.1, 1.0)),
        contact_angle_deg=bend_side * uniform(wall.contact_angle_deg),
        tilt_deg=uniform(wall.tilt_deg),
        wall_stiffness_n_per_m=uniform(wall.stiffness_n_per_m),
        friction=uniform(wall.friction),
        wave=names[1] if rng.random() < motion.half_wave_share else names[0],
        beat_hz=uniform(motion.beat_hz),
        lateral_share=uniform(motion.lateral_share),
        lateral_phase=angle_rad(),
        respiration_m=uniform(motion.respiration_m),
        respiration_phase=angle_rad(),
        peak_force_n=uniform(motion.peak_force_n),
        free_share=uniform(motion.free_share),
    )
    return replace(parameters, **_sample_more(settings, rng))


def sample_kind(settings: WorldSettings, rng: np.random.Generator) -> dict[str, Any]:
    """Samples the kind of tissue and motion of a session, where the preset varies them.

    The kind is kept when the other parameters are drawn again. Otherwise kinds that reach their forces easily would be
    more frequent than they are drawn.

    Args:
        settings: settings of the world.
        rng: random numbers.

    Returns:
        The drawn parameters, by name.
    """
    wall, kind = settings.wall, dict[str, Any]()
    if wall.laws:
        kind["law"] = wall.laws[int(rng.integers(len(wall.laws)))]
    if wall.faces:
        kind["face"] = wall.faces[int(rng.integers(len(wall.faces)))]
        if kind["face"] != "flat":
            kind["face_radius_m"] = float(rng.uniform(*wall.face_radius_m))
    if settings.motion.by_hand_share and rng.random() < settings.motion.by_hand_share:
        kind |= {"wave": BY_HAND, "respiration_m": 0.0}
    return kind


def _sample_more(settings: WorldSettings, rng: np.random.Generator) -> dict[str, Any]:
    """Samples values that only some presets draw, after all others, so that sessions of other presets do not change."""
    wall, drawn = settings.wall, dict[str, Any]()
    if wall.log_stiffness:
        drawn["wall_stiffness_n_per_m"] = float(np.exp(rng.uniform(*np.log(wall.stiffness_n_per_m))))
    if wall.loss_factors:
        drawn["loss_factor"] = float(rng.uniform(*wall.loss_factors))
    if settings.motion.least_force_n:
        drawn["least_force_n"] = float(rng.uniform(*settings.motion.least_force_n))
    return drawn
