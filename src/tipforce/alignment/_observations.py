"""Events -> observations: each picture with the actuation at its mid-exposure."""

from collections import deque
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from ..io import WAIT_S, ActuationSeries
from ..types import STAGE, Actuation, Event, Frame, Observation
from ._pairing import PAIR_S, Pairing

__all__ = ["observations"]


def observations(
    events: Iterable[Event],
    view: str | Sequence[str] = "camera",
    *,
    wait_s: float = WAIT_S,
    pair_s: float = PAIR_S,
) -> Iterator[Observation]:
    """An observation for each frame of ``view``, or of the first of several views.

    Of each further view the picture nearest in time, at most ``pair_s`` away, is in the same observation; where it was
    dropped, that view is absent. Actuation is interpolated linearly where a later reading comes within ``wait_s`` (in
    stamps) of the frame, else the last one holds; names without any reading so far are absent. Frames wait for that
    reading and for their partners, never longer than events ``wait_s`` and ``pair_s`` later; a live loop passes
    ``wait_s=0``.
    """
    views = (view,) if isinstance(view, str) else tuple(view)
    series, pairing = ActuationSeries(), Pairing(views, pair_s)
    waiting: deque[Frame] = deque()
    wait_ns, pair_ns = round(wait_s * 1e9), round(pair_s * 1e9)

    def release(frame: Frame) -> Observation:
        values = series.at(np.array([frame.stamp_ns]), wait_s=wait_s)
        known = {name: float(value[0]) for name, value in values.items() if not np.isnan(value[0])}
        series.forget_before(frame.stamp_ns)
        return Observation(frame.stamp_ns, pairing.views_of(frame), known)

    def ready(stamp_ns: int, now_ns: int) -> bool:
        read = series.settled_at(stamp_ns) or now_ns - stamp_ns >= wait_ns
        return read and (pairing.settled_at(stamp_ns) or now_ns - stamp_ns > pair_ns)

    for event in events:
        if isinstance(event, Actuation) and event.stream != STAGE:
            series.add(event)
        elif isinstance(event, Frame):
            if event.view == views[0]:
                waiting.append(event)
            else:
                pairing.add(event)
        while waiting and ready(waiting[0].stamp_ns, event.stamp_ns):
            yield release(waiting.popleft())
        if isinstance(event, Frame):
            pairing.forget_before(waiting[0].stamp_ns if waiting else event.stamp_ns)
    while waiting:
        yield release(waiting.popleft())
