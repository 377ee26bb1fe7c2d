"""Events -> observations: each picture with the actuation at its mid-exposure."""

from collections import deque
from collections.abc import Iterable, Iterator

import numpy as np

from ..types import STAGE, Actuation, Event, Frame, Observation
from ._actuation import WAIT_S, ActuationSeries

__all__ = ["observations"]


def observations(events: Iterable[Event], view: str = "camera", *, wait_s: float = WAIT_S) -> Iterator[Observation]:
    """An observation for each frame of ``view``.

    Actuation is interpolated linearly where a later reading comes within ``wait_s`` (in stamps) of the frame, else the
    last one holds; names without any reading so far are absent. Frames wait for that reading, never longer than events
    ``wait_s`` later; a live loop passes ``wait_s=0``.
    """
    series = ActuationSeries()
    waiting: deque[Frame] = deque()
    wait_ns = round(wait_s * 1e9)

    def release(frame: Frame) -> Observation:
        values = series.at(np.array([frame.stamp_ns]), wait_s=wait_s)
        known = {name: float(value[0]) for name, value in values.items() if not np.isnan(value[0])}
        series.forget_before(frame.stamp_ns)
        return Observation(frame.stamp_ns, {view: frame.image}, known)

    for event in events:
        if isinstance(event, Actuation) and event.stream != STAGE:
            series.add(event)
        elif isinstance(event, Frame) and event.view == view:
            waiting.append(event)
        while waiting and (series.settled_at(waiting[0].stamp_ns) or event.stamp_ns - waiting[0].stamp_ns >= wait_ns):
            yield release(waiting.popleft())
    while waiting:
        yield release(waiting.popleft())
