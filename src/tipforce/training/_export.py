"""Exports a trained network to an ONNX graph, compares both, and reads the weights in a graph."""

import copy
import logging
import warnings
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from .._system.extras import import_extra

if TYPE_CHECKING:
    from torch import Tensor, nn

OPSET = 18
IR_VERSION = 10

_CONSTANT = "constant/"
"""Prefix of the initialisers that are no parameters."""
_FP32 = "/fp32"
"""Suffix of an initialiser's name where it is cast to single precision."""
MIN_HALF_PRECISION_SIZE = 256
"""Smallest number of elements of a matrix that is stored in half precision; small ones save almost nothing."""


def export_graph(
    network: "nn.Module",
    inputs: Mapping[str, tuple[tuple[int, ...], str]],
    outputs: Sequence[str],
    metadata: Mapping[str, str],
    *,
    free_axes: Mapping[int, int] | None = None,
    half_precision: bool = True,
) -> bytes:
    """Exports ``network`` in eval mode to an ONNX graph; the network itself is not changed.

    Initialisers carry the names of parameters and buffers (`graph_weights`); those that the outputs do not depend on
    are left out. Matrices and kernels are stored in half precision, followed by a Cast that runtimes fold when they
    load the graph: half the bytes, the same speed. A matrix beyond the range of half precision stays in single.

    Args:
        network: the network.
        inputs: names of its arguments -> (shape of one sample, "uint8" or "float32"); a batch dimension ``n`` is added.
        outputs: names of the tensors it returns, in order.
        metadata: metadata to store with the graph.
        free_axes: axes of the inputs, counted with the batch dimension, whose length may be any multiple of a number:
            axis -> that number. The lengths in ``inputs`` are then examples.
        half_precision: whether large arrays are stored in half precision; otherwise all are in single.

    Returns:
        The bytes of the graph.

    Raises:
        MissingExtraError: torch, onnx or onnxscript is not installed.
    """
    torch, onnx = import_extra("torch", "train"), import_extra("onnx", "train")
    optimizer = import_extra("onnxscript.optimizer", "train")
    exported = _replace_mean_pooling(copy.deepcopy(network).cpu().float().eval())
    kinds = {"uint8": torch.uint8, "float32": torch.float32}
    # two samples: a batch of one would be taken for a constant
    examples = {name: torch.ones((2, *shape), dtype=kinds[kind]) for name, (shape, kind) in inputs.items()}
    dim = torch.export.Dim
    axes = {0: dim("n")} | {k: multiple * dim(f"axis{k}") for k, multiple in (free_axes or {}).items()}
    with _suppress_warnings(), torch.no_grad():
        program = torch.onnx.export(
            exported,
            kwargs=examples,
            dynamo=True,
            input_names=list(inputs),
            output_names=list(outputs),
            dynamic_shapes=dict.fromkeys(inputs, axes),
            opset_version=OPSET,
            optimize=False,  # it would fold the batch norms into the kernels, and their names would be gone
            verbose=False,
        )
        optimizer.fold_constants(program.model, onnx_shape_inference=True)
        optimizer.remove_unused_nodes(program.model)
    model = _clean_model(onnx, program.model_proto, set(exported.state_dict()))
    if half_precision:
        store_in_half_precision(onnx, model)
    onnx.helper.set_model_props(model, dict(metadata))
    onnx.checker.check_model(model, full_check=True)
    return model.SerializeToString()


def graph_weights(graph: bytes) -> dict[str, npt.NDArray[np.float32]]:
    """Returns parameters and buffers of the network in a graph of `export_graph`, by name.

    Large ones are rounded to half precision. The counters of batch normalisation are not among them.
    """
    onnx = import_extra("onnx", "train")
    found = {each.name: onnx.numpy_helper.to_array(each) for each in onnx.load_from_string(graph).graph.initializer}
    return {name: array.astype(np.float32) for name, array in found.items() if not name.startswith(_CONSTANT)}


def parity_n(
    graph: bytes, network: "nn.Module", batch: Mapping[str, npt.NDArray[Any]], output: str = "force_n"
) -> float:
    """Returns the largest deviation of a graph's output from the network's in eval mode.

    Args:
        graph: the ONNX graph.
        network: the network from which it was exported.
        batch: inputs by name, (n, ...) each.
        output: name of the output that is compared.

    Returns:
        The deviation in the output's unit (N). It is NaN where either output is NaN: compare it to a limit by
        ``not parity < limit``.
    """
    import onnxruntime

    torch = import_extra("torch", "train")
    session = onnxruntime.InferenceSession(graph, providers=["CPUExecutionProvider"])
    names = [each.name for each in session.get_outputs()]
    found: npt.NDArray[Any] = np.asarray(session.run([output], dict(batch))[0], np.float64)
    reference = copy.deepcopy(network).cpu().float().eval()
    with torch.no_grad():
        result: Any = reference(
            **{name: torch.from_numpy(np.ascontiguousarray(array)) for name, array in batch.items()}
        )
    expected: Tensor = result[output] if isinstance(result, Mapping) else _as_list(result)[names.index(output)]
    return float(np.max(np.abs(found - expected.double().numpy()), initial=0.0))


