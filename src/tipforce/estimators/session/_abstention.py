"""Reasons why a method that fits a rod has no estimate."""

import math

from ...types import ForceEstimate, SessionInfo, Status
from .._reading import Abstention
from ._settings import RodFitSettings, RodSettings


def late_frame(stamp_ns: int, newest_ns: int | None) -> ForceEstimate | None:
    """Returns the refusal of a frame that is not newer than the newest one; None where it is newer.

    Args:
        stamp_ns: stamp of the frame.
        newest_ns: stamp of the newest frame that was used; None before the first.
    """
    if newest_ns is None or stamp_ns > newest_ns:
        return None
    late_ms = (newest_ns - stamp_ns) * 1e-6
    return ForceEstimate.invalid(stamp_ns, Status.STALE, f"{late_ms:.1f} ms older than a frame that was used already")


def actuation_out_of_range(settings: RodFitSettings, info: SessionInfo, knob_deg: float) -> Abstention | None:
    """Returns the abstention where the knob would bend the shaft too far; None where its angle is within its limit.

    Args:
        settings: settings of the method.
        info: the session metadata.
        knob_deg: reading of the knob; NaN: not known.
    """
    gain = info.actuation.knob_gain_per_m_deg
    if gain is None or math.isnan(knob_deg) or abs(gain * knob_deg) <= settings.max_precurvature_per_m:
        return None
    return Abstention(
        Status.OUT_OF_DISTRIBUTION,
        f"the knob at {knob_deg:g} degrees asks for a curvature of {gain * knob_deg:.3g} 1/m, more than "
        f"max_precurvature_per_m = {settings.max_precurvature_per_m:g}",
    )


def unexplained(settings: RodFitSettings, misfit: float, off: float | None = None) -> Abstention:
    """Returns the abstention where the rod does not have the detected shape.

    Args:
        settings: settings of the method.
        misfit: mean square misfit, in the noise's variances.
        off: mean square distance of rod, clamp and camera from their priors, in the priors' variances; None where the
            method does not check it.
    """
    text = f"no force at the tip bends the stated rod into this shape: the mean square misfit is {misfit:.1f}, "
    if off is None:
        text += f"the limit {settings.max_misfit:g}"
    else:
        text += (
            f"that of rod, clamp and camera from their stated values {off:.1f}; the limit of both together is "
            f"max_misfit = {settings.max_misfit:g}"
        )
    return Abstention(Status.OUT_OF_DISTRIBUTION, text)


def impossible(settings: RodSettings) -> Abstention:
    """Returns the abstention where the line shows a force that the prior excludes.

    Args:
        settings: settings of the method.
    """
    return Abstention(
        Status.OUT_OF_DISTRIBUTION,
        f"the shape shows a force that is larger than prior.largest_force_n = {settings.prior.largest_force_n:g} N, or "
        "that pulls at the tip",
    )


def too_noisy(settings: RodFitSettings, level: float) -> Abstention | None:
    """Returns the abstention where a line fits with much more noise only; None where the noise is within its limit.

    Args:
        settings: settings of the method.
        level: noise of the line relative to the stated one.
    """
    if level <= settings.noise.max_level:
        return None
    return Abstention(
        Status.OUT_OF_DISTRIBUTION,
        f"the stated rod explains the detected line only with {level:.0f} times the noise that is stated, more than "
        f"noise.max_level = {settings.noise.max_level:g}",
    )
