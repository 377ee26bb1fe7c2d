"""Static quantisation of a graph to 8 bits, and the growth of its error by it.

The bytes of the image enter the first convolution directly, without a conversion to floating point.
"""

import tempfile
from collections.abc import Iterable, Mapping, Sequence
from contextlib import nullcontext, redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from .._system.extras import import_extra
from ._export import to_single_precision

MAX_ERROR_GROWTH = 0.05
"""Largest relative growth of the error by quantisation; beyond it the graph in single precision is used."""

_Inputs = Mapping[str, npt.NDArray[Any]]
"""Inputs of a graph by name."""

_PREPROCESSED = {"onnx.quant.pre_process": "onnxruntime.quant"}
"""Metadata for the quantiser: batch normalisation is folded already; otherwise it would warn."""

_BYTE = np.float32(1.0 / 255.0)


def quantise(graph: bytes, batches: Iterable[_Inputs]) -> bytes:
    """Quantises the convolutions of a graph to 8 bits (static quantisation); inputs and outputs stay the same.

    Activations are unsigned (processors multiply unsigned by signed bytes fastest); kernels are signed and symmetric,
    with a scale for each output channel (Krishnamoorthi 2018; Jacob et al. 2018). The nodes before the first
    convolutions, the dense layers and the nodes with other inputs than images stay in single precision: they take
    little time, and rounding there would round the force. Images that are only divided by 255 enter the first
    convolution as bytes.

    Args:
        graph: a graph of `export_graph`.
        batches: calibration batches, typical inputs of the graph; the range of every activation is taken from them.

    Returns:
        The quantised graph.

    Raises:
        MissingExtraError: onnx is not installed.
    """
    onnx = import_extra("onnx", "train")
    model = fold_batch_norms(graph)
    metadata = {each.key: each.value for each in onnx.load_from_string(graph).metadata_props}
    model = quantise_nodes(model, batches, _not_quantised(onnx, model.graph))
    _feed_bytes(onnx, model)
    _drop_unused(model.graph)
    onnx.helper.set_model_props(model, metadata)
    onnx.checker.check_model(model)
    return model.SerializeToString()


def fold_batch_norms(graph: bytes) -> Any:
    """Returns the ONNX model of a graph in single precision, its batch normalisation folded into the kernels.

    Raises:
        MissingExtraError: onnx is not installed.
    """
    import onnxruntime

    onnx = import_extra("onnx", "train")
    model = onnx.load_from_string(graph)
    to_single_precision(model)
    with tempfile.TemporaryDirectory(prefix="tipforce-") as folder:
        path = Path(folder) / "folded.onnx"
        options = onnxruntime.SessionOptions()
        options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_ENABLE_BASIC
        options.optimized_model_filepath = str(path)
        onnxruntime.InferenceSession(model.SerializeToString(), options, providers=["CPUExecutionProvider"])
        return onnx.load(str(path))


def quantise_nodes(
    model: Any,
    batches: Iterable[_Inputs],
    excluded: list[str],
    *,
    kinds: Sequence[str] | None = None,
    cut_outliers: bool = False,
) -> Any:
    """Returns ``model`` with its nodes in 8 bits: activations unsigned, kernels signed with a scale for each channel.

    Args:
        model: a model of `fold_batch_norms`; its metadata are replaced.
        batches: calibration batches.
        excluded: names of the nodes that stay in single precision.
        kinds: operators that are quantised; all that can be by default.
        cut_outliers: whether the range of an activation leaves out its largest 0.001 %; otherwise it holds all values.
    """
    onnx, tool = import_extra("onnx", "train"), import_extra("onnxruntime.quantization", "train")
    _drop_unused(model.graph)
    onnx.helper.set_model_props(model, _PREPROCESSED)
    methods = tool.CalibrationMethod
    with tempfile.TemporaryDirectory(prefix="tipforce-") as folder:
        path = Path(folder) / "quantised.onnx"
        with redirect_stdout(StringIO()) if cut_outliers else nullcontext():  # that method prints its progress
            tool.quantize_static(
                model,
                str(path),
                _calibration_reader(tool, batches),
                quant_format=tool.QuantFormat.QDQ,
                op_types_to_quantize=kinds,
                activation_type=tool.QuantType.QUInt8,
                weight_type=tool.QuantType.QInt8,
                per_channel=True,
                nodes_to_exclude=excluded,
                calibrate_method=methods.Percentile if cut_outliers else methods.MinMax,
            )
        return onnx.load(str(path))