def _replace_mean_pooling(network: "nn.Module") -> "nn.Module":
    """Replaces mean pooling to one pixel by a mean: with channels last torch would export it with a Gather after it."""
    torch = import_extra("torch", "train")

    class Mean(torch.nn.Module):
        def forward(self, x: Any) -> Any:
            return x.mean((2, 3), keepdim=True)

    for module in list(network.modules()):
        for name, child in list(module.named_children()):
            if isinstance(child, torch.nn.AdaptiveAvgPool2d) and child.output_size in (1, (1, 1)):
                setattr(module, name, Mean())
    return network


def to_single_precision(model: Any) -> None:
    """Reverts the storage in half precision, in place: every initialiser is fp32 and no Cast follows it."""
    onnx = import_extra("onnx", "train")
    graph = model.graph
    for node in [node for node in graph.node if len(node.output) == 1 and node.output[0].endswith(_FP32)]:
        graph.node.remove(node)
    for each in graph.initializer:
        if each.data_type == onnx.TensorProto.FLOAT16:
            each.CopyFrom(onnx.numpy_helper.from_array(onnx.numpy_helper.to_array(each).astype(np.float32), each.name))
    for node in graph.node:
        node.input[:] = [name.removesuffix(_FP32) for name in node.input]


def _as_list(result: Any) -> "list[Tensor]":
    return list(result) if isinstance(result, tuple | list) else [result]


@contextmanager
def _suppress_warnings() -> Generator[None]:
    """Suppresses the exporter's own deprecation warnings, and the one that torchvision is not installed."""
    registration = logging.getLogger("torch.onnx._internal.exporter._registration")
    level = registration.level
    registration.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", category=FutureWarning, module=r"copyreg|torch\..*")
            warnings.filterwarnings(
                "ignore", category=DeprecationWarning, module=r"onnxscript\..*|torch\..*|onnx_ir\..*"
            )
            warnings.filterwarnings("ignore", message=r"# The axis name: n will not be used")
            yield
    finally:
        registration.setLevel(level)


def _clean_model(onnx: Any, model: Any, parameters: set[str]) -> Any:
    """Returns a new model of the same nodes without source locations; names distinguish constants from parameters."""
    constants = {each.name for each in model.graph.initializer if each.name not in parameters}
    renamed = {name: f"{_CONSTANT}{number}" for number, name in enumerate(sorted(constants))}
    nodes = [
        onnx.helper.make_node(node.op_type, [renamed.get(name, name) for name in node.input], list(node.output))
        for node in model.graph.node
    ]
    for new, old in zip(nodes, model.graph.node, strict=True):
        new.attribute.extend(old.attribute)
        new.name = old.name
    initialisers: list[Any] = []
    for each in model.graph.initializer:
        array = onnx.numpy_helper.to_array(each)
        initialisers.append(onnx.numpy_helper.from_array(array, renamed.get(each.name, each.name)))
    graph = onnx.helper.make_graph(
        nodes, "tipforce", _name_and_type(model.graph.input), _name_and_type(model.graph.output), initialisers
    )
    return onnx.helper.make_model(
        graph,
        opset_imports=[onnx.helper.make_opsetid("", OPSET)],
        ir_version=IR_VERSION,
        producer_name="tipforce",
    )


def _name_and_type(values: Sequence[Any]) -> list[Any]:
    """Returns inputs or outputs with name and type only."""
    cleaned: list[Any] = []
    for value in values:
        new = type(value)()
        new.name = value.name
        new.type.CopyFrom(value.type)
        cleaned.append(new)
    return cleaned


def store_in_half_precision(onnx: Any, model: Any) -> None:
    """Stores matrices and kernels in half precision.

    Args:
        onnx: the module of that name.
        model: an ONNX model; changed in place.
    """
    graph = model.graph
    casts: dict[str, Any] = {}
    for each in graph.initializer:
        array = onnx.numpy_helper.to_array(each)
        if array.dtype != np.float32 or array.ndim < 2 or array.size < MIN_HALF_PRECISION_SIZE:
            continue
        if float(np.max(np.abs(array))) > float(np.finfo(np.float16).max):
            continue
        each.CopyFrom(onnx.numpy_helper.from_array(array.astype(np.float16), each.name))
        casts[each.name] = onnx.helper.make_node(
            "Cast", [each.name], [each.name + _FP32], each.name + _FP32, to=onnx.TensorProto.FLOAT
        )
    for node in graph.node:
        node.input[:] = [name + _FP32 if name in casts else name for name in node.input]
    nodes = [*casts.values(), *graph.node]
    del graph.node[:]
    graph.node.extend(nodes)
