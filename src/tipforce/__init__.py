"""tipforce estimates the contact force at a catheter's tip from images of the catheter. Research use only.

>>> import tipforce
>>> tipforce.SessionInfo().view("camera").base_side is None
True

Names are loaded when they are first used, so that ``import tipforce`` is fast.
"""

import logging
from typing import TYPE_CHECKING

from ._system.lazy import loaded_on_use as _loaded_on_use
from .errors import TipforceError

if TYPE_CHECKING:
    from .datasets import open_dataset
    from .estimators import load_model
    from .io import open_recording
    from .pipelines import estimate, evaluate, import_session, inspect, simulate, train
    from .types import Catheter, ForceEstimate, Frame, Observation, SessionInfo, Status, Wrench, read_bench

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
    "estimate",
    "evaluate",
    "import_session",
    "inspect",
    "load_model",
    "open_dataset",
    "open_recording",
    "read_bench",
    "simulate",
    "train",
]

__version__ = "0.1.0"

logging.getLogger("tipforce").addHandler(logging.NullHandler())

__getattr__, __dir__ = _loaded_on_use(
    __name__,
    {
        "datasets": ("open_dataset",),
        "estimators": ("load_model",),
        "io": ("open_recording",),
        "pipelines": ("estimate", "evaluate", "import_session", "inspect", "simulate", "train"),
        "types": (
            "Catheter",
            "ForceEstimate",
            "Frame",
            "Observation",
            "SessionInfo",
            "Status",
            "Wrench",
            "read_bench",
        ),
    },
)
