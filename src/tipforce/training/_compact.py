"""`compact`: a small network for grey images of the window around the catheter.

The position of the catheter in its window is the measurement, so the last feature grid enters the dense layers itself,
not its mean. Metadata of catheter and bench modulate the dense features (feature-wise linear modulation, FiLM, Perez et
al. 2018). The force is the sum of two terms, one in the unit of bending (EI / L^2) and one in that of indentation
(stiffness x L), so that stiffness and length of the catheter enter as in mechanics.

The depth of the indentation determines the force only where the stiffness of the tissue is known. With classes of
tissue the network estimates the force and its variance for each class, and the probability of each class from this
image: a mixture. In training its classes are known where the sessions state their tissue; otherwise they follow from
the mixture itself (expectation and maximisation). The user of the network weights the classes by the earlier images of
the session.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import numpy.typing as npt

from ..errors import InputError
from ..types import IntArray
from ._augmentation import CURVATURE, Augmentation, augment_image, centre_crop
from ._blocks import convolution, encoder_levels, image_blocks
from ._data import HEATMAP_UNKNOWN, TrainingSamples
from ._task import Batch, Weights

if TYPE_CHECKING:
    from torch import Tensor, nn

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

TISSUE_OUTPUTS = ("tissue_force_n", "tissue_log_variance", "tissue_logits")
"""Further outputs of a network with classes of tissue: force (n, c, t) and logarithm of its variance (n, c, t) for each
class, logits of the classes (n, c). "force_n" and "log_variance" are then mean and variance of the mixture."""

TISSUE_N_PER_M = tuple(np.geomspace(36.0, 418.0, 8).tolist())
"""Stiffness of each class of tissue, in newtons per metre of indentation: neighbours differ by 42 %."""

DEFAULT_TISSUE_N_PER_M = float(np.sqrt(TISSUE_N_PER_M[0] * TISSUE_N_PER_M[-1]))
"""Tissue of a network without classes: near the 120 N/m of `bench-2021`."""

COMPACT_UNIT_N = 0.1
"""Unit of the network's force, in newtons: in it forces are of order one."""

FEATURES = 128
"""Features before the last dense layer."""

CONTACT_N = 0.015
"""Measured forces above this count as contact."""

_BETA = 0.5
"""Exponent of the variance in the weight of the likelihood (beta-NLL, Seitzer et al. 2022): 0 is the plain likelihood,
1 the mean squared error."""
_LOSS_WEIGHTS = {"force": 1.0, "contact": 0.02, "tissue": 0.05, "heatmap": 0.1, "in_distribution": 0.1}
DOUBLE_WEIGHT_N = 0.2
"""A force of this size has weight 2, of twice this size weight 3: large forces are rare, and would be estimated too
near to the usual ones, which is the dangerous side."""

_HEATMAP_PX = 8
"""Image pixels to one pixel of the heatmap."""
_CHANNELS = (32, 64, 112, 112)
_RESIDUAL_BLOCKS = (0, 1, 1, 0)
"""Residual blocks on each level."""
_GRID_CHANNELS = 32
LOG_VARIANCE_RANGE = -9.0, 3.0


