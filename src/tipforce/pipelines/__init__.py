"""Plain functions, one for each job: the public API and the command line call them.

Each is loaded when it is first used: a command does not wait for the modules of the others.
"""

from typing import TYPE_CHECKING

from .._system.lazy import loaded_on_use as _loaded_on_use

if TYPE_CHECKING:
    from ._annotate import AnnotateSettings, AnnotationJob, detector_beside
    from ._calibrate import CalibrateReport, calibrate, describe_calibration, plot_calibration
    from ._control import REGIMES, ControlRun, ControlSession, bench_of_regime, live_bench, run_control
    from ._control_report import control, plot_control, verdict
    from ._copy_recording import copy_recording
    from ._demo import DemoReport, demo
    from ._estimate import COLUMNS, EstimateReport, estimate, for_source, view_line, write_estimates
    from ._evaluate import EvaluateReport, evaluate, thesis_settings
    from ._fine_tune_locator import (
        FineTuneResult,
        LeftOutFrame,
        LocatorFigures,
        LocatorFineTuneSettings,
        fine_tune_locator,
    )
    from ._guided import Guide, missing_for_training
    from ._import_session import import_session
    from ._inspect import inspect
    from ._inspect_images import InspectionResult, inspect_frames, inspect_image_file, inspect_sessions
    from ._limits import limits_in
    from ._live import LiveRunSettings, live, live_line, open_live_source
    from ._live_control import HoldSettings, LiveControl
    from ._live_page import LivePage, PageAddress
    from ._record import RecordingReport, record
    from ._record_bench import BenchRecording, describe_health
    from ._simulate import SimulateReport, preset_settings, simulate, simulate_dataset
    from ._simulate_samples import write_samples
    from ._stage_motion import StageMotion
    from ._summary import RecordingSummary, describe_recording, plot_summary, summarise_recording
    from ._train import TrainReport, train

__all__ = [
    "COLUMNS",
    "REGIMES",
    "AnnotateSettings",
    "AnnotationJob",
    "BenchRecording",
    "CalibrateReport",
    "ControlRun",
    "ControlSession",
    "DemoReport",
    "EstimateReport",
    "EvaluateReport",
    "FineTuneResult",
    "Guide",
    "HoldSettings",
    "InspectionResult",
    "LeftOutFrame",
    "LiveControl",
    "LivePage",
    "LiveRunSettings",
    "LocatorFigures",
    "LocatorFineTuneSettings",
    "PageAddress",
    "RecordingReport",
    "RecordingSummary",
    "SimulateReport",
    "StageMotion",
    "TrainReport",
    "bench_of_regime",
    "calibrate",
    "control",
    "copy_recording",
    "demo",
    "describe_calibration",
    "describe_health",
    "describe_recording",
    "detector_beside",
    "estimate",
    "evaluate",
    "fine_tune_locator",
    "for_source",
    "import_session",
    "inspect",
    "inspect_frames",
    "inspect_image_file",
    "inspect_sessions",
    "limits_in",
    "live",
    "live_bench",
    "live_line",
    "missing_for_training",
    "open_live_source",
    "plot_calibration",
    "plot_control",
    "plot_summary",
    "preset_settings",
    "record",
    "run_control",
    "simulate",
    "simulate_dataset",
    "summarise_recording",
    "thesis_settings",
    "train",
    "verdict",
    "view_line",
    "write_estimates",
    "write_samples",
]

__getattr__, __dir__ = _loaded_on_use(
    __name__,
    {
        "_annotate": ("AnnotateSettings", "AnnotationJob", "detector_beside"),
        "_calibrate": ("CalibrateReport", "calibrate", "describe_calibration", "plot_calibration"),
        "_control": ("REGIMES", "ControlRun", "ControlSession", "bench_of_regime", "live_bench", "run_control"),
        "_control_report": ("control", "plot_control", "verdict"),
        "_copy_recording": ("copy_recording",),
        "_demo": ("DemoReport", "demo"),
        "_estimate": ("COLUMNS", "EstimateReport", "estimate", "for_source", "view_line", "write_estimates"),
        "_evaluate": ("EvaluateReport", "evaluate", "thesis_settings"),
        "_fine_tune_locator": (
            "FineTuneResult",
            "LeftOutFrame",
            "LocatorFigures",
            "LocatorFineTuneSettings",
            "fine_tune_locator",
        ),
        "_guided": ("Guide", "missing_for_training"),
        "_import_session": ("import_session",),
        "_inspect": ("inspect",),
        "_inspect_images": ("InspectionResult", "inspect_frames", "inspect_image_file", "inspect_sessions"),
        "_limits": ("limits_in",),
        "_live": ("LiveRunSettings", "live", "live_line", "open_live_source"),
        "_live_control": ("HoldSettings", "LiveControl"),
        "_live_page": ("LivePage", "PageAddress"),
        "_record": ("RecordingReport", "record"),
        "_record_bench": ("BenchRecording", "describe_health"),
        "_simulate": ("SimulateReport", "preset_settings", "simulate", "simulate_dataset"),
        "_simulate_samples": ("write_samples",),
        "_stage_motion": ("StageMotion",),
        "_summary": ("RecordingSummary", "describe_recording", "plot_summary", "summarise_recording"),
        "_train": ("TrainReport", "train"),
    },
)
