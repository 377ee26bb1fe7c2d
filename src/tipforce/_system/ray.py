"""Runs work on the nodes of a Ray cluster. All nodes need this program, and the folders that the work uses."""

import importlib
import os
import secrets
import socket
import time
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from ..errors import InputError
from .cores import cores
from .extras import import_extra
from .processes import Task, limit_threads

ADDRESS = "RAY_ADDRESS"
"""Environment variable with the address of the cluster, such as ``10.0.0.1:6379``; without it Ray starts on this
machine."""
MAX_RETRIES = 5
"""Number of times that an item is done again after its process or node was lost; then the item itself is the cause."""
_POLL_S = 0.2
COUNT_PERIOD_S = 0.5
_MARK = ".node-check-"
_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


@dataclass(frozen=True)
class RayExecutor:
    """Each item is a task of Ray with one core. An item whose process or node was lost is done again elsewhere.

    ``address``: address of the cluster; None for one on this machine that ends with the work.
    """

    address: str | None = None

    @classmethod
    def from_environment(cls) -> "RayExecutor":
        """Returns an executor with the address in `ADDRESS`. Raises MissingExtraError where Ray is not installed."""
        _import_ray()
        return cls(os.environ.get(ADDRESS) or None)

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
        """See `Executor`.

        Raises:
            InputError: a node lacks the folders or has another version of this program, or an item was lost repeatedly.
        """
        if not items:
            return []
        with _connected(self.address) as ray, _mark(shared) as mark:
            counter = _counter_here(ray)
            seen = None if mark is None else str(mark.absolute())

            def send(numbers: Sequence[int], needs: Mapping[str, int]) -> list[Any]:
                work = ray.remote(_work).options(max_retries=MAX_RETRIES, **needs)
                setup = ray.put(_Setup(task, str(Path.cwd()), seen, _version(), needs["num_cpus"], counter))
                return [work.remote(setup, number, items[number]) for number in numbers]

            needs = _largest_node(ray) if alone else {"num_cpus": 1}
            refs = send(range(len(items)), needs)
            pending, share = list(refs), 0.0
            try:
                while pending:
                    left = _left_for(ray, needs) if alone else None
                    done, pending = ray.wait(pending, num_returns=len(pending), timeout=_POLL_S)
                    for ref in done:
                        _result(ray, ref)
                    if left and pending:
                        lost, needs = [refs.index(ref) for ref in pending], left
                        for ref in pending:
                            ray.cancel(ref, force=True)
                        pending = send(lost, needs)
                        for number, ref in zip(lost, pending, strict=True):
                            refs[number] = ref
                    share = max(share, 1.0 - len(pending) / len(items), _counted(ray, counter) / (len(items) * steps))
                    if progress:
                        progress(min(1.0, share))
                return [_result(ray, ref) for ref in refs]
            finally:
                for ref in pending:
                    ray.cancel(ref, force=True)
                ray.kill(counter)


class _Counter:
    """Counts the steps that the nodes have done; for an item that is done again, those of the last time."""

    def __init__(self) -> None:
        self._steps: dict[int, int] = {}

    def put(self, item: int, steps: int) -> None:
        """Stores the number of steps of an item so far."""
        self._steps[item] = steps

    def total(self) -> int:
        """Returns the number of steps of all items."""
        return sum(self._steps.values())


def _counter_here(ray: Any) -> Any:
    """Returns a counter on the node of this process, which lives as long as it is needed."""
    node = ray.get_runtime_context().get_node_id()
    here = importlib.import_module("ray.util.scheduling_strategies").NodeAffinitySchedulingStrategy(node, soft=True)
    return ray.remote(_Counter).options(num_cpus=0, scheduling_strategy=here).remote()


def _counted(ray: Any, counter: Any) -> int:
    """Returns the steps done so far; 0 where the counter is busy or lost: progress then counts whole items."""
    try:
        return ray.get(counter.total.remote(), timeout=_POLL_S)
    except ray.exceptions.RayError:
        return 0


def _nodes(ray: Any) -> list[dict[str, float]]:
    """Returns the resources of each node that is alive."""
    return [node["Resources"] for node in ray.nodes() if node["Alive"]]


