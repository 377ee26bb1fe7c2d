"""The force sensor under the tissue: its pose, bias, drift, noise, steps and clock."""

import math
from dataclasses import dataclass

import numpy as np

from ...types import FloatArray
from ._session import STEP_S, Course, Session
from ._settings import SmallBenchSettings

__all__ = ["SensorLog", "read_sensor"]


@dataclass(frozen=True, slots=True, eq=False)
class SensorLog:
    """What the sensor's logger wrote, and what is true of it.

    ``time_s`` (m,): the logger's clock; camera time = time_s + ``clock_offset_s``. ``force_n`` (m, 3): the force of the
    tip on the tissue in the sensor's frame, whose x axis lies ``true_angle_deg`` counter-clockwise from the base
    frame's as displayed, z toward the camera; the person at the bench takes it for ``nominal_angle_deg``.
    """

    time_s: FloatArray
    force_n: FloatArray
    clock_offset_s: float
    nominal_angle_deg: float
    true_angle_deg: float
    drift_n_per_s: float
    scale_error: float

    def measured_metres_per_px(self, true: float) -> float:
        """What a ruler in the picture gave as the scale."""
        return float(f"{true * (1.0 + self.scale_error):.4g}")


def read_sensor(settings: SmallBenchSettings, session: Session, course: Course, rng: np.random.Generator) -> SensorLog:
    """One reading each millisecond of the sensor's own clock, from its zero to beyond the last frame."""
    offset = float(rng.uniform(*settings.clock_offset_ms)) * 1e-3
    # The sensor is screwed on with its x axis into the wall, and that direction is read off to whole degrees.
    nominal = float(round(math.degrees(session.wall.angle_rad)))
    true = nominal + float(rng.uniform(*settings.sensor_angle_error_deg))
    time_s: FloatArray = np.arange(round((settings.seconds + 0.2) / STEP_S), dtype=np.float64) * STEP_S
    seen = time_s + offset
    on_tissue = -np.stack([np.interp(seen, course.time_s, course.contact.force_n[:, k]) for k in range(2)], axis=1)
    c, s = math.cos(math.radians(true)), math.sin(math.radians(true))
    force = np.zeros((time_s.size, 3))
    force[:, 0] = c * on_tissue[:, 0] + s * on_tissue[:, 1]
    force[:, 1] = -s * on_tissue[:, 0] + c * on_tissue[:, 1]
    drift = rng.uniform(*settings.sensor_drift_n_per_min, 3) / 60.0
    force += rng.uniform(*settings.sensor_bias_n, 3) + drift * seen[:, None]
    force += settings.sensor_noise_n * rng.standard_normal(force.shape)
    step = np.array(settings.sensor_step_n)
    return SensorLog(
        time_s=time_s,
        force_n=np.round(force / step) * step,
        clock_offset_s=offset,
        nominal_angle_deg=nominal,
        true_angle_deg=true,
        drift_n_per_s=float(drift[0]),
        scale_error=float(rng.uniform(*settings.scale_error)),
    )
