"""From network to graph: the same answers, the same names, half the bytes, and nothing of who made it."""

import sys

import numpy as np
import onnx
import pytest
import torch
from torch import nn

from tipforce.errors import MissingExtraError
from tipforce.training import export_graph, graph_weights, parity_n

INPUTS = {"image": ((16, 16), "uint8"), "actuation": ((2,), "float32")}


class Small(nn.Module):
    def __init__(self, outputs: int = 2) -> None:
        super().__init__()
        self.see = nn.Sequential(nn.Conv2d(1, 32, 3, 2), nn.BatchNorm2d(32), nn.ReLU(), nn.AdaptiveAvgPool2d(1))
        self.drop = nn.Dropout(0.5)
        self.head = nn.Linear(34, outputs)
        self.scale = nn.Parameter(torch.tensor(2.0))
        self.unused = nn.Linear(3, 3)

    def forward(self, image: torch.Tensor, actuation: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        seen = self.see(image.unsqueeze(1).float() / 255)
        both = torch.cat((self.drop(seen.flatten(1)), actuation), 1)
        return self.head(both) * self.scale, seen


def batch(samples: int = 5) -> dict[str, np.ndarray]:
    draw = np.random.default_rng(0)
    return {
        "image": draw.integers(0, 256, (samples, 16, 16), dtype=np.uint8),
        "actuation": draw.normal(size=(samples, 2)).astype(np.float32),
    }


@pytest.fixture(scope="module")
def network() -> Small:
    with torch.random.fork_rng():
        torch.manual_seed(0)
        small = Small()
        small.train()
        with torch.no_grad():  # batch norms that have seen something
            small(torch.from_numpy(batch(8)["image"]), torch.zeros(8, 2))
    return small


@pytest.fixture(scope="module")
def graph(network: Small) -> bytes:
    return export_graph(network, INPUTS, ["force_n", "seen"], {"trained_on": "nothing"})


def test_the_graph_answers_as_the_network_does(network: Small, graph: bytes) -> None:
    assert parity_n(graph, network, batch()) < 2e-3
    assert parity_n(graph, network, batch(1)) < 2e-3, "a batch of one"
    assert parity_n(graph, network, batch(), "seen") < 2e-3
    with torch.no_grad():
        changed = Small()
        changed.load_state_dict(network.state_dict())
        changed.head.bias[1] += 0.1
    assert parity_n(graph, changed, batch()) == pytest.approx(0.2, abs=5e-3), "twice the bias, by the scale"


def test_an_answer_that_is_no_number_is_seen(network: Small, graph: bytes) -> None:
    broken = Small()
    broken.load_state_dict(network.state_dict())
    with torch.no_grad():
        broken.head.bias[0] = torch.nan
    assert not parity_n(graph, broken, batch()) < 1.0


def test_weights_come_back_under_their_names(network: Small, graph: bytes) -> None:
    found, wanted = graph_weights(graph), network.state_dict()
    left_out = {"see.1.num_batches_tracked", "unused.weight", "unused.bias"}
    assert set(found) == set(wanted) - left_out
    for name, array in found.items():
        assert array.dtype == np.float32
        assert array.shape == wanted[name].shape
        assert np.allclose(array, wanted[name].numpy(), rtol=1e-3, atol=1e-6), name
    again = Small()
    again.load_state_dict({name: torch.from_numpy(array) for name, array in found.items()}, strict=False)
    assert parity_n(graph, again, batch()) < 1e-6, "what was rounded is what answers"


def test_matrices_are_stored_in_half_and_vectors_whole(network: Small, graph: bytes) -> None:
    kinds = {each.name: each.data_type for each in onnx.load_from_string(graph).graph.initializer}
    assert kinds["see.0.weight"] == onnx.TensorProto.FLOAT16
    assert kinds["see.1.running_var"] == onnx.TensorProto.FLOAT
    large = Small()
    large.load_state_dict(network.state_dict())
    with torch.no_grad():
        large.see[0].weight[0, 0, 0, 0] = 1e6
    graph = export_graph(large, INPUTS, ["force_n", "seen"], {})
    assert np.max(graph_weights(graph)["see.0.weight"]) == 1e6, "what half precision cannot hold stays whole"


def test_exporting_leaves_the_network_as_it_is(network: Small, graph: bytes) -> None:
    assert network.training
    assert network.drop.training
    assert all(value.dtype != torch.float16 for value in network.state_dict().values())


def test_the_graph_holds_its_facts_and_nothing_of_the_source(graph: bytes) -> None:
    model = onnx.load_from_string(graph)
    assert {each.key: each.value for each in model.metadata_props} == {"trained_on": "nothing"}
    assert model.producer_name == "tipforce"
    assert not any(each.metadata_props or each.doc_string for each in (*model.graph.node, *model.graph.input))
    assert b".py" not in graph


def test_a_missing_extra_names_the_install_line(network: Small, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "onnxscript.optimizer", None)
    with pytest.raises(MissingExtraError, match=r"onnxscript is not installed.*pip install -e '\.\[train\]'"):
        export_graph(network, INPUTS, ["force_n", "seen"], {})
