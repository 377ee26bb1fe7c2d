"""The network, its optimiser and what they know: one pass over the data, and all of it as a state to go on from."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..types import IntArray
from ._batches import Batches, batches_of
from ._machine import Machine
from ._recipe import TrainConfig
from ._task import Batch, Task
from ._weights import Weights, start_from

__all__ = ["Trainer"]


class Trainer:
    """Trains the network of ``task`` epoch by epoch on ``machine``; ``fresh``: weights that ``start`` did not give."""

    def __init__(self, task: Task, recipe: TrainConfig, machine: Machine, start: Weights | None) -> None:
        import torch

        self._task, self._recipe, self._machine = task, recipe, machine
        torch.manual_seed(recipe.seed)
        self.network: Any = task.build()
        self.fresh = start_from(self.network, start, task.head) if start is not None else []
        self.network = self.network.to(machine.device, memory_format=torch.channels_last)
        self._optimiser = _optimiser(self.network, recipe)
        self._averaged: dict[str, Any] | None = self._copy() if recipe.average else None
        self._steps = 0

    def train(self, batches: Batches, places: IntArray, epoch: int, scale: float, done: Callable[[float], None]) -> Any:
        """One pass over ``places``; returns mean loss and mean error in newtons, as they were on the way.

        ``epoch`` from 0 on; ``scale`` of the rate, beside the recipe's schedule; ``done`` hears the share that is done.
        """
        import torch

        recipe = self._recipe
        # keyed, not carried on: an epoch draws the same whatever ran before it
        torch.manual_seed(_mixed(recipe.seed, epoch))
        parts = batches_of(places, recipe.batch, np.random.default_rng((recipe.seed, 2, epoch)))
        self.network.train()
        total = torch.zeros(2, device=self._machine.device)
        for number, arrays in enumerate(batches.run(parts, epoch)):
            batch = self._on_device(arrays)
            rate = scale * _rate(recipe, epoch + number / len(parts), 1.0 / len(parts))
            for group in self._optimiser.param_groups:
                group["lr"] = rate
            bf16 = self._machine.precision == "bf16"
            with torch.autocast(self._machine.device, dtype=torch.bfloat16, enabled=bf16):
                outputs = self.network(**{name: batch[name] for name in self._task.inputs})
            outputs = _in_fp32(outputs)
            loss = self._task.loss(outputs, batch)
            self._optimiser.zero_grad(set_to_none=True)
            loss.backward()  # pyright: ignore[reportUnknownMemberType]
            if recipe.clip_norm is not None:
                torch.nn.utils.clip_grad_norm_(self.network.parameters(), recipe.clip_norm)
            self._optimiser.step()
            self._steps += 1
            self._average()
            with torch.no_grad():
                error = self._task.error_n(outputs, batch).mean()
            total += len(parts[number]) * torch.stack([loss.detach(), error])
            done((number + 1) / len(parts))
        return (total / len(places)).tolist()

    def error_n(self, batches: Batches, places: IntArray) -> float:
        """Mean error in newtons over ``places``, nothing altered, in fp32, of the network that would be kept."""
        import torch

        trained = None
        if self._averaged is not None:
            trained = self._copy()
            self.network.load_state_dict(self._averaged)
        self.network.eval()
        total = torch.zeros((), device=self._machine.device)
        with torch.no_grad():
            for arrays in batches.run(batches_of(places, 2 * self._recipe.batch), None):
                batch = self._on_device(arrays)
                outputs = self.network(**{name: batch[name] for name in self._task.inputs})
                total += self._task.error_n(_in_fp32(outputs), batch).sum()
        if trained is not None:
            self.network.load_state_dict(trained)
        return float(total) / len(places)

    def kept(self) -> dict[str, Any]:
        """A copy of the weights that would be kept now: the trained ones, or their moving average."""
        if self._averaged is None:
            return self._copy()
        return {name: value.clone() for name, value in self._averaged.items()}

    def state(self) -> dict[str, Any]:
        """All that the next epoch hangs on."""
        state: dict[str, Any] = {
            "network": self.network.state_dict(),
            "optimiser": self._optimiser.state_dict(),
            "steps": self._steps,
        }
        return state if self._averaged is None else {**state, "averaged": self._averaged}

    def load(self, state: dict[str, Any]) -> None:
        """The inverse of `state`."""
        self.network.load_state_dict(state["network"])
        self._optimiser.load_state_dict(state["optimiser"])
        self._steps = state["steps"]
        if self._averaged is not None:
            self._averaged = {name: value.to(self._machine.device) for name, value in state["averaged"].items()}

    def _copy(self) -> dict[str, Any]:
        return {name: value.detach().clone() for name, value in self.network.state_dict().items()}

    def _average(self) -> None:
        """Move the average toward the weights; it forgets faster at first, when there is little to remember."""
        import torch

        if self._averaged is None:
            return
        share = 1.0 - min(self._recipe.average, (1 + self._steps) / (10 + self._steps))
        with torch.no_grad():
            for name, value in self.network.state_dict().items():
                if value.is_floating_point():
                    self._averaged[name].lerp_(value, share)
                else:
                    self._averaged[name].copy_(value)

    def _on_device(self, arrays: Batch) -> dict[str, Any]:
        import torch

        tensors = {name: torch.from_numpy(np.ascontiguousarray(array)) for name, array in arrays.items()}
        if self._machine.device == "cpu":
            return tensors
        return {name: value.pin_memory().to("cuda", non_blocking=True) for name, value in tensors.items()}


def _optimiser(network: Any, recipe: TrainConfig) -> Any:
    import torch

    if recipe.optimiser == "sgd":
        return torch.optim.SGD(
            network.parameters(), lr=recipe.rate, momentum=recipe.momentum, weight_decay=recipe.weight_decay
        )
    return torch.optim.AdamW(network.parameters(), lr=recipe.rate, weight_decay=recipe.weight_decay)


def _rate(recipe: TrainConfig, epoch: float, step: float) -> float:
    """The learning rate ``epoch`` epochs after the beginning, where a step takes ``step`` of one."""
    warm = min(1.0, (epoch + step) / recipe.warmup_epochs) if recipe.warmup_epochs else 1.0
    fall = 0.5 * (1.0 + math.cos(math.pi * min(1.0, epoch / recipe.epochs))) if recipe.schedule == "cosine" else 1.0
    return recipe.rate * warm * fall


def _mixed(seed: int, epoch: int) -> int:
    """One number from both."""
    return int(np.random.SeedSequence((seed, 3, epoch)).generate_state(1, np.uint64)[0] >> 1)


def _in_fp32(outputs: Any) -> Any:
    """What a network returned, a tensor or several in a tuple, list or mapping, in fp32."""
    if isinstance(outputs, dict):
        return {name: _in_fp32(value) for name, value in outputs.items()}
    if isinstance(outputs, Sequence):
        return tuple(_in_fp32(value) for value in outputs)
    return outputs.float()
