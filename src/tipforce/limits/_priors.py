"""What an estimator knows of a session beforehand: priors of the unknown parameters, centreline noise, forces."""

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
"""Prior standard deviation of each in-plane component of the force: broad, independent in every frame."""
SESSION_NOISE = "detection, per session"
"""The group of those errors of the detected centreline that stay for a session."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """An unknown parameter of the measurement model, with its Gaussian prior.

    ``std`` in ``unit``: of the prior, as wide as the distribution that it is drawn from. ``group``: parameters that are
    reported together. ``memory_s``: correlation time; infinite: constant over a session; 0: independent in every frame.
    ``why``: where the width comes from.
    """

    name: str
    group: str
    std: float
    unit: str
    memory_s: float
    why: str


def _std(bounds: tuple[float, float]) -> float:
    """Of a uniform draw."""
    return (bounds[1] - bounds[0]) / math.sqrt(12)


def unknown_parameters(settings: SimulationSettings, parameters: SessionParameters) -> tuple[Parameter, ...]:
    """Returns the parameters of a session, the force's three components first.

    What is the same in every session counts as known: the law of stiffening with curvature, GJ / EI, the electrode's
    length, the diameter, the width of the backlash and the camera's inset. An estimator can learn them from other
    sessions.
    """
    world, scene = settings.world, settings.scene
    shaft, actuation, wall, device = world.shaft, world.actuation, world.wall, parameters.device
    within = 2 * shaft.known_to / math.sqrt(12)
    stiffness = shaft.nominal_stiffness_nm2
    firm = within if stiffness is None else _std(shaft.stiffness_nm2) / stiffness
    long = within * device.nominal_flexible_length_m
    if shaft.nominal_flexible_length_m is not None:
        long = _std(shaft.flexible_length_m)
    low, high = wall.friction
    drag = math.sqrt((low * low + low * high + high * high) / 3)  # root mean square of the uniform draw
    tilt = _std((math.radians(wall.tilt_deg[0]), math.radians(wall.tilt_deg[1])))
    degree, ever, anew = math.radians(1.0), math.inf, 0.0

    def uniform(bounds: tuple[float, float], unit: str = "") -> str:
        return f"U({bounds[0]:g}, {bounds[1]:g}){unit and ' '}{unit}"

    off = f"metadata within {100 * shaft.known_to:g} %"
    return (
        Parameter("force along the base tangent", "force", BROAD_FORCE_STD_N, "N", anew, "broad"),
        Parameter("force across it in the image", "force", BROAD_FORCE_STD_N, "N", anew, "broad"),
        Parameter(
            "force in depth",
            "depth",
            BROAD_FORCE_STD_N * tilt,
            "N",
            anew,
            f"wall's tilt {uniform(wall.tilt_deg, 'deg')}",
        ),
        Parameter(
            "place of the touch on the dome",
            "touch",
            0.5 * drag * device.diameter_m,
            "m",
            ever,
            f"dome's radius x friction {uniform(wall.friction)}; the wall's normal stays",
        ),
        Parameter(
            "stiffness EI",
            "stiffness",
            firm,
            "1",
            ever,
            off if stiffness is None else f"{uniform(shaft.stiffness_nm2)} N m^2, nominal {stiffness:g}",
        ),
        Parameter("proximal stiffening", "stiffness profile", shaft.proximal_stiffer, "1", ever, "not in the metadata"),
        Parameter(
            "creep, relative",
            "creep",
            1.0,
            "1",
            ever,
            f"not in the metadata; {100 * shaft.creep_share:g} %, {shaft.creep_s:g} s",
        ),
        Parameter(
            "free length",
            "length",
            long,
            "m",
            ever,
            off if shaft.nominal_flexible_length_m is None else f"{uniform(shaft.flexible_length_m)} m",
        ),
        Parameter("knob factor", "knob", _std(actuation.factor), "1", ever, uniform(actuation.factor)),
        Parameter("knob drift", "knob", actuation.drift_rms, "1", actuation.drift_s, "Gauss-Markov"),
        Parameter(
            "place in the backlash",
            "knob",
            actuation.play_deg / math.sqrt(12),
            "deg",
            ever,
            f"within {actuation.play_deg:g} degrees, until the knob has crossed it",
        ),
        Parameter(
            "bend out of the plane",
            "depth",
            _std(shaft.out_of_plane_per_m),
            "1/m",
            ever,
            uniform(shaft.out_of_plane_per_m, "1/m"),
        ),
        Parameter("base, right", "base", _std(scene.base_shift_m), "m", ever, uniform(scene.base_shift_m, "m")),
        Parameter("base, down", "base", _std(scene.base_shift_m), "m", ever, uniform(scene.base_shift_m, "m")),
        Parameter(
            "base, turn", "base", degree * _std(scene.base_turn_deg), "rad", ever, uniform(scene.base_turn_deg, "deg")
        ),
        Parameter("camera, yaw", "camera", degree * _std(scene.yaw_deg), "rad", ever, uniform(scene.yaw_deg, "deg")),
        Parameter(
            "camera, pitch", "camera", degree * _std(scene.pitch_deg), "rad", ever, uniform(scene.pitch_deg, "deg")
        ),
        Parameter(
            "camera, distance",
            "camera",
            _std(scene.camera_distance_m),
            "m",
            ever,
            uniform(scene.camera_distance_m, "m"),
        ),
        Parameter("lens, k1", "camera", _std(scene.distortion_k1), "1", ever, uniform(scene.distortion_k1)),
        Parameter(
            "lens, p1", "camera", _std(scene.distortion_tangential), "1", ever, uniform(scene.distortion_tangential)
        ),
        Parameter(
            "lens, p2", "camera", _std(scene.distortion_tangential), "1", ever, uniform(scene.distortion_tangential)
        ),
        Parameter(
            "scale",
            "scale",
            2 * settings.scale_error / math.sqrt(12),
            "1",
            ever,
            f"measured within {100 * settings.scale_error:g} %",
        ),
    )


@dataclass(frozen=True, slots=True)
class CentrelineNoise:
    """Errors of a detected centreline in the catheter's plane: ``fresh`` in every frame, or ``lasting`` a session."""

    fresh: LineNoise
    lasting: LineNoise