def _largest_node(ray: Any) -> dict[str, int]:
    """Returns the resources of the largest node: a node with a GPU comes before one with more cores."""
    best = max(_nodes(ray), key=lambda has: (has.get("GPU", 0) > 0, has.get("CPU", 0)))
    needs = {"num_cpus": max(1, int(best.get("CPU", 1)))}
    return needs | {"num_gpus": 1} if best.get("GPU", 0) >= 1 else needs


def _left_for(ray: Any, needs: Mapping[str, int]) -> dict[str, int] | None:
    """Returns the resources of the largest node that is left, if all nodes with the resources ``needs`` were lost.

    Returns None while one of them is alive; also if there is no node at all, because Ray waits for one.
    """
    nodes, largest = _nodes(ray), _largest_node(ray)
    if any(_has(node, needs) for node in nodes) or not any(_has(node, largest) for node in nodes):
        return None
    return largest


def _has(node: Mapping[str, float], needs: Mapping[str, int]) -> bool:
    return node.get("CPU", 0) >= needs["num_cpus"] and node.get("GPU", 0) >= needs.get("num_gpus", 0)


@dataclass(frozen=True)
class _Setup:
    """Setup of each item: the task, its working folder, a file that all nodes must have, version, cores."""

    task: "Task[Any, Any]"
    folder: str
    mark: str | None
    version: str
    cores: int = 1
    counter: Any = None


def _work(setup: _Setup, number: int, item: Any) -> Any:
    """Processes one item on a node."""
    node = socket.gethostname()
    if setup.version != _version():
        raise InputError(f"node {node}: has tipforce {_version()}, the others have {setup.version}; install the same")
    for path in (setup.folder, setup.mark):
        if path is not None and not Path(path).exists():
            raise InputError(
                f"node {node}: there is no {path}; the working folder must be on a file system that all "
                "nodes have at the same path"
            )
    os.chdir(setup.folder)  # relative paths refer to this folder
    limit_threads(setup.cores)
    steps, sent_s = 0, 0.0

    def step() -> None:
        nonlocal steps, sent_s
        steps += 1
        if setup.counter is not None and time.monotonic() - sent_s >= COUNT_PERIOD_S:
            sent_s = time.monotonic()
            setup.counter.put.remote(number, steps)

    return setup.task(item, step)


def _result(ray: Any, ref: Any) -> Any:
    """Waits for the part of the work ``ref`` and returns its result; raises the error that its function raised.

    Raises:
        InputError: Ray lost the part with its workers too often.
    """
    try:
        return ray.get(ref)
    except ray.exceptions.RayTaskError as error:
        raise error.cause from None
    except ray.exceptions.RayError as error:
        raise InputError(
            f"Ray lost a part of the work {1 + MAX_RETRIES} times ({type(error).__name__}); finished parts are kept: "
            "the same command continues from them"
        ) from error


def _version() -> str:
    from .. import __version__

    return __version__


def _import_ray() -> Any:
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # no usage data leave this machine
    return import_extra("ray", "cluster")


@contextmanager
def _connected(address: str | None) -> Generator[Any]:
    """Yields Ray, connected. A connection that existed before is kept."""
    ray = _import_ray()
    if ray.is_initialized():
        yield ray
        return
    quiet = {"log_to_driver": False, "logging_level": "ERROR"}
    try:
        if address is None:
            ray.init(address="local", num_cpus=cores(), include_dashboard=False, **quiet)
        else:
            ray.init(address=address, **quiet)
    except (ConnectionError, RuntimeError, ValueError) as error:
        raise InputError(f"{ADDRESS}={address}: Ray cannot be reached there ({error})") from error
    try:
        yield ray
    finally:
        ray.shutdown()


@contextmanager
def _mark(shared: Path | None) -> Generator[Path | None]:
    """Yields a file in ``shared`` by which a node recognises the same folder, not another one of the same name."""
    if shared is None:
        yield None
        return
    for left in shared.glob(f"{_MARK}*"):  # left by a run that was killed
        left.unlink(missing_ok=True)
    mark = shared / f"{_MARK}{secrets.token_hex(4)}"
    mark.touch()
    try:
        yield mark
    finally:
        mark.unlink(missing_ok=True)
