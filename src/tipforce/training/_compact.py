"""`compact`: a small network for grey images of the window around the catheter.

Where the catheter lies in its window is the measurement, so the last feature grid enters the dense layers as it is, not
as its mean. Metadata of catheter and bench modulate the dense features (feature-wise linear modulation, FiLM, Perez et
al. 2018). The force is the sum of two terms, one in the unit of bending (EI / L^2) and one in that of indentation
(stiffness x L), so that stiffness and length of the catheter enter as in mechanics.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from ..errors import InputError
from ..types import IntArray
from ._augmentation import CURVATURE, Augmentation, augment_image, centre_crop
from ._data import HEATMAP_UNKNOWN, TrainingSamples
from ._task import Batch

if TYPE_CHECKING:
    from torch import Tensor, nn

__all__ = ["COMPACT_OUTPUTS", "COMPACT_UNIT_N", "CompactTask", "build_compact"]

COMPACT_OUTPUTS = (
    "force_n",
    "log_variance",
    "contact_logit",
    "heatmap_logit",
    "in_distribution_logit",
    "grid",
    "features",
)
"""Outputs of the network, in order: force (n, t) in newtons; logarithm of its variance (n, t), in `COMPACT_UNIT_N`
squared; logit of contact (n,); logits of the catheter's heatmap (n, size / 8, size / 8); logit of an in-distribution
position of the catheter (n,); last feature grid (n, 32 (size / 32)^2); features before the last dense layer
(n, `FEATURES`)."""

COMPACT_UNIT_N = 0.1
"""Unit of the network's force, in newtons: in it forces are of order one."""

FEATURES = 128
"""Features before the last dense layer."""

CONTACT_N = 0.015
"""Measured forces above this count as contact."""

_BETA = 0.5
"""Exponent of the variance in the weight of the likelihood (beta-NLL, Seitzer et al. 2022): 0 is the plain likelihood,
1 the mean squared error."""
_LOSS_WEIGHTS = {"force": 1.0, "contact": 0.02, "heatmap": 0.1, "in_distribution": 0.1}

_BLOCK_PX = 4
"""Side of the squares of pixels that become the channels of the first layer: no information is lost, and the large
image, where convolutions take most of the time, is never convolved."""
_HEATMAP_PX = 8
"""Image pixels to one pixel of the heatmap."""
_CHANNELS = (32, 64, 112, 112)
_RESIDUAL_BLOCKS = (0, 1, 1, 0)
"""Residual blocks on each level."""
_GRID_CHANNELS = 32
_LOG_VARIANCE_RANGE = -9.0, 3.0
_CONTRAST_FLOOR = 4.0
"""Grey levels added to an image's standard deviation, so that noise in an even image is not amplified."""


