"""One epoch of training or validation: batches prepared in background threads, the network and its optimiser."""

import math
import time
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from itertools import islice
from typing import Any

import numpy as np

from ..types import IntArray
from ._config import TrainConfig
from ._data import TrainingSamples
from ._device import Device
from ._task import Batch, Task, Weights, load_weights

PREFETCH = 3
"""Number of batches per thread that are prepared in advance."""


class BatchLoader:
    """Prepares batches in the background, in the order in which they are needed.

    A batch depends on seed, epoch and its samples alone, so the number of threads changes nothing in it.

    Attributes:
        waited_s: total time for which the consumer waited for batches.
    """

    def __init__(self, task: Task, samples: TrainingSamples, seed: int, pool: ThreadPoolExecutor, workers: int) -> None:
        self._task, self._samples, self._seed = task, samples, seed
        self._pool, self._prefetch = pool, PREFETCH * workers
        self.waited_s = 0.0

    def run(self, batches: list[IntArray], epoch: int | None) -> Iterator[Batch]:
        """Yields one batch for each array of sample indices.

        Args:
            batches: indices of the samples of each batch.
            epoch: number of the epoch, which seeds the augmentation; None: for validation, without augmentation.
        """
        rest = iter(batches)
        waiting: deque[Future[Batch]] = deque(self._submit(index, epoch) for index in islice(rest, self._prefetch))
        try:
            while waiting:
                start = time.perf_counter()
                batch = waiting.popleft().result()
                self.waited_s += time.perf_counter() - start
                waiting.extend(self._submit(index, epoch) for index in islice(rest, 1))
                yield batch
        finally:
            for future in waiting:
                future.cancel()

    def _submit(self, index: IntArray, epoch: int | None) -> "Future[Batch]":
        return self._pool.submit(self._prepare, index, epoch)

    def _prepare(self, index: IntArray, epoch: int | None) -> Batch:
        if epoch is None:
            return self._task.batch(self._samples, index, None)
        rngs = [np.random.default_rng((self._seed, 1, epoch, sample)) for sample in index.tolist()]
        return self._task.batch(self._samples, index, rngs)


@contextmanager
def batch_loader(task: Task, samples: TrainingSamples, seed: int, workers: int) -> Generator[BatchLoader]:
    """Opens a `BatchLoader`; its threads end with the block.

    Args:
        task: makes the batches.
        samples: all samples.
        seed: seed of the augmentation.
        workers: number of threads.

    Yields:
        The loader.
    """
    with ThreadPoolExecutor(workers, thread_name_prefix="batches") as pool:
        yield BatchLoader(task, samples, seed, pool, workers)


