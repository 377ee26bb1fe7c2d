"""One model of a session: constants, slow states and forces, with the posterior of the force integrated."""

from ._filter import FilterResult, SessionFilter
from ._settings import SessionPriors, SessionSettings
from .session import SessionModel

__all__ = ["FilterResult", "SessionFilter", "SessionModel", "SessionPriors", "SessionSettings"]
