"""Export of a fitted method as an ONNX graph."""

from pathlib import Path
from typing import Any

from ..io import write_atomic
from ._base import Estimator


def export_onnx(estimator: Estimator, path: str | Path) -> dict[str, Any]:
    """Writes a fitted method as an ONNX graph.

    Args:
        estimator: the fitted method.
        path: the file.

    Returns:
        Facts about the graph, among them ``parity_n`` and ``bytes``.

    Raises:
        InputError: the method has no export.
        ModelError: the graph's estimates would differ from this program's; nothing is written.
        MissingExtraError: onnx is not installed.
    """
    data, facts = estimator.to_onnx()
    write_atomic(Path(path), data)
    return {**facts, "bytes": len(data)}
