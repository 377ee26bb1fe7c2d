"""A minute at a bench without images: lines of a rod under known forces, a beating wall, a knob that turns."""

from collections.abc import Callable

import numpy as np
import pytest
from tests.oracles.planar_rod import solve_static

from tipforce.calibration import CalibrationSession
from tipforce.estimators.session import LineFrame
from tipforce.io import ClockMap, Inertia, Tare
from tipforce.mechanics import PlanarRod, Play
from tipforce.types import (
    STAGE_ACROSS,
    STAGE_FORWARD,
    ActuationInfo,
    BasePose,
    Catheter,
    CentrelinePx,
    DetectedShape,
    SensorInfo,
    SessionInfo,
    Status,
    ViewInfo,
)

SCALE = 2e-4
STIFFNESS, GAIN, OFFSET, PLAY, TISSUE = 4.6e-4, 0.55, 0.4, 1.6, 130.0
"""What is true; the metadata state a stiffness of 4.3e-4 N m^2 and a gain of 0.533."""
DOME = 1.165e-3
"""Radius of the tip, m."""
INFO = SessionInfo(
    "made",
    Catheter(diameter_m=2.33e-3, flexible_length_m=0.04, rigid_length_m=0.008, bending_stiffness_nm2=4.3e-4),
    {"camera": ViewInfo(SCALE, "left")},
    SensorInfo(45.0, "tip-on-tissue", moving_mass_kg=0.05),
    ActuationInfo(0.533),
)


def make_session(*, turned_deg: float = 0.0, contact: bool = True, moving_knob: bool = True) -> CalibrationSession:
    """150 frames in 19 s. ``turned_deg``: by so much the sensor's stated angle is too small."""
    rng, count = np.random.default_rng(0), 150
    seconds = np.arange(count) / 8.0
    knob = 14.0 + 8.0 * np.sin(2 * np.pi * seconds / 9.0) if moving_knob else np.full(count, 10.0)
    curvature = OFFSET + GAIN * Play(PLAY, output=float(knob[0])).run(knob)
    normal = np.array([-np.cos(0.7), -np.sin(0.7)])
    depth = np.maximum(0.0, 2.2e-3 * np.sin(2 * np.pi * 1.13 * seconds)) if contact else np.zeros(count)
    slip = 0.2 * np.sin(2 * np.pi * 0.41 * seconds)
    force = (TISSUE * depth)[:, None] * (normal + slip[:, None] * np.array([-normal[1], normal[0]]))
    frame = LineFrame((640, 480), "left", SCALE)
    shapes, lines, domes = [], [], []
    base = BasePose(np.array([-0.5, 239.5]), 0.0)
    for k in range(count):
        rod = PlanarRod(
            0.04, STIFFNESS, 0.008 - DOME, curvature[k], stiffening_curvature_per_m=4.5e-4**-0.5, segments=60
        )
        points = solve_static(rod, force[k]).centreline_m(np.linspace(0.0, 0.048 - DOME, 63))
        axis = points[-1] - points[-4]
        axis /= np.linalg.norm(axis)
        points = np.vstack([points, points[-1] + DOME * axis])  # the wall pushes through the middle of the dome
        image = CentrelinePx(points / SCALE * (1.0, -1.0) + base.origin_px + rng.normal(0.0, 0.02, (64, 2)))
        shapes.append(DetectedShape(Status.VALID, "", image, base, 11.65))
        lines.append(frame.line(image))
        domes.append(points[-2])
    dome = np.array(domes)
    # where the wall stands: in contact as deep as it is, else somewhere out of reach
    stage = dome @ normal + np.where(depth > 0.0, depth, -2e-3)
    turn = np.radians(-turned_deg)
    c, s = np.cos(turn), np.sin(turn)
    turning = np.array([[c, s], [-s, c]])
    stamps = (seconds * 1e9).astype(np.int64)
    nothing = np.zeros((count, 2))
    return CalibrationSession(
        name="made",
        info=INFO,
        view="camera",
        stamp_ns=stamps,
        shapes=shapes,
        lines=lines,
        scale_m_per_px=SCALE,
        dome_m=dome,
        diameter_px=np.full(count, 11.65),
        force_n=(force + rng.normal(0.0, 2e-3, force.shape)) @ turning,
        rate_n_per_s=nothing,
        past_n=nothing,
        knob_deg=knob,
        knob_series=(stamps, knob),
        stage_names=(STAGE_FORWARD, STAGE_ACROSS),
        stage_m=np.stack([stage, np.zeros(count)], axis=1),
        stage_m_per_s=np.gradient(np.stack([stage, np.zeros(count)], axis=1), seconds, axis=0),
        stage_to_base=np.stack([normal, [normal[1], -normal[0]]], axis=1) if not turned_deg else turning.T,
        stage_angle_std_rad=0.01,
        clock_map=ClockMap(40_000_000, "estimated", 0.6, 0.99),
        tare=Tare(np.array([0.1, 0.0, 0.0]), np.full(3, 5e-4), ((0.0, 5.0),), "stated"),
        inertia=Inertia((STAGE_FORWARD, STAGE_ACROSS), np.array([[0.05, 0.0, 0.0], [0.0, 0.05, 0.0]]), 0, "estimated"),
        mass_std_kg=np.array([1e-3, 2e-3]),
        frames=count,
    )


@pytest.fixture(scope="session")
def session() -> CalibrationSession:
    return make_session()


@pytest.fixture(scope="session")
def made() -> Callable[..., CalibrationSession]:
    return make_session
