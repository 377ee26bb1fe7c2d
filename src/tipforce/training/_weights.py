"""Weights of a network as plain arrays, and back."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..errors import InputError
from ._task import Task

if TYPE_CHECKING:
    from torch import nn

__all__ = ["Weights", "network_of", "start_from", "weights_in"]

Weights = Mapping[str, npt.NDArray[Any]]
"""Parameters and buffers by name."""

_COUNTER = "num_batches_tracked"
"""What batch normalisation counts and nobody reads."""


def weights_in(network: "nn.Module") -> dict[str, npt.NDArray[Any]]:
    """Copies of all parameters and buffers of ``network``."""
    return {name: value.detach().cpu().numpy().copy() for name, value in network.state_dict().items()}


def network_of(task: Task, weights: Weights) -> "nn.Module":
    """The network of ``task`` with exactly ``weights``, on the CPU, set to answer (not to train)."""
    network = task.build()
    fresh = start_from(network, weights, ())
    assert not fresh
    return network.eval()


def start_from(network: "nn.Module", weights: Weights, head: tuple[str, ...]) -> list[str]:
    """Set ``network``'s weights; returns the names of those that stayed as they were.

    Only names that begin with one of ``head`` may: their shape hangs on the outputs. Raises InputError for weights of
    another network.
    """
    import torch

    new = network.state_dict()
    fresh: list[str] = []
    for name, value in new.items():
        given = weights.get(name)
        if given is not None and tuple(given.shape) == tuple(value.shape):
            new[name] = torch.from_numpy(np.array(given)).to(value.dtype)
        elif name.startswith(head) if head else False:
            fresh.append(name)
        elif not name.endswith(_COUNTER):
            got = "none of that name" if given is None else f"the shape {tuple(given.shape)}"
            raise InputError(
                f"the weights to start from belong to another network: {name} has the shape {tuple(value.shape)} "
                f"here, they have {got}; start from a model of the same method"
            )
    network.load_state_dict(new)
    return fresh
