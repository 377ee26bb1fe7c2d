"""Convolution blocks of the small networks."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from torch import Tensor, nn


def convolution(channels_in: int, channels_out: int, kernel: int = 3, stride: int = 1) -> "nn.Module":
    """Returns a convolution with batch normalisation and ReLU.

    Args:
        channels_in: channels of the input.
        channels_out: channels of the output.
        kernel: side of the kernel in pixels.
        stride: stride in pixels.
    """
    from torch import nn

    layer = nn.Conv2d(channels_in, channels_out, kernel, stride, kernel // 2, bias=False)
    return nn.Sequential(layer, nn.BatchNorm2d(channels_out), nn.ReLU(inplace=True))


def residual_block(channels: int) -> "nn.Module":
    """Returns a residual block of two convolutions (He et al. 2016)."""
    import torch
    from torch import nn

    class ResidualBlock(nn.Module):
        """See `residual_block`."""

        def __init__(self) -> None:
            super().__init__()
            self.first = convolution(channels, channels)
            self.second = nn.Sequential(nn.Conv2d(channels, channels, 3, 1, 1, bias=False), nn.BatchNorm2d(channels))

        def forward(self, x: "Tensor") -> "Tensor":
            return torch.relu(x + self.second(self.first(x)))

    return ResidualBlock()
