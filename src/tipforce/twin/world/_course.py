"""What happens in one session, instant by instant: knob, stage and wall move, the rod follows."""

import math
from dataclasses import dataclass, fields, replace

import numpy as np

from ...mechanics import Play, SpatialContact, SpatialRod, SpatialWall, damping_of_loss_factor, press_spatial
from ...types import FloatArray
from ._axis import Axis, AxisLimits
from ._draw import Draw, knob_course, slow_drift
from ._waves import WAVES
from .settings import WorldSettings

__all__ = ["LEAD_S", "STEP_S", "Course", "Motion", "Rig", "build_rig", "run_course"]

STEP_S = 1e-3
"""Between instants of a session."""
LEAD_S, TRAIL_S = 0.5, 0.3
"""Simulated before the first frame and after the last: the force log's clock lies off by less."""
APPROACH_S = 1.5
CLEARANCE_M = 3e-3
"""Between tip and wall where they are closest while the sensor is tared."""
_SEGMENT_M = 1e-3


@dataclass(frozen=True, slots=True)
class Motion:
    """What is solved for: amplitude along the normal, and how far the stage stands off."""

    amplitude_m: float
    standoff_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Rig:
    """A session's rod and wall, and where they meet. Directions in the base frame.

    ``forward``, ``across`` (3,): the stage's axes; ``forward`` points into the nominal wall, so the tissue comes
    forward against it. ``touch_m`` (3,): a point of the wall's surface when it just meets the tip as it hangs under
    ``touch_curvature_per_m``. ``support_m``: how far the unloaded dome reaches along the wall's normal, over
    ``support_curvature_per_m``, both (k,).
    """

    draw: Draw
    rod: SpatialRod
    wall: SpatialWall
    forward: FloatArray
    across: FloatArray
    touch_m: FloatArray
    touch_reach_m: float
    support_curvature_per_m: FloatArray
    support_m: FloatArray
    settings: WorldSettings

    @property
    def radius_m(self) -> float:
        """Of the electrode and its dome."""
        return 0.5 * self.draw.device.diameter_m

    def reach_m(self, curvature_per_m: FloatArray) -> FloatArray:
        """(m,) curvature of the unloaded shaft -> (m,) how far its dome reaches beyond first touch, along the stage."""
        reach = np.interp(curvature_per_m, self.support_curvature_per_m, self.support_m)
        return (reach - self.touch_reach_m) / float(self.forward @ self.wall.normal)


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """A session instant by instant.

    ``time_s`` (m,) on the camera's clock; ``knob_deg`` (m,); ``curvature_per_m`` (m,) of the unloaded shaft in its
    plane of bending; ``command_m``, ``stage_m`` (m, 2): the stage's axes, told and come to, forward positive against
    the tip; ``acceleration_m_per_s2`` (m, 3) of the stage, base frame; ``wall_m`` (m, 3): where the point of the
    undented surface that was touched first is.
    """

    time_s: FloatArray
    knob_deg: FloatArray
    curvature_per_m: FloatArray
    command_m: FloatArray
    stage_m: FloatArray
    acceleration_m_per_s2: FloatArray
    wall_m: FloatArray
    contact: SpatialContact


def _tip_of(rod: SpatialRod, curvature_per_m: float, radius_m: float) -> tuple[FloatArray, FloatArray]:
    """Middle of the dome and the electrode's direction, of the rod without load."""
    strain = np.asarray(rod.precurvature_per_m) + np.array([0.0, 0.0, curvature_per_m])
    nodes = rod.nodes_m(replace(rod, precurvature_per_m=strain).unloaded_quaternions)
    axis = nodes[-1] - nodes[-2]
    axis /= np.linalg.norm(axis)
    return nodes[-1] - radius_m * axis, axis


def build_rig(settings: WorldSettings, draw: Draw) -> Rig:
    """Rod and wall of a session; raises ValueError where a drawn value has no physical meaning."""
    shaft, device = settings.shaft, draw.device
    segments = max(20, round(device.flexible_length_m / _SEGMENT_M))
    joints = np.linspace(0.0, 1.0, segments + 1)
    relaxed = device.stiffness_nm2 / (1.0 + shaft.creep_share)  # EI is what answers at once
    rod = SpatialRod(
        flexible_length_m=device.flexible_length_m,
        bending_stiffness_nm2=relaxed,
        rigid_length_m=shaft.rigid_length_m,
        torsional_stiffness_nm2=shaft.torsion_over_bending * relaxed,
        precurvature_per_m=np.array([0.0, draw.out_of_plane_per_m, 0.0]),
        stiffening_curvature_per_m=shaft.stiffening_curvature_per_m,
        stiffness_profile=np.where(joints < 1 / 3, 1.0 + shaft.proximal_stiffer, 1.0),
        segments=segments,
    )
    gain = settings.actuation.gain_per_m_deg * draw.knob_factor
    start = gain * (draw.knob_low_deg + draw.play_start_deg)
    radius = 0.5 * device.diameter_m
    centre, axis = _tip_of(rod, start, radius)
    angle = math.atan2(axis[1], axis[0]) + math.radians(draw.contact_angle_deg)
    forward = np.array([math.cos(angle), math.sin(angle), 0.0])
    tilt = math.radians(draw.tilt_deg)
    normal = math.cos(tilt) * forward + np.array([0.0, 0.0, math.sin(tilt)])
    spread = 0.2 * abs(gain) * max(draw.knob_high_deg, 1.0) + 5.0
    curvatures = np.linspace(gain * draw.knob_low_deg - spread, gain * draw.knob_high_deg + spread, 60)
    support = np.array([_tip_of(rod, float(c), radius)[0] @ normal for c in curvatures])
    stiffness = draw.wall_stiffness_n_per_m
    return Rig(
        draw=draw,
        rod=rod,
        wall=SpatialWall(
            normal=normal,
            stiffness_n_per_m=stiffness,
            damping_ns_per_m=damping_of_loss_factor(stiffness, settings.wall.loss_factor, settings.wall.loss_hz),
            friction=draw.friction,
        ),
        forward=forward,
        across=np.array([-forward[1], forward[0], 0.0]),
        touch_m=centre + radius * normal,
        touch_reach_m=float(centre @ normal),
        support_curvature_per_m=curvatures,
        support_m=support,
        settings=settings,
    )


