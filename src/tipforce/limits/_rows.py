"""How what is seen of a catheter in the picture moves with each unknown."""

from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline

from ..geometry import arc_length
from ..mechanics import contact_derivatives
from ..simulation.rendering.camera import Lens
from ..types import BoolArray, FloatArray
from ._facts import Facts

__all__ = ["POINTS", "changed_lens", "seen_rows"]

POINTS = 33
"""Of the seen line, from the picture's border to the tip."""


def changed_lens(lens: Lens, name: str, step: float) -> Lens:
    """``lens`` with one of the camera's unknowns changed by ``step``, in its own unit."""
    match name:
        case "base, right":
            return replace(lens, base_at_m=(lens.base_at_m[0] + step, lens.base_at_m[1]))
        case "base, down":
            return replace(lens, base_at_m=(lens.base_at_m[0], lens.base_at_m[1] + step))
        case "base, turn":
            return replace(lens, base_turn_rad=lens.base_turn_rad + step)
        case "camera, yaw":
            return replace(lens, yaw_rad=lens.yaw_rad + step)
        case "camera, pitch":
            return replace(lens, pitch_rad=lens.pitch_rad + step)
        case "camera, distance":
            return replace(lens, distance_m=lens.distance_m + step)
        case "scale":
            return replace(lens, scale_m_per_px=lens.scale_m_per_px * (1 + step))
        case _:
            distortion = list(lens.distortion)
            distortion[{"lens, k1": 0, "lens, p1": 2, "lens, p2": 3}[name]] += step
            k1, k2, p1, p2, k3 = distortion
            return replace(lens, distortion=(k1, k2, p1, p2, k3))


_CAMERA_STEPS = {
    "base, right": 1e-6,
    "base, down": 1e-6,
    "base, turn": 1e-5,
    "camera, yaw": 1e-5,
    "camera, pitch": 1e-5,
    "camera, distance": 1e-5,
    "lens, k1": 1e-4,
    "lens, p1": 1e-5,
    "lens, p2": 1e-5,
    "scale": 1e-5,
}


def seen_rows(facts: Facts) -> tuple[dict[str, FloatArray], FloatArray, BoolArray]:
    """Slopes by the unknowns' names, (m, POINTS + 1) each; arc lengths of the points; where the shape is known (m,).

    A row says how far the line moves in the picture, in metres of the catheter's plane per unit of the unknown: across
    itself at each point, to the left as seen along it, and at last along itself at the tip.
    """
    settings, rig, lens = facts.settings, facts.rig, facts.lens
    width, height = settings.width, settings.height
    camera, shaft = lens.camera(width, height), settings.world.shaft
    scale = lens.scale_m_per_px * 640.0 / width
    begin = _first_seen_m(facts)
    joints = np.linspace(0.0, 1.0, rig.rod.segments + 1)
    curvature = facts.curvature_per_m
    nothing = np.zeros_like(curvature)
    found = contact_derivatives(
        rig.rod,
        facts.lines_m,
        facts.force_n,
        facts.touch_m,
        np.linspace(begin, rig.rod.length_m, POINTS),
        tip_radius_m=rig.radius_m,
        precurvature_change_per_m=np.stack([nothing, nothing, curvature], axis=1),
        stiffness_patterns=np.stack([np.ones(joints.size), (joints < 1 / 3).astype(np.float64)]),
        time_s=facts.time_s,
        creep=shaft.creep_share,
        creep_time_s=shaft.creep_s,
    )
    m = len(curvature)
    # Where the clamp has been advanced, the whole rod has.
    places = (found.centreline_m + facts.lines_m[:, :1]).reshape(-1, 3)
    pixels, slopes = camera.project_with_slopes(places)
    pixels, slopes = pixels.reshape(m, POINTS, 2), slopes.reshape(m, POINTS, 2, 3)
    tangent = CubicSpline(np.arange(POINTS), pixels, axis=1)(np.arange(POINTS), 1)
    tangent /= np.linalg.norm(tangent, axis=2, keepdims=True)
    left = np.stack([tangent[..., 1], -tangent[..., 0]], axis=2)  # v runs down

    def row(moves: FloatArray) -> FloatArray:
        """(m, POINTS, 2) px per unit -> (m, POINTS + 1)."""
        across = np.sum(left * moves, axis=2)
        return scale * np.column_stack([across, np.sum(tangent[:, -1] * moves[:, -1], axis=1)])

    def of_rod(column: FloatArray) -> FloatArray:
        return row((slopes @ column[..., None])[..., 0])

    knob = of_rod(found["precurvature"][..., 1])
    gain = settings.world.actuation.gain_per_m_deg * rig.draw.knob_factor
    size = np.linalg.norm(facts.force_n, axis=1)
    rows = {
        "force along the base tangent": of_rod(found["force"][..., 0]),
        "force across it in the picture": of_rod(found["force"][..., 1]),
        "force in depth": of_rod(found["force"][..., 2]),
        "place of the touch on the dome": size[:, None] * of_rod(found["moment"][..., 2]),
        "stiffness EI": of_rod(found["stiffness"][..., 0]),
        "proximal stiffening": of_rod(found["stiffness"][..., 1]),
        "creep, relative": of_rod(found["creep"][..., 0]),
        "free length": of_rod(found["length"][..., 0]),
        "knob factor": curvature[:, None] * knob,
        "knob drift": curvature[:, None] * knob,
        "place in the backlash": gain * knob,
        "bend out of the plane": of_rod(found["precurvature"][..., 0]),
    }
    for name, step in _CAMERA_STEPS.items():
        more, less = (changed_lens(lens, name, way).camera(width, height).project(places) for way in (step, -step))
        rows[name] = row(((more - less) / (2 * step)).reshape(m, POINTS, 2))
    arc = scale * arc_length(pixels[0])
    return rows, arc, found.stable


def _first_seen_m(facts: Facts) -> float:
    """Arc length at which the shaft comes into the picture; the base lies outside of it."""
    line, settings = facts.lines_m[0], facts.settings
    pixels = facts.lens.camera(settings.width, settings.height).project(line)
    far = np.array([settings.width - 1, settings.height - 1])
    inward = np.minimum(pixels, far - pixels).min(axis=1)  # how far inside the picture
    first = int(np.argmax(inward >= 0))
    if first:
        first -= inward[first] / (inward[first] - inward[first - 1])
    return float(first) * facts.rig.rod.length_m / (len(line) - 1)
