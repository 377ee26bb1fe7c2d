"""The settings of a simulated fluoroscopy session, and the scene that is drawn from them.

A range is (low, high): one uniform draw a session.
"""

import math
import operator
from dataclasses import replace
from typing import Literal

import numpy as np
from pydantic import Field

from ....geometry import CArm, Pose
from ....types import FloatArray
from ..._fields import NotNegative, Positive, Range, Settings, Share, Some
from ._c_arm_error import perturbed
from ._instrument_variety import varied_catheter, varied_instruments
from ._scene import Anatomy, CatheterConstruction, Detector, Instrument, Rhythm, XrayBeam, XrayScene, XrayView
from ._variety import XrayVarietyRanges, sample_variety, uniform


class XrayRanges(Settings):
    """Ranges of fluoroscopy from session to session. The defaults are the preset ``fluoro``: one view."""

    planes: Literal[1, 2] = 1
    between_planes_deg: Range = (80.0, 100.0)
    calibration_px: NotNegative = 0.5
    """RMS over the working volume by which the stated calibration is off, at 512 columns."""

    primary_deg: Range = (-45.0, 45.0)
    """LAO positive."""
    secondary_deg: Range = (-15.0, 25.0)
    """Cranial positive."""
    roll_deg: Range = (-1.0, 1.0)
    source_detector_m: Range = (1.00, 1.18)
    source_object_m: Range = (0.70, 0.78)
    scale_m_per_px: Range = (0.24e-3, 0.26e-3)
    """At the isocentre, at 512 columns."""
    centre_px: Range = (-6.0, 6.0)

    photons: Range = (20.0, 500.0)
    """A pixel, detected. Drawn uniformly in its logarithm: every factor of dose is as likely."""
    pulse_s: Range = (5e-3, 10e-3)
    rate_hz: Positive = 15.0
    focal_spot_m: Range = (0.15e-3, 0.30e-3)
    """Sigma: about a third of the nominal focal spot."""
    control_s: Range = (0.2, 0.6)

    scatter: Range = (0.25, 0.8)
    """Over direct photons, behind the grid."""
    scatter_m: Range = (20e-3, 40e-3)
    glare: Range = (0.01, 0.06)
    glare_m: Range = (30e-3, 60e-3)
    blur_px: Range = (0.45, 0.7)
    blur_tail_px: Range = (1.2, 2.2)
    blur_tail: Range = (0.1, 0.3)
    lag_fast: Range = (0.01, 0.10)
    lag_fast_keep: Range = (0.1, 0.4)
    lag_slow: Range = (0.0, 0.02)
    lag_slow_keep: Range = (0.6, 0.8)
    electronic: Range = (0.8, 3.0)
    line_noise: Range = (0.0, 0.4)
    linear_display: Share = 0.25
    """Sessions shown on a linear curve; the others on a logarithmic one."""
    log_contrast: Range = (48.0, 80.0)
    """Grey levels (of 256) for a factor e in the light."""
    linear_level: Range = (85.0, 120.0)
    """Grey level of the field's mean."""

    base_side: Literal["left", "right", "top", "bottom"] = "bottom"
    base_inset_m: Range = (-1.6e-3, -1.6e-3)
    """Distance of the base inside the first view's border; negative: beyond it. Inside, the sheath is in view."""
    base_shift_m: Range = (-10e-3, 10e-3)
    """Along that border."""
    base_turn_deg: Range = (-12.0, 12.0)
    base_tilt_deg: Range = (-8.0, 8.0)
    """Out of the first view's plane."""

    diameter_m: Range = (1.67e-3, 2.67e-3)
    electrode_m: Positive = 8e-3
    ring_m: Positive = 2e-3
    ring_gap_m: Positive = 2.5e-3
    barium_sulphate: Range = (0.18, 0.38)
    wall: Range = (0.22, 0.34)
    braid: Range = (0.2, 0.5)
    core: Range = (0.01, 0.06)
    uneven: Range = (0.0, 0.08)

    devices: Some = (1, 4)
    """Wires, diagnostic catheters and leads that cross the image."""
    probe: Share = 0.12
    """Sessions with an ultrasound probe in the oesophagus."""
    sway_m: Range = (1e-3, 5e-3)
    heart_hz: Range = (1.0, 1.5)
    breath_hz: Range = (0.2, 0.3)
    breath_m: Range = (2e-3, 14e-3)
    beat: Range = (0.01, 0.05)
    spine_x_m: Range = (-45e-3, -15e-3)
    spine_y_m: Range = (62e-3, 85e-3)
    bone: Range = (0.7, 1.2)
    lung: Range = (0.5, 1.0)
    dome_m: Range = (-75e-3, -45e-3)
    heart_size: Range = (0.85, 1.2)
    sternal_wires: Share = 0.35
    leads: Some = (0, 3)
    variety: XrayVarietyRanges | None = Field(default=None, exclude_if=operator.not_)
    """Differences between laboratories; None: an even image without collimator, processing and table."""


