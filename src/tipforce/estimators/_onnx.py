"""Export to ONNX, with a parity gate in newtons."""

from pathlib import Path
from typing import Any

from ._base import Estimator

__all__ = ["export_onnx"]


def export_onnx(estimator: Estimator, path: str | Path) -> dict[str, Any]:
    """Write the fitted regression as an ONNX graph; returns its facts, among them the parity in newtons."""
    raise NotImplementedError(estimator, path)
