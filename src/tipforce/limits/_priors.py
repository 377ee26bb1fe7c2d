"""Prior knowledge of an estimator about a session: unknown parameters, centreline noise, forces."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..mechanics import LineNoise
from ..simulation import PRESETS, AnySimulationSettings, SimulationSettings
from ..simulation.world import SessionParameters
from ..types import FloatArray

BROAD_FORCE_STD_N = 0.3
"""Broad prior standard deviation of each in-plane component of the force, independent in every frame."""
SESSION_NOISE = "detection, per session"
"""Name of the group of the detected centreline's errors that are constant in a session."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """An unknown parameter of the measurement model, with its Gaussian prior.

    Attributes:
        name: name of the parameter.
        group: name of the parameters that are reported together.
        std: standard deviation of the prior, equal to that of the distribution from which the parameter is drawn.
        unit: unit of ``std``.
        memory_s: correlation time; infinite: constant over a session; 0: independent in every frame.
        why: origin of the width of the prior.
    """

    name: str
    group: str
    std: float
    unit: str
    memory_s: float
    why: str


def _std(bounds: tuple[float, float]) -> float:
    """Returns the standard deviation of a uniform distribution from ``bounds[0]`` to ``bounds[1]``."""
    return (bounds[1] - bounds[0]) / math.sqrt(12)


def unknown_parameters(settings: SimulationSettings, parameters: SessionParameters) -> tuple[Parameter, ...]:
    """Returns the unknown parameters of a session, the three components of the force first.

    Parameters that are the same in every session are assumed to be known, because an estimator can learn them from
    other sessions: the law of stiffening with curvature, GJ / EI, the electrode's length, the diameter, the width of
    the backlash and the camera's inset.

    Args:
        settings: settings of the simulation.
        parameters: parameters of the session.
    """
    world, scene = settings.world, settings.scene
    shaft, actuation, wall, device = world.shaft, world.actuation, world.wall, parameters.device
    measured_std = 2 * shaft.known_to / math.sqrt(12)  # relative, of values that are measured, not nominal
    stiffness = shaft.nominal_stiffness_nm2
    stiffness_std = measured_std if stiffness is None else _std(shaft.stiffness_nm2) / stiffness
    length_std_m = measured_std * device.nominal_flexible_length_m
    if shaft.nominal_flexible_length_m is not None:
        length_std_m = _std(shaft.flexible_length_m)
    low, high = wall.friction
    friction_rms = math.sqrt((low * low + low * high + high * high) / 3)  # of a uniform draw
    tilt_rad = _std((math.radians(wall.tilt_deg[0]), math.radians(wall.tilt_deg[1])))
    degree, always, fresh = math.radians(1.0), math.inf, 0.0  # the last two: correlation times

    def uniform(bounds: tuple[float, float], unit: str = "") -> str:
        return f"U({bounds[0]:g}, {bounds[1]:g}){unit and ' '}{unit}"

    measured = f"metadata within {100 * shaft.known_to:g} %"
    of_stiffness = measured if stiffness is None else f"{uniform(shaft.stiffness_nm2)} N m^2, nominal {stiffness:g}"
    of_length = measured if shaft.nominal_flexible_length_m is None else f"{uniform(shaft.flexible_length_m)} m"
    of_touch = f"dome's radius x friction {uniform(wall.friction)}; the wall's normal stays"
    of_creep = f"not in the metadata; {100 * shaft.creep_share:g} %, {shaft.creep_s:g} s"
    of_play = f"within {actuation.play_deg:g} degrees, until the knob has crossed it"
    of_scale = f"measured within {100 * settings.scale_error:g} %"
    out_of_plane, base, distance = shaft.out_of_plane_per_m, scene.base_shift_m, scene.camera_distance_m
    turn_deg, yaw_deg, pitch_deg, k1 = scene.base_turn_deg, scene.yaw_deg, scene.pitch_deg, scene.distortion_k1
    p12, of_p12 = _std(scene.distortion_tangential), uniform(scene.distortion_tangential)
    depth_std_n, of_depth = BROAD_FORCE_STD_N * tilt_rad, f"wall's tilt {uniform(wall.tilt_deg, 'deg')}"
    play_std_deg, scale_std = actuation.play_deg / math.sqrt(12), 2 * settings.scale_error / math.sqrt(12)
    return (
        Parameter("force along the base tangent", "force", BROAD_FORCE_STD_N, "N", fresh, "broad"),
        Parameter("force across it in the image", "force", BROAD_FORCE_STD_N, "N", fresh, "broad"),
        Parameter("force in depth", "depth", depth_std_n, "N", fresh, of_depth),
        Parameter(
            "place of the touch on the dome", "touch", 0.5 * friction_rms * device.diameter_m, "m", always, of_touch
        ),
        Parameter("stiffness EI", "stiffness", stiffness_std, "1", always, of_stiffness),
        Parameter(
            "proximal stiffening", "stiffness profile", shaft.proximal_stiffer, "1", always, "not in the metadata"
        ),
        Parameter("creep, relative", "creep", 1.0, "1", always, of_creep),
        Parameter("free length", "length", length_std_m, "m", always, of_length),
        Parameter("knob factor", "knob", _std(actuation.factor), "1", always, uniform(actuation.factor)),
        Parameter("knob drift", "knob", actuation.drift_rms, "1", actuation.drift_s, "Gauss-Markov"),
        Parameter("place in the backlash", "knob", play_std_deg, "deg", always, of_play),
        Parameter("bend out of the plane", "depth", _std(out_of_plane), "1/m", always, uniform(out_of_plane, "1/m")),
        Parameter("base, right", "base", _std(base), "m", always, uniform(base, "m")),
        Parameter("base, down", "base", _std(base), "m", always, uniform(base, "m")),
        Parameter("base, turn", "base", degree * _std(turn_deg), "rad", always, uniform(turn_deg, "deg")),
        Parameter("camera, yaw", "camera", degree * _std(yaw_deg), "rad", always, uniform(yaw_deg, "deg")),
        Parameter("camera, pitch", "camera", degree * _std(pitch_deg), "rad", always, uniform(pitch_deg, "deg")),
        Parameter("camera, distance", "camera", _std(distance), "m", always, uniform(distance, "m")),
        Parameter("lens, k1", "camera", _std(k1), "1", always, uniform(k1)),
        Parameter("lens, p1", "camera", p12, "1", always, of_p12),
        Parameter("lens, p2", "camera", p12, "1", always, of_p12),
        Parameter("scale", "scale", scale_std, "1", always, of_scale),
    )


@dataclass(frozen=True, slots=True)
class CentrelineNoise:
    """Errors of a detected centreline in the catheter's plane: ``fresh`` in each frame, ``lasting`` for a session."""

    fresh: LineNoise
    lasting: LineNoise