@dataclass(frozen=True)
class CompactTask:
    """Force components from grey images and metadata features.

    Attributes:
        outputs: number of force components.
        metadata: number of metadata features.
        size: side of the network's image in pixels.
        planar: which outputs are fx and fy of the base frame, which mirroring an image changes; None where the forces
            are in another frame.
        augmentation: of training; None: none.
        actuation: mean and standard deviation of each actuation value that joins the metadata.
    """

    outputs: int
    metadata: int
    size: int = 160
    planar: tuple[int, int] | None = (0, 1)
    augmentation: Augmentation | None = None
    actuation: tuple[tuple[float, float], ...] = ()

    @property
    def name(self) -> str:
        """See `Task`."""
        return f"compact, {self.outputs} outputs, {self.metadata + len(self.actuation)} numbers, {self.size} pixels"

    @property
    def inputs(self) -> tuple[str, ...]:
        """See `Task`."""
        return ("image", "metadata", "actuation") if self.actuation else ("image", "metadata")

    @property
    def head(self) -> tuple[str, ...]:
        """The last dense layers and those that take the metadata."""
        return ("output_head.", "film.", "actuation_", "distribution_head.")

    @property
    def mirrors(self) -> bool:
        """Whether training mirrors images: how other actuation than the knob changes in a mirror is not known."""
        wanted = self.augmentation is not None and self.augmentation.mirror > 0
        return wanted and self.planar is not None and not self.actuation

    def build(self) -> "nn.Module":
        """See `build_compact`."""
        mirror = None
        if self.mirrors and self.planar is not None:
            signs = np.ones(self.outputs), np.ones(self.metadata)
            signs[0][self.planar[1]] = signs[1][CURVATURE] = -1.0
            mirror = tuple(signs[0].tolist()), tuple(signs[1].tolist())
        return build_compact(self.outputs, self.metadata, self.size, COMPACT_UNIT_N, self.actuation, mirror)

    def batch(self, samples: TrainingSamples, index: IntArray, rngs: Sequence[np.random.Generator] | None) -> Batch:
        """Returns images of ``size`` pixels with their labels, augmented where ``rngs`` are given."""
        taken: Batch = {
            "force_n": samples.force_n[index].copy(),
            **{name: values[index].copy() for name, values in samples.inputs.items()},
        }
        images = np.empty((len(index), self.size, self.size), np.uint8)
        grid = self.size // _HEATMAP_PX
        heatmaps = np.full((len(index), grid, grid), np.nan, np.float32)
        in_distribution = np.ones(len(index), np.float32)
        for k, sample in enumerate(index.tolist()):
            known = samples.heatmap is not None and samples.heatmap[sample].min() != HEATMAP_UNKNOWN
            heatmap = samples.heatmap[sample] if samples.heatmap is not None and known else None
            if rngs is None or self.augmentation is None:
                images[k] = centre_crop(samples.images[sample], self.size)
                heatmap = None if heatmap is None else centre_crop(heatmap, self.size // 4)
            else:
                augmented = augment_image(
                    samples.images[sample], heatmap, taken["force_n"][k], taken["metadata"][k], self, rngs[k]
                )
                images[k], heatmap, in_distribution[k] = augmented.image, augmented.heatmap, augmented.in_distribution
            if heatmap is not None:
                heatmaps[k] = cv2.resize(heatmap, (grid, grid), interpolation=cv2.INTER_AREA) / np.float32(255.0)
        return taken | {"image": images, "heatmap": heatmaps, "in_distribution": in_distribution}

    def loss(self, outputs: Any, batch: Mapping[str, "Tensor"]) -> "Tensor":
        """Returns the weighted sum of the losses.

        These are the Gaussian likelihood of the force with the predicted variance, and the cross-entropies of contact,
        heatmap and in-distribution. Samples that are out of distribution count in the last two alone.
        """
        import torch
        from torch.nn.functional import binary_cross_entropy_with_logits

        force, log_variance, contact, heatmap, in_distribution, *_ = outputs
        weight = _sample_weight(batch)
        error = (force - batch["force_n"]) / COMPACT_UNIT_N
        likelihood = 0.5 * (error * error * torch.exp(-log_variance) + log_variance)
        likelihood = likelihood * torch.exp(_BETA * log_variance).detach()
        in_contact = (torch.linalg.vector_norm(batch["force_n"], dim=1) > CONTACT_N).float()
        total = _LOSS_WEIGHTS["force"] * (likelihood.mean(dim=1) * weight).mean()
        contact_loss = binary_cross_entropy_with_logits(contact, in_contact, reduction="none")
        total = total + _LOSS_WEIGHTS["contact"] * (contact_loss * weight).mean()
        total = total + _LOSS_WEIGHTS["in_distribution"] * binary_cross_entropy_with_logits(
            in_distribution, batch["in_distribution"]
        )
        known = ~torch.isnan(batch["heatmap"])
        if bool(known.any()):
            total = total + _LOSS_WEIGHTS["heatmap"] * binary_cross_entropy_with_logits(
                heatmap[known], batch["heatmap"][known]
            )
        return total

    def error_n(self, outputs: Any, batch: Mapping[str, "Tensor"]) -> "Tensor":
        """Returns (b,) lengths of the force error, weighted: their mean is that of the in-distribution samples."""
        import torch

        return torch.linalg.vector_norm(outputs[0] - batch["force_n"], dim=1) * _sample_weight(batch)


def _sample_weight(batch: Mapping[str, "Tensor"]) -> "Tensor":
    """Returns (b,) the weight of each sample in a mean over the in-distribution samples."""
    in_distribution = batch["in_distribution"]
    return in_distribution * (len(in_distribution) / in_distribution.sum().clamp(min=1.0))


def build_compact(
    outputs: int,
    metadata: int,
    size: int,
    unit_n: float,
    actuation: tuple[tuple[float, float], ...] = (),
    mirror: tuple[tuple[float, ...], tuple[float, ...]] | None = None,
) -> "nn.Module":
    """Build the network: ``image`` (n, size, size) uint8 and ``metadata`` (n, metadata) to `COMPACT_OUTPUTS`.

    Args:
        outputs: number of force components.
        metadata: number of metadata features; the first two are the logarithms of stiffness and length.
        size: side of the image in pixels.
        unit_n: unit of the force, in newtons.
        actuation: mean and standard deviation of each further value (n, k) that joins the metadata.
        mirror: signs of the force components and of the metadata features in a mirrored image. In eval mode the
            network then evaluates the image and its mirror image and returns the mean of both (grid and features: of
            the image as it is).

    Raises:
        InputError: ``size`` is no multiple of 32.
    """
    import torch
    from torch import Tensor, nn

    if size % 32:
        raise InputError(f"size={size}: the side of the network's image must be a multiple of 32; 160 is usual")

    def convolution(channels_in: int, channels_out: int, kernel: int = 3, stride: int = 1) -> nn.Sequential:
        layer = nn.Conv2d(channels_in, channels_out, kernel, stride, kernel // 2, bias=False)
        return nn.Sequential(layer, nn.BatchNorm2d(channels_out), nn.ReLU(inplace=True))

    class ResidualBlock(nn.Module):
        """He et al. 2016."""

        def __init__(self, channels: int) -> None:
            super().__init__()
            self.first = convolution(channels, channels)
            self.second = nn.Sequential(nn.Conv2d(channels, channels, 3, 1, 1, bias=False), nn.BatchNorm2d(channels))

        def forward(self, x: Tensor) -> Tensor:
            return torch.relu(x + self.second(self.first(x)))

    class Compact(nn.Module):
        """See `build_compact`."""

        unit_n: Tensor
        actuation_mean: Tensor
        actuation_deviation: Tensor
        force_signs: Tensor
        metadata_signs: Tensor

        def __init__(self) -> None:
            super().__init__()
            before = _BLOCK_PX * _BLOCK_PX
            self.levels = nn.ModuleList()
            for level, (channels, blocks) in enumerate(zip(_CHANNELS, _RESIDUAL_BLOCKS, strict=True)):
                entry = convolution(before, channels, 3, 1 if level == 0 else 2)
                self.levels.append(nn.Sequential(entry, *(ResidualBlock(channels) for _ in range(blocks))))
                before = channels
            grid = _GRID_CHANNELS * (size // 32) ** 2
            self.grid_projection = convolution(before, _GRID_CHANNELS, 1)
            self.dense = nn.Linear(grid, FEATURES)
            self.film = nn.Sequential(nn.Linear(metadata + len(actuation), 32), nn.ReLU(), nn.Linear(32, 2 * FEATURES))
            self.hidden = nn.Linear(FEATURES, FEATURES)
            self.output_head = nn.Linear(FEATURES, 3 * outputs + 1)
            self.heatmap_head = nn.Conv2d(_CHANNELS[1], 1, 1)
            self.distribution_head = nn.Sequential(nn.Linear(grid, 32), nn.ReLU(), nn.Linear(32, 1))
            self.register_buffer("unit_n", torch.tensor(unit_n))
            if actuation:
                self.register_buffer("actuation_mean", torch.tensor([mean for mean, _ in actuation]))
                self.register_buffer("actuation_deviation", torch.tensor([deviation for _, deviation in actuation]))

            if mirror is not None:
                self.register_buffer("force_signs", torch.tensor(mirror[0]), persistent=False)
                self.register_buffer("metadata_signs", torch.tensor(mirror[1]), persistent=False)

        def forward(self, image: Tensor, metadata: Tensor, actuation: Tensor | None = None) -> tuple[Tensor, ...]:
            if self.training or mirror is None or actuation is not None:
                return self.single(image, metadata, actuation)
            count = image.shape[0]
            images = torch.cat([image, image.flip(1)])
            found = self.single(images, torch.cat([metadata, metadata * self.metadata_signs]), None)
            force, log_variance, contact, heatmap, in_distribution = (each[:count] for each in found[:5])
            mirrored = [each[count:] for each in found[:5]]
            return (
                0.5 * (force + mirrored[0] * self.force_signs),
                0.5 * (log_variance + mirrored[1]),
                0.5 * (contact + mirrored[2]),
                0.5 * (heatmap + mirrored[3].flip(1)),
                0.5 * (in_distribution + mirrored[4]),
                *(each[:count] for each in found[5:]),
            )

        def single(self, image: Tensor, metadata: Tensor, actuation: Tensor | None) -> tuple[Tensor, ...]:
            """Returns the outputs for each image alone, without its mirror image."""
            x = image.float().unsqueeze(1)
            x = x - x.mean((2, 3), keepdim=True)
            x = x / ((x * x).mean((2, 3), keepdim=True).sqrt() + _CONTRAST_FLOOR)
            x = torch.nn.functional.pixel_unshuffle(x, _BLOCK_PX)
            x = self.levels[1](self.levels[0](x))
            heatmap = self.heatmap_head(x)
            for level in self.levels[2:]:
                x = level(x)
            conditions = metadata
            if actuation is not None:
                conditions = torch.cat([metadata, (actuation - self.actuation_mean) / self.actuation_deviation], dim=1)
            scale, shift = self.film(conditions).chunk(2, 1)
            grid = self.grid_projection(x).flatten(1)
            x = torch.relu(self.dense(grid) * (1.0 + scale) + shift)
            features = torch.relu(self.hidden(x))
            output = self.output_head(features).float()
            bending = self.unit_n * torch.exp(metadata[:, :1] - 2.0 * metadata[:, 1:2])
            indentation = self.unit_n * torch.exp(metadata[:, 1:2])
            force = output[:, :outputs] * bending + output[:, outputs : 2 * outputs] * indentation
            log_variance, contact = output[:, 2 * outputs : 3 * outputs].clamp(*_LOG_VARIANCE_RANGE), output[:, -1]
            in_distribution = self.distribution_head(grid)[:, 0].float()
            return force, log_variance, contact, heatmap[:, 0].float(), in_distribution, grid.float(), features.float()

    return Compact()
