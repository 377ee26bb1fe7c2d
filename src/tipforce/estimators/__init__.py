"""Methods that turn what is seen into a force: one file a method, all with the same face."""

from ._base import Estimator, Progress, Stream
from ._create import ESTIMATORS, create
from ._onnx import export_onnx
from ._run import RunReport, write_estimates
from ._shows import ShowsShape
from .store import load_model, read_manifest, save_model

__all__ = [
    "ESTIMATORS",
    "Estimator",
    "Progress",
    "RunReport",
    "ShowsShape",
    "Stream",
    "create",
    "export_onnx",
    "load_model",
    "read_manifest",
    "save_model",
    "write_estimates",
]
