"""Conformal intervals: how far the answers of a method lay from the truth on sessions it had not seen.

Every session's residuals come from machines trained without that session (cross-conformal, Vovk 2015). The sessions are
what is exchangeable, not the frames of one: each of J sessions carries the mass 1 / (J + 1), spread over its frames,
and the session still to come carries the rest at infinity (conformal prediction for exchangeable groups, Lee, Barber
and Willett 2023). A 90 % quantile is finite from 9 sessions on. Below, the frames are pooled, which promises nothing
about a new session, and the basis says so.
"""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..types import BoolArray, FloatArray
from ._answers import Interval

__all__ = ["COVERAGE", "Basis", "basis_of", "half_width", "interval_from", "interval_of", "needed_sessions"]

COVERAGE = 0.9


@dataclass(frozen=True, slots=True)
class Basis:
    """What an interval rests on: ``by_session`` True where it holds for a new session; ``text`` says it to people."""

    by_session: bool
    text: str


def needed_sessions(coverage: float = COVERAGE) -> int:
    """Sessions from which on the quantile is finite.

    >>> needed_sessions()
    9
    """
    return math.ceil(coverage / (1 - coverage) - 1e-9)


def basis_of(sessions: int, held_out: bool, drawn: str = "random folds") -> Basis:
    """The basis with ``sessions`` sessions, whose residuals come from held-out sessions or from what was ``drawn``.

    >>> basis_of(4, True).text
    'frames of held-out sessions (4 sessions: too few for a guarantee on a new one)'
    """
    if not held_out:
        return Basis(False, f"{drawn} of {'one session' if sessions == 1 else f'{sessions} sessions'}")
    if sessions >= needed_sessions():
        return Basis(True, "whole sessions")
    return Basis(False, f"frames of held-out sessions ({sessions} sessions: too few for a guarantee on a new one)")


def half_width(residuals: FloatArray, session: npt.NDArray[np.str_], basis: Basis, coverage: float = COVERAGE) -> float:
    """Half the width of the interval that holds ``coverage``; ``residuals`` (n,) signed, of the ``session`` (n,).

    >>> frames = np.repeat([f"s{k}" for k in range(9)], 2)
    >>> float(half_width(np.arange(18.0), frames, basis_of(9, True)))
    17.0
    """
    size, order = np.abs(residuals), np.argsort(np.abs(residuals))
    if basis.by_session:
        _, place, counts = np.unique(session, return_inverse=True, return_counts=True)
        mass = 1.0 / ((len(counts) + 1) * counts[place])
    else:
        mass = np.full(len(size), 1.0 / (len(size) + 1))
    reached = np.flatnonzero(np.cumsum(mass[order]) >= coverage - 1e-9)
    return float(size[order[reached[0]]]) if len(reached) else math.inf


def interval_from(
    known: BoolArray,
    found: FloatArray,
    wrong: FloatArray,
    truth: FloatArray,
    session: npt.NDArray[np.str_],
    held_out: bool,
    drawn: str = "random folds",
) -> Interval:
    """The intervals of a method that knows the components ``known`` (3,), or the magnitude alone where that is none.

    ``found`` and ``truth`` (n, t) newtons, ``wrong`` their difference, of samples of the ``session`` (n,) that
    the method had not seen; ``held_out``: as whole sessions; else they were ``drawn``, which the basis says.
    """
    if known.any():
        off = np.linalg.norm(found, axis=1) - np.linalg.norm(truth, axis=1)
    else:
        off = np.maximum(found[:, 0], 0.0) - truth[:, 0]
    return interval_of(known, wrong, off, session, held_out, drawn)


def interval_of(
    known: BoolArray, wrong: FloatArray, off: FloatArray, session: npt.NDArray[np.str_], held_out: bool, drawn: str
) -> Interval:
    """From errors of the components, ``wrong`` (n, t), and of the magnitude, ``off`` (n,), in their unit."""
    sessions = len(set(session.tolist()))
    basis = basis_of(sessions, held_out, drawn)
    half, covariance = np.full(3, np.nan), np.full((3, 3), np.nan)
    if known.any():
        axes = np.flatnonzero(known)
        half[axes] = [half_width(wrong[:, t], session, basis) for t in range(len(axes))]
        covariance[np.ix_(axes, axes)] = wrong.T @ wrong / len(wrong)
    return Interval(
        half_n=half,
        magnitude_half_n=half_width(off, session, basis),
        covariance_n2=covariance,
        by_session=basis.by_session,
        basis=basis.text,
        sessions=sessions,
        samples=len(wrong),
    )
