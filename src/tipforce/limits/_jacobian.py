"""Derivatives of the detected centreline by each unknown parameter, and the data of a session that they need."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from pydantic import ValidationError
from scipy.interpolate import CubicSpline

from ..geometry import arc_length
from ..mechanics import contact_derivatives
from ..simulation import CameraImaging, SimulatedBench, SimulationSettings, Truth
from ..simulation.rendering.camera import Lens
from ..simulation.world import BenchModel, DeviceProperties, SessionParameters, build_bench_model
from ..types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, slots=True, eq=False)
class BoundInputs:
    """Data of a session for the bound, at its m frames; see `Truth` for the arrays.

    Attributes:
        session: name of the session.
        settings: settings of the simulation.
        bench_model: rod, wall and parameters of the session.
        lens: the camera.
        stamp_ns: (m,) stamps.
        force_n: (m, 3) force of the tissue on the tip, base frame.
        touch_m: (m, 3) point of contact, base frame.
        touching: (m,) whether the tip is in contact.
        lines_m: (m, p, 3) centreline in metres, base frame.
        curvature_per_m: (m,) curvature that the knob sets.
        knob_deg: (m,) angle of the knob.
    """

    session: str
    settings: SimulationSettings
    bench_model: BenchModel
    lens: Lens
    stamp_ns: IntArray
    force_n: FloatArray
    touch_m: FloatArray
    touching: BoolArray
    lines_m: FloatArray
    curvature_per_m: FloatArray
    knob_deg: FloatArray

    @property
    def time_s(self) -> FloatArray:
        """(m,) time in s since the first frame."""
        return (self.stamp_ns - self.stamp_ns[0]) * 1e-9

    @property
    def contact_angle_deg(self) -> FloatArray:
        """(m,) angle between the tip's axis and the direction into the wall."""
        axis = self.lines_m[:, -1] - self.lines_m[:, -2]
        cosine = axis @ self.bench_model.wall.normal / np.linalg.norm(axis, axis=1)
        return np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))


def bound_inputs(source: Truth | SimulatedBench) -> BoundInputs:
    """Collects the inputs of the bound from a ground truth, or from the bench itself; no image is rendered.

    Raises:
        ValueError: the session has X-ray images, or the ground truth has settings of another version.
    """
    if isinstance(source, Truth):
        stated = {name: value for name, value in source.settings.items() if name not in ("seed", "number")}
        try:
            settings = SimulationSettings.model_validate(stated)
        except ValidationError as error:
            key = ".".join(str(part) for part in error.errors()[0]["loc"])
            raise ValueError(
                f"its truth was made with settings that one camera's bench does not have ({key})"
            ) from None
        values: Mapping[str, Any] = source.values
        parameters = SessionParameters(
            device=DeviceProperties(**_part(DeviceProperties, values)), **_part(SessionParameters, values)
        )
        return BoundInputs(
            session=source.session,
            settings=settings,
            bench_model=build_bench_model(settings.world, parameters),
            lens=Lens(**_part(Lens, values["lens"])),
            stamp_ns=source.stamp_ns,
            force_n=source.force_n,
            touch_m=source.touch_m,
            touching=source.touching,
            lines_m=source.centreline_m,
            curvature_per_m=source.curvature_per_m,
            knob_deg=source.knob_deg,
        )
    if not isinstance(source.settings, SimulationSettings) or not isinstance(source.imaging, CameraImaging):
        raise ValueError(f"the bound is for images of one camera; {source.settings.preset} has X-ray images")
    times, trajectory, interpolator = source.frame_s, source.session.trajectory, source.interpolator
    return BoundInputs(
        session=source.name,
        settings=source.settings,
        bench_model=source.session.bench_model,
        lens=source.imaging.scene.lens,
        stamp_ns=source.stamp_ns,
        force_n=interpolator.at(trajectory.contact.force_n, times),
        touch_m=interpolator.at(trajectory.contact.touch_m, times),
        touching=trajectory.contact.touching[interpolator.nearest(times)],
        lines_m=interpolator.lines_m(times),
        curvature_per_m=interpolator.at(trajectory.curvature_per_m, times),
        knob_deg=interpolator.at(trajectory.knob_deg, times),
    )