@dataclass(frozen=True, slots=True)
class IndentationReading:
    """How well an estimator reads the indentation of the tissue, and what it knows of the tissue beforehand.

    ``std_m``: of the depth in one frame; ``log_stiffness_std``: of the stiffness's logarithm; ``face_m``: of where the
    undented face lies, the same all session.
    """

    std_m: float
    log_stiffness_std: float
    face_m: float

    def parameters(self) -> tuple[Parameter, Parameter]:
        """Returns the unknowns that come with it."""
        ever = math.inf
        return (
            Parameter("stiffness of the tissue, relative", "tissue", self.log_stiffness_std, "1", ever, "prior"),
            Parameter("place of the tissue's face", "face", self.face_m, "m", ever, "as it is seen"),
        )


_PIXEL_M = 0.2e-3
"""A pixel in the presets' middle."""
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
"""By preset: the centreline noise of the tracer in pixels, measured by ``python -m bench.studies.line_noise``."""


def _covariance(std_n: list[float], xy: float, xz: float, yz: float) -> FloatArray:
    return np.outer(std_n, std_n) * np.array([[1.0, xy, xz], [xy, 1.0, yz], [xz, yz, 1.0]])


CONTACT_FORCE_PRIORS_N2: dict[str, FloatArray] = {
    "bench-2021": _covariance([0.0727, 0.0560, 0.0056], 0.307, 0.004, -0.207),
    "generalise": _covariance([0.0702, 0.0585, 0.0049], 0.071, -0.067, -0.207),
}
"""(3, 3) by preset: covariance of the force in contact, base frame, over sessions 40 to 79 of seed 0. It is the prior
of an estimator that has learnt the forces from other sessions. ``python -m bench.studies.limits`` measures it."""


def noise_preset(settings: AnySimulationSettings | Mapping[str, Any]) -> str | None:
    """Returns the preset whose measured `CENTRELINE_NOISE` holds for ``settings``, or None.

    ``settings``: as they are, or as a ground truth states them. The length of a session does not matter.

    >>> noise_preset(PRESETS["generalise"])
    'generalise'
    """
    stated = settings.model_dump(mode="json") if not isinstance(settings, Mapping) else settings
    if stated.get("preset") in CENTRELINE_NOISE:
        return str(stated["preset"])
    return next(
        (
            name
            for name in CENTRELINE_NOISE
            if _appearance(stated) == _appearance(PRESETS[name].model_dump(mode="json"))
        ),
        None,
    )


def _appearance(stated: Mapping[str, Any]) -> dict[str, Any]:
    """What a session's images and forces are drawn from."""
    look = {name: value for name, value in stated.items() if name not in ("preset", "seed", "number")}
    return look | {"world": {name: value for name, value in look.get("world", {}).items() if name != "seconds"}}
