"""What happens in one session: parameters are drawn, the wall's motion is solved, contact is computed."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from scipy.optimize import brentq

from ...errors import InputError
from ...mechanics import Contact, Rod, Wall, press
from ...types import FloatArray
from ._settings import SmallBenchSettings

__all__ = ["Course", "Session", "run_session"]

STEP_S = 1e-3
"""Between instants of the simulation."""
LEAD_S, TRAIL_S = 0.1, 0.3
"""Simulated before the first frame and after the last: the force log's clock lies off by less."""
_COARSE_S = 4e-3
_APPROACH_S = 1.5
_RESPIRATION_HZ = 0.25
_LOSS_HZ = 1.2
_CLEARANCE_M = 3e-3
"""Between tip and wall where they are closest while the sensor is tared."""
_DRAWS = 500


@dataclass(frozen=True, slots=True)
class Session:
    """One session's drawn values: the truth. Lengths in metres, angles in the base frame."""

    rod: Rod
    wall: Wall
    contact_angle_deg: float
    touch_m: float
    """Position of the wall's surface, along the direction into it, at which it meets the unloaded tip."""
    beat_hz: float
    amplitude_m: float
    lateral_m: float
    lateral_phase: float
    respiration_m: float
    respiration_phase: float
    standoff_m: float
    """Taken from the motion so that the wall lets go for the wanted share of the time."""
    redraws: int

    def push_m(self, t: FloatArray) -> FloatArray:
        """How far the wall has come in beyond first touch, once the approach is over."""
        beat = self.amplitude_m * np.sin(2 * np.pi * self.beat_hz * t)
        breath = self.respiration_m * np.sin(2 * np.pi * _RESPIRATION_HZ * t + self.respiration_phase)
        return beat + breath - self.standoff_m

    def along_m(self, t: FloatArray) -> FloatArray:
        """The wall's own way along its surface."""
        return self.lateral_m * np.sin(2 * np.pi * self.beat_hz * t + self.lateral_phase)


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """A session instant by instant: ``time_s`` (m,), the wall's surface ``position_m`` and ``along_m`` (m,)."""

    time_s: FloatArray
    position_m: FloatArray
    along_m: FloatArray
    contact: Contact


def _touch(rod: Rod, wall: Wall, radius: float) -> float:
    """Position of the wall that just meets the unloaded tip."""
    angles = rod.unloaded_angles_rad
    ball = rod.nodes_m(angles)[-1] - radius * np.array([math.cos(angles[-1]), math.sin(angles[-1])])
    return float(ball @ [math.cos(wall.angle_rad), math.sin(wall.angle_rad)]) + radius


def _draw(settings: SmallBenchSettings, rng: np.random.Generator, redraws: int) -> tuple[Session, float, float]:
    """Values of one session but for the amplitude; the wanted peak force and share without contact."""

    def one(bounds: tuple[float, float]) -> float:
        return float(rng.uniform(*bounds))

    curvature = settings.knob_gain_per_m_deg * settings.knob_deg * one(settings.knob_factor)
    rod = Rod(
        flexible_length_m=one(settings.flexible_length_m),
        bending_stiffness_nm2=one(settings.stiffness_nm2),
        rigid_length_m=settings.rigid_length_m,
        precurvature_per_m=curvature,
        stiffening_curvature_per_m=settings.stiffening_curvature_per_m,
    )
    contact_angle = one(settings.contact_angle_deg)
    stiffness = one(settings.wall_stiffness_n_per_m)
    wall = Wall(
        angle_rad=float(rod.unloaded_angles_rad[-1]) + math.radians(contact_angle),
        stiffness_n_per_m=stiffness,
        damping_ns_per_m=settings.loss_factor * stiffness / (2 * math.pi * _LOSS_HZ),
        friction=one(settings.friction),
    )
    session = Session(
        rod=rod,
        wall=wall,
        contact_angle_deg=contact_angle,
        touch_m=_touch(rod, wall, settings.diameter_m / 2),
        beat_hz=one(settings.beat_hz),
        amplitude_m=0.0,
        lateral_m=one(settings.lateral_share),
        lateral_phase=one((0.0, 2 * math.pi)),
        respiration_m=one(settings.respiration_m),
        respiration_phase=one((0.0, 2 * math.pi)),
        standoff_m=0.0,
        redraws=redraws,
    )
    return session, one(settings.peak_force_n), one(settings.free_share)


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    """Where ``function`` crosses zero, to 10 um."""
    return float(cast("float", brentq(function, low, high, xtol=1e-5)))


