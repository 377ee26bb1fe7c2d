"""The locator's network: an image with prompts to points along the catheter, their visibility, and kinds of objects.

The encoder is EfficientNet-Lite0 (Tan & Le 2019; the "lite" variant without squeeze-and-excitation) with ImageNet
weights where they are given. Prompts are further input channels of the same network; their weights begin at zero, so
the network begins as one without prompts.
"""

from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from ._inputs import PROMPT_CHANNELS

LINE_POINTS = 16
"""Number of points of the line that the network returns, evenly spaced in arc length from base to tip."""
STRIDE_PX = 4
"""Side of a cell of the heat maps, in pixels of the image."""
SIZE_MULTIPLE_PX = 32
"""The sides of an image are multiples of this."""
OBJECT_KINDS = 5
"""Kinds of pixels: ground, catheter, sheath, instrument, object in front of the catheter."""
POINT_STATES = 3
"""States of a point: outside of the image, hidden, seen."""
DENSE_CHANNELS = 5
"""Values of each cell on the catheter: arc length, direction (2), offset to the line (2)."""
DECODER_CHANNELS = 48

_BLOCKS = ((1, 3, 1, 1, 16), (2, 3, 2, 6, 24), (2, 5, 2, 6, 40), (3, 3, 2, 6, 80), (3, 5, 1, 6, 112), (4, 5, 2, 6, 192),
           (1, 3, 1, 6, 320))  # fmt: skip
"""Groups of blocks of the encoder: repeats, kernel, stride, expansion, channels."""


class LocatorOutputs(NamedTuple):
    """Result of `Locator` for a batch of ``b`` images of (h, w) px.

    Attributes:
        heat: (b, LINE_POINTS, h / 4, w / 4) logits of each point's position; a logit of 0 is as likely as that the
            point is outside of the image.
        kinds: (b, OBJECT_KINDS, h / 4, w / 4) logits of the kind of object in each cell.
        dense: (b, DENSE_CHANNELS, h / 4, w / 4): arc length as a share of the catheter (logit), direction (cos, sin),
            offset to the line (u, v) in cells.
        states: (b, LINE_POINTS, POINT_STATES) logits.
        present: (b,) logit of a catheter in the image.
    """

    heat: Tensor
    kinds: Tensor
    dense: Tensor
    states: Tensor
    present: Tensor


def _pad_same(x: Tensor, kernel: int, stride: int) -> Tensor:
    """Pads as TensorFlow's SAME does for even sizes: the ImageNet weights were trained with it."""
    total = kernel - stride if stride > 1 else kernel - 1
    left = total // 2
    return F.pad(x, (left, total - left, left, total - left))


class _Block(nn.Module):
    """An inverted bottleneck without squeeze-and-excitation."""

    def __init__(self, inputs: int, outputs: int, kernel: int, stride: int, expansion: int) -> None:
        super().__init__()
        middle = inputs * expansion
        if expansion > 1:
            self._expand_conv = nn.Conv2d(inputs, middle, 1, bias=False)
            self._bn0 = nn.BatchNorm2d(middle, eps=1e-3, momentum=0.01)
        self._depthwise_conv = nn.Conv2d(middle, middle, kernel, stride, groups=middle, bias=False)
        self._bn1 = nn.BatchNorm2d(middle, eps=1e-3, momentum=0.01)
        self._project_conv = nn.Conv2d(middle, outputs, 1, bias=False)
        self._bn2 = nn.BatchNorm2d(outputs, eps=1e-3, momentum=0.01)
        self._kernel, self._stride, self._expands = kernel, stride, expansion > 1
        self._residual = stride == 1 and inputs == outputs

    def forward(self, x: Tensor) -> Tensor:
        y = F.relu6(self._bn0(self._expand_conv(x))) if self._expands else x
        y = F.relu6(self._bn1(self._depthwise_conv(_pad_same(y, self._kernel, self._stride))))
        y = self._bn2(self._project_conv(y))
        return x + y if self._residual else y


