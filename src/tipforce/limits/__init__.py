"""How well the force on the twin's tip can be known at best: the posterior Cramer-Rao bound, frame by frame."""

from ._beside import BoundBeside, bounds_beside, nuisances
from ._facts import Facts, facts_of
from ._noise import FORCES_N2, MEASURED, SeenNoise, measured_on
from ._rows import changed_lens, seen_rows
from ._session import ForceBound, SessionBound
from ._unknowns import FORCE_STD_N, LASTING, Unknown, unknowns_of

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
