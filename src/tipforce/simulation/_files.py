"""Many sessions as files, with the truth beside each."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

from ._bench import SimulatedBench
from ._imaging import views_of
from ._sessions import refuse_other, stated, write_sessions
from ._settings import AnySimulationSettings, SimulationSettings
from ._sidecar import read_truth, truth_of, truth_path, write_truth
from .world import refuse_short

__all__ = ["WriteSession", "simulate"]

WriteSession = Callable[[SimulatedBench, Path, Callable[[], None]], None]
"""Writes a session to a path that does not exist yet, whole or not at all; calls the function after every frame. Must
be importable by another process."""


def _place(root: Path, suffix: str, number: int) -> Path:
    return root / f"session_{number:02d}{suffix}"


def _work(
    settings: AnySimulationSettings,
    seed: int,
    root: Path,
    suffix: str,
    write: WriteSession,
    number: int,
    tick: Callable[[], None],
) -> None:
    bench, target = SimulatedBench(settings, seed, number), _place(root, suffix, number)
    write_truth(truth_of(bench), truth_path(target))
    write(bench, target, tick)


def _is_done(target: Path, settings: AnySimulationSettings, seed: int, number: int) -> bool:
    """Whether ``target`` holds this very session; InputError where it holds another."""
    if not target.exists():
        return False
    refuse_other(target, read_truth(target).settings, stated(settings, seed, number))
    return True


def simulate(
    folder: Path | str,
    write: WriteSession,
    settings: AnySimulationSettings | None = None,
    *,
    suffix: str = ".mcap",
    sessions: int = 8,
    seed: int = 0,
    workers: int | None = None,
    progress: Callable[[str, float], None] | None = None,
) -> list[Path]:
    """``sessions`` sessions in ``folder``: what ``write`` makes of each, and ``session_00.truth.npz`` and so on beside.

    ``suffix``: of the paths that ``write`` gets, as in ``session_00.mcap``; empty for a session that is a folder. Those
    that stand there already are kept. Works in ``workers`` processes, as many as there are cores by default; a
    single one is this process. Returns the paths, old and new. Raises InputError where a file holds a session of other
    settings, or a session is too short.
    """
    settings = settings or SimulationSettings()
    refuse_short(settings.world)
    root = Path(folder)
    places = [_place(root, suffix, number) for number in range(sessions)]
    wanted = [number for number, place in enumerate(places) if not _is_done(place, settings, seed, number)]
    root.mkdir(parents=True, exist_ok=True)
    frames = round(settings.world.seconds * settings.world.clock.fps) * len(views_of(settings))
    work = partial(_work, settings, seed, root, suffix, write)
    write_sessions(work, wanted, frames, workers=workers, progress=progress)
    return places
