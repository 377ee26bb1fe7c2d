"""How well the force on the twin's tip can be known at best: the posterior Cramer-Rao bound, frame by frame."""

from ._facts import Facts, facts_of
from ._noise import FORCES_N2, MEASURED, SeenNoise
from ._rows import changed_lens, seen_rows
from ._session import ForceBound, SessionBound
from ._unknowns import FORCE_STD_N, LASTING, Unknown, unknowns_of

__all__ = [
    "FORCES_N2",
    "FORCE_STD_N",
    "LASTING",
    "MEASURED",
    "Facts",
    "ForceBound",
    "SeenNoise",
    "SessionBound",
    "Unknown",
    "changed_lens",
    "facts_of",
    "seen_rows",
    "unknowns_of",
]
