"""Force from one line, and the reasons for an abstention."""

from typing import NamedTuple

import numpy as np

from ...types import DetectedShape, FloatArray, ForceEstimate, Status
from .._builder import within_error
from .._reading import Abstention
from ..uncertainty import GAUSS_90
from ._calibration import Widths
from ._posterior import force_over_contact
from ._settings import RodFitSettings, RodSettings

_FIRM = 2e-3
"""Softest pivot of the rod's Hessian, over EI / h, below which a fold is near."""


_POSSIBLE = 0.05
"""Contact is possible: the upper end of a 90 % interval is that of the force in contact."""


class Outcome(NamedTuple):
    """The fits of one line. ``force_n`` (2,), ``covariance_n2`` (2, 2), both in contact; ``log_odds`` of contact.

    ``angle_rad``: of the tip's axis; ``misfit``: mean square, of the better hypothesis, in the noise's variances;
    ``firmness``: see `Found`; ``open_n``: standard deviation of the force from the image alone, with the present
    constants; ``off``: distance of the session's constants from their priors, mean square in the priors' variances;
    ``level``: level of the line's noise relative to the stated one.
    """

    force_n: FloatArray
    covariance_n2: FloatArray
    log_odds: float
    angle_rad: float
    misfit: float
    firmness: float
    converged: bool
    open_n: float
    off: float
    level: float


def tempered(evidence: float, covariance: FloatArray, sure_n: float) -> float:
    """Returns the log evidence of contact over none. Evidence against contact counts less where the force is uncertain.

    A push along the axis of a straight shaft looks like none: taken for none it would teach wrong constants.
    ``covariance`` (2, 2) of the force in contact; ``sure_n``: see `RodSettings`.
    """
    if evidence > 0.0:
        return evidence
    widest = float(np.linalg.eigvalsh(covariance)[-1])
    return evidence / (1.0 + widest / sure_n**2)


def estimate_of(
    settings: RodSettings, widths: Widths, stamp_ns: int, outcome: Outcome, shape: DetectedShape | None
) -> ForceEstimate:
    """The force over contact and none with its intervals, or why there is none."""
    if abstention := unfit(settings, outcome):
        return ForceEstimate.invalid(stamp_ns, abstention.status, abstention.detail, shape)
    mixed = force_over_contact(
        outcome.force_n, outcome.covariance_n2, outcome.angle_rad, outcome.log_odds, settings.prior.of_force()
    )
    if mixed.contact > _POSSIBLE and outcome.open_n > settings.max_std_n:
        return ForceEstimate.invalid(
            stamp_ns,
            Status.UNOBSERVABLE,
            f"the shape leaves a direction of the force open by {outcome.open_n:.2g} N, more than max_std_n = "
            f"{settings.max_std_n:g}: it is pushed along its own axis",
            shape,
            (0.0, float(np.hypot(*mixed.force_n)) + GAUSS_90 * outcome.open_n),
        )
    return within_error(widths.estimate(stamp_ns, mixed, shape), settings.max_error_n)


def unexplained(settings: RodFitSettings, misfit: float) -> Abstention:
    """Returns the abstention where the rod does not have the detected shape.

    Args:
        settings: settings of the method.
        misfit: mean square misfit, in the noise's variances.
    """
    return Abstention(
        Status.OUT_OF_DISTRIBUTION,
        f"no force at the tip bends the stated rod into this shape: the mean square misfit is {misfit:.1f}, the limit "
        f"{settings.max_misfit:g}",
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


def unfit(settings: RodSettings, outcome: Outcome) -> Abstention | None:
    """Why the rod does not explain the line, or None."""
    if not (outcome.converged and outcome.misfit <= settings.max_misfit):
        if outcome.firmness < _FIRM:
            return Abstention(Status.FOLD, "no stable shape of the rod fits the centreline: it is near a fold")
        return unexplained(settings, outcome.misfit)
    if outcome.firmness < _FIRM:
        return Abstention(Status.FOLD, "the rod is about to buckle: a small change of the force bends it far")
    if noisy := too_noisy(settings, outcome.level):
        return noisy
    if outcome.off > settings.max_off:
        return Abstention(
            Status.OUT_OF_DISTRIBUTION,
            f"rod, clamp and camera must differ from the stated values: mean square {outcome.off:.0f} of their "
            f"priors' variances, the limit is max_off = {settings.max_off:g}",
        )
    return None
