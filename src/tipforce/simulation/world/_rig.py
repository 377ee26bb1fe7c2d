"""A session's rod and wall, and where they meet."""

import math
from dataclasses import dataclass, replace

import numpy as np

from ...mechanics import SpatialRod, SpatialWall, damping_of_loss_factor
from ...types import FloatArray
from ._draw import Draw
from ._rows import times
from .settings import ShaftSettings, WorldSettings

__all__ = ["Rig", "build_rig"]

_SEGMENT_M = 1e-3


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

    def directed(self, stage: FloatArray) -> FloatArray:
        """(m, 2) of the stage's axes -> (m, 3) in the base frame. Forward, the tissue comes against the tip."""
        return times(stage, np.stack([-self.forward, self.across]))

    def curvature_per_m(self, transmitted_deg: FloatArray, drift: FloatArray) -> FloatArray:
        """(m,) of the unloaded shaft in its plane of bending, from the knob behind its play and the relative drift."""
        return self.settings.actuation.gain_per_m_deg * self.draw.knob_factor * transmitted_deg * (1.0 + drift)

    def reach_m(self, curvature_per_m: FloatArray) -> FloatArray:
        """(m,) curvature of the unloaded shaft -> (m,) how far its dome reaches beyond first touch, along the stage."""
        reach = np.interp(curvature_per_m, self.support_curvature_per_m, self.support_m)
        return (reach - self.touch_reach_m) / float(self.forward @ self.wall.normal)


def _tip_of(rod: SpatialRod, curvature_per_m: float, radius_m: float) -> tuple[FloatArray, FloatArray]:
    """Middle of the dome and the electrode's direction, of the rod without load."""
    strain = np.asarray(rod.precurvature_per_m) + np.array([0.0, 0.0, curvature_per_m])
    nodes = rod.nodes_m(replace(rod, precurvature_per_m=strain).unloaded_quaternions)
    axis = nodes[-1] - nodes[-2]
    axis /= np.linalg.norm(axis)
    return nodes[-1] - radius_m * axis, axis


def _profile(shaft: ShaftSettings, joints: FloatArray) -> FloatArray:
    """Factors on EI at ``joints`` (k,), shares of the flexible length."""
    profile = np.where(joints < 1 / 3, 1.0 + shaft.proximal_stiffer, 1.0)
    if shaft.stiffness_knots:
        places, factors = np.transpose(shaft.stiffness_knots)
        profile = profile * np.interp(joints, places, factors)
    return profile


def build_rig(settings: WorldSettings, draw: Draw, segment_m: float = _SEGMENT_M) -> Rig:
    """Rod, in segments of about so much, and wall of a session.

    Raises ValueError where a drawn value has no physical meaning.
    """
    shaft, device = settings.shaft, draw.device
    segments = max(20, round(device.flexible_length_m / segment_m))
    joints = np.linspace(0.0, 1.0, segments + 1)
    relaxed = device.stiffness_nm2 / (1.0 + shaft.creep_share)  # EI is what answers at once
    rod = SpatialRod(
        flexible_length_m=device.flexible_length_m,
        bending_stiffness_nm2=relaxed,
        rigid_length_m=shaft.rigid_length_m,
        torsional_stiffness_nm2=shaft.torsion_over_bending * relaxed,
        precurvature_per_m=np.array([0.0, draw.out_of_plane_per_m, 0.0]),
        stiffening_curvature_per_m=shaft.stiffening_curvature_per_m,
        stiffness_profile=_profile(shaft, joints),
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
            side_stiffness_n_per_m2=settings.wall.side_stiffness_n_per_m2,
        ),
        forward=forward,
        across=np.array([-forward[1], forward[0], 0.0]),
        touch_m=centre + radius * normal,
        touch_reach_m=float(centre @ normal),
        support_curvature_per_m=curvatures,
        support_m=support,
        settings=settings,
    )
