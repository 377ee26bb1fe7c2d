"""Lower bounds of the force error: posterior Cramer-Rao bounds of simulated sessions, frame by frame."""

from ._bound import CramerRaoBound, ForceCovarianceBound
from ._companion import CompanionBound, describe_nuisances, read_companion_bounds
from ._jacobian import BoundInputs, bound_inputs, centreline_jacobian, perturb_lens
from ._priors import (
    BROAD_FORCE_STD_N,
    CENTRELINE_NOISE,
    CONTACT_FORCE_PRIORS_N2,
    SESSION_NOISE,
    CentrelineNoise,
    IndentationReading,
    Parameter,
    noise_preset,
    unknown_parameters,
)

__all__ = [
    "BROAD_FORCE_STD_N",
    "CENTRELINE_NOISE",
    "CONTACT_FORCE_PRIORS_N2",
    "SESSION_NOISE",
    "BoundInputs",
    "CentrelineNoise",
    "CompanionBound",
    "CramerRaoBound",
    "ForceCovarianceBound",
    "IndentationReading",
    "Parameter",
    "bound_inputs",
    "centreline_jacobian",
    "describe_nuisances",
    "noise_preset",
    "perturb_lens",
    "read_companion_bounds",
    "unknown_parameters",
]
