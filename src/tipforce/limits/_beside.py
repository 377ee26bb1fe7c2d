"""The bounds of many sessions, from the truth that lies beside their recordings, and what they take for unknown."""

import math
import multiprocessing
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from ..simulation._cores import cores
from ..simulation._sidecar import read_truth
from ..types import FloatArray, IntArray
from ._noise import FORCES_N2, measured_on
from ._session import SessionBound
from ._unknowns import FORCE_STD_N, Unknown

__all__ = ["BoundBeside", "bounds_beside", "nuisances"]

_FEW = 4
"""Sessions that are done sooner than another process has started."""


@dataclass(frozen=True, slots=True, eq=False)
class BoundBeside:
    """The bounds of one session's m frames, or why there are none.

    ``std_n``: way -> (m, 3), of fx, fy and the magnitude, NaN where no shape was found. The ways: ``one_frame`` and
    ``all_frames`` (all until then) of who knows what forces the preset has, ``one_frame_broad`` and
    ``all_frames_broad`` of who does not. ``contact_angle_deg`` (m,). ``refused``: why there is no bound, else "".
    """

    session: str
    preset: str
    stamp_ns: IntArray
    std_n: Mapping[str, FloatArray]
    contact_angle_deg: FloatArray
    unknowns: tuple[Unknown, ...] = ()
    refused: str = ""


def bounds_beside(
    paths: Iterable[Path],
    sessions: Collection[str],
    *,
    workers: int | None = None,
    progress: Callable[[str, float], None] | None = None,
) -> list[BoundBeside]:
    """Of the truths at ``paths`` (see `read_truth`) the bounds of those of ``sessions``, in the order of ``paths``.

    In ``workers`` processes: as many as there are cores by default. About 0.6 s of one core for a minute's session.
    """
    work, todo = partial(_beside, sessions=frozenset(sessions)), list(paths)
    crew = min(len(todo) // _FEW, workers or cores())

    def collected(found: Iterable[BoundBeside | None]) -> list[BoundBeside]:
        kept: list[BoundBeside] = []
        for done, one in enumerate(found):
            if one is not None:
                kept.append(one)
            if progress is not None:
                progress("smallest possible errors", (done + 1) / len(todo))
        return kept

    if crew <= 1:
        return collected(map(work, todo))
    with ProcessPoolExecutor(crew, mp_context=multiprocessing.get_context("spawn")) as pool:
        return collected(pool.map(work, todo))


def _beside(path: Path, sessions: Collection[str]) -> BoundBeside | None:
    """None of a session that is not wanted."""
    truth = read_truth(path)
    if truth.session not in sessions:
        return None
    preset = measured_on(truth.settings) or str(truth.settings.get("preset"))
    try:
        bound = SessionBound.of(truth)
    except ValueError as error:
        return BoundBeside(truth.session, preset, truth.stamp_ns, {}, np.zeros(0), refused=str(error))
    learnt = FORCES_N2[preset]
    found = {
        "one_frame": bound.each((), learnt),
        "all_frames": bound.along((), learnt),
        "one_frame_broad": bound.each(),
        "all_frames_broad": bound.along(),
    }
    std = {way: force.fx_fy_magnitude_n for way, force in found.items()}
    return BoundBeside(truth.session, preset, truth.stamp_ns, std, bound.contact_angle_deg, bound.unknowns)


def nuisances(bounds: Sequence[BoundBeside]) -> list[str]:
    """One sentence for each preset: what its bound takes for unknown, and how well that is known beforehand."""
    sentences: list[str] = []
    for preset in dict.fromkeys(each.preset for each in bounds if not each.refused):
        sets = [each.unknowns for each in bounds if each.preset == preset and not each.refused]
        told = [_told(same) for same in zip(*sets, strict=True) if same[0].group != "force"]
        spread = ", ".join(f"{1e3 * math.sqrt(value):.2g}" for value in np.diag(FORCES_N2[preset]))
        sentences.append(
            f"Bound of {preset}: posterior Cramer-Rao bound of the centreline that fine sees, with its measured error; "
            f"unknown, each a Gaussian of the standard deviation in brackets, are {', '.join(told)} and the error of "
            f"seeing that lasts a session; of the force it is known beforehand how wide the preset's contact forces "
            f"spread ({spread} mN along x, y, z), or, broad, no more than {1e3 * FORCE_STD_N:.0f} mN along x and y."
        )
    return sentences


_WRITTEN = {"m": (1e3, " mm"), "rad": (math.degrees(1.0), " deg"), "1": (1.0, "")}


def _told(same: Sequence[Unknown]) -> str:
    """One unknown of all sessions of a preset: its name and width, from the least to the most where they differ."""
    factor, unit = _WRITTEN.get(same[0].unit, (1.0, f" {same[0].unit}"))
    ends = [f"{factor * pick(unknown.std for unknown in same):.2g}" for pick in (min, max)]
    return f"{same[0].name.replace(',', '')} ({' to '.join(dict.fromkeys(ends))}{unit})"