FLUORO = XrayRanges()
"""One view."""
BIPLANE = XrayRanges(planes=2, scatter=(0.4, 1.1))
"""Two views, 90 +- 10 degrees apart; each scatters into the other."""
FLUORO_VARIED = XrayRanges(
    variety=XrayVarietyRanges(),
    primary_deg=(-60.0, 60.0), secondary_deg=(-30.0, 30.0), roll_deg=(-3.0, 3.0),
    source_detector_m=(0.95, 1.25), source_object_m=(0.66, 0.84),
    scale_m_per_px=(0.17e-3, 0.30e-3), centre_px=(-25.0, 25.0),
    photons=(15.0, 600.0), pulse_s=(4e-3, 15e-3), blur_px=(0.4, 1.0), lag_fast=(0.0, 0.12),
    linear_display=0.4, linear_level=(50.0, 130.0), log_contrast=(40.0, 95.0),
    base_inset_m=(-4e-3, 22e-3), base_shift_m=(-20e-3, 20e-3), base_turn_deg=(-25.0, 25.0),
    devices=(0, 3), probe=0.15, bone=(0.6, 1.5), sternal_wires=0.35, leads=(0, 4),
)  # fmt: skip
"""One view, as it differs from laboratory to laboratory."""
BIPLANE_VARIED = FLUORO_VARIED.model_copy(
    update={"planes": 2, "between_planes_deg": (60.0, 100.0), "scatter": (0.4, 1.1)}
)
"""Two views, 60 to 100 degrees apart, as they differ from laboratory to laboratory."""
_TURNS = {"left": 0.0, "right": math.pi, "top": -0.5 * math.pi, "bottom": 0.5 * math.pi}
_HALF_PX = 256.0
_ROUTE_SHARES = {"wire": 0.3, "sinus": 0.3, "ventricle": 0.25, "lead": 0.15}
"""Probability of each route of an instrument: a guide wire to the upper left or right of the heart, a catheter into the
coronary sinus, a catheter into the ventricle, a lead from above."""
_KINDS = {"wire": "wire", "sinus": "diagnostic", "ventricle": "diagnostic", "lead": "lead"}
"""Kind of instrument that takes a route, see `Instrument`."""
_WIRE_SPREAD_MM, _OTHER_SPREAD_MM = 2.5, 5.0
"""Standard deviation of the points of a route about their usual places: of a guide wire, and of other instruments."""
_PROBE_KNOTS_MM = ((-8, 48, 110), (-6, 46, 60), (-4, 44, 20), (0, 42, -8))
"""Axis of the ultrasound probe in the oesophagus, from above. The patient's frame: x left, y back, z to the head."""
_PROBE_RADIUS_M = (4.5e-3, 6e-3)
_PROBE_SWAY_M = 0.5e-3
_PROBE_SPREAD_MM = 3.0
Rows = list[tuple[float, float, float]]


