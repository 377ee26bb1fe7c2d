"""Which pictures of several cameras belong together."""

from collections import deque
from collections.abc import Sequence

import numpy as np

from ..types import Frame, Image, IntArray

__all__ = ["PAIR_S", "Pairing", "nearest_frames"]

PAIR_S = 0.02
"""Two pictures belong to one instant where their stamps differ by no more."""


def nearest_frames(stamps_ns: IntArray, others_ns: IntArray, within_s: float = PAIR_S) -> IntArray:
    """(n,) for each of ``stamps_ns`` (n,) the place of the nearest of ``others_ns`` (m,); -1 where none is near.

    Both sorted; of two that are equally near, the earlier.

    >>> nearest_frames(np.array([0, 66_000_000]), np.array([1_000_000, 140_000_000])).tolist()
    [0, -1]
    """
    if not len(others_ns):
        return np.full(len(stamps_ns), -1, np.int64)
    after = np.clip(np.searchsorted(others_ns, stamps_ns), 0, len(others_ns) - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.where(np.abs(others_ns[before] - stamps_ns) <= np.abs(others_ns[after] - stamps_ns), before, after)
    return np.where(np.abs(others_ns[nearest] - stamps_ns) <= within_s * 1e9, nearest, -1)


class Pairing:
    """Frames as they come -> for a frame of the first view, the pictures of all views at its instant."""

    def __init__(self, views: Sequence[str], within_s: float = PAIR_S) -> None:
        self._views, self._within_s = tuple(views), within_s
        self._others: dict[str, deque[Frame]] = {view: deque() for view in self._views[1:]}

    def add(self, frame: Frame) -> None:
        """A frame of a view beyond the first; others are passed over."""
        if frame.view in self._others:
            self._others[frame.view].append(frame)

    def forget_before(self, stamp_ns: int) -> None:
        """Drop what no frame at or after ``stamp_ns`` needs."""
        for frames in self._others.values():
            while len(frames) > 1 and frames[1].stamp_ns <= stamp_ns:
                frames.popleft()

    def settled_at(self, stamp_ns: int) -> bool:
        """Whether every other view has come as far as ``stamp_ns``: later frames pair no better."""
        return all(frames and frames[-1].stamp_ns >= stamp_ns for frames in self._others.values())

    def views_of(self, frame: Frame) -> dict[str, Image]:
        """``frame`` of the first view and what belongs to it; a view without such a picture is absent."""
        found = {self._views[0]: frame.image}
        for view, frames in self._others.items():
            stamps = np.array([other.stamp_ns for other in frames], np.int64)
            place = int(nearest_frames(np.array([frame.stamp_ns]), stamps, self._within_s)[0])
            if place >= 0:
                found[view] = frames[place].image
        return found
