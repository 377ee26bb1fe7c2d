"""Method 2 of the thesis: ResNet-18 from the whole picture to the force (ch. 4, fig. 29)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..types import IntArray
from ._losses import component_rms
from ._samples import Samples
from ._task import Batch

if TYPE_CHECKING:
    from torch import Tensor, nn

__all__ = ["RESNET_OUTPUTS", "ResnetTask"]

RESNET_OUTPUTS = ("force_n", "pooled")
"""What the network returns: (n, outputs) newtons, and the (n, `FEATURES`) that they were made of."""

FEATURES = 512
"""What the last block of ResNet-18 leaves after pooling."""


@dataclass(frozen=True, slots=True)
class ResnetTask:
    """``outputs`` force components (thesis: 2) from a picture, and from actuation values where there are any.

    The network takes ``picture`` (n, h, w, 3) bytes and makes them 0..1 itself. ``actuation``: mean and deviation of
    each actuation value; these (n, k), less the mean and over the deviation, are joined to the pooled features before
    the one dense layer (eq. 18).
    """

    outputs: int
    actuation: tuple[tuple[float, float], ...] = ()

    @property
    def name(self) -> str:
        """What a checkpoint is recognised by."""
        return f"ResNet-18, {self.outputs} outputs, {len(self.actuation)} actuation values"

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the network's arguments."""
        return ("picture", "actuation") if self.actuation else ("picture",)

    @property
    def head(self) -> tuple[str, ...]:
        """The dense layer, and the scaling of what is joined to its input."""
        return ("dense.", "actuation_")

    def build(self) -> "nn.Module":
        """Stem of 64 filters 7 x 7 and a 3 x 3 maximum, four blocks to 512 filters, mean over the picture, dense."""
        import torch
        from monai.networks.nets import resnet18  # pyright: ignore[reportPrivateImportUsage]
        from torch import Tensor, nn

        class Resnet(nn.Module):
            """Bytes in, newtons out."""

            actuation_mean: Tensor
            actuation_deviation: Tensor

            def __init__(self, outputs: int, actuation: tuple[tuple[float, float], ...]) -> None:
                super().__init__()
                # no bias where batch normalisation follows, as in He et al. 2016, which the thesis follows
                self.body = resnet18(
                    spatial_dims=2, n_input_channels=3, conv1_t_stride=2, feed_forward=False, bias_downsample=False
                )
                self.dense = nn.Linear(FEATURES + len(actuation), outputs)
                nn.init.zeros_(self.dense.bias)
                if actuation:
                    self.register_buffer("actuation_mean", torch.tensor([mean for mean, _ in actuation]))
                    self.register_buffer("actuation_deviation", torch.tensor([spread for _, spread in actuation]))

            def forward(self, picture: Tensor, actuation: Tensor | None = None) -> tuple[Tensor, Tensor]:
                pooled: Tensor = self.body(picture.permute(0, 3, 1, 2).float() / 255.0)
                known = pooled
                if actuation is not None:
                    scaled = (actuation - self.actuation_mean) / self.actuation_deviation
                    known = torch.cat([pooled, scaled.to(pooled.dtype)], dim=1)
                return self.dense(known), pooled

        return Resnet(self.outputs, self.actuation)

    def batch(self, samples: Samples, index: IntArray, draws: Sequence[np.random.Generator] | None) -> Batch:
        """Pictures, labels and actuation as they are: the thesis alters nothing."""
        del draws
        taken: Batch = {"picture": samples.pictures[index], "force_n": samples.force_n[index]}
        return taken | {name: values[index] for name, values in samples.inputs.items()}

    def loss(self, outputs: Any, batch: Mapping[str, "Tensor"]) -> "Tensor":
        """Thesis eq. (19) of each sample, and of the batch their mean."""
        return component_rms(outputs[0], batch["force_n"]).mean()

    def error_n(self, outputs: Any, batch: Mapping[str, "Tensor"]) -> "Tensor":
        """(b,): thesis eq. (19), which also is what the thesis judges by."""
        return component_rms(outputs[0], batch["force_n"])