def sample_xray_scene(
    ranges: XrayRanges, rng: np.random.Generator, catheter_rng: np.random.Generator | None = None
) -> XrayScene:
    """Draws the scene of one session.

    Args:
        ranges: ranges from which the scene is drawn.
        rng: random numbers of the scene.
        catheter_rng: random numbers of the catheter, in a varied scene; None: ``rng``.

    Returns:
        The scene.

    >>> one, two = (sample_xray_scene(XrayRanges(), np.random.default_rng(3)) for _ in range(2))
    >>> one == two
    True
    """
    views = _views(ranges, rng)
    pose = _base(ranges, rng, views[0].true)
    anatomy = _anatomy(ranges, rng)
    turn, place = pose.axis_angle_rad, pose.translation_m
    scene = XrayScene(
        seed=int(rng.integers(2**31)),
        views=views,
        base_axis_angle=(float(turn[0]), float(turn[1]), float(turn[2])),
        base_m=(float(place[0]), float(place[1]), float(place[2])),
        catheter=_catheter(ranges, rng),
        devices=_instruments(ranges, rng),
        rhythm=Rhythm(
            heart_hz=uniform(rng, ranges.heart_hz),
            breath_hz=uniform(rng, ranges.breath_hz),
            beat=uniform(rng, ranges.beat),
            breath_m=uniform(rng, ranges.breath_m),
            heart_phase=rng.random(),
            breath_phase=rng.random(),
        ),
        anatomy=anatomy,
    )
    return scene if ranges.variety is None else _varied(ranges.variety, scene, rng, catheter_rng or rng)


def _varied(
    ranges: XrayVarietyRanges, scene: XrayScene, rng: np.random.Generator, catheter_rng: np.random.Generator
) -> XrayScene:
    """Adds the differences between laboratories to a scene.

    The base moves out of the isocentre's plane, and the stated geometry gets larger errors. The catheter is drawn from
    ``catheter_rng``, which all of its sessions share; everything else from ``rng``.
    """
    display_axes = scene.views[0].true.display_axes()
    depth_m = uniform(rng, ranges.depth_m) * display_axes[2]
    base_m = np.array(scene.base_m) + depth_m
    low, high = (math.log(x) for x in ranges.calibration_px)
    error_px = math.exp(rng.uniform(low, high))
    return replace(
        scene,
        views=tuple(replace(view, stated=perturbed(view.true, error_px, rng)) for view in scene.views),
        base_m=(float(base_m[0]), float(base_m[1]), float(base_m[2])),
        catheter=varied_catheter(ranges, scene.catheter, catheter_rng),
        devices=scene.devices + varied_instruments(ranges, rng),
        variety=sample_variety(ranges, rng, display_axes[0], display_axes[1], len(scene.views)),
    )


def _arm(ranges: XrayRanges, rng: np.random.Generator, primary_deg: float, secondary_deg: float) -> CArm:
    """Draws distances, scale, roll and principal point of a C-arm with these angles."""
    return CArm(
        primary_deg=primary_deg,
        secondary_deg=secondary_deg,
        source_detector_m=uniform(rng, ranges.source_detector_m),
        source_object_m=uniform(rng, ranges.source_object_m),
        scale_m_per_px=uniform(rng, ranges.scale_m_per_px),
        roll_deg=uniform(rng, ranges.roll_deg),
        centre_px=(uniform(rng, ranges.centre_px), uniform(rng, ranges.centre_px)),
    )


def _views(ranges: XrayRanges, rng: np.random.Generator) -> tuple[XrayView, ...]:
    """Draws one plane or two: C-arm with its stated position, beam, and one detector for all."""
    first = _arm(ranges, rng, uniform(rng, ranges.primary_deg), uniform(rng, ranges.secondary_deg))
    arms = [first]
    if ranges.planes == 2:
        # The second arm is across: its primary angle is found so that the central rays have the drawn angle.
        apart_deg, secondary_deg = uniform(rng, ranges.between_planes_deg), uniform(rng, (-5.0, 5.0))
        first_tilt, second_tilt = math.radians(first.secondary_deg), math.radians(secondary_deg)
        cosine = (math.cos(math.radians(apart_deg)) - math.sin(first_tilt) * math.sin(second_tilt)) / (
            math.cos(first_tilt) * math.cos(second_tilt)
        )
        primary_deg = first.primary_deg + math.degrees(math.acos(max(-1.0, min(1.0, cosine))))
        arms.append(_arm(ranges, rng, primary_deg, secondary_deg))
    pulse_s, detector = uniform(rng, ranges.pulse_s), _detector(ranges, rng)
    low, high = (math.log(x) for x in ranges.photons)  # the dose is uniform in its logarithm
    views: list[XrayView] = []
    for arm in arms:
        beam = XrayBeam(
            photons=math.exp(rng.uniform(low, high)),
            pulse_s=pulse_s,
            rate_hz=ranges.rate_hz,
            focal_spot_m=uniform(rng, ranges.focal_spot_m),
            control_s=uniform(rng, ranges.control_s),
        )
        views.append(XrayView(arm, perturbed(arm, ranges.calibration_px, rng), beam, detector))
    return tuple(views)


