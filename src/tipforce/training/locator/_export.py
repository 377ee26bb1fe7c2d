"""Exports the locator to an ONNX graph, and reads its weights from one."""

from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from ..._system.extras import import_extra
from ...errors import ModelError
from .._export import export_graph, graph_weights
from ._inputs import PROMPT_CHANNELS
from ._network import SIZE_MULTIPLE_PX, Locator

GRAPH_OUTPUTS = ("heat", "states", "present")
"""Outputs of the graph; see `LocatorOutputs`. The kinds and the dense values serve the training alone."""
_EXAMPLE_PX = 256, 320


class _GraphOutputs(Locator):
    """The locator with the outputs of its graph only."""

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor, Tensor]:  # type: ignore[override]
        outputs = super().forward(image)
        return outputs.heat, outputs.states, outputs.present


def export_locator(network: Locator) -> bytes:
    """Exports ``network`` to an ONNX graph; large weights are stored in half precision, and computed in single.

    The graph has the input ``image`` (n, 3 + PROMPT_CHANNELS, h, w) float32, as `network_input` makes it, h and w
    multiples of `SIZE_MULTIPLE_PX`; and the outputs `GRAPH_OUTPUTS`.

    Raises:
        MissingExtraError: onnx or onnxscript is not installed.
    """
    reduced = _GraphOutputs()
    reduced.load_state_dict(network.state_dict())
    return export_graph(
        reduced,
        {"image": ((3 + PROMPT_CHANNELS, *_EXAMPLE_PX), "float32")},
        GRAPH_OUTPUTS,
        {},
        free_axes={2: SIZE_MULTIPLE_PX, 3: SIZE_MULTIPLE_PX},
    )


def graph_with_weights(graph: bytes, network: Locator) -> bytes:
    """Returns a graph of `export_locator` with the weights of another network; this takes no export.

    Args:
        graph: the graph in single precision.
        network: the network whose weights are stored, each in the precision of the graph's.

    Raises:
        MissingExtraError: onnx is not installed.
    """
    onnx = import_extra("onnx", "train")
    model, state = onnx.load_from_string(graph), network.state_dict()
    for each in model.graph.initializer:
        if each.name in state:
            array = state[each.name].detach().numpy().astype(onnx.numpy_helper.to_array(each).dtype)
            each.CopyFrom(onnx.numpy_helper.from_array(array, each.name))
    return model.SerializeToString()


def locator_from_graph(path: Path) -> Locator:
    """Returns the network, in eval mode, with the weights in a graph of `export_locator`.

    Raises:
        ModelError: the file is no such graph.
        MissingExtraError: onnx is not installed.
    """
    network = Locator()
    try:
        weights = graph_weights(path.read_bytes())
    except import_extra("google.protobuf.message", "train").DecodeError:
        raise ModelError(f"{path}: this is no graph of the locator: it is no ONNX file") from None
    state = network.state_dict()
    for name, value in state.items():
        if name.endswith("num_batches_tracked"):
            continue
        given = weights.get(name)
        if given is None or tuple(given.shape) != tuple(value.shape):
            raise ModelError(f"{path}: this is no graph of the locator: it has no weights {name}")
        state[name] = torch.from_numpy(np.array(given))
    network.load_state_dict(state)
    return network.eval()
