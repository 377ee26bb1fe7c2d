"""One model of a session: constants, slow states and forces, with the posterior of the force integrated."""

from ._filter import FilterResult, SessionFilter
from ._limits import ForceLimits, Limit, LimitsTally
from ._settings import SessionPriors, SessionSettings
from .session import SessionModel, SessionStream

__all__ = [
    "FilterResult",
    "ForceLimits",
    "Limit",
    "LimitsTally",
    "SessionFilter",
    "SessionModel",
    "SessionPriors",
    "SessionSettings",
    "SessionStream",
]
