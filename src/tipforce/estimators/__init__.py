"""Methods that estimate the force: one module or package for each, with one interface, found by their names."""

from ._base import Estimator, FineTunable, Progress, Stream, no_progress
from ._facts import ModelFacts, ModelSummary
from ._fit import Training, for_dataset, train
from ._onnx import export_onnx
from ._registry import ESTIMATORS, create, method
from .fusion import Fusion, FusionSettings
from .networks import Compact, CompactSettings, Dcfe, DcfeSettings, NetworkEstimator, Stereo, StereoSettings
from .session import NoiseSettings, PriorSettings, Rod, RodSettings, RodTrack, RodTrackSettings
from .shape import AngleSettings, ShapeFacts, ShapeRegressor, ShapeRegressorSettings, WindowSettings
from .store import (
    FORMAT_VERSION,
    check_target,
    initial_model_folder,
    load_initial_model,
    load_model,
    load_pretrained,
    located,
    pretrained_names,
    read_manifest,
    run_directory,
    save_model,
    training_lines,
    training_started,
)
from .svr import Svr, SvrSettings
from .uncertainty import COVERAGE

__all__ = [
    "COVERAGE",
    "ESTIMATORS",
    "FORMAT_VERSION",
    "AngleSettings",
    "Compact",
    "CompactSettings",
    "Dcfe",
    "DcfeSettings",
    "Estimator",
    "FineTunable",
    "Fusion",
    "FusionSettings",
    "ModelFacts",
    "ModelSummary",
    "NetworkEstimator",
    "NoiseSettings",
    "PriorSettings",
    "Progress",
    "Rod",
    "RodSettings",
    "RodTrack",
    "RodTrackSettings",
    "ShapeFacts",
    "ShapeRegressor",
    "ShapeRegressorSettings",
    "Stereo",
    "StereoSettings",
    "Stream",
    "Svr",
    "SvrSettings",
    "Training",
    "WindowSettings",
    "check_target",
    "create",
    "export_onnx",
    "for_dataset",
    "initial_model_folder",
    "load_initial_model",
    "load_model",
    "load_pretrained",
    "located",
    "method",
    "no_progress",
    "pretrained_names",
    "read_manifest",
    "run_directory",
    "save_model",
    "train",
    "training_lines",
    "training_started",
]
