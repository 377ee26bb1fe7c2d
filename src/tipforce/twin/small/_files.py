"""Sessions as files: what a logger and a camera leave behind, and the truth beside it."""

import json
import multiprocessing
import os
import shutil
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from dataclasses import dataclass
from multiprocessing.sharedctypes import Synchronized
from pathlib import Path

from ...errors import InputError
from ...types import Frame
from ._bench import SmallBench
from ._settings import SmallBenchSettings
from ._truth import read_truth, write_truth

__all__ = ["VideoMaker", "simulate", "write_session"]

VideoMaker = Callable[[Path, Iterable[Frame], float], None]
"""Writes frames as a video file of so many frames a second; a function that another process can import."""

_counter: "Synchronized[int] | None" = None
"""In a worker process: frames drawn so far, over all workers."""


def _share_counter(counter: "Synchronized[int]") -> None:
    global _counter
    _counter = counter


def _count() -> None:
    if _counter is not None:
        with _counter.get_lock():
            _counter.value += 1


def write_session(bench: SmallBench, folder: Path, write_video: VideoMaker, tick: Callable[[], None]) -> None:
    """``video.mp4``, ``force.csv``, ``bench.json`` and ``truth.npz`` in the new ``folder``; whole or not at all.

    ``tick`` is called after every frame.
    """
    part = folder.with_name(folder.name + ".part")
    shutil.rmtree(part, ignore_errors=True)
    part.mkdir(parents=True)

    def frames() -> Iterator[Frame]:
        for frame in bench.camera():
            yield frame
            tick()

    write_video(part / "video.mp4", frames(), bench.settings.fps)
    log = bench.force_log()
    rows = (
        f"{time:.4f},{x:.6g},{y:.6g},{z:.6g}\n"
        for time, (x, y, z) in zip(log.time_s.tolist(), (log.force_n + 0.0).tolist(), strict=True)
    )
    (part / "force.csv").write_text("time_s,fx_n,fy_n,fz_n\n" + "".join(rows), encoding="utf-8")
    (part / "bench.json").write_text(json.dumps(bench.public(), indent=2) + "\n", encoding="utf-8")
    write_truth(bench.truth(), part)
    part.rename(folder)


def _cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _work(settings: SmallBenchSettings, seed: int, number: int, folder: Path, write_video: VideoMaker) -> None:
    write_session(SmallBench(settings, seed, number), folder, write_video, _count)


def _is_done(folder: Path, settings: SmallBenchSettings, seed: int, number: int) -> bool:
    """Whether ``folder`` holds this very session; InputError where it holds another."""
    if not folder.exists():
        return False
    found = dict(read_truth(folder).settings)
    wanted = {**settings.model_dump(mode="json"), "seed": seed, "number": number}
    # numbers of a tuple come back as a list
    wanted = json.loads(json.dumps(wanted))
    for key in wanted:
        if found.get(key) != wanted[key]:
            raise InputError(
                f"{folder}: was simulated with {key} = {found.get(key)}, not {wanted[key]}; choose another folder with "
                "-o or delete this one"
            )
    return True


@dataclass
class _Report:
    what: str
    total: int
    progress: Callable[[str, float], None] | None
    frames: int = 0

    def one_more(self) -> None:
        self.reached(self.frames + 1)

    def reached(self, frames: int) -> None:
        self.frames = frames
        if self.progress:
            self.progress(self.what, frames / self.total)


def simulate(
    folder: Path | str,
    write_video: VideoMaker,
    settings: SmallBenchSettings | None = None,
    *,
    sessions: int = 8,
    seed: int = 0,
    workers: int | None = None,
    progress: Callable[[str, float], None] | None = None,
) -> list[Path]:
    """``sessions`` sessions under ``folder``, as `write_session` does; those that stand there already are kept.

    Works in ``workers`` processes, as many as there are cores by default; a single one is this process. Returns the
    folders, old and new. Raises InputError where a folder holds a session of other settings.
    """
    settings = settings or SmallBenchSettings()
    root = Path(folder)
    folders = [root / f"session_{number:02d}" for number in range(sessions)]
    wanted = [number for number, place in enumerate(folders) if not _is_done(place, settings, seed, number)]
    root.mkdir(parents=True, exist_ok=True)
    total = max(1, len(wanted) * round(settings.seconds * settings.fps))
    crew = min(len(wanted), workers or _cores())
    report = _Report(f"simulating {len(wanted)} sessions", total, progress)
    if crew <= 1:
        for number in wanted:
            write_session(SmallBench(settings, seed, number), folders[number], write_video, report.one_more)
        return folders
    context = multiprocessing.get_context("spawn")
    counter = context.Value("q", 0)
    with ProcessPoolExecutor(crew, mp_context=context, initializer=_share_counter, initargs=(counter,)) as pool:
        pending: set[Future[None]] = {
            pool.submit(_work, settings, seed, number, folders[number], write_video) for number in wanted
        }
        try:
            while pending:
                done, pending = wait(pending, timeout=0.2, return_when=FIRST_COMPLETED)
                for future in done:
                    future.result()
                report.reached(counter.value)
        except BaseException:
            pool.shutdown(wait=True, cancel_futures=True)
            raise
    return folders
