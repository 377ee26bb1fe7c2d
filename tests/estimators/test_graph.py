"""A graph behind a call: what goes in is checked, what is damaged is one clear sentence."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

from tipforce.errors import InputError, ModelError
from tipforce.estimators.networks import Graph, _trial, check_graph_file, try_graph


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
    return model.SerializeToString()


IMAGE = np.full((3, 4, 6), 7, np.uint8)
ACTUATION = np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]], np.float32)


def test_it_returns_its_outputs_for_any_number_of_samples(data: bytes) -> None:
    graph = Graph(data, "model.onnx", threads=1)
    assert np.allclose(graph(image=IMAGE, actuation=ACTUATION)["force_n"], 7 * ACTUATION)
    assert np.allclose(graph(image=IMAGE[:1], actuation=ACTUATION[:1])["force_n"], 7 * ACTUATION[:1])


def test_views_and_reversed_images_answer_the_same(data: bytes) -> None:
    graph = Graph(data, "model.onnx")
    wide = np.zeros((3, 4, 12), np.uint8)
    wide[:, :, ::2] = np.arange(6)
    answers = graph(image=wide[::-1, ::-1, ::2], actuation=ACTUATION)["force_n"]
    assert np.allclose(answers, 2.5 * ACTUATION)


def test_several_threads_may_ask_at_once(data: bytes) -> None:
    graph = Graph(data, "model.onnx", threads=1)

    def ask(value: int) -> bool:
        found = graph(image=np.full((3, 4, 6), value, np.uint8), actuation=ACTUATION)["force_n"]
        return np.allclose(found, value * ACTUATION)

    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(ask, range(200)))


@pytest.mark.parametrize(
    ("inputs", "message"),
    [
        ({}, r"model\.onnx: lacks the input actuation, lacks the input image; it takes image, actuation"),
        ({"image": IMAGE, "actuation": ACTUATION, "x": ACTUATION}, r"has no input x; it takes image, actuation"),
        (
            {"image": IMAGE[:, :3], "actuation": ACTUATION},
            r"image must be uint8 of the shape \(n, 4, 6\), got uint8 of the shape \(3, 3, 6\)",
        ),
        ({"image": IMAGE[0], "actuation": ACTUATION}, r"got uint8 of the shape \(4, 6\)"),
        ({"image": IMAGE.astype(float), "actuation": ACTUATION}, r"must be uint8 .*, got float64"),
        (
            {"image": IMAGE, "actuation": ACTUATION[:2]},
            r"as many samples in each input, got image 3, actuation 2",
        ),
    ],
)
def test_a_wrong_input_is_one_clear_sentence(data: bytes, inputs: dict[str, np.ndarray], message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        Graph(data, "model.onnx", threads=1)(**inputs)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("damage", [lambda d: d[:100], lambda d: b"", lambda d: b"hello", lambda d: d[: len(d) // 2]])
def test_damaged_bytes_are_one_clear_sentence(data: bytes, damage: Callable[[bytes], bytes]) -> None:
    with pytest.raises(ModelError, match=r"^model\.onnx: is damaged or no network's graph .*train the model again"):
        Graph(damage(data), "model.onnx", threads=1)


def with_operator(data: bytes, *nodes: onnx.NodeProto, **tensors: np.ndarray) -> bytes:
    """The graph with operators behind its output, the last of which gives ``force_n``."""
    model = onnx.load_from_string(data)
    model.graph.node[-1].output[0] = "before"
    model.graph.node.extend(nodes)
    model.graph.initializer.extend(onnx.numpy_helper.from_array(array, name) for name, array in tensors.items())
    return model.SerializeToString()


def looped(data: bytes) -> bytes:
    body = helper.make_graph(
        [helper.make_node("Identity", ["go"], ["still"]), helper.make_node("Identity", ["x"], ["y"])],
        "body",
        [helper.make_tensor_value_info(name, kind, []) for name, kind in (("i", 7), ("go", 9), ("x", 1))],
        [helper.make_tensor_value_info(name, kind, []) for name, kind in (("still", 9), ("y", 1))],
    )
    loop = helper.make_node("Loop", ["times", "yes", "before"], ["force_n"], body=body)
    return with_operator(data, loop, times=np.array(2**62), yes=np.array(True))


def changed(data: bytes, change: Callable[[onnx.ModelProto], object]) -> bytes:
    model = onnx.load_from_string(data)
    change(model)
    return model.SerializeToString()


def external(model: onnx.ModelProto) -> None:
    tensor = model.graph.initializer[0]
    tensor.ClearField("raw_data")
    tensor.data_location = onnx.TensorProto.EXTERNAL
    tensor.external_data.add(key="location", value="/etc/passwd")


@pytest.mark.parametrize(
    ("harm", "message"),
    [
        (looped, "has graphs or sparse tensors within its operators"),
        (
            lambda d: with_operator(d, helper.make_node("RandomNormalLike", ["before"], ["force_n"])),
            "'RandomNormalLike'",
        ),
        (lambda d: changed(d, lambda m: setattr(m.graph.node[0], "domain", "com.else")), "operator 'com.else.Cast'"),
        (lambda d: changed(d, lambda m: m.functions.add(name="f")), "has functions or training steps of its own"),
        (lambda d: changed(d, external), "keeps data in other files"),
        (lambda d: changed(d, lambda m: m.graph.sparse_initializer.add()), "has sparse tensors"),
        (lambda d: changed(d, lambda m: m.graph.initializer[0].dims.append(10**9)), "claims 2 x 1000000000 values"),
        (
            lambda d: changed(d, lambda m: m.graph.initializer[0].dims.append(-1)),
            "claims 2 x 18446744073709551615 values",
        ),
        (lambda d: d + d, "is damaged or no network's graph"),
        (lambda d: b"\x3a\xff\xff\xff\xff\xff\xff\xff\xff\xff\xff\xff", "is damaged or no network's graph"),
        (lambda d: b"\x08\x01" * 1_100_000, "has more than 1000000 fields"),
    ],
)
def test_a_graph_with_anything_but_plain_operators_is_not_loaded(
    data: bytes, harm: Callable[[bytes], bytes], message: str
) -> None:
    with pytest.raises(ModelError, match=message):
        check_graph_file(harm(data), "model.onnx")


def test_a_trial_ends_what_takes_too_much(data: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "model.onnx"
    path.write_bytes(data)
    try_graph(path)
    expand = helper.make_node("Expand", ["before", "shape"], ["large"])
    mean = helper.make_node("ReduceMean", ["large"], ["force_n"], axes=[0, 1])
    path.write_bytes(with_operator(data, expand, mean, shape=np.array([65_536, 65_536, 1, 2])))
    with pytest.raises(ModelError, match=r"model\.onnx: takes more than 4 GiB of memory; copy the whole"):
        try_graph(path)
    monkeypatch.setattr(_trial, "TRIAL_S", 0.01)
    with pytest.raises(ModelError, match=r"model\.onnx: one run took more than 0\.01 s"):
        try_graph(path)
