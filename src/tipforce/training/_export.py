"""From a trained network to an ONNX graph, and back to its weights."""

import copy
import logging
import warnings
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ._packages import package

if TYPE_CHECKING:
    from torch import Tensor, nn

__all__ = ["CONSTANT", "export_graph", "parity_n", "plain", "weights_of"]

OPSET = 18
IR_VERSION = 10

CONSTANT = "constant/"
"""How the names of initialisers begin that are no parameters."""

_WIDE = "/fp32"
_HALVED_FROM = 256
"""Smallest number of elements of a matrix that is stored in half precision; vectors weigh next to nothing."""


def export_graph(
    network: "nn.Module",
    inputs: Mapping[str, tuple[tuple[int, ...], str]],
    outputs: Sequence[str],
    facts: Mapping[str, str],
    *,
    halved: bool = True,
) -> bytes:
    """ONNX graph of ``network`` as it answers in eval mode; the network itself stays as it is.

    ``inputs``: the names of its arguments -> (shape of one sample, "uint8" or "float32"); a batch dimension ``n``
    stands before each. ``outputs``: names of the tensors it returns, in order. ``facts`` go along with the graph.

    Initialisers carry the names of parameters and buffers (`weights_of`); those that the outputs do not depend on are
    left out. Matrices and kernels are stored in half precision, with a Cast behind that runtimes fold when they load
    the graph: half the bytes, the same speed. One that half precision cannot hold stays whole; without ``halved``, all.
    Raises MissingExtraError without torch, onnx and onnxscript.
    """
    torch, onnx = package("torch"), package("onnx")
    optimizer = package("onnxscript.optimizer")
    frozen = _with_plain_means(copy.deepcopy(network).cpu().float().eval())
    kinds = {"uint8": torch.uint8, "float32": torch.float32}
    # two samples: a batch of one would be taken for a constant
    examples = {name: torch.ones((2, *shape), dtype=kinds[kind]) for name, (shape, kind) in inputs.items()}
    batch = torch.export.Dim("n")
    with _quiet(), torch.no_grad():
        program = torch.onnx.export(
            frozen,
            kwargs=examples,
            dynamo=True,
            input_names=list(inputs),
            output_names=list(outputs),
            dynamic_shapes={name: {0: batch} for name in inputs},
            opset_version=OPSET,
            optimize=False,  # it would fold the batch norms into the kernels, and their names would be gone
            verbose=False,
        )
        optimizer.fold_constants(program.model, onnx_shape_inference=True)
        optimizer.remove_unused_nodes(program.model)
    model = _tidied(onnx, program.model_proto, set(frozen.state_dict()))
    if halved:
        _halve(onnx, model)
    onnx.helper.set_model_props(model, dict(facts))
    onnx.checker.check_model(model, full_check=True)
    return model.SerializeToString()


def weights_of(graph: bytes) -> dict[str, npt.NDArray[np.float32]]:
    """Parameters and buffers of the network that `export_graph` made ``graph`` of, as the graph has them.

    Large ones are rounded to half precision. Batch norms' counters of batches are not among them.
    """
    onnx = package("onnx")
    found = {each.name: onnx.numpy_helper.to_array(each) for each in onnx.load_from_string(graph).graph.initializer}
    return {name: array.astype(np.float32) for name, array in found.items() if not name.startswith(CONSTANT)}


def parity_n(
    graph: bytes, network: "nn.Module", batch: Mapping[str, npt.NDArray[Any]], output: str = "force_n"
) -> float:
    """Largest deviation of ``graph``'s answer ``output`` from that of ``network`` in eval mode, over ``batch``.

    NaN where either answers NaN: hold it to a limit by ``not parity < limit``.
    """
    import onnxruntime

    torch = package("torch")
    session = onnxruntime.InferenceSession(graph, providers=["CPUExecutionProvider"])
    names = [each.name for each in session.get_outputs()]
    found: npt.NDArray[Any] = np.asarray(session.run([output], dict(batch))[0], np.float64)
    frozen = copy.deepcopy(network).cpu().float().eval()
    with torch.no_grad():
        answer: Any = frozen(**{name: torch.from_numpy(np.ascontiguousarray(array)) for name, array in batch.items()})
    wanted: Tensor = answer[output] if isinstance(answer, Mapping) else _listed(answer)[names.index(output)]
    return float(np.max(np.abs(found - wanted.double().numpy()), initial=0.0))


