"""The support vector machines as an ONNX graph, with a parity gate in newtons."""

import importlib
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..._system.extras import import_extra
from ...errors import ModelError
from ...types import FloatArray
from ._machine import Machines

PARITY_N = 1e-6
"""Largest difference of estimates to those of scikit-learn, and of a graph's to those of this program."""

OPSET = 17
IR_VERSION = 8
PROBES = 256


def regression_graph(machines: Machines, names: Sequence[str], targets: Sequence[str]) -> tuple[bytes, dict[str, Any]]:
    """Returns a fitted regression as an ONNX graph in plain operators and double precision.

    Its input ``features`` (n, k) are raw shape numbers and actuation, as ``metadata_props["features"]`` lists them
    (with a window: lag after lag); its output ``force_n`` (n, t) is in newtons. The detection is not part of the graph.

    Args:
        machines: the fitted machines.
        names: names of the features.
        targets: names of the estimated forces.

    Returns:
        The bytes of the graph, and facts about it. ``parity_n`` is the largest deviation from this program on probes
        around the support vectors.

    Raises:
        ModelError: the deviation reaches `PARITY_N`.
        MissingExtraError: onnx is not installed.
    """
    onnx = import_extra("onnx", "onnx")
    runtime: Any = importlib.import_module("onnxruntime")  # here, because the import is slow
    model = _graph(onnx, machines, {"features": ", ".join(names), "targets": ", ".join(targets)})
    onnx.checker.check_model(model)
    data = model.SerializeToString()
    session = runtime.InferenceSession(data, providers=["CPUExecutionProvider"])
    probes = _probes(machines)
    parity = float(np.max(np.abs(session.run(None, {"features": probes})[0] - machines.many(probes))))
    if not parity < PARITY_N:
        raise ModelError(f"the ONNX graph would differ by up to {parity:.2g} N from this program: it was not written")
    return data, {"parity_n": parity, "features": list(names), "targets": list(targets), "opset": OPSET}


def _probes(machines: Machines) -> FloatArray:
    """Returns (PROBES, k) raw features between and a little beyond the support vectors."""
    draw = np.random.default_rng(0)
    pairs = machines.vectors[draw.integers(0, len(machines.vectors), (2, PROBES))]
    scaled = pairs[0] + draw.uniform(-0.5, 1.5, (PROBES, 1)) * (pairs[1] - pairs[0])
    usable = machines.scale > 0
    return np.where(usable, scaled / np.where(usable, machines.scale, 1.0) + machines.shift, 0.0)


def _graph(onnx: Any, machines: Machines, facts: dict[str, str]) -> Any:
    """Returns the ONNX model of `Machines`: for each target the kernel sum and the linear part, in newtons."""
    helper, number = onnx.helper, onnx.numpy_helper.from_array
    constants: list[Any] = []
    nodes: list[Any] = []

    def constant(name: str, array: Any) -> str:
        constants.append(number(np.ascontiguousarray(array), name))
        return name

    def node(kind: str, *inputs: str, out: str, **options: Any) -> str:
        nodes.append(helper.make_node(kind, list(inputs), [out], **options))
        return out

    def summed(square: str, out: str) -> str:
        return node("ReduceSum", square, constant(f"{out}_axis", np.array([1], np.int64)), out=out, keepdims=1)

    shifted = node("Sub", "features", constant("shift", machines.shift), out="moved")
    x = node("Mul", shifted, constant("scale", machines.scale), out="x")  # (n, k) scaled features
    length = summed(node("Mul", x, x, out="x_squared"), "x_length")
    forces: list[str] = []
    start = 0
    for t, end in enumerate(machines.ends.tolist()):
        vectors, dual = machines.vectors[start:end], machines.dual[start:end]
        start = end
        # |x - v|^2 = |x|^2 - 2 x v + |v|^2, by matrices
        cross = node("MatMul", x, constant(f"vectors_{t}", -2.0 * vectors.T), out=f"cross_{t}")
        near = node("Add", cross, constant(f"lengths_{t}", np.sum(vectors**2, axis=1)), out=f"near_{t}")
        square = node("Add", near, length, out=f"square_{t}")
        scaled = node("Mul", square, constant(f"gamma_{t}", np.array(-machines.gamma[t])), out=f"scaled_{t}")
        curved = node(
            "MatMul", node("Exp", scaled, out=f"kernel_{t}"), constant(f"dual_{t}", dual[:, None]), out=f"c_{t}"
        )
        straight = node("MatMul", x, constant(f"weights_{t}", machines.weights[t][:, None]), out=f"s_{t}")
        both = node("Add", curved, straight, out=f"both_{t}")
        share = node("Add", both, constant(f"intercept_{t}", np.array(machines.intercept[t])), out=f"share_{t}")
        forces.append(node("Mul", share, constant(f"unit_{t}", np.array(machines.unit_n[t])), out=f"newtons_{t}"))
    node("Concat", *forces, out="force_n", axis=1)
    double, width = onnx.TensorProto.DOUBLE, machines.vectors.shape[1]
    graph = helper.make_graph(
        nodes,
        "tipforce_svr",
        [helper.make_tensor_value_info("features", double, ["n", width])],
        [helper.make_tensor_value_info("force_n", double, ["n", len(forces)])],
        constants,
    )
    model = helper.make_model(
        graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=IR_VERSION, producer_name="tipforce"
    )
    helper.set_model_props(model, facts)
    return model
