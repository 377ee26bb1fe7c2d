"""Knowledge of the rod estimators on a session before its images: priors of the unknowns, and the forces."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from ...errors import InputError
from ...mechanics.planar import FORCE, UNKNOWNS, Model
from ...types import ActuationInfo, FloatArray, SessionInfo
from ._line_error import LINE_PX
from ._settings import RodPriors, RodSettings

NEEDED = ("catheter.flexible_length_m", "catheter.bending_stiffness_nm2")
"""Session metadata without which there is no rod."""

_STIFFNESS = UNKNOWNS.index("stiffness") - FORCE
STIFFNESS_LEFT_OUT = 0.025
"""Relative deviation of EI from its stated value in spite of a good measurement: the shaft creeps and stiffens."""
_CAMERA_M, _MOST_TILT_DEG = 0.4, 60.0
"""Usual distance of a camera, for the effect of its tilt on lengths."""


@dataclass(frozen=True, eq=False)
class Knowledge:
    """Gaussians of the unknowns: constants of a session (`UNKNOWNS` behind the force), relative to its metadata.

    ``constants`` and ``constants_covariance``; ``contact_share``: of the frames; ``sessions``: number of training
    sessions, 0: the values of the settings.
    """

    constants: FloatArray
    constants_covariance: FloatArray
    contact_share: float
    sessions: int = 0

    @classmethod
    def stated(cls, settings: RodSettings) -> Self:
        """Returns the priors that the settings state, as standard deviations in the order of `UNKNOWNS`."""
        prior = settings.prior
        mean = np.zeros(len(UNKNOWNS) - FORCE)
        mean[UNKNOWNS.index("stiffening_m2") - FORCE] = prior.stiffening_m2
        mean[UNKNOWNS.index("creep") - FORCE] = prior.creep
        angle = math.radians(prior.base_angle_deg)
        std = [
            prior.precurvature_per_m, prior.stiffness, prior.proximal_stiffness, prior.stiffening_std_m2, prior.length,
            prior.scale, prior.base_position_m, prior.base_position_m, angle, prior.tilt_per_m, prior.tilt_per_m,
            prior.distortion_per_m2, prior.creep_std,
        ]  # fmt: skip
        return cls(mean, np.diag(np.square(std)), prior.contact_share)

    def for_session(self, settings: RodSettings, info: SessionInfo, knob_deg: float) -> tuple[FloatArray, FloatArray]:
        """Returns the prior of a session's constants: these priors, changed by the session's metadata and knob.

        Args:
            settings: the settings.
            info: the session metadata.
            knob_deg: angle of the knob, which bends the shaft; NaN: not known.

        Returns:
            Mean (constants,) and covariance (constants, constants); the first constant is the pre-curvature, 1/m.
        """
        mean, covariance = self.constants.copy(), self.constants_covariance.copy()
        for index, std in stated_stds(info, settings.vision.view).items():
            if not (self.sessions and index == _STIFFNESS):  # a learnt stiffness counts more than a stated one
                covariance[index, index] = std**2
        actuation, prior = info.actuation, settings.prior
        gain, knob_curvature_per_m = actuation.knob_gain_per_m_deg, actuation.curvature_per_m(knob_deg)
        if gain is not None and knob_curvature_per_m is not None:
            mean[0] += knob_curvature_per_m
            if not self.sessions:  # learnt priors contain the errors of the knob already
                play_deg = prior.knob_play_deg if actuation.knob_play_deg is None else actuation.knob_play_deg
                play_std_per_m = gain * play_deg / math.sqrt(12.0)  # uniform within the play
                covariance[0, 0] += play_std_per_m**2 + (knob_gain_std(prior, actuation) * gain * knob_deg) ** 2
        elif gain is not None or not info.catheter.rest_curvature_per_m:  # a stated shape without a knob is kept
            covariance[0] = covariance[:, 0] = 0.0
            covariance[0, 0] = prior.unknown_precurvature_per_m**2
            mean[0] = 0.0
        return mean, covariance

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Returns the arrays of the model folder, by name; the inverse of `of`."""
        return {
            "constants": self.constants,
            "constants_covariance": self.constants_covariance,
            "contact_share": np.array(self.contact_share),
            "sessions": np.array(self.sessions),
        }

    @classmethod
    def of(cls, arrays: Mapping[str, npt.NDArray[Any]]) -> Self:
        """Makes the priors from the arrays of a model folder, after checks; the inverse of `arrays`.

        Raises:
            KeyError: an array is missing.
            ValueError: an array has another shape, or no plausible values.
        """
        count = len(UNKNOWNS) - FORCE
        shapes = {
            "constants": (count,), "constants_covariance": (count, count), "contact_share": (), "sessions": (),
        }  # fmt: skip
        for name, shape in shapes.items():
            if arrays[name].shape != shape or not np.isfinite(arrays[name]).all():
                raise ValueError(f"{name}: expected finite numbers {shape}, got {arrays[name].shape}")
        mean, covariance = (np.asarray(arrays[name], np.float64) for name in list(shapes)[:2])
        if not (np.diag(covariance) > 0).all() or not (np.linalg.eigvalsh(_correlation(covariance)) > 0).all():
            raise ValueError("constants_covariance is no covariance")
        share, sessions = float(arrays["contact_share"]), int(arrays["sessions"])
        if not (0.0 < share < 1.0 and sessions >= 0):
            raise ValueError(f"expected a share of contact within 0 and 1, and sessions, got {share}, {sessions}")
        return cls(mean, covariance, share, sessions)


