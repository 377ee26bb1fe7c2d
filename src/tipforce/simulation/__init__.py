"""The twin: a bench in software, as hard as a real one, behind the same seams."""

from ._bench import SimulatedBench
from ._files import WriteSession, simulate
from ._live import LiveSimulation
from ._logs import write_logs
from ._samples import SampleSet, sample_set
from ._sessions import refuse_other, write_sessions
from ._settings import PRESETS, AnySimulationSettings, FluoroSettings, SimulationSettings
from ._sidecar import Truth, ViewTruth, read_truth, truth_of, truth_path, write_truth

__all__ = [
    "PRESETS",
    "AnySimulationSettings",
    "FluoroSettings",
    "LiveSimulation",
    "SampleSet",
    "SimulatedBench",
    "SimulationSettings",
    "Truth",
    "ViewTruth",
    "WriteSession",
    "read_truth",
    "refuse_other",
    "sample_set",
    "simulate",
    "truth_of",
    "truth_path",
    "write_logs",
    "write_sessions",
    "write_truth",
]
