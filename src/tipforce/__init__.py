"""tipforce estimates the contact force at a catheter's tip from images of the catheter. Research use only.

>>> import tipforce
>>> tipforce.SessionInfo().view("camera").base_side is None
True

Names are loaded when they are first used, so that ``import tipforce`` takes a moment only.
"""

import importlib
import logging
from typing import TYPE_CHECKING, Any

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

_LAZY = {
    "estimate": "pipelines",
    "evaluate": "pipelines",
    "import_session": "pipelines",
    "inspect": "pipelines",
    "simulate": "pipelines",
    "train": "pipelines",
    "load_model": "estimators",
    "open_dataset": "datasets",
    "open_recording": "io",
    **dict.fromkeys(
        ("Catheter", "ForceEstimate", "Frame", "Observation", "SessionInfo", "Status", "Wrench", "read_bench"), "types"
    ),
}
"""Public name -> the package it is in."""

logging.getLogger("tipforce").addHandler(logging.NullHandler())


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module 'tipforce' has no attribute {name!r}")
    value = getattr(importlib.import_module(f".{_LAZY[name]}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
