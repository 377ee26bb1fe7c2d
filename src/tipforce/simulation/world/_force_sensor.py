"""The force sensor under the tissue: it moves with the stage and has a pose, bias, drift, noise, steps and a clock."""

import math
from dataclasses import dataclass

import numpy as np

from ...geometry import Pose
from ...types import FloatArray, IntArray
from ._bench_model import times
from .settings import ClockSettings, SensorSettings

GRAVITY_M_PER_S2 = np.array([0.0, 0.0, -9.80665])
"""Base frame: the bench is level and the camera is above it."""


@dataclass(frozen=True, slots=True, eq=False)
class SensorLoad:
    """Loads on the sensor at each instant of the bench's own time, in the base frame.

    Attributes:
        time_s: (m,) time.
        force_n: (m, 3) force of the tip on the tissue.
        lever_m: (m, 3) from the sensor's origin to the point of contact.
        acceleration_m_per_s2: (m, 3) acceleration of the stage.
        side: force and lever (m, 3) of the side of the shaft; None if it does not touch.
    """

    time_s: FloatArray
    force_n: FloatArray
    lever_m: FloatArray
    acceleration_m_per_s2: FloatArray
    side: tuple[FloatArray, FloatArray] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class SensorLog:
    """The log of the sensor, and its true parameters.

    Attributes:
        stamp_ns: (k,) the logger's clock, from its zero.
        force_n: (k, 3) sensor frame.
        torque_nm: (k, 3) sensor frame.
        true_s: (k,) true time of each reading on the camera's clock.
        rotation: (3, 3) from the base frame to the sensor's.
        nominal_angle_deg: the rotation about z that a person at the bench would state.
        offset_s: camera time = logger's time (1 + ``drift``) + ``offset_s``.
        drift: see ``offset_s``.
        bias_n: (3,) bias of the force.
        drift_n_per_s: (3,) drift of the force.
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


class ForceSensor:
    """Readings at the sensor's rate on its own clock, from its zero. The rows of ``log`` are filled by `take`.

    Args:
        settings: settings of the sensor.
        clock: settings of the clocks.
        normal_angle_rad: angle from the base frame's x to the sensor's x axis, which is along the stage's normal; it is
            stated in whole degrees.
        seconds: length of the log.
        rng: random numbers of the sensor.
    """

    def __init__(
        self,
        settings: SensorSettings,
        clock: ClockSettings,
        normal_angle_rad: float,
        seconds: float,
        rng: np.random.Generator,
    ) -> None:
        """Draws clock, pose, bias, drift and noise of the sensor; `take` fills the readings."""
        offset_s = float(rng.uniform(*clock.force_offset_ms)) * 1e-3
        drift = float(rng.uniform(*clock.force_drift_ppm)) * 1e-6
        nominal_deg = float(round(math.degrees(normal_angle_rad)))
        # The true pose differs from the nominal one by small rotations.
        error_rad = np.radians(rng.uniform(*settings.pose_error_deg, 3))
        base_from_sensor = Pose.from_euler(error_rad + np.array([0.0, 0.0, math.radians(nominal_deg)]), np.zeros(3))
        logger_s: FloatArray = np.arange(round(seconds * settings.rate_hz), dtype=np.float64) / settings.rate_hz
        self.settings = settings
        self.log = SensorLog(
            stamp_ns=np.round(logger_s * 1e9).astype(np.int64),
            force_n=np.zeros((logger_s.size, 3)),
            torque_nm=np.zeros((logger_s.size, 3)),
            true_s=logger_s * (1.0 + drift) + offset_s,
            rotation=base_from_sensor.rotation.T,
            nominal_angle_deg=nominal_deg,
            offset_s=offset_s,
            drift=drift,
            bias_n=rng.uniform(*settings.bias_n, 3),
            drift_n_per_s=rng.uniform(*settings.drift_n_per_min, 3) / 60.0,
        )
        self._noise_n = settings.noise_n * rng.standard_normal((logger_s.size, 3))
        self._torque_noise_nm = settings.torque_noise_nm * rng.standard_normal((logger_s.size, 3))

    def take(self, load: SensorLoad, first: int, end: int) -> None:
        """Takes readings into the log.

        Args:
            load: load on the sensor; its times contain those of the readings.
            first: number of the first reading.
            end: end of the readings, exclusive.
        """
        settings, log, rows = self.settings, self.log, slice(first, end)
        true_s = log.true_s[rows]

        def at(values: FloatArray) -> FloatArray:
            """Interpolates (m, 3) values at the times of the readings."""
            return np.stack([np.interp(true_s, load.time_s, values[:, k]) for k in range(3)], axis=1)

        # Weight and inertia of the mass above the sensor.
        mass_force = settings.moving_mass_kg * (GRAVITY_M_PER_S2 - at(load.acceleration_m_per_s2))
        contact_force = at(load.force_n)
        moment = np.cross(at(load.lever_m), contact_force)
        if load.side is not None:
            side_force = at(load.side[0])
            moment = moment + np.cross(at(load.side[1]), side_force)
            contact_force = contact_force + side_force
        force = times(contact_force + mass_force, log.rotation.T) + log.bias_n + log.drift_n_per_s * true_s[:, None]
        force += self._noise_n[rows]
        torque = times(moment, log.rotation.T) + self._torque_noise_nm[rows]
        step = np.array(settings.step_n)
        log.force_n[rows] = np.round(force / step) * step
        log.torque_nm[rows] = np.round(torque / settings.torque_step_nm) * settings.torque_step_nm
