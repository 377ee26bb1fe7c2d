"""The force sensor under the tissue: it rides on the stage, with its pose, bias, drift, noise, steps and clock."""

import math
from dataclasses import dataclass

import numpy as np

from ...geometry import Pose
from ...types import FloatArray, IntArray
from .settings import ClockSettings, SensorSettings

__all__ = ["Load", "SensorLog", "read_sensor"]

GRAVITY_M_PER_S2 = np.array([0.0, 0.0, -9.80665])
"""Base frame: the camera looks down on a level bench."""


@dataclass(frozen=True, slots=True, eq=False)
class Load:
    """What acts on the sensor, instant by instant on the bench's own time, in the base frame.

    ``time_s`` (m,). ``force_n`` (m, 3): of the tip on the tissue. ``lever_m`` (m, 3): from the sensor's origin to
    where the tip touches. ``acceleration_m_per_s2`` (m, 3): of the stage.
    """

    time_s: FloatArray
    force_n: FloatArray
    lever_m: FloatArray
    acceleration_m_per_s2: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class SensorLog:
    """What the sensor's logger wrote, and what is true of it.

    ``stamp_ns`` (k,): the logger's clock, from its zero. ``force_n``, ``torque_nm`` (k, 3): the sensor's frame.
    ``true_s`` (k,): when that really was, on the camera's clock. ``rotation`` (3, 3): base frame to the sensor's;
    ``nominal_angle_deg``: what the person at the bench takes for it, a turn about z. ``offset_s``, ``drift``: camera
    time = logger's time (1 + drift) + offset. ``bias_n`` (3,), ``drift_n_per_s`` (3,).
    """

    stamp_ns: IntArray
    force_n: FloatArray
    torque_nm: FloatArray
    true_s: FloatArray
    rotation: FloatArray
    nominal_angle_deg: float
    offset_s: float
    drift: float
    bias_n: FloatArray
    drift_n_per_s: FloatArray


def read_sensor(
    settings: SensorSettings,
    clock: ClockSettings,
    load: Load,
    normal_angle_rad: float,
    seconds: float,
    rng: np.random.Generator,
) -> SensorLog:
    """Readings at the sensor's rate for ``seconds`` of its own clock, from its zero.

    The sensor is screwed on with its x axis along the stage's normal, ``normal_angle_rad`` from the base frame's x,
    a direction that is read off to whole degrees.
    """
    offset = float(rng.uniform(*clock.force_offset_ms)) * 1e-3
    drift = float(rng.uniform(*clock.force_drift_ppm)) * 1e-6
    nominal = float(round(math.degrees(normal_angle_rad)))
    error = np.radians(rng.uniform(*settings.pose_error_deg, 3))
    turn = Pose.from_euler(error + np.array([0.0, 0.0, math.radians(nominal)]), np.zeros(3))
    to_sensor = turn.rotation.T
    own: FloatArray = np.arange(round(seconds * settings.rate_hz), dtype=np.float64) / settings.rate_hz
    true = own * (1.0 + drift) + offset

    def at(values: FloatArray) -> FloatArray:
        return np.stack([np.interp(true, load.time_s, values[:, k]) for k in range(3)], axis=1)

    carried = settings.moving_mass_kg * (GRAVITY_M_PER_S2 - at(load.acceleration_m_per_s2))
    tip = at(load.force_n)
    bias = rng.uniform(*settings.bias_n, 3)
    creeping = rng.uniform(*settings.drift_n_per_min, 3) / 60.0
    force = (tip + carried) @ to_sensor.T + bias + creeping * true[:, None]
    force += settings.noise_n * rng.standard_normal(force.shape)
    torque = np.cross(at(load.lever_m), tip) @ to_sensor.T
    torque += settings.torque_noise_nm * rng.standard_normal(torque.shape)
    step = np.array(settings.step_n)
    return SensorLog(
        stamp_ns=np.round(own * 1e9).astype(np.int64),
        force_n=np.round(force / step) * step,
        torque_nm=np.round(torque / settings.torque_step_nm) * settings.torque_step_nm,
        true_s=true,
        rotation=to_sensor,
        nominal_angle_deg=nominal,
        offset_s=offset,
        drift=drift,
        bias_n=bias,
        drift_n_per_s=creeping,
    )
