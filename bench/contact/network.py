"""The network that reads the geometry of the contact, and its loss."""

import torch
from torch import nn
from torch.nn import functional

OUTPUTS = 7
"""Logits of three classes: the tip touches a tissue that is visible in this session, it does not touch it, the tissue
of this session is never visible; mean and log standard deviation of ``asinh(depth / DEPTH_M)``; the vector of the
direction, whose length is the concentration of a von Mises distribution."""


def _unit(inputs: int, outputs: int, stride: int = 1, size: int = 3) -> nn.Sequential:
    convolution = nn.Conv2d(inputs, outputs, size, stride, size // 2, bias=False)
    return nn.Sequential(convolution, nn.BatchNorm2d(outputs), nn.ReLU())


class _Block(nn.Module):
    """Two convolutions beside the identity."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first, self.second = _unit(channels, channels), _unit(channels, channels)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return x + self.second(self.first(x))


class ContactNetwork(nn.Module):
    """(n, 1, 112, 112) grey levels from 0 to 1 -> (n, `OUTPUTS`); 0.6 M weights."""

    def __init__(self) -> None:
        super().__init__()
        self.body = nn.Sequential(
            _unit(1, 16, 2, 5),
            _unit(16, 32, 2),
            _Block(32),
            _unit(32, 64, 2),
            _Block(64),
            _unit(64, 96, 2),
            _Block(96),
            _unit(96, 24, 1, 1),
        )
        self.head = nn.Sequential(
            nn.Flatten(), nn.Dropout(0.2), nn.Linear(24 * 49, 128), nn.ReLU(), nn.Linear(128, OUTPUTS)
        )

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        # each image by its own mean and contrast
        centred = image - image.mean((2, 3), keepdim=True)
        return self.head(self.body(centred / (centred.square().mean((2, 3), keepdim=True) + 1e-3).sqrt()))


def losses(found: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
    """Returns the three losses (3,) of a batch: class, depth, direction; the last two count in contact.

    Args:
        found: (n, `OUTPUTS`) outputs of the network.
        truth: (n, 4) contact (0 or 1), transformed depth, direction in rad, whether the tissue is visible (0 or 1).
    """
    touching = truth[:, 0]
    count = touching.sum().clamp(min=1.0)
    each = torch.where(truth[:, 3] > 0.5, 1.0 - touching, 2.0).long()
    contact = functional.cross_entropy(found[:, :3], each)
    log_std = found[:, 4].clamp(-4.0, 3.0)
    error = (found[:, 3] - truth[:, 1]) * torch.exp(-log_std)
    depth = log_std + 2.5 * torch.log1p(error.square() / 4.0)  # Student's distribution with 4 degrees of freedom
    strength = found[:, 5:].norm(dim=1).clamp(min=1e-4)
    along = found[:, 5] * torch.cos(truth[:, 2]) + found[:, 6] * torch.sin(truth[:, 2])
    direction = torch.log(torch.special.i0e(strength)) + strength - along
    return torch.stack([contact, (touching * depth).sum() / count, (touching * direction).sum() / count])
