"""Writes sessions as files, with the ground truth of each, in parallel; sessions that exist are kept."""

import json
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from .._system.executor import Executor, LocalExecutor
from .._system.locks import output_lock
from ..errors import InputError
from ._bench import SimulatedBench
from ._ground_truth import collect_truth, read_truth, settings_record, truth_path, write_truth
from ._imaging import view_names
from ._settings import AnySimulationSettings, SimulationSettings
from .world import require_long_enough


def require_same_settings(place: Path, found: Mapping[str, Any], wanted: Mapping[str, Any]) -> None:
    """Checks that the session at ``place`` was made with the settings ``wanted``.

    Args:
        place: path of the session, for the message.
        found: settings of the session in the file.
        wanted: expected settings.

    Raises:
        InputError: a setting differs.
    """
    for key, value in json.loads(json.dumps(wanted)).items():  # numbers of a tuple come back as a list
        if found.get(key) != value:
            difference = f"{key} = {found.get(key)}, not {value}" if not isinstance(value, dict) else f"another {key}"
            raise InputError(
                f"{place}: was simulated with {difference}; choose another folder with -o or delete this one"
            )


WriteSession = Callable[[SimulatedBench, Path, Callable[[], None]], None]
"""Writes a session to a path that does not exist yet, the whole session or none; calls the function after every frame.
Must be importable by another process."""


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
    """Writes one session with its ground truth; ``tick`` is called after every frame."""
    bench, target = SimulatedBench(settings, seed, number), _place(root, suffix, number)
    write_truth(collect_truth(bench), truth_path(target))
    write(bench, target, tick)


def _is_done(target: Path, settings: AnySimulationSettings, seed: int, number: int) -> bool:
    """Returns whether ``target`` contains session ``number`` of ``seed`` with these settings.

    Raises:
        InputError: it contains another session.
    """
    if not target.exists():
        return False
    require_same_settings(target, read_truth(target).settings, settings_record(settings, seed, number))
    return True


def simulate(
    folder: Path | str,
    write: WriteSession,
    settings: AnySimulationSettings | None = None,
    *,
    suffix: str = ".mcap",
    sessions: int = 8,
    seed: int = 0,
    executor: Executor | None = None,
    progress: Callable[[str, float], None] | None = None,
) -> list[Path]:
    """Simulates ``sessions`` sessions into ``folder``, each with its ground truth. Sessions that exist there are kept.

    Args:
        folder: folder of the sessions.
        write: writes one session.
        settings: settings of the bench; None: those of the preset ``bench-2021``.
        suffix: suffix of the paths, as in ``session_00.mcap``; empty for a session that is a folder.
        sessions: number of sessions.
        seed: seed of all random numbers.
        executor: runs the work; None: as many processes as there are cores.
        progress: called with a text and the finished share, 0 to 1.

    Returns:
        The paths of all sessions, old and new.

    Raises:
        InputError: a file holds a session of other settings, or a session is too short.
    """
    settings = settings or SimulationSettings()
    require_long_enough(settings.world)
    root = Path(folder)
    places = [_place(root, suffix, number) for number in range(sessions)]
    missing = [number for number, place in enumerate(places) if not _is_done(place, settings, seed, number)]
    frames = round(settings.world.seconds * settings.world.clock.fps) * len(view_names(settings))
    work = partial(_work, settings, seed, root, suffix, write)
    root.mkdir(parents=True, exist_ok=True)
    with output_lock(root):
        what = f"simulating {len(missing)} sessions"
        (executor or LocalExecutor()).run(
            work, missing, steps=frames, shared=root, progress=None if progress is None else partial(progress, what)
        )
    return places