def _part(kind: type[Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the entries of ``values`` that are fields of the dataclass ``kind``; lists of a file become tuples."""
    found = {field.name: values[field.name] for field in fields(kind) if field.name in values}
    return {name: tuple(value) if isinstance(value, list) else value for name, value in found.items()}


POINTS = 33
"""Number of points of the detected centreline, from the image's border to the tip."""


def perturb_lens(lens: Lens, name: str, step: float) -> Lens:
    """Returns ``lens`` with one of the camera's parameters changed.

    Args:
        lens: the camera.
        name: name of the parameter.
        step: change, in the unit of the parameter.
    """
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
    "base, right": 1e-6, "base, down": 1e-6, "base, turn": 1e-5, "camera, yaw": 1e-5, "camera, pitch": 1e-5,
    "camera, distance": 1e-5, "lens, k1": 1e-4, "lens, p1": 1e-5, "lens, p2": 1e-5, "scale": 1e-5,
}  # fmt: skip
"""Steps of the central differences, in the units of the parameters; see `unknown_parameters`."""


def centreline_jacobian(inputs: BoundInputs) -> tuple[dict[str, FloatArray], FloatArray, BoolArray]:
    """Returns the derivatives of the centreline by each parameter, its arc lengths, and where the shape is stable.

    Args:
        inputs: data of the session.

    Returns:
        Parameter name -> (m, POINTS + 1) derivatives: displacement of the centreline in the image, in metres of the
        catheter's plane per unit of the parameter; across the line at each point (left positive, base to tip), and last
        along the line at the tip. Then the points' arc lengths in metres (POINTS,), and (m,) whether the shape under a
        force of constant direction is stable.
    """
    settings, bench_model, lens = inputs.settings, inputs.bench_model, inputs.lens
    width, height = settings.width, settings.height
    camera, shaft = lens.camera(width, height), settings.world.shaft
    scale = lens.scale_m_per_px * 640.0 / width  # m/px; the lens states it for 640 columns
    first_m = _first_visible_m(inputs)
    joints = np.linspace(0.0, 1.0, bench_model.rod.segments + 1)
    curvature = inputs.curvature_per_m
    zero = np.zeros_like(curvature)
    derivatives = contact_derivatives(
        bench_model.rod,
        inputs.lines_m,
        inputs.force_n,
        inputs.touch_m,
        np.linspace(first_m, bench_model.rod.length_m, POINTS),
        tip_radius_m=bench_model.radius_m,
        precurvature_change_per_m=np.stack([zero, zero, curvature], axis=1),
        stiffness_patterns=np.stack([np.ones(joints.size), (joints < 1 / 3).astype(np.float64)]),
        time_s=inputs.time_s,
        creep=shaft.creep_share,
        creep_time_s=shaft.creep_s,
    )
    frames = len(curvature)
    # An advance of the clamp moves the whole rod.
    positions = (derivatives.centreline_m + inputs.lines_m[:, :1]).reshape(-1, 3)
    pixels, slopes = camera.project_with_slopes(positions)
    pixels, slopes = pixels.reshape(frames, POINTS, 2), slopes.reshape(frames, POINTS, 2, 3)
    tangent = CubicSpline(np.arange(POINTS), pixels, axis=1)(np.arange(POINTS), 1)
    tangent /= np.linalg.norm(tangent, axis=2, keepdims=True)
    left = np.stack([tangent[..., 1], -tangent[..., 0]], axis=2)  # v points down

    def row(moves: FloatArray) -> FloatArray:
        """Converts displacements (m, POINTS, 2) in px per unit to a row (m, POINTS + 1)."""
        across = np.sum(left * moves, axis=2)
        return scale * np.column_stack([across, np.sum(tangent[:, -1] * moves[:, -1], axis=1)])

    def of_rod(column: FloatArray) -> FloatArray:
        """Converts displacements (m, POINTS, 3) of the rod in m per unit to a row, through the camera."""
        return row((slopes @ column[..., None])[..., 0])

    per_curvature = of_rod(derivatives["precurvature"][..., 1])
    gain = settings.world.actuation.gain_per_m_deg * bench_model.parameters.knob_factor
    force_size = np.linalg.norm(inputs.force_n, axis=1)
    rows = {
        "force along the base tangent": of_rod(derivatives["force"][..., 0]),
        "force across it in the image": of_rod(derivatives["force"][..., 1]),
        "force in depth": of_rod(derivatives["force"][..., 2]),
        "place of the touch on the dome": force_size[:, None] * of_rod(derivatives["moment"][..., 2]),
        "stiffness EI": of_rod(derivatives["stiffness"][..., 0]),
        "proximal stiffening": of_rod(derivatives["stiffness"][..., 1]),
        "creep, relative": of_rod(derivatives["creep"][..., 0]),
        "free length": of_rod(derivatives["length"][..., 0]),
        "knob factor": curvature[:, None] * per_curvature,
        "knob drift": curvature[:, None] * per_curvature,
        "place in the backlash": gain * per_curvature,
        "bend out of the plane": of_rod(derivatives["precurvature"][..., 0]),
    }
    for name, step in _CAMERA_STEPS.items():  # central differences
        more, less = (
            perturb_lens(lens, name, signed).camera(width, height).project(positions) for signed in (step, -step)
        )
        rows[name] = row(((more - less) / (2 * step)).reshape(frames, POINTS, 2))
    arc = scale * arc_length(pixels[0])
    return rows, arc, derivatives.stable


def _first_visible_m(inputs: BoundInputs) -> float:
    """Returns the arc length in m at which the shaft enters the image in the first frame; the base is outside."""
    line, settings = inputs.lines_m[0], inputs.settings
    pixels = inputs.lens.camera(settings.width, settings.height).project(line)
    last_px = np.array([settings.width - 1, settings.height - 1])
    inside_px = np.minimum(pixels, last_px - pixels).min(axis=1)  # distance inside the image
    first = int(np.argmax(inside_px >= 0))
    if first:  # between two points: where the distance to the border is 0
        first -= inside_px[first] / (inside_px[first] - inside_px[first - 1])
    return float(first) * inputs.bench_model.rod.length_m / (len(line) - 1)