def _detector(ranges: XrayRanges, rng: np.random.Generator) -> Detector:
    """Draws scatter, glare, blur, lag, noise and display curve of a detector."""
    linear = rng.random() < ranges.linear_display
    return Detector(
        scatter=uniform(rng, ranges.scatter),
        scatter_m=uniform(rng, ranges.scatter_m),
        glare=uniform(rng, ranges.glare),
        glare_m=uniform(rng, ranges.glare_m),
        blur_px=(uniform(rng, ranges.blur_px), uniform(rng, ranges.blur_tail_px)),
        blur_tail=uniform(rng, ranges.blur_tail),
        lag=(
            (uniform(rng, ranges.lag_fast), uniform(rng, ranges.lag_fast_keep)),
            (uniform(rng, ranges.lag_slow), uniform(rng, ranges.lag_slow_keep)),
        ),
        electronic=uniform(rng, ranges.electronic),
        line_noise=uniform(rng, ranges.line_noise),
        curve="linear" if linear else "log",
        contrast=uniform(rng, ranges.linear_level if linear else ranges.log_contrast),
    )


def _base(ranges: XrayRanges, rng: np.random.Generator, arm: CArm) -> Pose:
    """Draws the pose of the base frame in the patient's frame.

    The base is in the plane of the first view (C-arm ``arm``) through the isocentre, near the middle of one side of the
    image; its tangent points inwards and is tilted a little out of that plane.
    """
    axes = arm.display_axes()  # rows: right, up, toward the viewer
    half_image_m = _HALF_PX * arm.scale_m_per_px
    inset_m, along_m = uniform(rng, ranges.base_inset_m), uniform(rng, ranges.base_shift_m)
    turn = _TURNS[ranges.base_side]
    inward, aside = np.array([math.cos(turn), math.sin(turn)]), np.array([-math.sin(turn), math.cos(turn)])
    centre_m = arm.scale_m_per_px * np.array([arm.centre_px[0], -arm.centre_px[1]])
    position_m = (inset_m - half_image_m) * inward + along_m * aside - centre_m
    tilt_rad = math.radians(uniform(rng, ranges.base_tilt_deg))
    spin_rad = turn + math.radians(uniform(rng, ranges.base_turn_deg))
    rotation = Pose.from_euler([rng.uniform(-0.1, 0.1), tilt_rad, spin_rad], np.zeros(3)).rotation
    return Pose(axes.T @ rotation, axes[:2].T @ position_m)


def _catheter(ranges: XrayRanges, rng: np.random.Generator) -> CatheterConstruction:
    """Draws radius and materials of a catheter with three rings at fixed distances behind its electrode."""
    pitch_m = ranges.ring_m + ranges.ring_gap_m
    first_m = ranges.electrode_m + ranges.ring_gap_m
    return CatheterConstruction(
        radius_m=0.5 * uniform(rng, ranges.diameter_m),
        electrode_m=ranges.electrode_m,
        rings_m=tuple((first_m + k * pitch_m, first_m + k * pitch_m + ranges.ring_m) for k in range(3)),
        barium_sulphate=uniform(rng, ranges.barium_sulphate),
        wall=uniform(rng, ranges.wall),
        braid=uniform(rng, ranges.braid),
        core=uniform(rng, ranges.core),
        uneven=uniform(rng, ranges.uneven),
    )


def _anatomy(ranges: XrayRanges, rng: np.random.Generator) -> Anatomy:
    """Draws position and relative densities of a patient's organs, and the number of wires and leads."""
    return Anatomy(
        spine_m=(uniform(rng, ranges.spine_x_m), uniform(rng, ranges.spine_y_m)),
        bone=uniform(rng, ranges.bone),
        lung=uniform(rng, ranges.lung),
        dome_m=uniform(rng, ranges.dome_m),
        heart_size=uniform(rng, ranges.heart_size),
        sternal_wires=int(rng.integers(4, 8)) if rng.random() < ranges.sternal_wires else 0,
        leads=int(rng.integers(ranges.leads[0], ranges.leads[1] + 1)),
    )


