"""`stereo`: a small network for the grey images of two views, with one encoder for both.

It is `compact` with two windows: both images pass through the same encoder, and the last feature grids of both views
enter the dense layers together. In training a light decoder also estimates the mask of the catheter in each view from
all levels of the encoder (segmentation and force together, as H-Net, Fekri et al. 2024). The exported graph has no
decoder.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InputError
from ..types import IntArray
from ._augmentation import CURVATURE, augment_image, centre_crop
from ._blocks import convolution, encoder_levels, image_blocks
from ._compact import COMPACT_UNIT_N, FEATURES, LOG_VARIANCE_RANGE, CompactTask
from ._data import HEATMAP_UNKNOWN, TrainingSamples
from ._task import Batch, Weights

if TYPE_CHECKING:
    from torch import nn

VIEWS = 2
STEREO_OUTPUTS = ("force_n", "log_variance", "contact_logit", "in_distribution_logit", "grid", "features")
"""Outputs of the network in use, as `COMPACT_OUTPUTS` without the heatmap; "grid" holds the feature grids of both
views."""

_MASK_PX = 4
"""Image pixels to one pixel of the estimated masks."""
_CHANNELS = (24, 48, 80, 96)
_RESIDUAL_BLOCKS = (0, 1, 1, 0)
"""Residual blocks on each level."""
_GRID_CHANNELS = 24
_MASK_CHANNELS = 16
_DISTRIBUTION_FEATURES = 16


@dataclass(frozen=True)
class StereoTask(CompactTask):
    """Force components from the grey images of two views and metadata features; the loss is that of `CompactTask`.

    The samples' images are (n, 2, h, h), their heatmaps (n, 2, h / 4, h / 4).

    Attributes:
        across: indices of the outputs across the base tangent, which change their sign where both images are mirrored:
            both images of a bench that is turned by 180 degrees about the base tangent. None where the forces are not
            in the base frame.
    """

    planar: tuple[int, int] | None = None
    across: tuple[int, ...] | None = None

    @property
    def name(self) -> str:
        """See `Task`."""
        return super().name.replace("compact", "stereo", 1)

    @property
    def head(self) -> tuple[str, ...]:
        """The last dense layers, those with the metadata as input, and the decoder, which no graph contains."""
        return (*super().head, "mask_")

    @property
    def turns(self) -> bool:
        """Whether training mirrors both images: the change of other actuation than the knob is then not known."""
        wanted = self.augmentation is not None and self.augmentation.mirror > 0
        return wanted and self.across is not None and not self.actuation

    def adapted(self, weights: Weights) -> Weights:
        """See `Task`; there is no earlier layout."""
        return weights

    def build(self) -> "nn.Module":
        """See `build_stereo`."""
        signs = self._signs() if self.turns else None
        return build_stereo(self.outputs, self.metadata, self.size, COMPACT_UNIT_N, self.actuation, signs)

    def _signs(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Returns the signs of force components and metadata features in mirrored images."""
        force = [-1.0 if k in (self.across or ()) else 1.0 for k in range(self.outputs)]
        metadata = [-1.0 if k == CURVATURE else 1.0 for k in range(self.metadata)]
        return tuple(force), tuple(metadata)

    def batch(self, samples: TrainingSamples, index: IntArray, rngs: Sequence[np.random.Generator] | None) -> Batch:
        """Returns pairs of images of ``size`` pixels with their labels; see `Task.batch`.

        Both images are mirrored together or not at all; all other changes are drawn for each view.
        """
        taken: Batch = {
            "force_n": samples.force_n[index].copy(),
            **{name: values[index].copy() for name, values in samples.inputs.items()},
        }
        grid = self.size // _MASK_PX
        images = np.empty((len(index), VIEWS, self.size, self.size), np.uint8)
        masks = np.full((len(index), VIEWS, grid, grid), np.nan, np.float32)
        in_distribution = np.ones(len(index), np.float32)
        signs = self._signs()
        for k, sample in enumerate(index.tolist()):
            rng = None if rngs is None or self.augmentation is None else rngs[k]
            mirror = self.turns and rng is not None and rng.random() < self._mirror
            if mirror:
                taken["force_n"][k] *= np.array(signs[0], np.float32)
                taken["metadata"][k] *= np.array(signs[1], np.float32)
            for view in range(VIEWS):
                image = samples.images[sample, view]
                mask = None if samples.heatmap is None else samples.heatmap[sample, view]
                if mask is not None and mask.min() == HEATMAP_UNKNOWN:
                    mask = None
                if mirror:
                    image, mask = np.ascontiguousarray(image[::-1]), None if mask is None else mask[::-1].copy()
                if rng is None:
                    images[k, view] = centre_crop(image, self.size)
                    mask = None if mask is None else centre_crop(mask, grid)
                else:
                    changed = augment_image(image, mask, taken["force_n"][k], taken["metadata"][k], self, rng)
                    images[k, view], mask = changed.image, changed.heatmap
                    in_distribution[k] = min(in_distribution[k], changed.in_distribution)
                if mask is not None:
                    masks[k, view] = mask / np.float32(255.0)
        return taken | {"image": images, "heatmap": masks, "in_distribution": in_distribution}

    @property
    def _mirror(self) -> float:
        return 0.0 if self.augmentation is None else self.augmentation.mirror


