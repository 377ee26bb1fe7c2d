"""Quantisation: nearly the same outputs, the image's bytes as they are, and a limit for the growth of the error."""

from collections.abc import Callable, Sequence

import numpy as np
import onnx
import onnxruntime
import pytest
from onnx import TensorProto, helper, numpy_helper

from tipforce.training import MAX_ERROR_GROWTH, error_growth, quantise

SIDE = 24


def network(size: int = 5, channels: int = 1, side: int = SIDE, before: Sequence[str] = ("Div",)) -> bytes:
    """Bytes -> convolution of stride 2 -> Relu -> convolution -> mean -> dense with an actuation value beside."""
    draw = np.random.default_rng(size + channels)
    weights = {
        "first": draw.normal(size=(6, channels, size, size)) / size,
        "first_bias": draw.normal(size=6) / 10,
        "second": draw.normal(size=(32, 6, 3, 3)) / 4,
        "dense": draw.normal(size=(33, 2)) / 30,
    }
    constants = [numpy_helper.from_array(array.astype(np.float32), name) for name, array in weights.items()]
    constants.append(numpy_helper.from_array(np.float32(255.0), "white"))
    constants.append(numpy_helper.from_array(np.array([1]), "axis"))
    constants.append(numpy_helper.from_array(np.array([2, 3]), "axes"))
    node = helper.make_node
    facing = (
        node("Unsqueeze", ["image", "axis"], ["facing"])
        if channels == 1
        else node("Transpose", ["image"], ["facing"], perm=[0, 3, 1, 2])
    )
    nodes = [
        facing,
        node("Cast", ["facing"], ["numbers"], to=TensorProto.FLOAT),
        node(before[0], ["numbers", "white"], ["bright"]),
        node("Conv", ["bright", "first", "first_bias"], ["a"], strides=[2, 2], pads=[size // 2] * 4),
        node("Relu", ["a"], ["b"]),
        node("Conv", ["b", "second"], ["c"], pads=[1] * 4),
        node("Relu", ["c"], ["d"]),
        node("ReduceMean", ["d", "axes"], ["e"], keepdims=0),
        node("Concat", ["e", "actuation"], ["f"], axis=1),
        node("Gemm", ["f", "dense"], ["force_n"]),
    ]
    shape = ["n", side, side] if channels == 1 else ["n", side, side, channels]
    inputs = [
        helper.make_tensor_value_info("image", TensorProto.UINT8, shape),
        helper.make_tensor_value_info("actuation", TensorProto.FLOAT, ["n", 1]),
    ]
    outputs = [helper.make_tensor_value_info("force_n", TensorProto.FLOAT, ["n", 2])]
    for each in nodes:
        each.name = each.output[0]
    graph = helper.make_graph(nodes, "g", inputs, outputs, constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=10)
    helper.set_model_props(model, {"trained_on": "nothing"})
    onnx.checker.check_model(model, full_check=True)
    return model.SerializeToString()


def batch(samples: int, channels: int = 1, side: int = SIDE, seed: int = 0) -> dict[str, np.ndarray]:
    draw = np.random.default_rng(seed)
    shape = (samples, side, side) if channels == 1 else (samples, side, side, channels)
    dark = np.linspace(40, 255, samples).astype(np.uint8).reshape(-1, *[1] * (len(shape) - 1))
    image = (draw.integers(0, 256, shape) * (dark / 255.0)).astype(np.uint8)
    return {"image": image, "actuation": draw.normal(size=(samples, 1)).astype(np.float32)}


def answers(graph: bytes, inputs: dict[str, np.ndarray]) -> np.ndarray:
    session = onnxruntime.InferenceSession(graph, providers=["CPUExecutionProvider"])
    return session.run(["force_n"], inputs)[0]


@pytest.mark.parametrize("channels", [1, 3])
def test_eight_bits_answer_nearly_the_same(channels: int) -> None:
    graph, unseen = network(channels=channels), batch(20, channels, seed=1)
    small = quantise(graph, [batch(8, channels)])
    wanted = answers(graph, unseen)
    assert np.max(np.abs(answers(small, unseen) - wanted)) < 0.02 * np.ptp(wanted)
    model = onnx.load_from_string(small)
    kinds = {each.data_type for each in model.graph.initializer if len(each.dims) == 4}
    assert kinds == {TensorProto.INT8}, "kernels are stored as bytes"
    assert [each.name for each in model.graph.input] == ["image", "actuation"]
    assert {each.key: each.value for each in model.metadata_props} == {"trained_on": "nothing"}
    assert not [node for node in model.graph.node if node.op_type in ("Cast", "Div")], "bytes go in as they are"


def test_images_that_are_not_divided_by_255_are_quantised_too() -> None:
    graph = network(before=("Mul",))
    small = quantise(graph, [batch(8)])
    wanted = answers(graph, batch(5))
    # processors without dot products of bytes add pairs of them in 16 bit, which may saturate
    assert np.max(np.abs(answers(small, batch(5)) - wanted)) < 0.05 * np.ptp(wanted)


def labelled(graph: bytes, error_n: float) -> Callable[[], list[tuple[dict[str, np.ndarray], np.ndarray]]]:
    """Labels that the graph misses by ``error_n``, the last one unknown."""
    inputs = batch(30, seed=2)
    angle = np.random.default_rng(3).uniform(0, 2 * np.pi, 30)
    force = answers(graph, inputs) + error_n * np.column_stack([np.cos(angle), np.sin(angle)])
    force[-1] = np.nan
    return lambda: [(inputs, force)]


def test_the_gate_lets_through_what_hardly_grows_and_nothing_else() -> None:
    graph = network()
    spread = float(np.ptp(answers(graph, batch(30, seed=2))))
    good = quantise(graph, [batch(8)])
    assert abs(error_growth(graph, good, labelled(graph, 0.2 * spread)())) < MAX_ERROR_GROWTH
    poor = quantise(graph, [{**batch(8), "image": batch(8)["image"] // 8}])  # ranges of dark images only
    assert error_growth(graph, poor, labelled(graph, 0.02 * spread)()) > 5 * MAX_ERROR_GROWTH
    with pytest.raises(ValueError, match="no labelled sample"):
        error_growth(graph, good, [])


def test_a_graph_that_answers_no_number_is_not_let_through() -> None:
    graph = network()
    model = onnx.load_from_string(graph)
    dense = next(each for each in model.graph.initializer if each.name == "dense")
    dense.CopyFrom(numpy_helper.from_array(np.full((33, 2), np.nan, np.float32), "dense"))
    assert not error_growth(graph, model.SerializeToString(), labelled(graph, 0.1)()) < MAX_ERROR_GROWTH
