"""What the loop must be told of a network: how it is built, fed and judged."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import numpy.typing as npt

from ..types import IntArray
from ._samples import Samples

if TYPE_CHECKING:
    from torch import Tensor, nn

__all__ = ["Batch", "Task"]

Batch = dict[str, npt.NDArray[Any]]
"""Arrays of one batch by name, (b, ...) each: what the network is given, and what it is judged by."""


class Task(Protocol):
    """A network to train. The loop is the same for all of them.

    ``name``: what a checkpoint is recognised by; ``inputs``: which arrays of a batch the network takes, by the names
    of its arguments; ``head``: how the names of the parameters begin that may be new where training starts from
    weights made for other outputs.
    """

    @property
    def name(self) -> str: ...

    @property
    def inputs(self) -> tuple[str, ...]: ...

    @property
    def head(self) -> tuple[str, ...]: ...

    def build(self) -> "nn.Module":
        """The network with its first weights, drawn from torch's generator."""
        ...

    def batch(self, samples: Samples, index: IntArray, draws: Sequence[np.random.Generator] | None) -> Batch:
        """The samples at ``index`` (b,). Called in background threads.

        ``draws``: a generator a sample, keyed by seed, epoch and sample, for what is altered at random in training;
        None where the network is measured and nothing may be altered.
        """
        ...

    def loss(self, outputs: Any, batch: Mapping[str, "Tensor"]) -> "Tensor":
        """What training makes small: a scalar, from what the network returned and the batch, both in fp32."""
        ...

    def error_n(self, outputs: Any, batch: Mapping[str, "Tensor"]) -> "Tensor":
        """(b,) newtons: how wrong each sample's force is. Its mean over the validation part chooses the epoch."""
        ...