def build_stereo(
    outputs: int,
    metadata: int,
    size: int,
    unit_n: float,
    actuation: tuple[tuple[float, float], ...] = (),
    mirror: tuple[tuple[float, ...], tuple[float, ...]] | None = None,
) -> "nn.Module":
    """Builds the network: ``image`` (n, 2, size, size) uint8 and ``metadata`` (n, metadata) to `STEREO_OUTPUTS`.

    In training mode the logits of the masks (n, 2, size / 4, size / 4) follow the logit of contact, as in
    `COMPACT_OUTPUTS`.

    Args:
        outputs: number of force components.
        metadata: number of metadata features; the first two are the logarithms of stiffness and length.
        size: side of the images in pixels.
        unit_n: unit of the force, in newtons.
        actuation: mean and standard deviation of each further value (n, k) that joins the metadata.
        mirror: signs of the force components and of the metadata features where both images are mirrored. In eval mode
            the network then evaluates the images and their mirror images and returns the mean of both (grid and
            features: of the images as they are).

    Returns:
        The module with random weights.

    Raises:
        InputError: ``size`` is no multiple of 32.
    """
    import torch
    from torch import Tensor, nn

    if size % 32:
        raise InputError(f"size={size}: the side of the network's images must be a multiple of 32; 160 is usual")

    class Stereo(nn.Module):
        """See `build_stereo`."""

        unit_n: Tensor
        actuation_mean: Tensor
        actuation_deviation: Tensor
        force_signs: Tensor
        metadata_signs: Tensor

        def __init__(self) -> None:
            super().__init__()
            self.levels = encoder_levels(_CHANNELS, _RESIDUAL_BLOCKS)
            grid = VIEWS * _GRID_CHANNELS * (size // 32) ** 2
            self.grid_projection = convolution(_CHANNELS[-1], _GRID_CHANNELS, 1)
            self.dense = nn.Linear(grid, FEATURES)
            self.film = nn.Sequential(nn.Linear(metadata + len(actuation), 32), nn.ReLU(), nn.Linear(32, 2 * FEATURES))
            self.hidden = nn.Linear(FEATURES, FEATURES)
            self.output_head = nn.Linear(FEATURES, 3 * outputs + 1)
            self.distribution_head = nn.Sequential(
                nn.Linear(grid, _DISTRIBUTION_FEATURES), nn.ReLU(), nn.Linear(_DISTRIBUTION_FEATURES, 1)
            )
            self.mask_levels = nn.ModuleList(nn.Conv2d(channels, _MASK_CHANNELS, 1) for channels in _CHANNELS[1:])
            self.mask_head = nn.ConvTranspose2d(_MASK_CHANNELS, 1, 2, 2)
            self.register_buffer("unit_n", torch.tensor(unit_n))
            if actuation:
                self.register_buffer("actuation_mean", torch.tensor([mean for mean, _ in actuation]))
                self.register_buffer("actuation_deviation", torch.tensor([deviation for _, deviation in actuation]))
            if mirror is not None:
                self.register_buffer("force_signs", torch.tensor(mirror[0]), persistent=False)
                self.register_buffer("metadata_signs", torch.tensor(mirror[1]), persistent=False)

        def forward(self, image: Tensor, metadata: Tensor, actuation: Tensor | None = None) -> tuple[Tensor, ...]:
            if self.training:
                levels = self.encoded(image)
                force, log_variance, contact, *others = self.estimated(levels[-1], metadata, actuation)
                return force, log_variance, contact, self.masks(levels[1:]), *others
            if mirror is None or actuation is not None:
                return self.estimated(self.encoded(image)[-1], metadata, actuation)
            count = image.shape[0]
            images = torch.cat([image, image.flip(2)])
            conditions = torch.cat([metadata, metadata * self.metadata_signs])
            found = self.estimated(self.encoded(images)[-1], conditions, None)
            force = 0.5 * (found[0][:count] + found[0][count:] * self.force_signs)
            means = (0.5 * (each[:count] + each[count:]) for each in found[1:4])
            return force, *means, *(each[:count] for each in found[4:])

        def encoded(self, image: Tensor) -> list[Tensor]:
            """Returns the features of all levels, (2 n, channels, h, h): both views of a sample one after the other."""
            x = image_blocks(image.flatten(0, 1))
            found: list[Tensor] = []
            for level in self.levels:
                x = level(x)
                found.append(x)
            return found

        def masks(self, levels: Sequence[Tensor]) -> Tensor:
            """Returns the logits of the masks (n, 2, size / 4, size / 4)."""
            side = levels[0].shape[-1]
            total = torch.zeros(1, device=levels[0].device)
            for features, project in zip(levels, self.mask_levels, strict=True):
                total = total + torch.nn.functional.interpolate(project(features), size=(side, side))
            return self.mask_head(torch.relu(total)).squeeze(1).unflatten(0, (-1, VIEWS)).float()

        def estimated(self, last: Tensor, metadata: Tensor, actuation: Tensor | None) -> tuple[Tensor, ...]:
            """Estimates the force from the features of the images as they are, without their mirror images.

            The force is the sum of a term in the unit of bending, EI / L^2, and a term in the unit of indentation,
            proportional to the length L: so stiffness EI and length enter as in mechanics. The metadata modulate the
            dense features by a scale and a shift (FiLM, Perez et al. 2018).

            Args:
                last: (2 n, c, h, h) features of the encoder's last level, both views of a sample one after the other.
                metadata: (n, k) metadata features; the first two are the logarithms of stiffness and length.
                actuation: (n, m) actuation values in their own units; None for a network without.

            Returns:
                `STEREO_OUTPUTS` of the n samples: forces (n, outputs) in N, the logarithm of their variances
                (n, outputs) in ``unit_n`` squared, the logit of contact (n,), the logit of an in-distribution position
                of the catheter (n,), the feature grids of both views (n, g), and the last features (n, `FEATURES`).
            """
            conditions = metadata
            if actuation is not None:
                conditions = torch.cat([metadata, (actuation - self.actuation_mean) / self.actuation_deviation], dim=1)
            scale, shift = self.film(conditions).chunk(2, 1)
            view_grids = self.grid_projection(last).flatten(1)
            grid = view_grids.unflatten(0, (-1, VIEWS)).flatten(1)  # both views of a sample in one row
            modulated = torch.relu(self.dense(grid) * (1.0 + scale) + shift)
            features = torch.relu(self.hidden(modulated))
            output = self.output_head(features).float()
            log_stiffness, log_length = metadata[:, :1], metadata[:, 1:2]
            bending_n = self.unit_n * torch.exp(log_stiffness - 2.0 * log_length)
            indentation_n = self.unit_n * torch.exp(log_length)
            bending_part, indentation_part = output[:, :outputs], output[:, outputs : 2 * outputs]
            force = bending_part * bending_n + indentation_part * indentation_n
            log_variance = output[:, 2 * outputs : 3 * outputs].clamp(*LOG_VARIANCE_RANGE)
            contact = output[:, -1]
            in_distribution = self.distribution_head(grid)[:, 0].float()
            return force, log_variance, contact, in_distribution, grid.float(), features.float()

    return Stereo()