@dataclass(frozen=True)
class CompactTask:
    """Force components from grey images and metadata features.

    Attributes:
        outputs: number of force components.
        metadata: number of metadata features.
        size: side of the network's image in pixels.
        planar: indices of the outputs fx and fy of the base frame, which mirroring an image changes; None where the
        forces
            are in another frame.
        augmentation: augmentation in training; None for none.
        actuation: mean and standard deviation of each actuation value that joins the metadata.
        tissue: whether the force is estimated for each class of tissue, `TISSUE_N_PER_M`. The samples' input "tissue"
            (n, 1) is then the logarithm of the stiffness in N/m, NaN where it is not known.
    """

    outputs: int
    metadata: int
    size: int = 160
    planar: tuple[int, int] | None = (0, 1)
    augmentation: Augmentation | None = None
    actuation: tuple[tuple[float, float], ...] = ()
    tissue: bool = False

    @property
    def name(self) -> str:
        """See `Task`."""
        numbers = f"{self.outputs} outputs, {self.metadata + len(self.actuation)} numbers, {self.size} pixels"
        return f"compact, {numbers}{', classes of tissue' if self.tissue else ''}"

    @property
    def inputs(self) -> tuple[str, ...]:
        """See `Task`."""
        return ("image", "metadata", "actuation") if self.actuation else ("image", "metadata")

    @property
    def head(self) -> tuple[str, ...]:
        """The last dense layers and those with the metadata as input."""
        return ("output_head.", "film.", "actuation_", "distribution_head.")

    @property
    def mirrors(self) -> bool:
        """Whether training mirrors images: the change of other actuation than the knob in a mirror is not known."""
        wanted = self.augmentation is not None and self.augmentation.mirror > 0
        return wanted and self.planar is not None and not self.actuation

    def adapted(self, weights: Weights) -> Weights:
        """See `Task`: adds classes of tissue to a network without; all of them first behave as the usual tissue."""
        head = {name: np.asarray(weights[name]) for name in ("output_head.weight", "output_head.bias")}
        t, classes = self.outputs, len(TISSUE_N_PER_M)
        if not self.tissue or any(len(rows) != _head_rows(t, 1) for rows in head.values()):
            return weights
        made: dict[str, npt.NDArray[Any]] = {}
        for name, rows in head.items():
            variance = np.concatenate([np.zeros_like(rows[:t]), rows[2 * t : 3 * t], np.zeros_like(rows[:1])])
            made[name] = np.concatenate([rows[: 2 * t], *[variance] * classes, rows[3 * t :]])
        return {**weights, **made}

    def build(self) -> "nn.Module":
        """See `build_compact`."""
        mirror = None
        if self.mirrors and self.planar is not None:
            signs = np.ones(self.outputs), np.ones(self.metadata)
            signs[0][self.planar[1]] = signs[1][CURVATURE] = -1.0
            mirror = tuple(signs[0].tolist()), tuple(signs[1].tolist())
        classes = len(TISSUE_N_PER_M) if self.tissue else 1
        return build_compact(self.outputs, self.metadata, self.size, COMPACT_UNIT_N, self.actuation, mirror, classes)

    def batch(self, samples: TrainingSamples, index: IntArray, rngs: Sequence[np.random.Generator] | None) -> Batch:
        """Returns images of ``size`` pixels with their labels, augmented where ``rngs`` are given; see `Task.batch`."""
        taken: Batch = {
            "force_n": samples.force_n[index].copy(),
            **{name: values[index].copy() for name, values in samples.inputs.items()},
        }
        if self.tissue:
            taken["tissue"] = tissue_shares(taken["tissue"][:, 0])
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
        the tissue's class, heatmap and in-distribution. Samples that are out of distribution count in the last two
        alone.

        Args:
            outputs: `COMPACT_OUTPUTS`, with tissue also `TISSUE_OUTPUTS`.
            batch: the tensors of `batch`.
        """
        import torch
        from torch.nn.functional import binary_cross_entropy_with_logits, log_softmax

        force, log_variance, contact, heatmap, in_distribution, *_ = outputs
        weight = _sample_weight(batch)
        size_n = torch.linalg.vector_norm(batch["force_n"], dim=1)
        force_weight = weight * (1.0 + size_n / DOUBLE_WEIGHT_N)
        if self.tissue:
            force, log_variance, logits = outputs[len(COMPACT_OUTPUTS) :]
        else:
            force, log_variance = force[:, None], log_variance[:, None]
            logits = torch.zeros_like(force[:, :, 0])
        error = (force - batch["force_n"][:, None]) / COMPACT_UNIT_N
        likelihood = 0.5 * (error * error * torch.exp(-log_variance) + log_variance)
        log_share = log_softmax(logits, dim=1)
        share = (log_share - likelihood.sum(dim=2)).softmax(dim=1).detach()
        if self.tissue:
            stated = batch["tissue"]
            share = torch.where(torch.isnan(stated), share, stated)
        likelihood = likelihood * torch.exp(_BETA * log_variance).detach()
        in_contact = (size_n > CONTACT_N).float()
        total = _LOSS_WEIGHTS["force"] * ((share * likelihood.mean(dim=2)).sum(dim=1) * force_weight).mean()
        total = total - _LOSS_WEIGHTS["tissue"] * ((share * log_share).sum(dim=1) * weight).mean()
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
        """Returns (b,) lengths of the force error, weighted: their mean is that of the in-distribution samples.

        Args:
            outputs: outputs of the network; the first is the force (b, t) in newtons.
            batch: the tensors of `batch`.
        """
        import torch

        return torch.linalg.vector_norm(outputs[0] - batch["force_n"], dim=1) * _sample_weight(batch)


def _sample_weight(batch: Mapping[str, "Tensor"]) -> "Tensor":
    """Returns the (b,) weights of the samples in a mean over the in-distribution samples."""
    in_distribution = batch["in_distribution"]
    return in_distribution * (len(in_distribution) / in_distribution.sum().clamp(min=1.0))


def tissue_shares(log_stiffness: npt.NDArray[np.floating]) -> npt.NDArray[np.float32]:
    """Returns (n, c) shares of the classes of tissue: the two next to the stiffness share linearly.

    Args:
        log_stiffness: (n,) logarithms of stiffnesses in N/m; NaN where unknown, and then NaN in the shares.

    >>> np.rint(100 * tissue_shares(np.log([36.0, 60.0]))[:, :3]).tolist()
    [[100.0, 0.0, 0.0], [0.0, 54.0, 46.0]]
    """
    centres = np.log(TISSUE_N_PER_M)
    within = np.clip(log_stiffness, centres[0], centres[-1])[:, None]
    shares = np.maximum(1.0 - np.abs(within - centres) / (centres[1] - centres[0]), 0.0)
    return shares.astype(np.float32)


def _head_rows(outputs: int, classes: int) -> int:
    """Returns the rows of the output head: parts in the units of bending and indentation, classes, contact.

    With one class: bending, indentation and variance of each component. With more: bending and indentation, then of
    each class its own indentation, its variance and its logit.
    """
    return 3 * outputs + 1 if classes == 1 else 2 * outputs + classes * (2 * outputs + 1) + 1


def build_compact(
    outputs: int,
    metadata: int,
    size: int,
    unit_n: float,
    actuation: tuple[tuple[float, float], ...] = (),
    mirror: tuple[tuple[float, ...], tuple[float, ...]] | None = None,
    classes: int = 1,
) -> "nn.Module":
    """Builds the network: ``image`` (n, size, size) uint8 and ``metadata`` (n, metadata) to `COMPACT_OUTPUTS`.

    With more than one class they are followed by `TISSUE_OUTPUTS`.

    Args:
        outputs: number of force components.
        metadata: number of metadata features; the first two are the logarithms of stiffness and length.
        size: side of the image in pixels.
        unit_n: unit of the force, in newtons.
        actuation: mean and standard deviation of each further value (n, k) that joins the metadata.
        mirror: signs of the force components and of the metadata features in a mirrored image. In eval mode the
            network then evaluates the image and its mirror image and returns the mean of both (grid and features: of
            the image as it is).
        classes: number of classes of tissue.

    Returns:
        The module with random weights.

    Raises:
        InputError: ``size`` is no multiple of 32.
    """
    import torch
    from torch import Tensor, nn

    if size % 32:
        raise InputError(f"size={size}: the side of the network's image must be a multiple of 32; 160 is usual")

    class Compact(nn.Module):
        """See `build_compact`."""

        unit_n: Tensor
        actuation_mean: Tensor
        actuation_deviation: Tensor
        force_signs: Tensor
        metadata_signs: Tensor
        tissue_ratio: Tensor

        def __init__(self) -> None:
            super().__init__()
            self.levels = encoder_levels(_CHANNELS, _RESIDUAL_BLOCKS)
            grid = _GRID_CHANNELS * (size // 32) ** 2
            self.grid_projection = convolution(_CHANNELS[-1], _GRID_CHANNELS, 1)
            self.dense = nn.Linear(grid, FEATURES)
            self.film = nn.Sequential(nn.Linear(metadata + len(actuation), 32), nn.ReLU(), nn.Linear(32, 2 * FEATURES))
            self.hidden = nn.Linear(FEATURES, FEATURES)
            self.output_head = nn.Linear(FEATURES, _head_rows(outputs, classes))
            self.heatmap_head = nn.Conv2d(_CHANNELS[1], 1, 1)
            self.distribution_head = nn.Sequential(nn.Linear(grid, 32), nn.ReLU(), nn.Linear(32, 1))
            self.register_buffer("unit_n", torch.tensor(unit_n))
            if classes > 1:
                ratio = np.array(TISSUE_N_PER_M, np.float32) / DEFAULT_TISSUE_N_PER_M
                self.register_buffer("tissue_ratio", torch.from_numpy(ratio)[:, None], persistent=False)
            if actuation:
                self.register_buffer("actuation_mean", torch.tensor([mean for mean, _ in actuation]))
                self.register_buffer("actuation_deviation", torch.tensor([deviation for _, deviation in actuation]))

            if mirror is not None:
                self.register_buffer("force_signs", torch.tensor(mirror[0]), persistent=False)
                self.register_buffer("metadata_signs", torch.tensor(mirror[1]), persistent=False)

        def forward(self, image: Tensor, metadata: Tensor, actuation: Tensor | None = None) -> tuple[Tensor, ...]:
            if self.training or mirror is None or actuation is not None:
                return self.joined(*self.single(image, metadata, actuation))
            count = image.shape[0]
            images = torch.cat([image, image.flip(1)])
            found = self.single(images, torch.cat([metadata, metadata * self.metadata_signs]), None)
            force, log_variance, logits, contact, heatmap, in_distribution = (each[:count] for each in found[:6])
            mirrored = [each[count:] for each in found[:6]]
            return self.joined(
                0.5 * (force + mirrored[0] * self.force_signs),
                0.5 * (log_variance + mirrored[1]),
                0.5 * (logits + mirrored[2]),
                0.5 * (contact + mirrored[3]),
                0.5 * (heatmap + mirrored[4].flip(1)),
                0.5 * (in_distribution + mirrored[5]),
                *(each[:count] for each in found[6:]),
            )

        def joined(self, force: Tensor, log_variance: Tensor, logits: Tensor, *others: Tensor) -> tuple[Tensor, ...]:
            """Returns the outputs, with mean and variance of the mixture over the classes."""
            if classes == 1:
                return force[:, 0], log_variance[:, 0], *others
            share = logits.softmax(dim=1)[:, :, None]
            mean = (share * force).sum(dim=1)
            spread = (force - mean[:, None]) / self.unit_n
            variance = (share * (torch.exp(log_variance) + spread * spread)).sum(dim=1)
            return mean, torch.log(variance), *others, force, log_variance, logits

        def single(self, image: Tensor, metadata: Tensor, actuation: Tensor | None) -> tuple[Tensor, ...]:
            """Returns the outputs for each image alone, without its mirror image."""
            x = self.levels[1](self.levels[0](image_blocks(image)))
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
            shared = outputs if classes == 1 else 2 * outputs
            by_class = output[:, shared:-1].unflatten(1, (classes, -1))
            pressing = by_class[:, :, :outputs]
            if classes > 1:
                # the force of an indentation is proportional to the stiffness; each class adds a term of its own
                pressing = pressing + output[:, None, outputs:shared] * self.tissue_ratio
            force = (output[:, :outputs] * bending)[:, None] + pressing * indentation[:, None]
            log_variance = by_class[:, :, outputs : 2 * outputs].clamp(*LOG_VARIANCE_RANGE)
            logits, contact = by_class[:, :, 2 * outputs :].sum(dim=2), output[:, -1]
            in_distribution = self.distribution_head(grid)[:, 0].float()
            heatmap = heatmap[:, 0].float()
            return force, log_variance, logits, contact, heatmap, in_distribution, grid.float(), features.float()

    return Compact()
