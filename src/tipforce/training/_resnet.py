"""Method 2 of the thesis: ResNet-18 from the whole image to the force (thesis ch. 4, fig. 29)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..types import IntArray
from ._data import TrainingSamples
from ._task import Batch, Weights

if TYPE_CHECKING:
    from torch import Tensor, nn

RESNET_OUTPUTS = ("force_n", "pooled")
"""Outputs of the network: force (n, outputs) in newtons, and the pooled features (n, `FEATURES`) it is made of."""

FEATURES = 512
"""Channels of the last block of ResNet-18."""

MIN_SQUARED_ERROR_N2 = 1e-12
"""Smallest squared error; it keeps the gradient of the root finite where the error is 0."""


@dataclass(frozen=True, slots=True)
class ResnetTask:
    """Force components from a colour image, and optionally from actuation values.

    The network takes ``image`` (n, h, w, 3) uint8 and scales it to 0..1 itself. Standardised actuation values (n, k)
    are joined to the pooled features before the dense layer (thesis eq. 18).

    Attributes:
        outputs: number of force components (thesis: 2).
        actuation: mean and standard deviation of each actuation value.
    """

    outputs: int
    actuation: tuple[tuple[float, float], ...] = ()

    @property
    def name(self) -> str:
        """See `Task`."""
        return f"ResNet-18, {self.outputs} outputs, {len(self.actuation)} actuation values"

    @property
    def inputs(self) -> tuple[str, ...]:
        """See `Task`."""
        return ("image", "actuation") if self.actuation else ("image",)

    @property
    def head(self) -> tuple[str, ...]:
        """The dense layer, and the standardisation of the actuation."""
        return ("dense.", "actuation_")

    def adapted(self, weights: Weights) -> Weights:
        """See `Task`: there is no earlier layout."""
        return weights

    def build(self) -> "nn.Module":
        """Returns the network: 64 filters 7 x 7, max pooling 3 x 3, four stages to 512 filters, mean pooling, dense."""
        import torch
        from monai.networks.nets import resnet18  # pyright: ignore[reportPrivateImportUsage]
        from torch import Tensor, nn

        class Resnet(nn.Module):
            """uint8 image to force in newtons."""

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

            def forward(self, image: Tensor, actuation: Tensor | None = None) -> tuple[Tensor, Tensor]:
                pooled: Tensor = self.body(image.permute(0, 3, 1, 2).float() / 255.0)
                features = pooled
                if actuation is not None:
                    scaled = (actuation - self.actuation_mean) / self.actuation_deviation
                    features = torch.cat([pooled, scaled.to(pooled.dtype)], dim=1)
                return self.dense(features), pooled

        return Resnet(self.outputs, self.actuation)

    def batch(self, samples: TrainingSamples, index: IntArray, rngs: Sequence[np.random.Generator] | None) -> Batch:
        """Returns images, labels and actuation; see `Task.batch`. There is no augmentation: the thesis has none."""
        del rngs
        taken: Batch = {"image": samples.images[index], "force_n": samples.force_n[index]}
        return taken | {name: values[index] for name, values in samples.inputs.items()}

    def loss(self, outputs: Any, batch: Mapping[str, "Tensor"]) -> "Tensor":
        """Returns the mean over the batch of thesis eq. (19); see `Task.loss`."""
        return component_rms(outputs[0], batch["force_n"]).mean()

    def error_n(self, outputs: Any, batch: Mapping[str, "Tensor"]) -> "Tensor":
        """Returns the (b,) errors by thesis eq. (19), which is also the measure of the thesis; see `Task.error_n`."""
        return component_rms(outputs[0], batch["force_n"])


def component_rms(predicted: "Tensor", target: "Tensor") -> "Tensor":
    """Returns thesis eq. (19): the root mean square over the components of the error of the force.

    Args:
        predicted: (b, t) forces in newtons.
        target: (b, t) forces in newtons.

    Returns:
        (b,) in newtons.
    """
    return ((predicted - target) ** 2).mean(dim=1).add(MIN_SQUARED_ERROR_N2).sqrt()
