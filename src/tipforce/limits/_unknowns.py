"""What an estimator does not know of a session, and how well it knows it beforehand."""

import math
from dataclasses import dataclass

from ..simulation._ranges import Range
from ..simulation._settings import SimulationSettings
from ..simulation.world import Draw

__all__ = ["FORCE_STD_N", "LASTING", "Unknown", "unknowns_of"]

FORCE_STD_N = 0.3
"""Each in-plane component of the force beforehand: broad, and drawn anew in every frame."""
LASTING = "seeing, lasting"
"""The group of the seen line's errors that stay for a session."""


@dataclass(frozen=True, slots=True)
class Unknown:
    """One number that is not known: ``std`` in ``unit`` beforehand, of a Gaussian as wide as what it is drawn from.

    ``group``: those that are told together. ``memory_s``: correlation time; infinite: the same for a session; 0: anew
    in every frame. ``why``: where the width comes from.
    """

    name: str
    group: str
    std: float
    unit: str
    memory_s: float
    why: str


def _std(bounds: Range) -> float:
    """Of a uniform draw."""
    return (bounds[1] - bounds[0]) / math.sqrt(12)


def unknowns_of(settings: SimulationSettings, draw: Draw) -> tuple[Unknown, ...]:
    """All of them, the force's three components first; what is drawn the same in every session counts as known.

    So do the law of stiffening with curvature, GJ / EI, the electrode's length, the diameter, the width of the play
    and the camera's inset: an estimator can learn them from other sessions.
    """
    world, scene = settings.world, settings.scene
    shaft, actuation, wall, device = world.shaft, world.actuation, world.wall, draw.device
    sheet = 2 * shaft.known_to / math.sqrt(12)
    stiffness = shaft.nominal_stiffness_nm2
    firm = sheet if stiffness is None else _std(shaft.stiffness_nm2) / stiffness
    long = sheet * device.nominal_flexible_length_m
    if shaft.nominal_flexible_length_m is not None:
        long = _std(shaft.flexible_length_m)
    low, high = wall.friction
    drag = math.sqrt((low * low + low * high + high * high) / 3)  # root mean square of the uniform draw
    tilt = _std((math.radians(wall.tilt_deg[0]), math.radians(wall.tilt_deg[1])))
    degree, ever, anew = math.radians(1.0), math.inf, 0.0

    def told(bounds: Range, unit: str = "") -> str:
        return f"U({bounds[0]:g}, {bounds[1]:g}){unit and ' '}{unit}"

    off = f"sheet within {100 * shaft.known_to:g} %"
    return (
        Unknown("force along the base tangent", "force", FORCE_STD_N, "N", anew, "broad"),
        Unknown("force across it in the picture", "force", FORCE_STD_N, "N", anew, "broad"),
        Unknown("force in depth", "depth", FORCE_STD_N * tilt, "N", anew, f"wall's tilt {told(wall.tilt_deg, 'deg')}"),
        Unknown("place of the touch on the dome", "touch", 0.5 * drag * device.diameter_m, "m", ever,
                f"dome's radius x friction {told(wall.friction)}; the wall's normal stays"),
        Unknown("stiffness EI", "stiffness", firm, "1", ever,
                off if stiffness is None else f"{told(shaft.stiffness_nm2)} N m^2, nominal {stiffness:g}"),
        Unknown("proximal stiffening", "stiffness profile", shaft.proximal_stiffer, "1", ever, "not on the sheet"),
        Unknown("creep, relative", "creep", 1.0, "1", ever,
                f"not on the sheet; {100 * shaft.creep_share:g} %, {shaft.creep_s:g} s"),
        Unknown("free length", "length", long, "m", ever,
                off if shaft.nominal_flexible_length_m is None else f"{told(shaft.flexible_length_m)} m"),
        Unknown("knob factor", "knob", _std(actuation.factor), "1", ever, told(actuation.factor)),
        Unknown("knob drift", "knob", actuation.drift_rms, "1", actuation.drift_s, "Gauss-Markov"),
        Unknown("place in the backlash", "knob", actuation.play_deg / math.sqrt(12), "deg", ever,
                f"within {actuation.play_deg:g} degrees, until the knob has crossed it"),
        Unknown("bend out of the plane", "depth", _std(shaft.out_of_plane_per_m), "1/m", ever,
                told(shaft.out_of_plane_per_m, "1/m")),
        Unknown("base, right", "base", _std(scene.base_shift_m), "m", ever, told(scene.base_shift_m, "m")),
        Unknown("base, down", "base", _std(scene.base_shift_m), "m", ever, told(scene.base_shift_m, "m")),
        Unknown("base, turn", "base", degree * _std(scene.base_turn_deg), "rad", ever,
                told(scene.base_turn_deg, "deg")),
        Unknown("camera, yaw", "camera", degree * _std(scene.yaw_deg), "rad", ever, told(scene.yaw_deg, "deg")),
        Unknown("camera, pitch", "camera", degree * _std(scene.pitch_deg), "rad", ever, told(scene.pitch_deg, "deg")),
        Unknown("camera, distance", "camera", _std(scene.camera_distance_m), "m", ever,
                told(scene.camera_distance_m, "m")),
        Unknown("lens, k1", "camera", _std(scene.distortion_k1), "1", ever, told(scene.distortion_k1)),
        Unknown("lens, p1", "camera", _std(scene.distortion_tangential), "1", ever, told(scene.distortion_tangential)),
        Unknown("lens, p2", "camera", _std(scene.distortion_tangential), "1", ever, told(scene.distortion_tangential)),
        Unknown("scale", "scale", 2 * settings.scale_error / math.sqrt(12), "1", ever,
                f"measured within {100 * settings.scale_error:g} %"),
    )  # fmt: skip
