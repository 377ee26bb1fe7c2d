"""The model of a session's bench: rod, wall, point of first contact, and the smooth centreline through the nodes."""

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.interpolate import CubicSpline

from ...mechanics import SpatialRod, SpatialWall, damping_of_loss_factor
from ...types import FloatArray
from ._parameters import SessionParameters
from .settings import ShaftSettings, WallSettings, WorldSettings

_SEGMENT_M = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class BenchModel:
    """A session's rod and wall, and the point of first contact. Directions in the base frame.

    Attributes:
        parameters: the drawn parameters of the session.
        rod: the catheter.
        wall: the tissue.
        forward: (3,) axis of the stage into the nominal wall; the tissue moves against it when the stage goes forward.
        across: (3,) the stage's other axis.
        touch_m: (3,) point of the wall's surface when it just touches the tip at the start of the session.
        touch_reach_m: distance of the dome's centre from the clamp along the wall's normal, at first contact.
        support_curvature_per_m: (k,) curvatures of the unloaded shaft.
        support_m: (k,) distance of the dome's centre along the wall's normal at these curvatures.
        settings: settings of the world.
    """

    parameters: SessionParameters
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
        """Radius of the electrode and its dome."""
        return 0.5 * self.parameters.device.diameter_m

    def directed(self, stage: FloatArray) -> FloatArray:
        """Returns positions (m, 2) on the stage's axes in the base frame (m, 3); forward is against the tip."""
        return times(stage, np.stack([-self.forward, self.across]))

    def curvature_per_m(self, transmitted_deg: FloatArray, drift: FloatArray) -> FloatArray:
        """Returns the curvature of the unloaded shaft in its plane of bending.

        Args:
            transmitted_deg: (m,) angle of the knob behind its play.
            drift: (m,) relative drift of the curvature.

        Returns:
            (m,) curvatures.
        """
        return self.settings.actuation.gain_per_m_deg * self.parameters.knob_factor * transmitted_deg * (1.0 + drift)

    def reach_m(self, curvature_per_m: FloatArray) -> FloatArray:
        """Returns the reach of the unloaded dome beyond first contact, along the stage.

        Args:
            curvature_per_m: (m,) curvature of the unloaded shaft.

        Returns:
            (m,) distances.
        """
        reach = np.interp(curvature_per_m, self.support_curvature_per_m, self.support_m)
        return (reach - self.touch_reach_m) / float(self.forward @ self.wall.normal)


def _tip_of(rod: SpatialRod, curvature_per_m: float, radius_m: float) -> tuple[FloatArray, FloatArray]:
    """Returns the centre (3,) of the dome in m and the direction (3,) of the electrode, without load; base frame."""
    strain = np.asarray(rod.precurvature_per_m) + np.array([0.0, 0.0, curvature_per_m])
    nodes = rod.nodes_m(replace(rod, precurvature_per_m=strain).unloaded_quaternions)
    axis = nodes[-1] - nodes[-2]
    axis /= np.linalg.norm(axis)
    return nodes[-1] - radius_m * axis, axis


def _profile(shaft: ShaftSettings, joints: FloatArray) -> FloatArray:
    """Returns the factors on EI at ``joints`` (k,), given as shares of the flexible length."""
    profile = np.where(joints < 1 / 3, 1.0 + shaft.proximal_stiffer, 1.0)
    if shaft.stiffness_knots:
        knots, factors = np.transpose(shaft.stiffness_knots)
        profile = profile * np.interp(joints, knots, factors)
    return profile


def _rest(shaft: ShaftSettings, out_of_plane_per_m: float, joints: FloatArray) -> FloatArray:
    """Returns the strain (k, 3) without load and with the knob at 0 at ``joints`` (k,), shares of the flexible length.

    Its components in 1/m: twist (0), bending out of the knob's plane, bending in that plane.
    """
    rest = np.zeros((len(joints), 3))
    rest[:, 1] = out_of_plane_per_m
    if shaft.rest_curvature_per_m:
        knots = np.linspace(0.0, 1.0, len(shaft.rest_curvature_per_m))
        rest[:, 2] = np.interp(joints, knots, shaft.rest_curvature_per_m)
    return rest


