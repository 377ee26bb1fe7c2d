"""Interface between the training loop and a network: its construction, its inputs, its evaluation, its weights."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import numpy.typing as npt

from ..errors import InputError
from ..types import IntArray
from ._data import TrainingSamples

if TYPE_CHECKING:
    from torch import Tensor, nn

Batch = dict[str, npt.NDArray[Any]]
"""Arrays of one batch by name, (b, ...) each: the inputs of the network and its labels."""

Weights = Mapping[str, npt.NDArray[Any]]
"""Parameters and buffers by name."""

_COUNTER = "num_batches_tracked"
"""A counter of batch normalisation that is not needed."""


class Task(Protocol):
    """A network to train. The training loop is the same for all of them."""

    @property
    def name(self) -> str:
        """Identifies the architecture: a checkpoint belongs to the task of the same name."""
        ...

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the network's arguments, each an array of a batch."""
        ...

    @property
    def head(self) -> tuple[str, ...]:
        """Prefixes of the parameters that may be re-initialised where fine-tuning changes the inputs or outputs."""
        ...

    def adapted(self, weights: Weights) -> Weights:
        """Returns initial weights of an earlier layout in the layout of this task; other weights unchanged."""
        ...

    def build(self) -> "nn.Module":
        """Returns the network with initial weights from torch's generator."""
        ...

    def batch(self, samples: TrainingSamples, index: IntArray, rngs: Sequence[np.random.Generator] | None) -> Batch:
        """Returns samples as arrays by name. Called in background threads.

        Args:
            samples: all samples.
            index: (b,) indices of the samples.
            rngs: one generator per sample for data augmentation, keyed by seed, epoch and sample; None for validation,
                without augmentation.
        """
        ...

    def loss(self, outputs: Any, batch: Mapping[str, "Tensor"]) -> "Tensor":
        """Returns the scalar training loss.

        Args:
            outputs: outputs of the network, in fp32.
            batch: the tensors of `batch`, in fp32.
        """
        ...

    def error_n(self, outputs: Any, batch: Mapping[str, "Tensor"]) -> "Tensor":
        """Returns (b,) force errors in newtons. Their mean over the validation split chooses the best epoch.

        Args:
            outputs: outputs of the network, in fp32.
            batch: the tensors of `batch`, in fp32.
        """
        ...


def network_weights(network: "nn.Module") -> dict[str, npt.NDArray[Any]]:
    """Returns copies of all parameters and buffers of ``network``."""
    return {name: value.detach().cpu().numpy().copy() for name, value in network.state_dict().items()}


def network_from_weights(task: Task, weights: Weights) -> "nn.Module":
    """Returns a network with given weights, on the CPU, in eval mode.

    Args:
        task: builds the network.
        weights: all its weights by name.
    """
    network = task.build()
    reinitialised = load_weights(network, weights, ())
    assert not reinitialised
    return network.eval()


def load_weights(network: "nn.Module", weights: Weights, head: tuple[str, ...]) -> list[str]:
    """Copies ``weights`` into ``network``.

    Args:
        network: the network, which is changed in place.
        weights: weights of the same architecture.
        head: prefixes of the parameters that may differ in shape; those keep their initial values.

    Returns:
        The names of the parameters that kept their initial values.

    Raises:
        InputError: the weights belong to another network.
    """
    import torch

    new = network.state_dict()
    reinitialised: list[str] = []
    for name, value in new.items():
        given = weights.get(name)
        if given is not None and tuple(given.shape) == tuple(value.shape):
            new[name] = torch.from_numpy(np.array(given)).to(value.dtype)
        elif name.startswith(head) if head else False:
            reinitialised.append(name)
        elif not name.endswith(_COUNTER):
            got = "none of that name" if given is None else f"the shape {tuple(given.shape)}"
            raise InputError(
                f"the initial weights belong to another network: {name} has the shape {tuple(value.shape)} here, they "
                f"have {got}; start from a model of the same method"
            )
    network.load_state_dict(new)
    return reinitialised
