"""Runs independent work in processes of this machine, or on the nodes of a Ray cluster."""

import multiprocessing
from collections.abc import Callable, Sequence
from concurrent.futures import Future, wait
from dataclasses import dataclass
from multiprocessing.sharedctypes import Synchronized
from pathlib import Path
from typing import Any, Literal, Protocol, TypeVar, runtime_checkable

from .cores import cores
from .processes import Task, worker_pool
from .ray import RayExecutor

ExecutorName = Literal["local", "ray"]
_Item = TypeVar("_Item")
_Result = TypeVar("_Result")
_POLL_S = 0.2
_counter: "Synchronized[int] | None" = None
"""In a worker process: number of steps done so far, over all workers."""


@runtime_checkable
class Executor(Protocol):
    """Processes many items of the same kind, none of which needs another one."""

    def run(
        self,
        task: "Task[_Item, _Result]",
        items: Sequence[_Item],
        *,
        steps: int = 1,
        alone: bool = False,
        shared: Path | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> list[_Result]:
        """Calls ``task`` for each of ``items``, in any order, in any process.

        Args:
            task: function that processes one item. An item is processed again if its process or machine is lost, so the
                files that ``task`` writes must appear whole or not at all.
            items: the items, one call for each.
            steps: number of times that ``task`` calls its function for an item.
            alone: an item takes all cores of a machine, and a GPU where there is one.
            shared: a folder that ``task`` reads or writes, which all machines must have.
            progress: called with the share that is done, 0 to 1.

        Returns:
            The results in the order of ``items``.

        Raises:
            Exception: the first error of ``task``; the other items are given up.
        """
        ...


@dataclass(frozen=True)
class LocalExecutor:
    """Runs ``workers`` processes of this machine, by default one for each core; a single worker is this process."""

    workers: int | None = None

    def run(
        self,
        task: "Task[_Item, _Result]",
        items: Sequence[_Item],
        *,
        steps: int = 1,
        alone: bool = False,
        shared: Path | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> list[_Result]:
        """See `Executor`."""
        del shared  # this machine has the folder
        total, count = max(1, len(items) * steps), 0

        def report(done: int) -> None:
            if progress:
                progress(min(1.0, done / total))

        def one_more() -> None:
            nonlocal count
            count += 1
            report(count)

        worker_count = 1 if alone else min(len(items), self.workers or cores())
        if worker_count <= 1:
            return [task(item, one_more) for item in items]
        counter = multiprocessing.get_context("spawn").Value("q", 0)
        with worker_pool(worker_count, _share_counter, (counter,)) as pool:
            futures = [pool.submit(_counted, task, item) for item in items]
            pending: set[Future[Any]] = set(futures)
            while pending:
                done, pending = wait(pending, timeout=_POLL_S, return_when="FIRST_COMPLETED")
                for future in done:
                    future.result()
                report(counter.value)
            return [future.result() for future in futures]


def executor_of(chosen: Executor | ExecutorName) -> Executor:
    """Returns the executor of that name, or ``chosen`` itself where it is one; Ray is connected when there is work.

    Raises:
        MissingExtraError: Ray is not installed.
    """
    if not isinstance(chosen, str):
        return chosen
    if chosen == "local":
        return LocalExecutor()
    return RayExecutor.from_environment()


def _share_counter(counter: "Synchronized[int]") -> None:
    global _counter
    _counter = counter


def _count() -> None:
    if _counter is not None:
        with _counter.get_lock():
            _counter.value += 1


def _counted(task: "Task[Any, Any]", item: Any) -> Any:
    return task(item, _count)
