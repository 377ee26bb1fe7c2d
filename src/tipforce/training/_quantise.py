"""From a graph to one that calculates in 8 bits, and whether it still answers well enough."""

import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ._bytes_in import gathered_in_groups, pictures_as_bytes
from ._export import plain
from ._packages import package

__all__ = ["LARGEST_GROWTH", "error_growth", "quantise"]

LARGEST_GROWTH = 0.05
"""Share by which 8 bits may let the error grow: more than that and the graph they were made of stays in use."""

_PREPARED = {"onnx.quant.pre_process": "onnxruntime.quant"}
"""Tells the quantiser that batch norms are folded already; it would warn."""

Batch = Mapping[str, npt.NDArray[Any]]


def quantise(graph: bytes, batches: Iterable[Batch]) -> bytes:
    """``graph``, of `export_graph`, with convolutions in 8 bits; the same inputs and outputs.

    ``batches``: inputs as they are met in use; the range of every activation is taken from them. Activations are
    unsigned (processors multiply unsigned by signed bytes quickest), kernels signed, symmetric, with a scale for each
    output channel (Krishnamoorthi 2018; Jacob et al. 2018). What comes before the first convolutions and from the
    dense layers on stays as it is, and what takes other inputs than pictures: it takes little time, and what is rounded
    there is the force. Bytes that are merely divided by 255 go into the first convolution as they are.
    Raises MissingExtraError without onnx.
    """
    import onnxruntime

    onnx, tool = package("onnx"), package("onnxruntime.quantization")
    model = onnx.load_from_string(graph)
    facts = {each.key: each.value for each in model.metadata_props}
    plain(model)
    with tempfile.TemporaryDirectory(prefix="tipforce-") as folder:
        fused, quantised = Path(folder) / "fused.onnx", Path(folder) / "quantised.onnx"
        options = onnxruntime.SessionOptions()
        options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_ENABLE_BASIC  # folds batch norms
        options.optimized_model_filepath = str(fused)
        onnxruntime.InferenceSession(model.SerializeToString(), options, providers=["CPUExecutionProvider"])
        model = onnx.load(str(fused))
        gathered_in_groups(onnx, model)
        _drop_unused(model.graph)
        onnx.helper.set_model_props(model, _PREPARED)
        tool.quantize_static(
            model,
            str(quantised),
            _reader(tool, batches),
            quant_format=tool.QuantFormat.QDQ,
            activation_type=tool.QuantType.QUInt8,
            weight_type=tool.QuantType.QInt8,
            per_channel=True,
            nodes_to_exclude=_kept_whole(onnx, model.graph),
        )
        model = onnx.load(str(quantised))
    pictures_as_bytes(onnx, model)
    _drop_unused(model.graph)
    onnx.helper.set_model_props(model, facts)
    onnx.checker.check_model(model)
    return model.SerializeToString()


def error_growth(graph: bytes, quantised: bytes, labelled: Iterable[tuple[Batch, npt.NDArray[Any]]]) -> float:
    """By which share the mean error of ``force_n`` grows from ``graph`` to ``quantised``; negative where it shrinks.

    ``labelled``: inputs and force (n, t) in newtons, that ``quantise`` was not given. The error of a sample is the
    length of the difference; those that hold NaN are left out. Accept the graph by ``growth < LARGEST_GROWTH``: NaN,
    from a graph that answers NaN, is not accepted. Raises ValueError for no labelled sample.
    """
    import onnxruntime

    ways = [onnxruntime.InferenceSession(each, providers=["CPUExecutionProvider"]) for each in (graph, quantised)]
    totals, count = np.zeros(2), 0
    for batch, force_n in labelled:
        there = ~np.isnan(force_n).any(axis=1)
        count += int(there.sum())
        for place, way in enumerate(ways):
            found: npt.NDArray[Any] = np.asarray(way.run(["force_n"], dict(batch))[0])
            totals[place] += np.linalg.norm(found - force_n, axis=1)[there].sum()
    if not count:
        raise ValueError("there is no labelled sample to compare the graphs by")
    return float(totals[1] / totals[0] - 1.0)


def _kept_whole(onnx: Any, graph: Any) -> list[str]:
    """Names of all but what lies between the first convolutions and the dense layers, and takes pictures alone."""
    seen: set[str] = set()
    after = {each.name for each in graph.input if each.type.tensor_type.elem_type != onnx.TensorProto.UINT8}
    names: list[str] = []
    for node in graph.node:  # in the order of calculation
        if node.op_type == "Conv" or seen.intersection(node.input):
            seen.update(node.output)
        dense = node.op_type in ("Gemm", "MatMul") or bool(after.intersection(node.input))
        if dense:
            after.update(node.output)
        if dense or not seen.intersection(node.output):
            names.append(node.name)
    return names


def _drop_unused(graph: Any) -> None:
    """Drop initialisers that no node takes any more."""
    used = {name for node in graph.node for name in node.input}
    for each in [each for each in graph.initializer if each.name not in used]:
        graph.initializer.remove(each)


def _reader(tool: Any, batches: Iterable[Batch]) -> Any:
    """Batches as the quantiser asks for them."""

    class Reader(tool.CalibrationDataReader):
        def __init__(self) -> None:
            self._left = iter(batches)

        def get_next(self) -> dict[str, Any] | None:
            batch = next(self._left, None)
            return None if batch is None else dict(batch)

    return Reader()
