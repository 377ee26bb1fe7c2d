"""Batches prepared in the background, in the order in which they are wanted."""

import time
from collections import deque
from collections.abc import Generator, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from itertools import islice

import numpy as np

from ..types import IntArray
from ._samples import Samples
from ._task import Batch, Task

__all__ = ["Batches", "batches_of", "feeding"]

AHEAD = 3
"""So many batches a thread are prepared before they are asked for."""


class Batches:
    """Prepares batches of ``samples`` for ``task``; ``waited_s`` is how long its user stood still for them.

    A batch hangs on seed, epoch and its samples alone, so the number of threads changes nothing in it.
    """

    def __init__(self, task: Task, samples: Samples, seed: int, pool: ThreadPoolExecutor, workers: int) -> None:
        self._task, self._samples, self._seed = task, samples, seed
        self._pool, self._ahead = pool, AHEAD * workers
        self.waited_s = 0.0

    def run(self, parts: list[IntArray], epoch: int | None) -> Iterator[Batch]:
        """One batch for each of ``parts``, places of samples; ``epoch`` None: to measure, so nothing is altered."""
        rest = iter(parts)
        waiting: deque[Future[Batch]] = deque(self._begin(part, epoch) for part in islice(rest, self._ahead))
        try:
            while waiting:
                start = time.perf_counter()
                batch = waiting.popleft().result()
                self.waited_s += time.perf_counter() - start
                waiting.extend(self._begin(part, epoch) for part in islice(rest, 1))
                yield batch
        finally:
            for future in waiting:
                future.cancel()

    def _begin(self, part: IntArray, epoch: int | None) -> "Future[Batch]":
        return self._pool.submit(self._prepare, part, epoch)

    def _prepare(self, part: IntArray, epoch: int | None) -> Batch:
        if epoch is None:
            return self._task.batch(self._samples, part, None)
        draws = [np.random.default_rng((self._seed, 1, epoch, place)) for place in part.tolist()]
        return self._task.batch(self._samples, part, draws)


@contextmanager
def feeding(task: Task, samples: Samples, seed: int, workers: int) -> Generator[Batches]:
    """`Batches` with ``workers`` threads, which end with the block."""
    with ThreadPoolExecutor(workers, thread_name_prefix="batches") as pool:
        yield Batches(task, samples, seed, pool, workers)


def batches_of(places: IntArray, size: int, draw: np.random.Generator | None = None) -> list[IntArray]:
    """``places`` in parts of about ``size``, none smaller than two where there are two; shuffled with ``draw``.

    >>> [len(part) for part in batches_of(np.arange(33), 16)]
    [11, 11, 11]
    """
    order = places if draw is None else draw.permutation(places)
    return np.array_split(order, max(1, -(-len(places) // size)))
