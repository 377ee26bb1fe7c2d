"""The line network, the locator's second: the axis, its visibility, base, tip and diameter in a straightened image."""

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor, nn

from ..._system.extras import import_extra
from ...errors import ModelError
from ...vision.locator import ACROSS, ALONG
from .._export import graph_weights

TARGET_SIGMA_STATIONS = 0.7
"""Standard deviation of the target of an end, in stations."""


def _conv(inputs: int, outputs: int, stride: tuple[int, int] = (1, 1)) -> nn.Sequential:
    conv = nn.Conv2d(inputs, outputs, 3, stride, 1, bias=False)
    return nn.Sequential(conv, nn.BatchNorm2d(outputs), nn.ReLU(inplace=True))


class _Residual(nn.Module):
    def __init__(self, width: int, dilation: int) -> None:
        super().__init__()
        self.way = nn.Sequential(
            nn.Conv2d(width, width, (1, 3), 1, (0, dilation), dilation=(1, dilation), bias=False),
            nn.BatchNorm2d(width),
            nn.ReLU(inplace=True),
            nn.Conv2d(width, width, (1, 3), 1, (0, 1), bias=False),
            nn.BatchNorm2d(width),
        )

    def forward(self, x: Tensor) -> Tensor:
        return F.relu(x + self.way(x))


class LineNetwork(nn.Module):
    """(b, 3, ACROSS, ALONG) -> seven tensors, (b, ALONG) but the last.

    Offset of the axis in diameters, logarithm of its scale of error, logits of base and tip, logit that the station is
    seen, logit by the image near the station that the strip is the catheter's (their mean is the strip's logit), and
    (b,) the logarithm of the true diameter over the one that the strip was made with.
    """

    def __init__(self, first: int = 24, second: int = 32, width: int = 96) -> None:
        super().__init__()
        self.front = nn.Sequential(
            _conv(3, first, (2, 1)), _conv(first, second, (2, 1)), _conv(second, second), _conv(second, second)
        )
        self.across = nn.Sequential(
            nn.Conv2d(second, width, (ACROSS // 4, 3), 1, (0, 1), bias=False),
            nn.BatchNorm2d(width),
            nn.ReLU(inplace=True),
        )
        self.along = nn.Sequential(*[_Residual(width, dilation) for dilation in (1, 2, 4, 8, 16)])
        self.head = nn.Conv2d(width, 7, 1)

    def forward(self, strip: Tensor) -> tuple[Tensor, ...]:
        y = self.head(self.along(self.across(self.front(strip))))[:, :, 0]
        seen = torch.sigmoid(y[:, 5])
        width = (seen * y[:, 6]).sum(-1) / seen.sum(-1).clamp_min(1.0)
        return y[:, 0], y[:, 1].clamp(-6.0, 3.0), y[:, 2], y[:, 3], y[:, 5], y[:, 4], width


def line_loss(found: tuple[Tensor, ...], wanted: dict[str, Tensor]) -> Tensor:
    """Returns the negative log-likelihood of the offsets (Laplace) plus the losses of the other outputs.

    Args:
        found: outputs of `LineNetwork`.
        wanted: fields of `StripTarget` by name, (b, ...) each.
    """
    offset, log_scale, base, tip, seen, right, log_width = found
    share = wanted["asked"].float()
    off = (offset - wanted["offset"]).abs() * torch.exp(-log_scale) + log_scale
    total = (off * share).sum() / share.sum().clamp_min(1.0)
    judged = wanted["judged"].float()
    visible = F.binary_cross_entropy_with_logits(seen, wanted["seen"], reduction="none")
    total = total + 0.7 * (visible * judged).sum() / judged.sum().clamp_min(1.0)
    total = total + 0.5 * F.binary_cross_entropy_with_logits(right.mean(-1), wanted["right"])
    is_right = wanted["right"]
    total = total + ((log_width - wanted["log_width"]).abs() * is_right).sum() / is_right.sum().clamp_min(1.0)
    grid = torch.arange(ALONG, dtype=torch.float32)
    for logits, end in ((base, wanted["ends"][:, 0]), (tip, wanted["ends"][:, 1])):
        peak = torch.exp(-0.5 * ((grid - end[:, None]) / TARGET_SIGMA_STATIONS) ** 2)
        peak = peak / peak.sum(1, keepdim=True).clamp_min(1e-6)
        use = ((end > 0.0) & (end < ALONG - 1)).float()
        total = total + 0.3 * (-(peak * F.log_softmax(logits, -1)).sum(1) * use).sum() / use.sum().clamp_min(1.0)
    return total


def line_network_from_graph(path: Path) -> LineNetwork:
    """Returns the line network, in eval mode, with the weights in its graph.

    In the graph the normalisation is part of the kernels: in the network it only adds its bias.

    Raises:
        ModelError: the file is no such graph.
        MissingExtraError: onnx is not installed.
    """
    weights, network = graph_weights(path.read_bytes()), LineNetwork().eval()
    with torch.no_grad():
        for name, conv, norm in _layers(network):
            bias = conv.bias if norm is None else norm.bias
            for given, own in ((weights.get(f"{name}.weight"), conv.weight), (weights.get(_bias(name, norm)), bias)):
                if own is None or given is None or tuple(given.shape) != tuple(own.shape):
                    raise ModelError(f"{path}: this is no graph of the line network: it has no weights {name}")
                own.copy_(torch.from_numpy(np.array(given)))
            if norm is not None:
                norm.running_var.fill_(1.0 - norm.eps)
    return network


def graph_with_line_weights(graph: bytes, network: LineNetwork) -> bytes:
    """Returns a graph of the line network with the weights of another one; this takes no export.

    Args:
        graph: the graph.
        network: the network whose weights are stored, each in the precision of the graph's.

    Raises:
        MissingExtraError: onnx is not installed.
    """
    onnx = import_extra("onnx", "train")
    model, state = onnx.load_from_string(graph), dict[str, Tensor]()
    for name, conv, norm in _layers(network):
        state[f"{name}.weight"] = conv.weight if norm is None else conv.weight * _factor(norm)[:, None, None, None]
        state[_bias(name, norm)] = conv.bias if norm is None else norm.bias - norm.running_mean * _factor(norm)
    for each in model.graph.initializer:
        if each.name in state:
            array = state[each.name].detach().numpy().astype(onnx.numpy_helper.to_array(each).dtype)
            each.CopyFrom(onnx.numpy_helper.from_array(array, each.name))
    return model.SerializeToString()


def _layers(network: LineNetwork) -> list[tuple[str, Any, Any]]:
    """Returns name, convolution, and the normalisation that follows it (None after the last) of each layer."""
    modules = [*network.named_modules(), ("", None)]
    return [
        (name, conv, norm if isinstance(norm, nn.BatchNorm2d) else None)
        for (name, conv), (_, norm) in pairwise(modules)
        if isinstance(conv, nn.Conv2d)
    ]


def _bias(name: str, norm: Any) -> str:
    return f"{name}.bias" if norm is None else f"{name}.weight_bias"


def _factor(norm: Any) -> Tensor:
    return norm.weight / torch.sqrt(norm.running_var + norm.eps)