def error_growth(graph: bytes, quantised: bytes, labelled: Iterable[tuple[_Inputs, npt.NDArray[Any]]]) -> float:
    """Returns the relative growth of the mean error of ``force_n`` by quantisation; negative where it shrinks.

    Accept the quantised graph by ``growth < MAX_ERROR_GROWTH``, so that NaN is not accepted.

    Args:
        graph: the graph in single precision.
        quantised: the graph in 8 bits.
        labelled: inputs and forces (n, t) in newtons, other samples than the calibration batches. The error of a
            sample is the length of the force difference; samples with NaN are left out.

    Raises:
        ValueError: there is no labelled sample.
    """
    import onnxruntime

    sessions = [onnxruntime.InferenceSession(each, providers=["CPUExecutionProvider"]) for each in (graph, quantised)]
    totals, count = np.zeros(2), 0
    for batch, force_n in labelled:
        known = ~np.isnan(force_n).any(axis=1)
        count += int(known.sum())
        for number, session in enumerate(sessions):
            found: npt.NDArray[Any] = np.asarray(session.run(["force_n"], dict(batch))[0])
            totals[number] += np.linalg.norm(found - force_n, axis=1)[known].sum()
    if not count:
        raise ValueError("there is no labelled sample to compare the graphs on")
    return float(totals[1] / totals[0] - 1.0)


def _not_quantised(onnx: Any, graph: Any) -> list[str]:
    """Returns the names of all nodes but those between the first convolutions and the dense layers of images alone."""
    convolved: set[str] = set()
    dense_inputs = {each.name for each in graph.input if each.type.tensor_type.elem_type != onnx.TensorProto.UINT8}
    names: list[str] = []
    for node in graph.node:  # in topological order
        if node.op_type == "Conv" or convolved.intersection(node.input):
            convolved.update(node.output)
        # the exporter may take the batch size from any input: this makes no node dense
        from_dense = node.op_type != "Shape" and bool(dense_inputs.intersection(node.input))
        dense = node.op_type in ("Gemm", "MatMul") or from_dense
        if dense:
            dense_inputs.update(node.output)
        if dense or not convolved.intersection(node.output):
            names.append(node.name)
    return names


def _drop_unused(graph: Any) -> None:
    """Removes initialisers that no node uses any more."""
    used = {name for node in graph.node for name in node.input}
    for each in [each for each in graph.initializer if each.name not in used]:
        graph.initializer.remove(each)


def _calibration_reader(tool: Any, batches: Iterable[_Inputs]) -> Any:
    """Returns ``batches`` with the interface that the quantiser expects."""

    class Reader(tool.CalibrationDataReader):
        def __init__(self) -> None:
            self._rest = iter(batches)

        def get_next(self) -> dict[str, Any] | None:
            batch = next(self._rest, None)
            return None if batch is None else dict(batch)

    return Reader()


def _feed_bytes(onnx: Any, model: Any) -> None:
    """Replaces Cast, division by 255 and quantisation of an image by its bytes, in place."""
    graph = model.graph
    consumers, producers = _consumers(graph), _producers(graph)
    constants = {each.name: each for each in graph.initializer}
    for division in [node for node in graph.node if node.op_type == "Div"]:
        cast, quantisation = (
            producers.get(division.input[0]),
            _only_consumer(consumers, division.output[0], "QuantizeLinear"),
        )
        if cast is None or cast.op_type != "Cast" or quantisation is None or not _by_255(onnx, constants, division):
            continue
        dequantisation = _only_consumer(consumers, quantisation.output[0], "DequantizeLinear")
        if dequantisation is None:
            continue
        scale, zero = "image_scale", "image_zero"
        graph.initializer.extend(
            [onnx.numpy_helper.from_array(np.array(_BYTE), scale), onnx.numpy_helper.from_array(np.uint8(0), zero)]
        )
        del dequantisation.input[:]
        dequantisation.input.extend([cast.input[0], scale, zero])
        for node in (cast, division, quantisation):
            graph.node.remove(node)


def _by_255(onnx: Any, constants: dict[str, Any], division: Any) -> bool:
    divisor = constants.get(division.input[1])
    return divisor is not None and bool(np.all(onnx.numpy_helper.to_array(divisor) == 255.0))


def _consumers(graph: Any) -> dict[str, list[Any]]:
    found: dict[str, list[Any]] = {}
    for node in graph.node:
        for name in node.input:
            found.setdefault(name, []).append(node)
    return found


def _producers(graph: Any) -> dict[str, Any]:
    return {name: node for node in graph.node for name in node.output}


def _only_consumer(consumers: dict[str, list[Any]], name: str, kind: str) -> Any:
    """Returns the only node that uses ``name``, if it is of this kind."""
    found = consumers.get(name, [])
    return found[0] if len(found) == 1 and found[0].op_type == kind else None