class Encoder(nn.Module):
    """Image and prompts (b, 3 + PROMPT_CHANNELS, h, w) -> features at strides 4, 8, 16 and 32."""

    TAPS = (2, 4, 10, 15)
    """Indices of the blocks whose outputs are used."""
    WIDTHS = (24, 40, 112, 320)
    """Channels of these outputs."""

    def __init__(self) -> None:
        super().__init__()
        self._conv_stem = nn.Conv2d(3 + PROMPT_CHANNELS, 32, 3, 2, bias=False)
        self._bn0 = nn.BatchNorm2d(32, eps=1e-3, momentum=0.01)
        blocks: list[nn.Module] = []
        width = 32
        for repeats, kernel, stride, expansion, outputs in _BLOCKS:
            for k in range(repeats):
                blocks.append(_Block(width, outputs, kernel, stride if k == 0 else 1, expansion))
                width = outputs
        self._blocks = nn.ModuleList(blocks)
        with torch.no_grad():
            self._conv_stem.weight[:, 3:].zero_()

    def forward(self, x: Tensor) -> list[Tensor]:
        x = F.relu6(self._bn0(self._conv_stem(_pad_same(x, 3, 2))))
        features: list[Tensor] = []
        for k, block in enumerate(self._blocks):
            x = block(x)
            if k in self.TAPS:
                features.append(x)
        return features


def _conv(inputs: int, outputs: int, kernel: int = 3) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, kernel, 1, kernel // 2, bias=False), nn.BatchNorm2d(outputs), nn.ReLU(inplace=True)
    )


class Locator(nn.Module):
    """The whole network: `network_input` (b, 3 + PROMPT_CHANNELS, h, w) -> `LocatorOutputs`.

    The sides of the image are multiples of `SIZE_MULTIPLE_PX`.
    """

    def __init__(self) -> None:
        super().__init__()
        width = DECODER_CHANNELS
        self.encoder = Encoder()
        w4, w8, w16, w32 = Encoder.WIDTHS
        self.deep = _conv(2 * w32, 96, 1)
        self.side16, self.mix16 = _conv(w16, 96, 1), _conv(96, 64)
        self.side8, self.mix8 = _conv(w8, 64, 1), _conv(64, 48)
        self.side4, self.mix4 = _conv(w4, 48, 1), _conv(48, width)
        self.last = _conv(width, width)
        self.head = nn.Conv2d(width, LINE_POINTS + OBJECT_KINDS + DENSE_CHANNELS, 1)
        assert self.head.bias is not None
        nn.init.constant_(self.head.bias[:LINE_POINTS], -4.0)
        self.place = nn.Parameter(0.1 * torch.randn(LINE_POINTS, 16))
        self.state = nn.Sequential(nn.Linear(width + 16 + 2, 64), nn.ReLU(inplace=True), nn.Linear(64, POINT_STATES))
        self.present = nn.Sequential(nn.Linear(2 * width + 3, 48), nn.ReLU(inplace=True), nn.Linear(48, 1))

    def forward(self, image: Tensor) -> LocatorOutputs:
        f4, f8, f16, f32 = self.encoder(image)
        # the mean over half a window around each cell, so that a larger image is read like a window
        around = F.avg_pool2d(f32, 7, 1, 3, count_include_pad=False)
        y = self.deep(torch.cat([f32, around], 1))
        y = self.mix16(F.interpolate(y, scale_factor=2.0, mode="nearest") + self.side16(f16))
        y = self.mix8(F.interpolate(y, scale_factor=2.0, mode="nearest") + self.side8(f8))
        y = self.last(self.mix4(F.interpolate(y, scale_factor=2.0, mode="nearest") + self.side4(f4)))
        maps = self.head(y)
        heat = maps[:, :LINE_POINTS]
        logits = heat.flatten(2).float()
        top = logits.amax(2).clamp_min(0.0)
        weight = torch.exp(logits - top[..., None])
        share = weight / (weight.sum(2) + torch.exp(-top))[..., None]
        features_at_point = share @ y.flatten(2).float().transpose(1, 2)
        peak = torch.stack([share.amax(2), share.sum(2)], 2)
        embedding = self.place.expand(image.shape[0], -1, -1)
        of_points = torch.cat([features_at_point, embedding, peak], 2).to(y.dtype)
        # rows of a matrix: the exporter would store a transposed copy of the weights under no name otherwise
        states = self.state(of_points.flatten(0, 1)).reshape(-1, LINE_POINTS, POINT_STATES)
        pooled = [features_at_point.mean(1), features_at_point.amax(1), peak.mean(1), peak[..., 1].amin(1, True)]
        present = self.present(torch.cat(pooled, 1).to(y.dtype))[:, 0]
        kinds, dense = maps[:, LINE_POINTS:].split((OBJECT_KINDS, DENSE_CHANNELS), 1)
        return LocatorOutputs(heat, kinds, dense, states, present)
