"""Sessions as files: what a logger and a camera leave behind, and the truth beside it."""

import json
import shutil
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path

from ...types import Frame
from .._sessions import refuse_other, stated, write_sessions
from ._bench import SmallBench
from ._settings import SmallBenchSettings
from ._truth import read_truth, write_truth

__all__ = ["VideoMaker", "simulate", "write_session"]

VideoMaker = Callable[[Path, Iterable[Frame], float], None]
"""Writes frames as a video file of so many frames a second; a function that another process can import."""


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


def _place(root: Path, number: int) -> Path:
    return root / f"session_{number:02d}"


def _work(
    settings: SmallBenchSettings,
    seed: int,
    root: Path,
    write_video: VideoMaker,
    number: int,
    tick: Callable[[], None],
) -> None:
    write_session(SmallBench(settings, seed, number), _place(root, number), write_video, tick)


def _is_done(folder: Path, settings: SmallBenchSettings, seed: int, number: int) -> bool:
    """Whether ``folder`` holds this very session; InputError where it holds another."""
    if not folder.exists():
        return False
    refuse_other(folder, read_truth(folder).settings, stated(settings, seed, number))
    return True


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
    wanted = [number for number in range(sessions) if not _is_done(_place(root, number), settings, seed, number)]
    root.mkdir(parents=True, exist_ok=True)
    frames = round(settings.seconds * settings.fps)
    write_sessions(
        partial(_work, settings, seed, root, write_video), wanted, frames, workers=workers, progress=progress
    )
    return [_place(root, number) for number in range(sessions)]
