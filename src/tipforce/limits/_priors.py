"""What an estimator knows of a session beforehand: priors of the unknown parameters, centreline noise, forces."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..mechanics import LineNoise
from ..simulation._fields import Range, Settings
from ..simulation._settings import PRESETS, SimulationSettings
from ..simulation.world import Draw
from ..types import FloatArray

__all__ = ["FORCES_N2", "FORCE_STD_N", "LASTING", "MEASURED", "SeenNoise", "Unknown", "measured_on", "unknowns_of"]

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


@dataclass(frozen=True, slots=True)
class SeenNoise:
    """Errors of a seen line in the plane of the catheter: ``fresh`` in every frame, and those ``lasting`` a session."""

    fresh: LineNoise
    lasting: LineNoise


_PX_M = 0.2e-3
"""A pixel in the presets' middle."""
MEASURED: dict[str, SeenNoise] = {
    "bench-2021": SeenNoise(
        fresh=LineNoise(
            0.0257, 13.7, 0.287, base_std_m=0.0299, base_m=2.28, tip_std_m=0.176, tip_m=18.8,
            white_share=0.001, common_share=0.0514,
        ).scaled(_PX_M),
        lasting=LineNoise(
            0.0264, 70.1, 1.022, base_std_m=0.0178, base_m=2.28, tip_std_m=0.249, tip_m=14.1,
            white_share=0.143, common_share=0.0001,
        ).scaled(_PX_M),
    ),
    "generalise": SeenNoise(
        fresh=LineNoise(
            0.0130, 23.3, 0.561, base_std_m=0.0561, base_m=2.88, tip_std_m=0.415, tip_m=66.8,
            white_share=0.0465, common_share=0.0001,
        ).scaled(_PX_M),
        lasting=LineNoise(
            0.0315, 33.2, 1.183, base_std_m=0.0409, base_m=6.13, tip_std_m=0.266, tip_m=59.6,
            white_share=0.0724, common_share=0.131,
        ).scaled(_PX_M),
    ),
}  # fmt: skip
"""By preset, of what `fine` sees, given in pixels: what ``python -m bench.line_noise`` found."""


def _covariance(std_n: list[float], xy: float, xz: float, yz: float) -> FloatArray:
    return np.outer(std_n, std_n) * np.array([[1.0, xy, xz], [xy, 1.0, yz], [xz, yz, 1.0]])


FORCES_N2: dict[str, FloatArray] = {
    "bench-2021": _covariance([0.0727, 0.0560, 0.0056], 0.307, 0.004, -0.207),
    "generalise": _covariance([0.0702, 0.0585, 0.0049], 0.071, -0.067, -0.207),
}
"""(3, 3) by preset: covariance of the force in contact, base frame, over sessions 40 to 79 of seed 0: what those know
beforehand who have learnt from other sessions what forces there are. ``python -m bench.limits`` measures it."""


def measured_on(settings: Settings | Mapping[str, Any]) -> str | None:
    """The preset on whose pictures `MEASURED` stands for those of ``settings``; None where that was not measured.

    ``settings`` as they are or as a truth states them. Sessions of another length look the same.

    >>> measured_on(PRESETS["generalise"])
    'generalise'
    """
    stated = settings.model_dump(mode="json") if isinstance(settings, Settings) else settings
    if stated.get("preset") in MEASURED:
        return str(stated["preset"])
    return next((name for name in MEASURED if _look(stated) == _look(PRESETS[name].model_dump(mode="json"))), None)


def _look(stated: Mapping[str, Any]) -> dict[str, Any]:
    """What a session's pictures and forces are drawn from."""
    look = {name: value for name, value in stated.items() if name not in ("preset", "seed", "number")}
    return look | {"world": {name: value for name, value in look.get("world", {}).items() if name != "seconds"}}
