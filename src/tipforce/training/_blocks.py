"""Blocks that the small networks share."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from torch import Tensor, nn

BLOCK_PX = 4
"""Side of the squares of pixels that become the channels of the first layer. No information is lost, and the image in
full size, where convolutions would take most of the time, is never convolved."""
CONTRAST_FLOOR = 4.0
"""Grey levels added to an image's standard deviation, so that noise in an even image is not amplified."""


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


def encoder_levels(channels: Sequence[int], blocks: Sequence[int]) -> "nn.ModuleList":
    """Returns the levels of an encoder of `image_blocks`: each but the first halves the side.

    Args:
        channels: channels of each level.
        blocks: number of residual blocks of each level.
    """
    from torch import nn

    levels, before = nn.ModuleList(), BLOCK_PX * BLOCK_PX
    for level, (after, count) in enumerate(zip(channels, blocks, strict=True)):
        entry = convolution(before, after, 3, 1 if level == 0 else 2)
        levels.append(nn.Sequential(entry, *(residual_block(after) for _ in range(count))))
        before = after
    return levels


def image_blocks(image: "Tensor") -> "Tensor":
    """Returns grey images (n, size, size) with zero mean and unit contrast, in blocks: (n, `BLOCK_PX`^2, h, h)."""
    import torch

    x = image.float().unsqueeze(1)
    x = x - x.mean((2, 3), keepdim=True)
    x = x / ((x * x).mean((2, 3), keepdim=True).sqrt() + CONTRAST_FLOOR)
    return torch.nn.functional.pixel_unshuffle(x, BLOCK_PX)