def _with_plain_means(network: "nn.Module") -> "nn.Module":
    """Pooling to one pixel said as a mean: of pictures with channels last, torch exports it with a gather behind."""
    torch = package("torch")

    class Mean(torch.nn.Module):
        def forward(self, x: Any) -> Any:
            return x.mean((2, 3), keepdim=True)

    for module in list(network.modules()):
        for name, child in list(module.named_children()):
            if isinstance(child, torch.nn.AdaptiveAvgPool2d) and child.output_size in (1, (1, 1)):
                setattr(module, name, Mean())
    return network


def plain(model: Any) -> None:
    """Undo the storing in half precision, in place: every initialiser is fp32 again and no Cast stands behind it."""
    onnx = package("onnx")
    graph = model.graph
    for node in [node for node in graph.node if len(node.output) == 1 and node.output[0].endswith(_WIDE)]:
        graph.node.remove(node)
    for each in graph.initializer:
        if each.data_type == onnx.TensorProto.FLOAT16:
            each.CopyFrom(onnx.numpy_helper.from_array(onnx.numpy_helper.to_array(each).astype(np.float32), each.name))
    for node in graph.node:
        node.input[:] = [name.removesuffix(_WIDE) for name in node.input]


def _listed(answer: Any) -> "list[Tensor]":
    return list(answer) if isinstance(answer, tuple | list) else [answer]


@contextmanager
def _quiet() -> Generator[None]:
    """Keeps the exporter's own deprecations, and that torchvision is not there, from who is waiting for the graph."""
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


def _tidied(onnx: Any, model: Any, parameters: set[str]) -> Any:
    """A new model of the same nodes: no traces of the source, and constants told from parameters by their names."""
    constants = {each.name for each in model.graph.initializer if each.name not in parameters}
    renamed = {name: f"{CONSTANT}{place}" for place, name in enumerate(sorted(constants))}
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
    graph = onnx.helper.make_graph(nodes, "tipforce", _bare(model.graph.input), _bare(model.graph.output), initialisers)
    return onnx.helper.make_model(
        graph,
        opset_imports=[onnx.helper.make_opsetid("", OPSET)],
        ir_version=IR_VERSION,
        producer_name="tipforce",
    )


def _bare(values: Sequence[Any]) -> list[Any]:
    """Inputs or outputs with name and type only."""
    bare: list[Any] = []
    for value in values:
        new = type(value)()
        new.name = value.name
        new.type.CopyFrom(value.type)
        bare.append(new)
    return bare


def _halve(onnx: Any, model: Any) -> None:
    """Store matrices and kernels in half precision, in place."""
    graph = model.graph
    casts: dict[str, Any] = {}
    for each in graph.initializer:
        array = onnx.numpy_helper.to_array(each)
        if array.dtype != np.float32 or array.ndim < 2 or array.size < _HALVED_FROM:
            continue
        if float(np.max(np.abs(array))) > float(np.finfo(np.float16).max):
            continue
        each.CopyFrom(onnx.numpy_helper.from_array(array.astype(np.float16), each.name))
        casts[each.name] = onnx.helper.make_node(
            "Cast", [each.name], [each.name + _WIDE], each.name + _WIDE, to=onnx.TensorProto.FLOAT
        )
    for node in graph.node:
        node.input[:] = [name + _WIDE if name in casts else name for name in node.input]
    nodes = [*casts.values(), *graph.node]
    del graph.node[:]
    graph.node.extend(nodes)
