"""A graph behind a call: what goes in is checked, what is damaged is one clear sentence."""

import importlib.util
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Literal

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

from tipforce.errors import InputError, MissingExtraError, ModelError
from tipforce.estimators.networks import Graph

Runtime = Literal["onnxruntime", "openvino"]
RUNTIMES = ["onnxruntime", *(["openvino"] if importlib.util.find_spec("openvino") else [])]


@pytest.fixture(scope="module")
def data() -> bytes:
    """force_n = the mean of the image times the actuation."""
    nodes = [
        helper.make_node("Cast", ["image"], ["bright"], to=TensorProto.FLOAT),
        helper.make_node("ReduceMean", ["bright"], ["mean"], axes=[1, 2], keepdims=0),
        helper.make_node("Reshape", ["mean", "column"], ["one"]),
        helper.make_node("Mul", ["one", "actuation"], ["force_n"]),
    ]
    inputs = [
        helper.make_tensor_value_info("image", TensorProto.UINT8, ["n", 4, 6]),
        helper.make_tensor_value_info("actuation", TensorProto.FLOAT, ["n", 2]),
    ]
    outputs = [helper.make_tensor_value_info("force_n", TensorProto.FLOAT, ["n", 2])]
    column = onnx.numpy_helper.from_array(np.array([-1, 1]), "column")
    graph = helper.make_graph(nodes, "g", inputs, outputs, [column])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    helper.set_model_props(model, {"unit": "N", "parity_n": "1e-05"})
    return model.SerializeToString()


PICTURE = np.full((3, 4, 6), 7, np.uint8)
ACTUATION = np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]], np.float32)


@pytest.mark.parametrize("on", RUNTIMES)
def test_it_returns_outputs_and_has_its_metadata(data: bytes, on: Runtime) -> None:
    graph = Graph(data, "model.onnx", threads=1, on=on)
    assert np.allclose(graph(image=PICTURE, actuation=ACTUATION)["force_n"], 7 * ACTUATION)
    assert np.allclose(graph(image=PICTURE[:1], actuation=ACTUATION[:1])["force_n"], 7 * ACTUATION[:1])
    assert graph.metadata == {"unit": "N", "parity_n": "1e-05"}
    assert graph.runtime.split()[0].lower() == on


def test_openvino_that_is_not_there_names_the_install_line(data: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(MissingExtraError, match=r"openvino is not installed.*\.\[openvino\]"):
        Graph(data, "model.onnx", on="openvino")


@pytest.mark.parametrize("on", RUNTIMES)
def test_views_and_reversed_pictures_answer_the_same(data: bytes, on: Runtime) -> None:
    graph = Graph(data, "model.onnx", on=on)
    wide = np.zeros((3, 4, 12), np.uint8)
    wide[:, :, ::2] = np.arange(6)
    answers = graph(image=wide[::-1, ::-1, ::2], actuation=ACTUATION)["force_n"]
    assert np.allclose(answers, 2.5 * ACTUATION)


@pytest.mark.parametrize("on", RUNTIMES)
def test_several_threads_may_ask_at_once(data: bytes, on: Runtime) -> None:
    graph = Graph(data, "model.onnx", threads=1, on=on)

    def ask(value: int) -> bool:
        found = graph(image=np.full((3, 4, 6), value, np.uint8), actuation=ACTUATION)["force_n"]
        return np.allclose(found, value * ACTUATION)

    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(ask, range(200)))


@pytest.mark.parametrize(
    ("inputs", "message"),
    [
        ({}, r"model\.onnx: lacks the input actuation, lacks the input image; it takes image, actuation"),
        ({"image": PICTURE, "actuation": ACTUATION, "x": ACTUATION}, r"has no input x; it takes image, actuation"),
        (
            {"image": PICTURE[:, :3], "actuation": ACTUATION},
            r"image must be uint8 of the shape \(n, 4, 6\), got uint8 of the shape \(3, 3, 6\)",
        ),
        ({"image": PICTURE[0], "actuation": ACTUATION}, r"got uint8 of the shape \(4, 6\)"),
        ({"image": PICTURE.astype(float), "actuation": ACTUATION}, r"must be uint8 .*, got float64"),
        (
            {"image": PICTURE, "actuation": ACTUATION[:2]},
            r"as many samples in each input, got image 3, actuation 2",
        ),
    ],
)
def test_a_wrong_input_is_one_clear_sentence(data: bytes, inputs: dict[str, np.ndarray], message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        Graph(data, "model.onnx", threads=1)(**inputs)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("on", RUNTIMES)
@pytest.mark.parametrize("damage", [lambda d: d[:100], lambda d: b"", lambda d: b"hello", lambda d: d[: len(d) // 2]])
def test_damaged_bytes_are_one_clear_sentence(data: bytes, damage: Callable[[bytes], bytes], on: Runtime) -> None:
    with pytest.raises(ModelError, match=r"^model\.onnx: is damaged or no network's graph .*train the model again"):
        Graph(damage(data), "model.onnx", threads=1, on=on)
