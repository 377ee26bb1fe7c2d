"""Methods that turn what is seen into a force: one file a method, all with the same face."""

from ._base import Estimator, Progress, Stream
from ._create import ESTIMATORS, create
from ._onnx import export_onnx
from .store import load_model, read_manifest, save_model

__all__ = [
    "ESTIMATORS",
    "Estimator",
    "Progress",
    "Stream",
    "create",
    "export_onnx",
    "load_model",
    "read_manifest",
    "save_model",
]
