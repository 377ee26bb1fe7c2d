"""tipforce reads the force at a catheter's tip from pictures of the catheter. Research use only."""

from .errors import TipforceError
from .types import Catheter, ForceEstimate, Frame, Observation, SessionInfo, Status, Wrench

__all__ = [
    "Catheter",
    "ForceEstimate",
    "Frame",
    "Observation",
    "SessionInfo",
    "Status",
    "TipforceError",
    "Wrench",
    "__version__",
]

__version__ = "0.1.0"