def stated_stds(info: SessionInfo, view: str) -> dict[int, float]:
    """Returns the standard deviations of constants that the session metadata state, by the constant's index.

    The index counts the `UNKNOWNS` behind the force. Stiffness, length and scale are relative.
    """
    catheter, camera = info.catheter, info.view(view)
    stiffness, tilt_deg = catheter.bending_stiffness_uncertainty, camera.tilt_uncertainty_deg
    tilt = None if tilt_deg is None else math.tan(math.radians(min(tilt_deg, _MOST_TILT_DEG))) / _CAMERA_M
    stated = {
        "stiffness": None if stiffness is None else math.hypot(stiffness, STIFFNESS_LEFT_OUT),
        "length": catheter.flexible_length_uncertainty,
        "scale": camera.metres_per_px_uncertainty,
        "tilt_x_per_m": tilt,
        "tilt_y_per_m": tilt,
    }
    return {UNKNOWNS.index(name) - FORCE: std for name, std in stated.items() if std is not None}


def knob_gain_std(prior: RodPriors, actuation: ActuationInfo) -> float:
    """Returns the relative standard deviation of the knob's gain: the stated one, else that of ``prior``."""
    stated = actuation.knob_gain_uncertainty
    return prior.knob_gain if stated is None else stated


def _correlation(covariance: FloatArray) -> FloatArray:
    std = np.sqrt(np.diag(covariance))
    return covariance / np.outer(std, std)


def noise_unit_m(model: Model, scale_m_per_px: float) -> float:
    """Returns the length in metres of one pixel of `LineError`.

    The errors were measured on a bench whose line is `LINE_PX` long. A finer image has no more information, since its
    blur covers more pixels: then the pixel of that bench counts, not the image's own.
    """
    return max(scale_m_per_px, (model.flexible_m + model.rigid_m) / LINE_PX)


def rod_model(info: SessionInfo, segments: int) -> Model:
    """Returns the rod that the metadata state: a flexible part in ``segments`` segments, and a rigid tip.

    The tip ends in a half-ball where the metadata state a diameter: the force acts at its centre.

    Raises:
        InputError: the metadata lack length or stiffness.
    """
    catheter = info.catheter
    if catheter.flexible_length_m is None or catheter.bending_stiffness_nm2 is None:
        raise InputError(f"the rod needs {' and '.join(NEEDED)}; state them in bench.toml")
    rigid = max(catheter.rigid_length_m or 0.0, 1e-6)  # the model needs a last element: without a tip it is negligible
    dome = min(rigid, 0.5 * (catheter.diameter_m or 0.0))
    return Model(
        segments, catheter.flexible_length_m, rigid, catheter.bending_stiffness_nm2,
        catheter.stiffness_factors(segments + 1), dome, catheter.rest_curvatures_per_m(segments + 1),
    )  # fmt: skip