def batch_indices(index: IntArray, size: int, rng: np.random.Generator | None = None) -> list[IntArray]:
    """Cuts indices into batches of about the same size.

    Args:
        index: (n,) indices of samples.
        size: usual number of samples in a batch.
        rng: shuffles the indices; None: they stay in order.

    Returns:
        The indices of each batch; none has fewer than two if there are two.

    >>> [len(batch) for batch in batch_indices(np.arange(33), 16)]
    [11, 11, 11]
    """
    order = index if rng is None else rng.permutation(index)
    return np.array_split(order, max(1, -(-len(index) // size)))


class Trainer:
    """Network, optimiser and averaged weights of one training.

    Args:
        task: builds the network.
        config: optimiser, schedule and so on.
        device: device of the training.
        init_from: initial weights; None: random ones.

    Attributes:
        network: the torch module.
        reinitialised: names of the weights that ``init_from`` did not have.
    """

    def __init__(self, task: Task, config: TrainConfig, device: Device, init_from: Weights | None) -> None:
        import torch

        self._task, self._config, self._device = task, config, device
        torch.manual_seed(config.seed)
        self.network: Any = task.build()
        self.reinitialised = []
        if init_from is not None:
            self.reinitialised = load_weights(self.network, task.adapted(init_from), task.head)
        self.network = self.network.to(device.kind, memory_format=torch.channels_last)
        self._optimiser = _optimiser(self.network, config)
        self._averaged: dict[str, Any] | None = self._weights() if config.average else None
        self._steps = 0

    def train_epoch(
        self, loader: BatchLoader, index: IntArray, epoch: int, rate_scale: float, report: Callable[[float], None]
    ) -> tuple[float, float]:
        """Trains once on all samples.

        Args:
            loader: prepares the batches.
            index: the samples to train on.
            epoch: number of the epoch, from 0.
            rate_scale: factor of the learning rate in addition to that of the schedule.
            report: called with the finished share of the epoch.

        Returns:
            Mean loss and mean error in newtons, as they were during training.
        """
        import torch

        config = self._config
        # keyed by the epoch: random numbers do not depend on earlier epochs in this process
        torch.manual_seed(_epoch_seed(config.seed, epoch))
        batches = batch_indices(index, config.batch, np.random.default_rng((config.seed, 2, epoch)))
        self.network.train()
        total = torch.zeros(2, device=self._device.kind)
        for number, arrays in enumerate(loader.run(batches, epoch)):
            batch = self._to_device(arrays)
            rate = rate_scale * _learning_rate(config, epoch + number / len(batches), 1.0 / len(batches))
            for group in self._optimiser.param_groups:
                group["lr"] = rate
            bf16 = self._device.precision == "bf16"
            with torch.autocast(self._device.kind, dtype=torch.bfloat16, enabled=bf16):
                outputs = self.network(**{name: batch[name] for name in self._task.inputs})
            outputs = _to_fp32(outputs)
            loss = self._task.loss(outputs, batch)
            self._optimiser.zero_grad(set_to_none=True)
            loss.backward()  # pyright: ignore[reportUnknownMemberType]
            if config.clip_norm is not None:
                torch.nn.utils.clip_grad_norm_(self.network.parameters(), config.clip_norm)
            self._optimiser.step()
            self._steps += 1
            self._update_average()
            with torch.no_grad():
                error = self._task.error_n(outputs, batch).mean()
            total += len(batches[number]) * torch.stack([loss.detach(), error])
            report((number + 1) / len(batches))
        loss_mean, error_mean_n = (total / len(index)).tolist()
        return loss_mean, error_mean_n

    def validation_error_n(self, loader: BatchLoader, index: IntArray) -> float:
        """Returns the mean force error of `best_weights` in newtons, in fp32 and without augmentation.

        Args:
            loader: loads the batches.
            index: (n,) indices of the samples.
        """
        import torch

        trained = None
        if self._averaged is not None:
            trained = self._weights()
            self.network.load_state_dict(self._averaged)
        self.network.eval()
        total = torch.zeros((), device=self._device.kind)
        with torch.no_grad():
            for arrays in loader.run(batch_indices(index, 2 * self._config.batch), None):
                batch = self._to_device(arrays)
                outputs = self.network(**{name: batch[name] for name in self._task.inputs})
                total += self._task.error_n(_to_fp32(outputs), batch).sum()
        if trained is not None:
            self.network.load_state_dict(trained)
        return float(total) / len(index)

    def best_weights(self) -> dict[str, Any]:
        """Returns a copy of the weights after an epoch: the trained ones, or their moving average."""
        if self._averaged is None:
            return self._weights()
        return {name: value.clone() for name, value in self._averaged.items()}

    def state(self) -> dict[str, Any]:
        """Returns everything that the next epoch depends on, for a checkpoint."""
        state: dict[str, Any] = {
            "network": self.network.state_dict(),
            "optimiser": self._optimiser.state_dict(),
            "steps": self._steps,
        }
        return state if self._averaged is None else {**state, "averaged": self._averaged}

    def load_state(self, state: dict[str, Any]) -> None:
        """Inverts `state`."""
        self.network.load_state_dict(state["network"])
        self._optimiser.load_state_dict(state["optimiser"])
        self._steps = state["steps"]
        if self._averaged is not None:
            self._averaged = {name: value.to(self._device.kind) for name, value in state["averaged"].items()}

    def _weights(self) -> dict[str, Any]:
        return {name: value.detach().clone() for name, value in self.network.state_dict().items()}

    def _update_average(self) -> None:
        """Updates the moving average. Its decay is smaller in the first steps, so that the initial weights fade."""
        import torch

        if self._averaged is None:
            return
        share = 1.0 - min(self._config.average, (1 + self._steps) / (10 + self._steps))
        with torch.no_grad():
            for name, value in self.network.state_dict().items():
                if value.is_floating_point():
                    self._averaged[name].lerp_(value, share)
                else:
                    self._averaged[name].copy_(value)

    def _to_device(self, arrays: Batch) -> dict[str, Any]:
        import torch

        tensors = {name: torch.from_numpy(np.ascontiguousarray(array)) for name, array in arrays.items()}
        if self._device.kind == "cpu":
            return tensors
        return {name: value.pin_memory().to("cuda", non_blocking=True) for name, value in tensors.items()}


def _optimiser(network: Any, config: TrainConfig) -> Any:
    import torch

    if config.optimiser == "sgd":
        return torch.optim.SGD(
            network.parameters(), lr=config.rate, momentum=config.momentum, weight_decay=config.weight_decay
        )
    return torch.optim.AdamW(network.parameters(), lr=config.rate, weight_decay=config.weight_decay)


def _learning_rate(config: TrainConfig, epoch: float, step: float) -> float:
    """Returns the scheduled learning rate after ``epoch`` epochs, where a step is the share ``step`` of an epoch."""
    warmup = min(1.0, (epoch + step) / config.warmup_epochs) if config.warmup_epochs else 1.0
    cosine = 0.5 * (1.0 + math.cos(math.pi * min(1.0, epoch / config.epochs))) if config.schedule == "cosine" else 1.0
    return config.rate * warmup * cosine


def _epoch_seed(seed: int, epoch: int) -> int:
    return int(np.random.SeedSequence((seed, 3, epoch)).generate_state(1, np.uint64)[0] >> 1)


def _to_fp32(outputs: Any) -> Any:
    """Returns the outputs of a network, a tensor or several in a tuple, list or mapping, in fp32."""
    if isinstance(outputs, dict):
        return {name: _to_fp32(value) for name, value in outputs.items()}
    if isinstance(outputs, Sequence):
        return tuple(_to_fp32(value) for value in outputs)
    return outputs.float()
