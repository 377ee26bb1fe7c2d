"""Child processes and signals: whatever ends this process ends its children, and nothing is left half-written."""

import ctypes
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from types import FrameType
from typing import Any

from ._cores import cores

__all__ = ["Interrupted", "run_child", "signals_end_the_program", "worker_pool"]

_GRACE_S = 1.0
"""So long a child may clean up before it is killed."""
_PR_SET_PDEATHSIG = 1
_PARENT = "TIPFORCE_PARENT"
"""Environment variable: process number of the tipforce that started this one."""
_running: set["subprocess.Popen[str]"] = set()


class Interrupted(BaseException):
    """Ctrl-C or SIGTERM; ``signal``: which one. Not an `Exception`: only the end of the program catches it."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.signal = signal.Signals(number)


@contextmanager
def signals_end_the_program() -> Generator[None]:
    """The first SIGINT or SIGTERM raises `Interrupted`, so that files are cleaned up; the second ends at once.

    In any other thread than the main one, where Python does not handle signals, nothing is changed. Where another
    tipforce started this one, it also ends with that.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def first(number: int, frame: FrameType | None) -> None:
        del frame
        for each in (signal.SIGINT, signal.SIGTERM):
            signal.signal(each, second)
        for child in tuple(_running):
            child.terminate()
        raise Interrupted(number)

    def second(number: int, frame: FrameType | None) -> None:
        del frame
        for child in (*multiprocessing.active_children(), *_running):
            child.kill()
        os._exit(128 + number)

    if os.environ.get(_PARENT) == str(os.getppid()):
        _end_with(os.getppid())
    before = {each: signal.signal(each, first) for each in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for each, handler in before.items():
            signal.signal(each, handler)


@contextmanager
def worker_pool(
    workers: int, initializer: Callable[..., None] | None = None, initargs: tuple[Any, ...] = ()
) -> Generator[ProcessPoolExecutor]:
    """A pool of processes that ends with the block, and with this process even where that is killed.

    Args:
        workers: number of processes.
        initializer: called in each process when it starts, with ``initargs``.
        initargs: its arguments.

    Each process has its share of the cores. An `Exception` in the block waits for what the processes have begun;
    anything else, such as Ctrl-C, ends them within `_GRACE_S`, in which they remove what they were writing.
    """
    pool = ProcessPoolExecutor(
        workers,
        mp_context=multiprocessing.get_context("spawn"),
        initializer=_start_worker,
        initargs=(os.getpid(), max(1, cores() // workers), initializer, initargs),
    )
    try:
        with _held_back(signal.SIGINT):  # a worker that is still starting could not ignore it
            pool.submit(os.getpid)  # starts them all
        yield pool
    except Exception:
        pool.shutdown(wait=True, cancel_futures=True)
        raise
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        _end_workers()
        raise
    pool.shutdown()


@contextmanager
def _held_back(number: int) -> Generator[None]:
    """Holds a signal back from this thread in the block, and for good from the processes that it starts there."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [number])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def run_child(
    command: Sequence[str], *, capture: bool = False, timeout_s: float | None = None
) -> subprocess.CompletedProcess[str]:
    """Runs a command and waits for it; where the wait ends otherwise, the command ends, too.

    Args:
        command: the program and its arguments.
        capture: keep what it writes to standard error.
        timeout_s: after which it is ended.

    Raises:
        TimeoutExpired: of subprocess, after ``timeout_s``.
    """
    environment = {**os.environ, _PARENT: str(os.getpid())}
    error_to = subprocess.PIPE if capture else None
    with subprocess.Popen(command, stderr=error_to, text=True, env=environment) as child:
        _running.add(child)
        try:
            _, said = child.communicate(timeout=timeout_s)
        except BaseException:
            child.terminate()
            try:
                child.wait(2 * _GRACE_S)
            except subprocess.TimeoutExpired:
                child.kill()
            raise
        finally:
            _running.discard(child)
        return subprocess.CompletedProcess(command, child.returncode, stderr=said)


def _end_workers() -> None:
    """Asks all workers of this process to end, and kills those that have not within `_GRACE_S`."""
    children = multiprocessing.active_children()
    for child in children:
        child.terminate()
    deadline = time.monotonic() + _GRACE_S
    for child in children:
        child.join(max(0.0, deadline - time.monotonic()))
        if child.is_alive():
            child.kill()


def _start_worker(
    parent: int, threads: int, initializer: Callable[..., None] | None, initargs: tuple[Any, ...]
) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal sends it to all; the parent decides
    signal.signal(signal.SIGTERM, _exit)
    _end_with(parent)
    _limit_threads(threads)
    if initializer is not None:
        initializer(*initargs)


def _limit_threads(threads: int) -> None:
    """Gives the libraries of this process its share of the cores: more threads than cores only wait for each other."""
    import cv2
    import numba
    import scipy.linalg  # pyright: ignore[reportUnusedImport] # noqa: F401 (loads the libraries that are limited)
    import threadpoolctl

    threadpoolctl.threadpool_limits(threads)
    numba.set_num_threads(min(threads, numba.get_num_threads()))
    cv2.setNumThreads(threads)


def _exit(number: int, frame: FrameType | None) -> None:
    del frame
    sys.exit(128 + number)


def _end_with(parent: int) -> None:
    """Has SIGTERM sent to this process when ``parent`` dies, as far as the operating system offers it."""
    if sys.platform != "linux":
        return
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != parent:  # it died before
        sys.exit(128 + signal.SIGTERM)
