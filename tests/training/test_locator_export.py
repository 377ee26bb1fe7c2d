"""A graph of the locator computes what the network computes, at any size, and holds all of its weights."""

from pathlib import Path

import numpy as np
import onnxruntime
import pytest

from tipforce.errors import ModelError
from tipforce.vision import locator as locator_package

torch = pytest.importorskip("torch")
pytest.importorskip("onnxscript")


@pytest.fixture(scope="module")
def network():
    from tipforce.training.locator import Locator

    torch.manual_seed(0)
    return Locator().eval()


@pytest.fixture(scope="module", params=["weights replaced", pytest.param("exported", marks=pytest.mark.slow)])
def graph(network, request: pytest.FixtureRequest) -> bytes:
    """The shipped graph with other weights, as a fine-tuning makes it; or an export, which takes 20 s."""
    from tipforce.training.locator import export_locator, graph_with_weights

    if request.param == "exported":
        return export_locator(network)
    return graph_with_weights(Path(locator_package.__file__).with_name("locator.onnx").read_bytes(), network)


@pytest.mark.parametrize("shape", [(1, 10, 96, 128), (2, 10, 64, 160)])
def test_the_graph_computes_what_the_network_computes_at_any_size(network, graph, shape):
    from tipforce.training.locator import GRAPH_OUTPUTS

    session = onnxruntime.InferenceSession(graph, providers=["CPUExecutionProvider"])
    image = torch.randn(shape, generator=torch.Generator().manual_seed(1))
    with torch.inference_mode():
        outputs = network(image)
    for name, values in zip(GRAPH_OUTPUTS, session.run(list(GRAPH_OUTPUTS), {"image": image.numpy()}), strict=True):
        expected = getattr(outputs, name).numpy()
        assert values.shape == expected.shape
        assert np.abs(values - expected).max() < 0.01  # weights are stored in half precision


def test_a_network_from_the_graph_has_all_weights(network, graph, tmp_path: Path):
    from tipforce.training.locator import locator_from_graph

    path = tmp_path / "locator.onnx"
    path.write_bytes(graph)
    state, read = network.state_dict(), locator_from_graph(path).state_dict()
    assert state.keys() == read.keys()
    for name, value in state.items():
        assert torch.allclose(value.float(), read[name].float(), rtol=1e-3, atol=1e-6), name


def test_another_graph_is_refused_with_its_file(tmp_path: Path):
    from tipforce.training import export_graph
    from tipforce.training.locator import locator_from_graph

    path = tmp_path / "other.onnx"
    path.write_bytes(export_graph(torch.nn.Linear(3, 2), {"input": ((3,), "float32")}, ["y"], {}))
    with pytest.raises(ModelError, match=r"other\.onnx: this is no graph of the locator"):
        locator_from_graph(path)
