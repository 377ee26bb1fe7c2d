"""Child processes and signals: when this process ends, its children end, and no file is left half-written."""

import ctypes
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from types import FrameType
from typing import Any, TypeVar

from .cores import CORES, cores

ENDING = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)  # Windows has no SIGHUP
"""Signals that end a program: Ctrl-C, the operating system, a terminal that is closed."""
_GRACE_S, _CHILD_GRACE_S = 0.8, 1.5
"""Time in which a worker may clean up before it is killed; and a program that this one started, which may have
workers."""
_AGAIN_S = 0.01
_PR_SET_PDEATHSIG = 1
_PARENT = "TIPFORCE_PARENT"
"""Environment variable: process number of the tipforce that started this one."""
_running: dict["subprocess.Popen[str]", bool] = {}
"""Programs that this one started and that have not ended -> whether they were asked to end."""
_T = TypeVar("_T")
_Item = TypeVar("_Item")
_Result = TypeVar("_Result")
Task = Callable[[_Item, Callable[[], None]], _Result]
"""Processes one item and calls the function after each of its steps. Task and items must be importable and
picklable."""


def ending_signals() -> tuple[signal.Signals, ...]:
    """Returns those of `ENDING` that this process handles: not SIGHUP where ``nohup`` made it ignored."""
    hang_up = getattr(signal, "SIGHUP", None)
    return tuple(each for each in ENDING if each != hang_up or signal.getsignal(each) != signal.SIG_IGN)


class Interrupted(BaseException):
    """Ctrl-C, SIGTERM or SIGHUP, in ``signal``. It is no `Exception`: only the end of the program catches it."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.signal = signal.Signals(number)


@contextmanager
def signals_end_the_program(*, worker: bool = False) -> Generator[None]:
    """Lets the first of `ENDING` raise `Interrupted` and the second end the process.

    After the first one, drives brake and files are cleaned up. The second one ends the process immediately. SIGHUP
    never does: a terminal that is closed may send it twice.

    A second signal does not end a ``worker``, because its parent and a terminal may both send one; a worker ends within
    `_GRACE_S` after the first one in any case.

    In any thread but the main one, where Python does not handle signals, nothing is changed. Where another tipforce
    started this one, this one ends with it, too; a terminal sends its signals to the other one only (`run_child`).

    Args:
        worker: whether this process is a worker of another one.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def first(number: int, frame: FrameType | None) -> None:
        if _called_by_compiled_code(frame):
            _send_again(number)
            return
        for each in before:
            signal.signal(each, signal.SIG_IGN if worker or each.name == "SIGHUP" else second)
        if worker:
            _end_later(number)
        _starts.ended = number
        for child in tuple(_running):  # threads may wait for them
            _ask_to_end(child)
        _starts.interrupt(number)

    def lost(unraisable: "sys.UnraisableHookArgs") -> None:
        if not isinstance(unraisable.exc_value, Interrupted):
            hook_before(unraisable)
            return
        for each in before:
            signal.signal(each, first)
        _send_again(unraisable.exc_value.signal)

    def second(number: int, frame: FrameType | None) -> None:
        del frame
        for child in (*multiprocessing.active_children(), *_running):
            child.kill()
        os._exit(128 + number)

    if parent := os.environ.pop(_PARENT, ""):
        _end_with(int(parent))
    # Python drops an error that is raised in a finalizer or a callback, such as those of its imports: it is raised
    # again
    hook_before, sys.unraisablehook = sys.unraisablehook, lost
    before = {each: signal.getsignal(each) for each in ending_signals()}
    for each in before:
        signal.signal(each, first)
    try:
        yield
    except Exception as error:
        if not _starts.ended:
            raise
        # a compiled module that is interrupted while it is imported raises an error of its own
        raise Interrupted(_starts.ended) from error
    finally:
        _starts.ended, sys.unraisablehook = 0, hook_before
        for each, handler in before.items():
            signal.signal(each, handler)


def _called_by_compiled_code(frame: FrameType | None) -> bool:
    """Returns whether ``frame`` is within a call by compiled code that crashes if the call raises.

    These are the import of a compiled module, and the making of a named tuple that a compiled function returns.
    """
    while frame is not None:
        name: str = frame.f_globals.get("__name__", "")
        if name.startswith("namedtuple_") or name == "numba.core.serialize":
            return True
        if frame.f_code.co_qualname.startswith("ExtensionFileLoader."):
            return True
        frame = frame.f_back
    return False


def _send_again(number: int) -> None:
    threading.Timer(_AGAIN_S, _send_to_main_thread, (number,)).start()


def _send_to_main_thread(number: int) -> None:
    if hasattr(signal, "pthread_kill"):
        signal.pthread_kill(threading.main_thread().ident or 0, number)  # ends a system call that waits
    else:  # Windows
        signal.raise_signal(number)