def build_bench_model(
    settings: WorldSettings, parameters: SessionParameters, segment_m: float = _SEGMENT_M
) -> BenchModel:
    """Builds rod and wall of a session.

    Args:
        settings: settings of the world.
        parameters: the drawn parameters.
        segment_m: approximate length of the rod's segments.

    Returns:
        The bench model.

    Raises:
        ValueError: a drawn value has no physical meaning.
    """
    shaft, device = settings.shaft, parameters.device
    segments = max(20, round(device.flexible_length_m / segment_m))
    joints = np.linspace(0.0, 1.0, segments + 1)
    relaxed_nm2 = device.stiffness_nm2 / (1.0 + shaft.creep_share)  # the drawn EI is the instantaneous one
    rod = SpatialRod(
        flexible_length_m=device.flexible_length_m,
        bending_stiffness_nm2=relaxed_nm2,
        rigid_length_m=shaft.rigid_length_m,
        torsional_stiffness_nm2=shaft.torsion_over_bending * relaxed_nm2,
        precurvature_per_m=_rest(shaft, parameters.out_of_plane_per_m, joints),
        stiffening_curvature_per_m=shaft.stiffening_curvature_per_m,
        stiffness_profile=_profile(shaft, joints),
        segments=segments,
    )
    gain = settings.actuation.gain_per_m_deg * parameters.knob_factor
    start_curvature = gain * (parameters.knob_low_deg + parameters.play_start_deg)
    radius_m = 0.5 * device.diameter_m
    # The stage's axis is in the image plane, at the contact angle to the unloaded tip; the tissue's normal is tilted.
    centre_m, axis = _tip_of(rod, start_curvature, radius_m)
    angle_rad = math.atan2(axis[1], axis[0]) + math.radians(parameters.contact_angle_deg)
    forward = np.array([math.cos(angle_rad), math.sin(angle_rad), 0.0])
    tilt_rad = math.radians(parameters.tilt_deg)
    normal = math.cos(tilt_rad) * forward + np.array([0.0, 0.0, math.sin(tilt_rad)])
    # Curvatures of all knob angles of the session, with a margin for play and drift.
    margin = 0.2 * abs(gain) * max(parameters.knob_high_deg, 1.0) + 5.0
    curvatures = np.linspace(gain * parameters.knob_low_deg - margin, gain * parameters.knob_high_deg + margin, 60)
    support = np.array([_tip_of(rod, float(c), radius_m)[0] @ normal for c in curvatures])
    return BenchModel(
        parameters=parameters,
        rod=rod,
        wall=_wall(settings.wall, parameters, normal),
        forward=forward,
        across=np.array([-forward[1], forward[0], 0.0]),
        touch_m=centre_m + radius_m * normal,
        touch_reach_m=float(centre_m @ normal),
        support_curvature_per_m=curvatures,
        support_m=support,
        settings=settings,
    )


def _wall(settings: WallSettings, parameters: SessionParameters, normal: FloatArray) -> SpatialWall:
    """Makes the tissue with ``normal`` (3,) into it; drawn parameters replace the settings where they are given."""
    stiffness = parameters.wall_stiffness_n_per_m
    loss = settings.loss_factor if parameters.loss_factor is None else parameters.loss_factor
    radius = parameters.face_radius_m
    return SpatialWall(
        normal=normal,
        stiffness_n_per_m=stiffness,
        damping_ns_per_m=damping_of_loss_factor(stiffness, loss, settings.loss_hz),
        friction=parameters.friction,
        hertz_depth_m=settings.law_depth_m if parameters.law == "hertz" else None,
        side_stiffness_n_per_m2=settings.side_stiffness_n_per_m2,
        exponential_depth_m=settings.law_depth_m if parameters.law == "exponential" else None,
        face_radius_m=-radius if radius is not None and parameters.face == "concave" else radius,
    )


@lru_cache(maxsize=16)
def _weights(segments: int, flexible_m: float, length_m: float, points: int) -> tuple[FloatArray, FloatArray]:
    """Returns weights (points, segments + 3) of nodes and end slopes, and lengths (points,) beyond the shaft's end."""
    # A spline is linear in its nodes and end slopes: that of the unit matrix gives the weight of each of them.
    node_arc_m = np.linspace(0.0, flexible_m, segments + 1)
    unit = np.eye(segments + 3)
    spline = CubicSpline(node_arc_m, unit[: segments + 1], bc_type=((1, unit[-2]), (1, unit[-1])))  # pyright: ignore[reportArgumentType]
    arc_m = np.linspace(0.0, length_m, points)
    return spline(np.minimum(arc_m, flexible_m)), np.maximum(arc_m - flexible_m, 0.0)


def smooth_centrelines(
    rod: SpatialRod, quaternions: FloatArray, points: int, advance_m: float | FloatArray = 0.0
) -> FloatArray:
    """Returns smooth centrelines, base to tip, uniform in arc length, base frame.

    It is a cubic spline through the ends of the shaft's segments, tangent to clamp and electrode, then the straight
    electrode. The corners of a polyline with segments of 1 mm would deviate by 0.01 px.

    Args:
        rod: the rod.
        quaternions: (k, segments + 1, 4) orientations of its elements.
        points: number of points of a centreline.
        advance_m: (k,) advance of the clamp along x.

    Returns:
        (k, points, 3) points.
    """
    nodes = rod.nodes_m(quaternions, advance_m)
    axis = (nodes[:, -1:] - nodes[:, -2:-1]) / rod.rigid_length_m
    clamp = np.tile([1.0, 0.0, 0.0], (len(nodes), 1, 1))
    weights, beyond = _weights(rod.segments, rod.flexible_length_m, rod.length_m, points)
    return weights @ np.concatenate([nodes[:, :-1], clamp, axis], axis=1) + beyond[:, None] * axis


def times(rows: FloatArray, matrix: FloatArray) -> FloatArray:
    """Multiplies two matrices so that a row's product does not depend on the number of rows.

    The library rounds the product of a single row differently from that of two and more.

    Args:
        rows: (n, k) matrix.
        matrix: (k, m) matrix.

    Returns:
        (n, m) product.
    """
    many = rows if len(rows) != 1 else np.repeat(rows, 2, axis=0)
    return (many @ matrix)[: len(rows)]
