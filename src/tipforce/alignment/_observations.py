"""Events -> observations: the images of one instant, with the actuation at their mid-exposure."""

from bisect import insort
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
    """Collects the frames of several views; for a frame it finds the images of all views at its instant.

    Args:
        views: names of the views.
        within_s: largest difference in time between the images of one observation.
        apart: whether an image of a further view is an instant of its own if no image of the first view is near.
    """

    def __init__(self, views: Sequence[str], within_s: float = PAIR_S, *, apart: bool = False) -> None:
        self._first, self._within_s, self._apart = views[0], within_s, apart
        self._frames: dict[str, deque[Frame]] = {view: deque() for view in views}

    def add(self, frame: Frame) -> bool:
        """Adds a frame; returns whether it may set the time of an observation. A frame of other views is ignored."""
        if frame.view not in self._frames:
            return False
        self._frames[frame.view].append(frame)
        return self._apart or frame.view == self._first

    def forget_before(self, stamp_ns: int) -> None:
        """Drops the frames that no frame at or after ``stamp_ns`` needs."""
        for frames in self._frames.values():
            while len(frames) > 1 and frames[1].stamp_ns <= stamp_ns:
                frames.popleft()

    def final_at(self, frame: Frame) -> bool:
        """Returns whether every other view has come as far as ``frame``: later frames pair no better."""
        others = (frames for view, frames in self._frames.items() if view != frame.view)
        return all(frames and frames[-1].stamp_ns >= frame.stamp_ns for frames in others)

    def views_of(self, frame: Frame) -> dict[str, Image]:
        """Returns the images at the instant of ``frame``, that of the first view first.

        The nearest image of each other view counts, if it is at most ``within_s`` apart; a view without one is absent.
        For a frame of a further view the result is its own image, and nothing where it belongs to the instant of a
        frame of the first view.
        """
        if frame.view != self._first:
            return {} if self._near(self._first, frame) else {frame.view: frame.image}
        images = {self._first: frame.image}
        for view in self._frames:
            if view != self._first and (partner := self._near(view, frame)):
                images[view] = partner.image
        return images

    def _near(self, view: str, frame: Frame) -> Frame | None:
        frames = self._frames[view]
        stamps = np.array([each.stamp_ns for each in frames], np.int64)
        index = int(nearest_frames(np.array([frame.stamp_ns]), stamps, self._within_s)[0])
        return frames[index] if index >= 0 else None


class ObservationQueue:
    """Takes events as they arrive, and returns the observations that are complete.

    There is one observation for each frame of the first view. It contains the image of each further view that is
    nearest in time; where none is near, that view is absent. With ``apart`` a frame of a further view that no frame of
    the first view is near is an observation of its own, as where the views are exposed in turn or one is lost.
    Actuation is interpolated linearly where a later reading, within ``WAIT_S`` of the frame in stamps, is there, else
    the last one holds; names without an earlier reading are absent.

    Args:
        views: names of the views.
        wait_s: longest time that a frame waits for a later reading; a live loop passes 0, and has the later reading
            where images arrive later than readings.
        pair_s: largest difference in time between the images of one observation, and longest time that a frame waits.
            All times are those of the stamps: the newest event sets the present time.
        apart: see above.
    """

    def __init__(
        self, views: Sequence[str], *, wait_s: float = WAIT_S, pair_s: float = PAIR_S, apart: bool = False
    ) -> None:
        self._wait_s = wait_s
        self._wait_ns, self._pair_ns = round(wait_s * 1e9), round(pair_s * 1e9)
        self._series, self._pairing = ActuationSeries(), Pairing(views, pair_s, apart=apart)
        self._waiting: list[Frame] = []

    def add(self, event: Event) -> list[Observation]:
        """Returns the observations that are complete with this event, in order of their frames."""
        if isinstance(event, Actuation) and event.stream != STAGE:
            self._series.add(event)
        elif isinstance(event, Frame) and self._pairing.add(event):
            insort(self._waiting, event, key=lambda frame: frame.stamp_ns)
        complete: list[Observation] = []
        while self._waiting and self._ready(self._waiting[0], event.stamp_ns):
            complete += self._release(self._waiting.pop(0))
        if isinstance(event, Frame):
            self._pairing.forget_before((self._waiting[0] if self._waiting else event).stamp_ns - self._pair_ns)
        return complete

    def rest(self) -> list[Observation]:
        """Returns the observations of the frames that still wait, where no event comes any more."""
        complete = [observation for frame in self._waiting for observation in self._release(frame)]
        self._waiting.clear()
        return complete

    def _ready(self, frame: Frame, now_ns: int) -> bool:
        age_ns = now_ns - frame.stamp_ns
        read = self._series.final_at(frame.stamp_ns) or age_ns >= self._wait_ns
        return read and (self._pairing.final_at(frame) or age_ns > self._pair_ns)

    def _release(self, frame: Frame) -> list[Observation]:
        """Returns the observation of ``frame``; none where it belongs to that of a frame of the first view."""
        images = self._pairing.views_of(frame)
        if not images:
            return []
        # a later reading that is there already is used even if no frame waits for one
        values = self._series.at(np.array([frame.stamp_ns]), wait_s=max(self._wait_s, WAIT_S))
        readings = {name: float(value[0]) for name, value in values.items() if not np.isnan(value[0])}
        self._series.forget_before(frame.stamp_ns)
        return [Observation(frame.stamp_ns, images, readings)]


def observations(
    events: Iterable[Event],
    view: str | Sequence[str] = DEFAULT_VIEW,
    *,
    wait_s: float = WAIT_S,
    pair_s: float = PAIR_S,
    apart: bool = False,
) -> Iterator[Observation]:
    """Yields an observation for each frame of a view, or of the first of several views; see `ObservationQueue`.

    Args:
        events: events in the order of their arrival.
        view: name of the view, or names of several.
        wait_s: longest time that a frame waits for a later reading.
        pair_s: largest difference in time between the images of one observation.
        apart: whether a frame of a further view may be an observation of its own.

    Yields:
        The observations, in order of the frames.
    """
    names = (view,) if isinstance(view, str) else view
    queue = ObservationQueue(names, wait_s=wait_s, pair_s=pair_s, apart=apart)
    for event in events:
        yield from queue.add(event)
    yield from queue.rest()
