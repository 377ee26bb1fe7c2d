"""The twin: a bench in software, as hard as a real one, behind the same seams."""

from ._bench import TwinBench
from ._files import WriteSession, simulate
from ._logs import write_logs
from ._settings import PRESETS, TwinSettings
from ._sidecar import Truth, read_truth, truth_of, truth_path, write_truth

__all__ = [
    "PRESETS",
    "Truth",
    "TwinBench",
    "TwinSettings",
    "WriteSession",
    "read_truth",
    "simulate",
    "truth_of",
    "truth_path",
    "write_logs",
    "write_truth",
]
