"""A network made for this task: small, grey, and with positions kept to the end.

Where the catheter lies in its window is the measurement, so the last grid of features goes into the dense layers as it
is, not as its mean. What the sheet beside the bench says of the catheter modulates them (feature-wise linear
modulation, Perez et al. 2018). The force is the sum of two answers, one in the unit of bending (EI / L^2), one in that
of pressing into tissue (stiffness x L), so that stiffness and length of the catheter enter as mechanics has it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from ..types import IntArray
from ._augment import CURVATURE, Augmentation, augmented, middle
from ._compact_network import HEAT, build_compact
from ._samples import UNKNOWN, Samples
from ._task import Batch

if TYPE_CHECKING:
    from torch import Tensor, nn

__all__ = ["COMPACT_UNIT_N", "CompactTask"]

COMPACT_UNIT_N = 0.1
"""The force of which the network's numbers are of order one."""

CONTACT_N = 0.015
"""Above this a sensor's reading counts as contact in training."""

_SHARPNESS = 0.5
"""Exponent beta of the variance's weight in the likelihood (Seitzer et al. 2022): 0 plain, 1 squares alone."""
_WEIGHTS = {"force": 1.0, "contact": 0.02, "heat": 0.1, "familiar": 0.1}


@dataclass(frozen=True)
class CompactTask:
    """``outputs`` force components from grey pictures of ``size`` pixels and ``sheet`` numbers.

    ``planar``: which outputs are fx and fy of the base frame, which a mirrored picture changes alike; None where forces
    are in another frame. ``actuation``: mean and deviation of each actuation value that joins the sheet.
    """

    outputs: int
    sheet: int
    size: int = 160
    planar: tuple[int, int] | None = (0, 1)
    augmentation: Augmentation | None = None
    actuation: tuple[tuple[float, float], ...] = ()

    @property
    def name(self) -> str:
        """What a checkpoint is recognised by."""
        return f"compact, {self.outputs} outputs, {self.sheet + len(self.actuation)} numbers, {self.size} pixels"

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the network's arguments."""
        return ("picture", "sheet", "actuation") if self.actuation else ("picture", "sheet")

    @property
    def head(self) -> tuple[str, ...]:
        """The last dense layers and what takes the sheet."""
        return ("answer.", "sheet.", "actuation_", "familiar.")

    @property
    def mirrors(self) -> bool:
        """Whether training mirrors pictures; nobody knows which other actuation changes its sign in a mirror."""
        asked = self.augmentation is not None and self.augmentation.mirror > 0
        return asked and self.planar is not None and not self.actuation

    def build(self) -> "nn.Module":
        """See `build_compact`."""
        mirror = None
        if self.mirrors and self.planar is not None:
            signs = np.ones(self.outputs), np.ones(self.sheet)
            signs[0][self.planar[1]] = signs[1][CURVATURE] = -1.0
            mirror = tuple(signs[0].tolist()), tuple(signs[1].tolist())
        return build_compact(self.outputs, self.sheet, self.size, COMPACT_UNIT_N, self.actuation, mirror)

    def batch(self, samples: Samples, index: IntArray, draws: Sequence[np.random.Generator] | None) -> Batch:
        """Pictures cut to ``size``, at random places, turns, lights and so on where ``draws`` are given."""
        taken: Batch = {
            "force_n": samples.force_n[index].copy(),
            **{name: values[index].copy() for name, values in samples.inputs.items()},
        }
        pictures = np.empty((len(index), self.size, self.size), np.uint8)
        grid = self.size // HEAT
        heat = np.full((len(index), grid, grid), np.nan, np.float32)
        familiar = np.ones(len(index), np.float32)
        for k, place in enumerate(index.tolist()):
            where = None if samples.heat is None or samples.heat[place].min() == UNKNOWN else samples.heat[place]
            if draws is None or self.augmentation is None:
                pictures[k] = middle(samples.pictures[place], self.size)
                seen = None if where is None else middle(where, self.size // 4)
            else:
                altered = augmented(
                    samples.pictures[place], where, taken["force_n"][k], taken["sheet"][k], self, draws[k]
                )
                pictures[k], seen, familiar[k] = altered.picture, altered.heat, not altered.moved
            if seen is not None:
                heat[k] = cv2.resize(seen, (grid, grid), interpolation=cv2.INTER_AREA) / np.float32(255.0)
        return taken | {"picture": pictures, "heat": heat, "familiar": familiar}

    def loss(self, outputs: Any, batch: Mapping[str, "Tensor"]) -> "Tensor":
        """Gaussian likelihood of the force with its own variance, contact yes / no, where the catheter is, familiar.

        Of pictures that are not to be answered it learns the last two alone.
        """
        import torch
        from torch.nn.functional import binary_cross_entropy_with_logits

        force, log_variance, contact, heat, familiar, *_ = outputs
        share = _share(batch)
        wrong = (force - batch["force_n"]) / COMPACT_UNIT_N
        likelihood = 0.5 * (wrong * wrong * torch.exp(-log_variance) + log_variance)
        likelihood = likelihood * torch.exp(_SHARPNESS * log_variance).detach()
        touching = (torch.linalg.vector_norm(batch["force_n"], dim=1) > CONTACT_N).float()
        total = _WEIGHTS["force"] * (likelihood.mean(dim=1) * share).mean()
        touched = binary_cross_entropy_with_logits(contact, touching, reduction="none")
        total = total + _WEIGHTS["contact"] * (touched * share).mean()
        total = total + _WEIGHTS["familiar"] * binary_cross_entropy_with_logits(familiar, batch["familiar"])
        there = ~torch.isnan(batch["heat"])
        if bool(there.any()):
            total = total + _WEIGHTS["heat"] * binary_cross_entropy_with_logits(heat[there], batch["heat"][there])
        return total

    def error_n(self, outputs: Any, batch: Mapping[str, "Tensor"]) -> "Tensor":
        """(b,): length of the difference of the vectors, weighted: the mean is that of those to be answered."""
        import torch

        return torch.linalg.vector_norm(outputs[0] - batch["force_n"], dim=1) * _share(batch)


def _share(batch: Mapping[str, "Tensor"]) -> "Tensor":
    """(b,): the weight of each sample in a mean over those to be answered."""
    familiar = batch["familiar"]
    return familiar * (len(familiar) / familiar.sum().clamp(min=1.0))
