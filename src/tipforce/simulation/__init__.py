"""A simulated bench with the errors of a real one, behind the same protocols: `Source`, `Actuators`, `Clock`."""

from ._bench import SimulatedBench
from ._ground_truth import Truth, ViewTruth, collect_truth, read_truth, truth_path, write_truth
from ._imaging import CameraImaging
from ._live import LiveSimulation, RealTimeClock
from ._logs import write_logs
from ._sample_set import SampleSet, sample_set
from ._session_files import WriteSession, require_same_settings, simulate
from ._settings import PRESETS, AnySimulationSettings, FluoroSettings, SimulationSettings

__all__ = [
    "PRESETS",
    "AnySimulationSettings",
    "CameraImaging",
    "FluoroSettings",
    "LiveSimulation",
    "RealTimeClock",
    "SampleSet",
    "SimulatedBench",
    "SimulationSettings",
    "Truth",
    "ViewTruth",
    "WriteSession",
    "collect_truth",
    "read_truth",
    "require_same_settings",
    "sample_set",
    "simulate",
    "truth_path",
    "write_logs",
    "write_truth",
]