@dataclass(frozen=True, slots=True)
class IndentationReading:
    """Accuracy with which an estimator reads the indentation of the tissue, and its prior knowledge of the tissue.

    Attributes:
        std_m: standard deviation of the indentation in one frame.
        log_stiffness_std: standard deviation of the stiffness's logarithm.
        face_m: standard deviation of the position of the unloaded face, constant in a session.
    """

    std_m: float
    log_stiffness_std: float
    face_m: float

    def parameters(self) -> tuple[Parameter, Parameter]:
        """Returns the unknown parameters of the tissue."""
        constant = math.inf
        return (
            Parameter("stiffness of the tissue, relative", "tissue", self.log_stiffness_std, "1", constant, "prior"),
            Parameter("place of the tissue's face", "face", self.face_m, "m", constant, "accuracy of the reading"),
        )


_PIXEL_M = 0.2e-3
"""Length of a pixel in the middle of the presets' images."""
CENTRELINE_NOISE: dict[str, CentrelineNoise] = {
    "bench-2021": CentrelineNoise(
        fresh=LineNoise(
            0.0257, 13.7, 0.287, base_std_m=0.0299, base_m=2.28, tip_std_m=0.176, tip_m=18.8,
            white_share=0.001, common_share=0.0514,
        ).scaled(_PIXEL_M),
        lasting=LineNoise(
            0.0264, 70.1, 1.022, base_std_m=0.0178, base_m=2.28, tip_std_m=0.249, tip_m=14.1,
            white_share=0.143, common_share=0.0001,
        ).scaled(_PIXEL_M),
    ),
    "generalise": CentrelineNoise(
        fresh=LineNoise(
            0.0130, 23.3, 0.561, base_std_m=0.0561, base_m=2.88, tip_std_m=0.415, tip_m=66.8,
            white_share=0.0465, common_share=0.0001,
        ).scaled(_PIXEL_M),
        lasting=LineNoise(
            0.0315, 33.2, 1.183, base_std_m=0.0409, base_m=6.13, tip_std_m=0.266, tip_m=59.6,
            white_share=0.0724, common_share=0.131,
        ).scaled(_PIXEL_M),
    ),
}  # fmt: skip
"""Centreline noise of the tracer in pixels by preset, measured by ``python -m bench.studies.line_noise``."""


def _covariance(std_n: list[float], xy: float, xz: float, yz: float) -> FloatArray:
    return np.outer(std_n, std_n) * np.array([[1.0, xy, xz], [xy, 1.0, yz], [xz, yz, 1.0]])


CONTACT_FORCE_PRIORS_N2: dict[str, FloatArray] = {
    "bench-2021": _covariance([0.0727, 0.0560, 0.0056], 0.307, 0.004, -0.207),
    "generalise": _covariance([0.0702, 0.0585, 0.0049], 0.071, -0.067, -0.207),
}
"""Covariance (3, 3) of the force in contact by preset, base frame, over sessions 40 to 79 of seed 0: the prior of an
estimator that was trained on other sessions. ``python -m bench.studies.limits`` measures it."""


def noise_preset(settings: AnySimulationSettings | Mapping[str, Any]) -> str | None:
    """Returns the preset whose measured `CENTRELINE_NOISE` is valid for ``settings``, or None.

    Args:
        settings: settings, also as a ground truth states them. The length of a session is ignored.

    >>> noise_preset(PRESETS["generalise"])
    'generalise'
    """
    stated = settings.model_dump(mode="json") if not isinstance(settings, Mapping) else settings
    if stated.get("preset") in CENTRELINE_NOISE:
        return str(stated["preset"])
    for name in CENTRELINE_NOISE:
        if _appearance(stated) == _appearance(PRESETS[name].model_dump(mode="json")):
            return name
    return None


def _appearance(stated: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the settings that determine a session's images and forces: all but name, seed, number and length."""
    stated = {name: value for name, value in stated.items() if name not in ("preset", "seed", "number")}
    return stated | {"world": {name: value for name, value in stated.get("world", {}).items() if name != "seconds"}}