def _solve(drawn: Session, peak: float, free: float, settings: SmallBenchSettings) -> Session | None:
    """``drawn`` with the amplitude that gives the peak force and the standoff that frees the tip long enough."""
    t = np.arange(0.0, 2 / _RESPIRATION_HZ, _COARSE_S)
    away = 1.0 - np.minimum(1.0, t / _APPROACH_S)

    def moving(amplitude: float) -> Session:
        session = replace(drawn, amplitude_m=amplitude, lateral_m=drawn.lateral_m * amplitude)
        return replace(session, standoff_m=float(np.quantile(session.push_m(t), free)))

    def excess(amplitude: float) -> float:
        session = moving(amplitude)
        push = session.push_m(t)
        push -= away * (push.max() + _CLEARANCE_M)
        position = session.touch_m - push
        contact = press(session.rod, session.wall, position, session.along_m(t), _COARSE_S, settings.diameter_m / 2)
        return float(np.linalg.norm(contact.force_n, axis=1).max()) - peak

    low, high = settings.amplitude_m
    if not excess(low) < 0.0 < excess(high):
        return None
    return moving(_root(excess, low, high))


def _run(session: Session, settings: SmallBenchSettings) -> Course:
    """The whole session at 1 kHz: tare out of reach, approach, beats."""
    count = round((settings.seconds + LEAD_S + TRAIL_S) / STEP_S)
    t: FloatArray = np.arange(count, dtype=np.float64) * STEP_S - LEAD_S
    share = np.clip((t - settings.tare_s) / _APPROACH_S, 0.0, 1.0)
    push, along = session.push_m(t), session.along_m(t)
    reach = session.amplitude_m + session.respiration_m - session.standoff_m + _CLEARANCE_M
    position = session.touch_m - push + (1.0 - share * share * (3.0 - 2.0 * share)) * reach
    contact = press(session.rod, session.wall, position, along, STEP_S, settings.diameter_m / 2)
    return Course(t, position, along, contact)


def _fits(course: Course, settings: SmallBenchSettings) -> bool:
    """Whether the course is one that a careful person would have kept."""
    contact = course.contact
    if not (contact.converged.all() and contact.stable.all() and contact.touching.any()):
        return False  # the tip snapped to another branch
    low, high = settings.peak_force_n
    peak = np.linalg.norm(contact.force_n, axis=1).max()
    steady = course.time_s > settings.tare_s + _APPROACH_S
    released = 1.0 - contact.touching[steady].mean()
    # The electrode must go on pointing into the wall: else its side, not its dome, would touch.
    towards = np.cos(contact.angles_rad[contact.touching, -1] - contact.wall.angle_rad).min()
    return bool(
        0.95 * low <= peak <= 1.05 * high
        and settings.free_share[0] <= released <= settings.free_share[1]
        and towards > 0.05
    )


def run_session(settings: SmallBenchSettings, seed: int, number: int) -> tuple[Session, Course]:
    """The session ``number`` of ``seed``: the same arguments give the same values.

    Raises InputError where the settings leave no session that can be had.
    """
    rng = np.random.default_rng([seed, number, 1])
    for redraws in range(_DRAWS):
        drawn, peak, free = _draw(settings, rng, redraws)
        session = _solve(drawn, peak, free, settings)
        if session is not None:
            course = _run(session, settings)
            if _fits(course, settings):
                return session, course
    raise InputError(
        f"no session with a peak force of {settings.peak_force_n} N and {settings.free_share} of the time without "
        f"contact was found in {_DRAWS} draws; widen peak_force_n, free_share or amplitude_m"
    )
