"""How well the force on the twin's tip can be known at best: the posterior Cramer-Rao bound, frame by frame."""

from ._bound import ForceBound, SessionBound
from ._companion import BoundBeside, bounds_beside, nuisances
from ._jacobian import Facts, changed_lens, facts_of, seen_rows
from ._priors import FORCE_STD_N, FORCES_N2, LASTING, MEASURED, SeenNoise, Unknown, measured_on, unknowns_of

__all__ = [
    "FORCES_N2",
    "FORCE_STD_N",
    "LASTING",
    "MEASURED",
    "BoundBeside",
    "Facts",
    "ForceBound",
    "SeenNoise",
    "SessionBound",
    "Unknown",
    "bounds_beside",
    "changed_lens",
    "facts_of",
    "measured_on",
    "nuisances",
    "seen_rows",
    "unknowns_of",
]