def _instruments(ranges: XrayRanges, rng: np.random.Generator) -> tuple[Instrument, ...]:
    """Draws the other instruments in the heart, and in a share of the sessions an ultrasound probe behind it.

    Args:
        ranges: ``devices`` limits the number of instruments, ``sway_m`` their movement with the heart; ``probe`` is the
            probability of the probe.
        rng: random numbers.

    Returns:
        The instruments, the probe last.
    """
    found: list[Instrument] = []
    fewest, most = ranges.devices
    for _ in range(int(rng.integers(fewest, most + 1))):
        route = str(rng.choice(list(_ROUTE_SHARES), p=list(_ROUTE_SHARES.values())))
        knots_mm, radius_m = _route(route, rng)
        spread_mm = _WIRE_SPREAD_MM if route == "wire" else _OTHER_SPREAD_MM
        sway_m = uniform(rng, ranges.sway_m)
        found.append(_instrument(_KINDS[route], radius_m, knots_mm, rng, sway_m, spread_mm))
    if rng.random() < ranges.probe:
        radius_m, knots_mm = uniform(rng, _PROBE_RADIUS_M), np.array(_PROBE_KNOTS_MM, np.float64)
        found.append(_instrument("probe", radius_m, knots_mm, rng, _PROBE_SWAY_M, _PROBE_SPREAD_MM))
    return tuple(found)


def _route(route: str, rng: np.random.Generator) -> tuple[FloatArray, float]:
    """Returns the usual axis and the radius of an instrument.

    The venae cavae are at the patient's right, the coronary sinus is at the back left. The patient's frame: x left,
    y back, z to the head.

    Args:
        route: key of `_ROUTE_SHARES`.
        rng: random numbers of the radius and of the side of a wire.

    Returns:
        (k, 3) points of the axis in the patient's frame in mm, from its entry to its end; the radius in m.
    """
    if route == "wire":
        side = rng.choice([-1.0, 1.0])
        rows: Rows = [(-25, 25, -130), (-22, 20, -60), (-15, 10, -10), (5, 0, 25), (25, -5, 45), (32 * side, -8, 62)]
        rows += [(26 * side, -10, 72), (18 * side, -8, 66)]  # the J of its end
        return np.array(rows), 0.44e-3
    if route == "sinus":
        rows = [(-26, 22, -130), (-22, 20, -60), (-18, 18, -28), (-2, 24, -16), (20, 28, -8), (36, 26, 6), (44, 18, 22)]
        return np.array(rows), rng.uniform(0.85e-3, 1.05e-3)
    if route == "ventricle":
        rows = [(-28, 18, -130), (-24, 14, -60), (-16, 4, -18), (2, -14, -16), (22, -24, -28), (34, -28, -36)]
        return np.array(rows), rng.uniform(0.8e-3, 1.0e-3)
    # a lead, from above
    rows = [(-14, 10, 130), (-18, 8, 70), (-20, 6, 25), (-8, -8, -12), (14, -22, -30), (30, -30, -42)]
    return np.array(rows), rng.uniform(0.9e-3, 1.4e-3)


def _instrument(
    kind: str, radius_m: float, knots_mm: FloatArray, rng: np.random.Generator, sway_m: float, spread_mm: float
) -> Instrument:
    """Draws one instrument about its usual place.

    Args:
        kind: kind of instrument, see `Instrument`.
        radius_m: radius.
        knots_mm: (k, 3) points of the usual axis in the patient's frame.
        rng: random numbers.
        sway_m: displacement of its end with the heart; the direction is drawn.
        spread_mm: standard deviation of each point about its usual place; the whole axis is shifted by twice that.
    """
    knots_m = 1e-3 * (knots_mm + rng.normal(0, spread_mm, knots_mm.shape) + rng.normal(0, 2 * spread_mm, 3))
    sway = rng.normal(size=3)
    sway *= sway_m / float(np.linalg.norm(sway))
    return Instrument(
        kind=kind,
        radius_m=radius_m,
        knots=tuple((float(x), float(y), float(z)) for x, y, z in knots_m),
        sway_m=(float(sway[0]), float(sway[1]), float(sway[2])),
        phase=rng.random(),
    )
