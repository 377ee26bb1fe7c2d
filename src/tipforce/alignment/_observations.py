"""Events -> observations: the images of one instant, with the actuation at their mid-exposure."""

from collections import deque
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from ..io import WAIT_S, ActuationSeries
from ..types import DEFAULT_VIEW, STAGE, Actuation, Event, Frame, Image, IntArray, Observation

PAIR_S = 0.02
"""Two images belong to one instant where their stamps differ by no more."""


def nearest_frames(stamps_ns: IntArray, others_ns: IntArray, within_s: float = PAIR_S) -> IntArray:
    """Finds the frame nearest in time; of two that are equally near, the earlier.

    Args:
        stamps_ns: (n,) stamps, sorted.
        others_ns: (m,) stamps of the frames, sorted.
        within_s: largest difference.

    Returns:
        (n,) indices of the frames; -1 where none is near.

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
    """Collects frames; for a frame of the first view it finds the images of all views at its instant.

    Args:
        views: names of the views.
        within_s: largest difference in time between the images of one observation.
    """

    def __init__(self, views: Sequence[str], within_s: float = PAIR_S) -> None:
        self._views, self._within_s = tuple(views), within_s
        self._others: dict[str, deque[Frame]] = {view: deque() for view in self._views[1:]}

    def add(self, frame: Frame) -> None:
        """Adds a frame of a view beyond the first; others are ignored."""
        if frame.view in self._others:
            self._others[frame.view].append(frame)

    def forget_before(self, stamp_ns: int) -> None:
        """Drops the frames that no frame at or after ``stamp_ns`` needs."""
        for frames in self._others.values():
            while len(frames) > 1 and frames[1].stamp_ns <= stamp_ns:
                frames.popleft()

    def final_at(self, stamp_ns: int) -> bool:
        """Returns whether every other view has come as far as ``stamp_ns``: later frames pair no better."""
        return all(frames and frames[-1].stamp_ns >= stamp_ns for frames in self._others.values())

    def views_of(self, frame: Frame) -> dict[str, Image]:
        """Returns ``frame`` of the first view and its partners; a view without such an image is absent."""
        found = {self._views[0]: frame.image}
        for view, frames in self._others.items():
            stamps = np.array([other.stamp_ns for other in frames], np.int64)
            place = int(nearest_frames(np.array([frame.stamp_ns]), stamps, self._within_s)[0])
            if place >= 0:
                found[view] = frames[place].image
        return found


class ObservationQueue:
    """Takes events as they arrive, and returns the observations that are complete.

    There is one observation for each frame of the first view. It contains the image of each further view that is
    nearest in time; where none is near, that view is absent. Actuation is interpolated linearly where a later reading,
    within ``WAIT_S`` of the frame in stamps, is there, else the last one holds; names without an earlier reading are
    absent.

    Args:
        views: names of the views.
        wait_s: longest time that a frame waits for a later reading; a live loop passes 0, and has the later reading
            where images arrive later than readings.
        pair_s: largest difference in time between the images of one observation, and longest time that a frame waits.
            All times are those of the stamps: the newest event sets the present time.
    """

    def __init__(self, views: Sequence[str], *, wait_s: float = WAIT_S, pair_s: float = PAIR_S) -> None:
        self._first, self._wait_s = views[0], wait_s
        self._wait_ns, self._pair_ns = round(wait_s * 1e9), round(pair_s * 1e9)
        self._series, self._pairing = ActuationSeries(), Pairing(views, pair_s)
        self._waiting: deque[Frame] = deque()

    def add(self, event: Event) -> list[Observation]:
        """Returns the observations that are complete with this event, in order of their frames."""
        if isinstance(event, Actuation) and event.stream != STAGE:
            self._series.add(event)
        elif isinstance(event, Frame):
            if event.view == self._first:
                self._waiting.append(event)
            else:
                self._pairing.add(event)
        found: list[Observation] = []
        while self._waiting and self._ready(self._waiting[0].stamp_ns, event.stamp_ns):
            found.append(self._release(self._waiting.popleft()))
        if isinstance(event, Frame):
            self._pairing.forget_before(self._waiting[0].stamp_ns if self._waiting else event.stamp_ns)
        return found

    def rest(self) -> list[Observation]:
        """Returns the observations of the frames that still wait, where no event comes any more."""
        found = [self._release(frame) for frame in self._waiting]
        self._waiting.clear()
        return found

    def _ready(self, stamp_ns: int, now_ns: int) -> bool:
        read = self._series.final_at(stamp_ns) or now_ns - stamp_ns >= self._wait_ns
        return read and (self._pairing.final_at(stamp_ns) or now_ns - stamp_ns > self._pair_ns)

    def _release(self, frame: Frame) -> Observation:
        values = self._series.at(np.array([frame.stamp_ns]), wait_s=max(self._wait_s, WAIT_S))
        known = {name: float(value[0]) for name, value in values.items() if not np.isnan(value[0])}
        self._series.forget_before(frame.stamp_ns)
        return Observation(frame.stamp_ns, self._pairing.views_of(frame), known)


def observations(
    events: Iterable[Event],
    view: str | Sequence[str] = DEFAULT_VIEW,
    *,
    wait_s: float = WAIT_S,
    pair_s: float = PAIR_S,
) -> Iterator[Observation]:
    """Yields an observation for each frame of a view, or of the first of several views; see `ObservationQueue`.

    Args:
        events: events in the order of their arrival.
        view: name of the view, or names of several.
        wait_s: longest time that a frame waits for a later reading.
        pair_s: largest difference in time between the images of one observation.

    Yields:
        The observations, in order of the frames.
    """
    queue = ObservationQueue((view,) if isinstance(view, str) else view, wait_s=wait_s, pair_s=pair_s)
    for event in events:
        yield from queue.add(event)
    yield from queue.rest()
