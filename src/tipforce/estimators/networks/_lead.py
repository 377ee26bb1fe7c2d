"""What the frame before adds: tissue resists the faster it is pressed, which no single picture tells.

A picture shows how deep the tissue is dented, and the elastic force follows from that; the viscous part leads it, by
the loss factor over the angular frequency: 23 ms in tissue of 0.175 at 1.2 Hz. Its size follows from how the answer
itself changed since a moment ago.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ...types import FloatArray, IntArray
from ._arrays import Looked

__all__ = ["Lead", "Trail", "earlier", "lead_from", "learn_lead"]

NEAREST_S, FARTHEST_S = 0.03, 0.15
"""The change is taken over at least and at most so much time: less is noise, more is another phase of the beat."""

_PRIOR = 200.0
"""What was learnt before counts as so many samples; without anything before, no lead does."""
_PAIRS = 20_000
"""At most twice so many are looked at."""


@dataclass(frozen=True, eq=False)
class Lead:
    """Force (t,) + rate of its change (t,) @ ``seconds`` (t, t) is the answer.

    ``alone``: how many times as large the error is where there is no earlier frame.
    """

    seconds: FloatArray
    alone: float

    @property
    def used(self) -> bool:
        """Whether earlier frames matter at all."""
        return bool(self.seconds.any())


class Trail:
    """The answers of the last moments of one session."""

    def __init__(self) -> None:
        self._past: deque[tuple[int, FloatArray]] = deque()

    def rate(self, stamp_ns: int, force_n: FloatArray) -> FloatArray | None:
        """(t,) newtons a second up to ``force_n`` (t,), which is kept for later; None without a fit earlier frame."""
        past = self._past
        while past and not 0 <= stamp_ns - past[0][0] <= FARTHEST_S * 1e9:
            past.popleft()
        while len(past) > 1 and stamp_ns - past[1][0] >= NEAREST_S * 1e9:
            past.popleft()
        found = None
        if past and stamp_ns - past[0][0] >= NEAREST_S * 1e9:
            found = (force_n - past[0][1]) / (1e-9 * (stamp_ns - past[0][0]))
        past.append((stamp_ns, force_n))
        return found


def lead_from(looked: Looked, start: Lead | None) -> Lead:
    """From the samples that have another one shortly before, as `learn_lead`."""
    before = earlier(looked.stamp_ns, looked.samples.session)
    later = np.flatnonzero(before >= 0)
    later = later[:: max(1, len(later) // _PAIRS)]
    outputs = looked.samples.force_n.shape[1]
    if start is None or start.seconds.shape != (outputs, outputs):
        start = Lead(np.zeros((outputs, outputs)), 1.0)
    if not len(later):
        return start
    now, then = (looked.at(index, names=("force_n",))["force_n"].astype(np.float64) for index in (later, before[later]))
    elapsed_s = 1e-9 * (looked.stamp_ns[later] - looked.stamp_ns[before[later]])
    return learn_lead(now, (now - then) / elapsed_s[:, None], looked.samples.force_n[later].astype(np.float64), start)


def earlier(stamp_ns: IntArray, session: npt.NDArray[np.str_]) -> IntArray:
    """(n,): which sample `Trail` compares each with, if all of ``session`` (n,) are shown in time; -1 for none."""
    found = np.full(len(stamp_ns), -1, np.int64)
    order = np.lexsort((stamp_ns, session))
    for rows in np.split(order, np.flatnonzero(session[order][1:] != session[order][:-1]) + 1):
        stamps = stamp_ns[rows]
        place = np.searchsorted(stamps, stamps - int(NEAREST_S * 1e9), side="right") - 1
        near = (place >= 0) & (stamps - stamps[np.maximum(place, 0)] <= FARTHEST_S * 1e9)
        found[rows[near]] = rows[place[near]]
    return found


def learn_lead(answer_n: FloatArray, rate: FloatArray, truth_n: FloatArray, start: Lead) -> Lead:
    """By least squares, from answers (n, t) to single pictures, the rates of their change and their labels.

    Pulled towards ``start``, which counts as `_PRIOR` samples.
    """
    if not rate.any():
        return start
    lacking = truth_n - answer_n
    pull = _PRIOR * float(np.mean(rate * rate)) * np.eye(answer_n.shape[1])
    led = np.linalg.solve(rate.T @ rate + pull, rate.T @ lacking + pull @ start.seconds)
    seconds = led.astype(np.float64)
    left = lacking - rate @ seconds
    return Lead(seconds, max(1.0, float(np.sqrt(np.mean(lacking**2) / max(np.mean(left**2), 1e-12)))))
