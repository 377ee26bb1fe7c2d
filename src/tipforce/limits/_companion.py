"""Computes the bounds of recorded sessions from the ground truth in their companion files; summarises the priors."""

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from .._system.cores import cores
from .._system.processes import worker_pool
from ..simulation import read_truth
from ..types import FloatArray, IntArray
from ._bound import CramerRaoBound
from ._priors import BROAD_FORCE_STD_N, CONTACT_FORCE_PRIORS_N2, Parameter, noise_preset

SESSIONS_PER_PROCESS = 4
"""Number of sessions that take less time than the start of another process."""


@dataclass(frozen=True, slots=True, eq=False)
class CompanionBound:
    """The bounds of the m frames of one session, or the reason why there are none.

    Attributes:
        session: name of the session.
        preset: name of the preset.
        stamp_ns: (m,) stamps.
        std_n: kind -> (m, 3) standard deviations of fx, fy and the magnitude; NaN where no stable shape was found. The
            kinds are ``one_frame`` and ``all_frames`` (with all frames before) with the preset's forces as the prior,
            and ``one_frame_broad`` and ``all_frames_broad`` with a broad prior.
        contact_angle_deg: (m,) angle between the tip and the wall's normal.
        parameters: unknown parameters.
        rejection_reason: reason why there is no bound, or "".
    """

    session: str
    preset: str
    stamp_ns: IntArray
    std_n: Mapping[str, FloatArray]
    contact_angle_deg: FloatArray
    parameters: tuple[Parameter, ...] = ()
    rejection_reason: str = ""


def read_companion_bounds(
    paths: Iterable[Path],
    sessions: Collection[str],
    *,
    workers: int | None = None,
    progress: Callable[[str, float], None] | None = None,
) -> list[CompanionBound]:
    """Computes the bounds of recorded sessions from their companion files.

    Args:
        paths: paths of the ground truths, see `read_truth`.
        sessions: names of the requested sessions; others are left out.
        workers: number of processes; by default the number of cores. A session of one minute takes about 0.6 s.
        progress: called with a label and the share that is done.

    Returns:
        One entry per session, in the order of ``paths``.
    """
    work, todo = partial(_read_bound, sessions=frozenset(sessions)), list(paths)
    worker_count = min(len(todo) // SESSIONS_PER_PROCESS, workers or cores())

    def collected(results: Iterable[CompanionBound | None]) -> list[CompanionBound]:
        """Reports the progress, and leaves out the sessions that are not requested."""
        requested: list[CompanionBound] = []
        for done, bound in enumerate(results):
            if bound is not None:
                requested.append(bound)
            if progress is not None:
                progress("smallest possible errors", (done + 1) / len(todo))
        return requested

    if worker_count <= 1:
        return collected(map(work, todo))
    with worker_pool(worker_count) as pool:
        return collected(pool.map(work, todo))


def _read_bound(path: Path, sessions: Collection[str]) -> CompanionBound | None:
    """Returns the four bounds of the session of a companion file; None if its name is not in ``sessions``."""
    truth = read_truth(path)
    if truth.session not in sessions:
        return None
    preset = noise_preset(truth.settings) or str(truth.settings.get("preset"))
    try:
        bound = CramerRaoBound.of(truth)
    except ValueError as error:
        return CompanionBound(truth.session, preset, truth.stamp_ns, {}, np.zeros(0), rejection_reason=str(error))
    force_prior = CONTACT_FORCE_PRIORS_N2[preset]
    with threadpool_limits(1):  # matrices this small take ten times as long on two threads
        bounds = {
            "one_frame": bound.single_frame((), force_prior),
            "all_frames": bound.sequential((), force_prior),
            "one_frame_broad": bound.single_frame(),
            "all_frames_broad": bound.sequential(),
        }
    std_n = {kind: force.fx_fy_magnitude_n for kind, force in bounds.items()}
    return CompanionBound(truth.session, preset, truth.stamp_ns, std_n, bound.contact_angle_deg, bound.parameters)


def describe_nuisances(bounds: Sequence[CompanionBound]) -> list[str]:
    """Returns one sentence for each preset: its unknown parameters and their priors."""
    sentences: list[str] = []
    for preset in dict.fromkeys(bound.preset for bound in bounds if not bound.rejection_reason):
        sets = [bound.parameters for bound in bounds if bound.preset == preset and not bound.rejection_reason]
        described = [_describe(same) for same in zip(*sets, strict=True) if same[0].group != "force"]
        spread = ", ".join(f"{1e3 * math.sqrt(value):.2g}" for value in np.diag(CONTACT_FORCE_PRIORS_N2[preset]))
        sentences.append(
            f"Bound of {preset}: posterior Cramer-Rao bound of the centreline that the tracer detects, with its "
            f"measured error; unknown, each a Gaussian of the standard deviation in brackets, are "
            f"{', '.join(described)} and the detection error that is constant in a session; prior of the force: "
            f"as wide as the preset's contact forces "
            f"({spread} mN along x, y, z), or broad, {1e3 * BROAD_FORCE_STD_N:.0f} mN along x and y; it is the "
            "shape's bound: a method that also reads the indentation of the tissue can be below it."
        )
    return sentences


_DISPLAY_UNITS = {"m": (1e3, " mm"), "rad": (math.degrees(1.0), " deg"), "1": (1.0, "")}


def _describe(same: Sequence[Parameter]) -> str:
    """Returns name and standard deviation of one parameter of a preset; smallest to largest if the sessions differ."""
    factor, unit = _DISPLAY_UNITS.get(same[0].unit, (1.0, f" {same[0].unit}"))
    ends = [f"{factor * pick(each.std for each in same):.2g}" for pick in (min, max)]
    return f"{same[0].name.replace(',', '')} ({' to '.join(dict.fromkeys(ends))}{unit})"
