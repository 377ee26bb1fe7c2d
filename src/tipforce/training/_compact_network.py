"""The layers of `CompactTask`'s network."""

from typing import TYPE_CHECKING

from ..errors import InputError

if TYPE_CHECKING:
    from torch import nn

__all__ = ["COMPACT_OUTPUTS", "HEAT", "build_compact"]

COMPACT_OUTPUTS = ("force_n", "log_variance", "contact", "heat", "familiar", "grid", "features")
"""Force (n, t) in newtons; logarithm of its variance (n, t) in the network's unit; contact (n,) and map of the catheter
(n, size / 8, size / 8), both as logits; whether the catheter lies as in training (n,), a logit; the last grid
(n, 32 (size / 32)^2); features (n, FEATURES)."""

FEATURES = 128
"""Numbers before the last dense layer: what a doubt is computed from."""

BLOCK = 4
"""Side of the squares of pixels that become the first layer's channels: nothing is lost, and nothing is computed where
the picture is still large, for that is where the time goes."""
HEAT = 8
"""Pixels of the picture to one of the map of where the catheter is."""
_CHANNELS = (32, 64, 112, 112)
_BLOCKS = (0, 1, 1, 0)
"""Residual blocks on each level."""
_KEPT = 32
"""Channels of the last grid."""
_LOGARITHMS = -9.0, 3.0
"""Between these the logarithm of a variance stays."""
_LEVEL = 4.0
"""Grey levels that keep an even picture from being blown up."""


def build_compact(
    outputs: int,
    sheet: int,
    size: int,
    unit_n: float,
    actuation: tuple[tuple[float, float], ...] = (),
    mirror: tuple[tuple[float, ...], tuple[float, ...]] | None = None,
) -> "nn.Module":
    """Bytes in, forces out: see the names of `COMPACT_OUTPUTS`, in order.

    ``picture`` (n, size, size) uint8, ``sheet`` (n, sheet) float32; ``actuation``: mean and deviation of each of
    further values (n, k), which join the sheet. ``mirror``: signs of the force (outputs,) and the sheet (sheet,) where
    the picture is mirrored across the base's tangent; the trained network then looks at both and answers their mean
    (grid and features: of the picture as it is). Raises InputError where ``size`` is no multiple of 32.
    """
    import torch
    from torch import Tensor, nn

    if size % 32:
        raise InputError(f"size={size}: the side of the network's picture must be a multiple of 32; 160 is usual")

    def convolved(before: int, after: int, kernel: int = 3, step: int = 1) -> nn.Sequential:
        convolution = nn.Conv2d(before, after, kernel, step, kernel // 2, bias=False)
        return nn.Sequential(convolution, nn.BatchNorm2d(after), nn.ReLU(inplace=True))

    class Block(nn.Module):
        """He et al. 2016."""

        def __init__(self, channels: int) -> None:
            super().__init__()
            self.first = convolved(channels, channels)
            self.second = nn.Sequential(nn.Conv2d(channels, channels, 3, 1, 1, bias=False), nn.BatchNorm2d(channels))

        def forward(self, x: Tensor) -> Tensor:
            return torch.relu(x + self.second(self.first(x)))

    class Compact(nn.Module):
        """See `build_compact`."""

        unit_n: Tensor
        actuation_mean: Tensor
        actuation_deviation: Tensor
        force_signs: Tensor
        sheet_signs: Tensor

        def __init__(self) -> None:
            super().__init__()
            before = BLOCK * BLOCK
            self.levels = nn.ModuleList()
            for place, (channels, blocks) in enumerate(zip(_CHANNELS, _BLOCKS, strict=True)):
                entry = convolved(before, channels, 3, 1 if place == 0 else 2)
                self.levels.append(nn.Sequential(entry, *(Block(channels) for _ in range(blocks))))
                before = channels
            self.kept = convolved(before, _KEPT, 1)
            self.dense = nn.Linear(_KEPT * (size // 32) ** 2, FEATURES)
            self.sheet = nn.Sequential(nn.Linear(sheet + len(actuation), 32), nn.ReLU(), nn.Linear(32, 2 * FEATURES))
            self.again = nn.Linear(FEATURES, FEATURES)
            self.answer = nn.Linear(FEATURES, 3 * outputs + 1)
            self.where = nn.Conv2d(_CHANNELS[1], 1, 1)
            self.familiar = nn.Sequential(nn.Linear(_KEPT * (size // 32) ** 2, 32), nn.ReLU(), nn.Linear(32, 1))
            self.register_buffer("unit_n", torch.tensor(unit_n))
            if actuation:
                self.register_buffer("actuation_mean", torch.tensor([mean for mean, _ in actuation]))
                self.register_buffer("actuation_deviation", torch.tensor([deviation for _, deviation in actuation]))

            if mirror is not None:
                self.register_buffer("force_signs", torch.tensor(mirror[0]), persistent=False)
                self.register_buffer("sheet_signs", torch.tensor(mirror[1]), persistent=False)

        def forward(self, picture: Tensor, sheet: Tensor, actuation: Tensor | None = None) -> tuple[Tensor, ...]:
            if self.training or mirror is None or actuation is not None:
                return self.looked(picture, sheet, actuation)
            count = picture.shape[0]
            pictures, sheets = torch.cat([picture, picture.flip(1)]), torch.cat([sheet, sheet * self.sheet_signs])
            found = self.looked(pictures, sheets, None)
            force, log_variance, contact, where, familiar = (each[:count] for each in found[:5])
            mirrored = [each[count:] for each in found[:5]]
            return (
                0.5 * (force + mirrored[0] * self.force_signs),
                0.5 * (log_variance + mirrored[1]),
                0.5 * (contact + mirrored[2]),
                0.5 * (where + mirrored[3].flip(1)),
                0.5 * (familiar + mirrored[4]),
                *(each[:count] for each in found[5:]),
            )

        def looked(self, picture: Tensor, sheet: Tensor, actuation: Tensor | None) -> tuple[Tensor, ...]:
            x = picture.float().unsqueeze(1)
            x = x - x.mean((2, 3), keepdim=True)
            x = x / ((x * x).mean((2, 3), keepdim=True).sqrt() + _LEVEL)
            x = torch.nn.functional.pixel_unshuffle(x, BLOCK)
            x = self.levels[1](self.levels[0](x))
            where = self.where(x)
            for level in self.levels[2:]:
                x = level(x)
            told = sheet
            if actuation is not None:
                told = torch.cat([sheet, (actuation - self.actuation_mean) / self.actuation_deviation], dim=1)
            scale, shift = self.sheet(told).chunk(2, 1)
            grid = self.kept(x).flatten(1)
            x = torch.relu(self.dense(grid) * (1.0 + scale) + shift)
            features = torch.relu(self.again(x))
            answer = self.answer(features).float()
            bending = self.unit_n * torch.exp(sheet[:, :1] - 2.0 * sheet[:, 1:2])
            pressing = self.unit_n * torch.exp(sheet[:, 1:2])
            force = answer[:, :outputs] * bending + answer[:, outputs : 2 * outputs] * pressing
            log_variance, contact = answer[:, 2 * outputs : 3 * outputs].clamp(*_LOGARITHMS), answer[:, -1]
            familiar = self.familiar(grid)[:, 0].float()
            return force, log_variance, contact, where[:, 0].float(), familiar, grid.float(), features.float()

    return Compact()