@dataclass(frozen=True, slots=True, eq=False)
class Tune:
    """What a session's motion is made of before its amplitude is known: (m,) each."""

    time_s: FloatArray
    knob_deg: FloatArray
    curvature_per_m: FloatArray
    wave: FloatArray
    lateral: FloatArray
    breath_m: FloatArray

    def thinned(self, step: int, start_s: float, end_s: float) -> "Tune":
        """Every ``step``-th instant from ``start_s`` to ``end_s``."""
        rows = np.flatnonzero((self.time_s >= start_s) & (self.time_s <= end_s))[::step]
        return Tune(*(getattr(self, field.name)[rows] for field in fields(self)))

    def push_m(self, rig: Rig, amplitude_m: float) -> FloatArray:
        """How far the wall would stand beyond first touch without standing off."""
        return amplitude_m * self.wave + self.breath_m + rig.reach_m(self.curvature_per_m)

    def standoff_m(self, rig: Rig, amplitude_m: float) -> float:
        """What frees the tip for the wanted share of the beats."""
        beating = self.time_s > rig.settings.tare_s + APPROACH_S
        return float(np.quantile(self.push_m(rig, amplitude_m)[beating], rig.draw.free_share))


def compose(rig: Rig, time_s: FloatArray, rng: np.random.Generator) -> Tune:
    """Knob, drift and waves over ``time_s``, evenly spaced."""
    draw, settings = rig.draw, rig.settings
    knob = knob_course(draw, time_s, rng)
    actuation = settings.actuation
    transmitted = Play(actuation.play_deg, output=float(knob[0]) + draw.play_start_deg).run(knob)
    drift = slow_drift(actuation.drift_rms, actuation.drift_s, time_s, rng)
    cycles = draw.beat_hz * time_s
    return Tune(
        time_s=time_s,
        knob_deg=knob,
        curvature_per_m=actuation.gain_per_m_deg * draw.knob_factor * transmitted * (1.0 + drift),
        wave=WAVES[draw.wave](cycles),
        lateral=draw.lateral_share * WAVES[draw.wave](cycles + draw.lateral_phase / (2 * math.pi)),
        breath_m=draw.respiration_m
        * np.sin(2 * math.pi * settings.motion.respiration_hz * time_s + draw.respiration_phase),
    )


def run_course(rig: Rig, tune: Tune, motion: Motion) -> Course:
    """Drive the stage and let the rod follow: at the spacing of ``tune``'s instants."""
    settings, t = rig.settings, tune.time_s
    dt = float(t[1] - t[0])
    push = tune.push_m(rig, motion.amplitude_m)
    near = np.clip((t - settings.tare_s) / APPROACH_S, 0.0, 1.0)
    away = (1.0 - near * near * (3.0 - 2.0 * near)) * (push.max() - motion.standoff_m + CLEARANCE_M)
    forward = motion.amplitude_m * tune.wave + tune.breath_m - motion.standoff_m - away
    command = np.stack([forward, motion.amplitude_m * tune.lateral], axis=1)
    drives = settings.motion
    limits = AxisLimits(drives.step_m, drives.max_speed_m_per_s, drives.max_acceleration_m_per_s2, drives.delay_s)
    axes = [Axis(limits, dt, start=float(command[0, k])) for k in range(2)]
    smooth = np.stack([axis.follow(command[:, k]) for k, axis in enumerate(axes)], axis=1)
    stage = np.stack([axis.resolved(smooth[:, k]) for k, axis in enumerate(axes)], axis=1)
    directions = np.stack([-rig.forward, rig.across])
    wall = rig.touch_m + stage @ directions
    contact = press_spatial(
        rig.rod, rig.wall, wall, dt, rig.radius_m,
        precurvature_change_per_m=np.stack([0 * t, 0 * t, tune.curvature_per_m], axis=1),
        creep=settings.shaft.creep_share, creep_time_s=settings.shaft.creep_s,
    )  # fmt: skip
    return Course(
        time_s=t,
        knob_deg=tune.knob_deg,
        curvature_per_m=tune.curvature_per_m,
        command_m=command,
        stage_m=stage,
        acceleration_m_per_s2=np.gradient(np.gradient(smooth, dt, axis=0), dt, axis=0) @ directions,
        wall_m=wall,
        contact=contact,
    )