@contextmanager
def worker_pool(
    workers: int, initializer: Callable[..., None] | None = None, initargs: tuple[Any, ...] = ()
) -> Generator[ProcessPoolExecutor]:
    """Yields a pool of processes that ends with the block, and with this process even if that is killed.

    Each process has its share of the cores. After an `Exception` in the block the pool waits for the tasks that have
    begun; after anything else, such as Ctrl-C, the processes end within `_GRACE_S`, in which they remove unfinished
    files.

    Args:
        workers: number of processes.
        initializer: called in each process when it starts, with ``initargs``.
        initargs: its arguments.
    """
    pool = _Pool(
        workers,
        mp_context=multiprocessing.get_context("spawn"),
        initializer=_start_worker,
        initargs=(os.getpid(), max(1, cores() // workers), initializer, initargs),
    )
    try:
        yield pool
    except Exception:
        pool.shutdown(wait=True, cancel_futures=True)
        raise
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        _end_workers()
        raise
    pool.shutdown()


class _Pool(ProcessPoolExecutor):
    """A pool whose processes start without SIGINT, each when it is first needed, and end when they are asked to."""

    def submit(self, fn: Callable[..., _T], /, *args: Any, **kwargs: Any) -> Future[_T]:
        with _starts:
            return super().submit(_until_asked_to_end, fn, *args, **kwargs)


def _until_asked_to_end(work: Callable[..., _T], *args: Any, **kwargs: Any) -> _T:
    """Returns the result of the work. After SIGTERM this process ends as soon as the work has cleaned up.

    The loop of the pool would take the end of the work for its result, and begin the next item.
    """
    try:
        with signals_end_the_program(worker=True):
            return work(*args, **kwargs)
    except Interrupted as asked:
        os._exit(128 + asked.signal)


def _end_later(number: int) -> None:
    """Ends this process after `_GRACE_S`, even if the interrupt has no effect: its parent may be dead."""
    last = threading.Timer(_GRACE_S, os._exit, (128 + number,))
    last.daemon = True
    last.start()


class _Starts:
    """``with _starts:`` around the start of a child.

    The child never gets SIGINT, from its first instruction on: a terminal sends it to all processes, and the parent
    decides. An interrupt of this process waits until the block ends, so that no child is left half-started or
    unknown. ``ended``: number of the signal that interrupted this process, or 0.
    """

    def __init__(self) -> None:
        self.ended = 0
        self._open = False
        self._late: int | None = None
        self._masks = threading.local()

    def interrupt(self, number: int) -> None:
        """Raises `Interrupted`, now or at the end of the block."""
        if self._open:
            self._late = number
        else:
            raise Interrupted(number)

    def __enter__(self) -> None:
        if threading.current_thread() is threading.main_thread():  # where Python handles signals
            self._open = True
        if hasattr(signal, "pthread_sigmask"):  # not on Windows
            self._masks.before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])

    def __exit__(self, *_: object) -> None:
        if hasattr(signal, "pthread_sigmask"):
            signal.pthread_sigmask(signal.SIG_SETMASK, self._masks.before)
        if threading.current_thread() is not threading.main_thread():
            return
        self._open = False
        if self._late is not None:
            number, self._late = self._late, None
            raise Interrupted(number)


_starts = _Starts()


def run_child(
    command: Sequence[str], *, capture: bool = False, timeout_s: float | None = None, threads: int | None = None
) -> subprocess.CompletedProcess[str]:
    """Runs a command and waits for it; an error during the wait ends the command, too.

    Args:
        command: the program and its arguments.
        capture: whether its standard error is kept.
        timeout_s: time in s after which it is ended; None: no limit.
        threads: number of cores that it may use; None: all cores of this process.

    Returns:
        The exit status and, with ``capture``, the text of standard error.

    Raises:
        TimeoutExpired: of subprocess, after ``timeout_s``.
    """
    environment = {**os.environ, _PARENT: str(os.getpid())}
    if threads is not None:
        environment |= {CORES: str(threads), "OMP_NUM_THREADS": str(threads)}
    error_to = subprocess.PIPE if capture else None
    child: subprocess.Popen[str] | None = None
    try:
        with _starts:
            child = subprocess.Popen(command, stderr=error_to, text=True, env=environment)
            _running[child] = False
        if _starts.ended:  # the interrupt came before this child was registered
            _ask_to_end(child)
        _, error_text = child.communicate(timeout=timeout_s)
        return subprocess.CompletedProcess(command, child.returncode, stderr=error_text)
    except BaseException:
        if child is not None:
            _end_child(child)
        raise
    finally:
        if child is not None:
            del _running[child]


def _end_child(child: "subprocess.Popen[str]") -> None:
    """Asks a child to end, and kills it if it has not ended within `_CHILD_GRACE_S`."""
    with child:
        _ask_to_end(child)
        try:
            child.wait(_CHILD_GRACE_S)
        except subprocess.TimeoutExpired:
            child.kill()


def _ask_to_end(child: "subprocess.Popen[str]") -> None:
    """Sends SIGTERM once: a second one would end the child before it has cleaned up."""
    if not _running[child]:
        _running[child] = True
        child.terminate()


def _end_workers() -> None:
    """Asks all workers of this process to end, and kills those that have not ended within `_GRACE_S`."""
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
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # for Windows; elsewhere it is blocked
    _end_with(parent)
    limit_threads(threads)
    if initializer is not None:
        initializer(*initargs)


def limit_threads(threads: int) -> None:
    """Limits the threads of the libraries in this process to its share of the cores: more threads only wait."""
    import cv2
    import numba
    import scipy.linalg  # pyright: ignore[reportUnusedImport] # noqa: F401 (loads the libraries that are limited)
    import threadpoolctl

    numba.set_num_threads(min(threads, numba.get_num_threads()))  # starts its threads, and lets OpenMP have as many
    threadpoolctl.threadpool_limits(threads)
    cv2.setNumThreads(threads)


def _end_with(parent: int) -> None:
    """Makes the operating system send SIGTERM to this process when ``parent`` dies, where it can (Linux)."""
    if sys.platform != "linux":
        return
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != parent:  # it had died already
        os._exit(128 + signal.SIGTERM)
