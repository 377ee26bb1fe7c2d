"""Writing many sessions: in all cores at once, and none of them twice."""

import json
import multiprocessing
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from multiprocessing.sharedctypes import Synchronized
from pathlib import Path
from typing import Any

from ..errors import InputError
from ._cores import cores
from ._ranges import Settings

__all__ = ["refuse_other", "stated", "write_sessions"]

Work = Callable[[int, Callable[[], None]], None]
"""Writes the session of a number and calls the function after every frame. Must be importable by another process."""

_counter: "Synchronized[int] | None" = None
"""In a worker process: frames drawn so far, over all workers."""


def _share_counter(counter: "Synchronized[int]") -> None:
    global _counter
    _counter = counter


def _count() -> None:
    if _counter is not None:
        with _counter.get_lock():
            _counter.value += 1


def _call(work: Work, number: int) -> None:
    work(number, _count)


def stated(settings: Settings, seed: int, number: int) -> dict[str, Any]:
    """What a session was made from, as its truth keeps it: JSON values."""
    return {**settings.model_dump(mode="json"), "seed": seed, "number": number}


def refuse_other(place: Path, found: Mapping[str, Any], wanted: Mapping[str, Any]) -> None:
    """Raises InputError where the session at ``place`` was made from something else than ``wanted``."""
    for key, value in json.loads(json.dumps(wanted)).items():  # numbers of a tuple come back as a list
        if found.get(key) != value:
            told = f"{key} = {found.get(key)}, not {value}" if not isinstance(value, dict) else f"another {key}"
            raise InputError(f"{place}: was simulated with {told}; choose another folder with -o or delete this one")


def write_sessions(
    work: Work,
    numbers: Sequence[int],
    frames: int,
    *,
    workers: int | None = None,
    progress: Callable[[str, float], None] | None = None,
) -> None:
    """``work`` for each of ``numbers``, in ``workers`` processes: as many as there are cores by default.

    A single one is this process. ``frames``: of a session, for ``progress``.
    """
    total, done_frames = max(1, len(numbers) * frames), 0

    def report(count: int) -> None:
        if progress:
            progress(f"simulating {len(numbers)} sessions", min(1.0, count / total))

    def one_more() -> None:
        nonlocal done_frames
        done_frames += 1
        report(done_frames)

    crew = min(len(numbers), workers or cores())
    if crew <= 1:
        for number in numbers:
            work(number, one_more)
        return
    context = multiprocessing.get_context("spawn")
    counter = context.Value("q", 0)
    with ProcessPoolExecutor(crew, mp_context=context, initializer=_share_counter, initargs=(counter,)) as pool:
        pending: set[Future[None]] = {pool.submit(_call, work, number) for number in numbers}
        try:
            while pending:
                done, pending = wait(pending, timeout=0.2, return_when=FIRST_COMPLETED)
                for future in done:
                    future.result()
                report(counter.value)
        except BaseException:
            pool.shutdown(wait=True, cancel_futures=True)
            raise
