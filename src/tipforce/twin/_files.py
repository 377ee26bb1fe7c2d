"""Sessions as files: written in all cores at once, whole or not at all, and not twice."""

import json
import multiprocessing
import os
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from multiprocessing.sharedctypes import Synchronized
from pathlib import Path

from ..errors import InputError
from ._bench import TwinBench
from ._settings import TwinSettings
from ._sidecar import read_truth, truth_of, truth_path, write_truth

__all__ = ["WriteSession", "simulate"]

WriteSession = Callable[[TwinBench, Path, Callable[[], None]], None]
"""Writes a session's recording to a path that does not exist yet, whole or not at all; calls the function after every
frame. Must be importable by another process."""

_counter: "Synchronized[int] | None" = None
"""In a worker process: frames drawn so far, over all workers."""


def _share_counter(counter: "Synchronized[int]") -> None:
    global _counter
    _counter = counter


def _count() -> None:
    if _counter is not None:
        with _counter.get_lock():
            _counter.value += 1


def _work(settings: TwinSettings, seed: int, number: int, target: Path, write: WriteSession) -> None:
    bench = TwinBench(settings, seed, number)
    write_truth(truth_of(bench), truth_path(target))
    write(bench, target, _count)


def _is_done(target: Path, settings: TwinSettings, seed: int, number: int) -> bool:
    """Whether ``target`` holds this very session; InputError where it holds another."""
    if not target.exists():
        return False
    found = dict(read_truth(truth_path(target)).settings)
    wanted = json.loads(json.dumps({**settings.model_dump(mode="json"), "seed": seed, "number": number}))
    for key in wanted:
        if found.get(key) != wanted[key]:
            raise InputError(
                f"{target}: was simulated with another {key}; choose another folder with -o or delete this one"
            )
    return True


def simulate(
    folder: Path | str,
    write: WriteSession,
    settings: TwinSettings | None = None,
    *,
    sessions: int = 8,
    seed: int = 0,
    workers: int | None = None,
    suffix: str = ".mcap",
    progress: Callable[[str, float], None] | None = None,
) -> list[Path]:
    """``sessions`` sessions in ``folder``: ``session_00.mcap`` and ``session_00.truth.npz``, and so on.

    Those that stand there already are kept. Works in ``workers`` processes, as many as there are cores by default.
    Returns the paths, old and new. Raises InputError where a file holds a session of other settings.
    """
    settings = settings or TwinSettings()
    root = Path(folder)
    targets = [root / f"session_{number:02d}{suffix}" for number in range(sessions)]
    wanted = [number for number, target in enumerate(targets) if not _is_done(target, settings, seed, number)]
    root.mkdir(parents=True, exist_ok=True)
    world = settings.world
    total = max(1, len(wanted) * round(world.seconds * world.clock.fps))
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    context = multiprocessing.get_context("spawn")
    counter = context.Value("q", 0)
    crew = max(1, min(len(wanted), workers or cores))
    with ProcessPoolExecutor(crew, mp_context=context, initializer=_share_counter, initargs=(counter,)) as pool:
        pending: set[Future[None]] = {
            pool.submit(_work, settings, seed, number, targets[number], write) for number in wanted
        }
        try:
            while pending:
                done, pending = wait(pending, timeout=0.2, return_when=FIRST_COMPLETED)
                for future in done:
                    future.result()
                if progress:
                    progress(f"simulating {len(wanted)} sessions", min(1.0, counter.value / total))
        except BaseException:
            pool.shutdown(wait=True, cancel_futures=True)
            raise
    return targets
