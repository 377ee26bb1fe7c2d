"""Streams of different rate, merged in the order of their stamps while they are written."""

from collections.abc import Iterable, Iterator, Mapping

import numpy as np

from ..types import Actuation, Event, FloatArray, Frame, IntArray, Wrench

__all__ = ["Readings", "merged"]

Readings = tuple[IntArray, dict[str, FloatArray]]
"""(n,) stamps, and (n,) values by name."""

_NO_TORQUE = np.full(3, np.nan)
_BLOCK = 1 << 14
"""Rows handed out at a time: a log may run for hours after the last frame."""


def merged(
    frames: Iterable[Event],
    force: tuple[IntArray, FloatArray] | None,
    drives: Mapping[str, Readings],
    shift_ns: int,
) -> Iterator[Event]:
    """``frames`` (and what comes with them), force readings, ``drives`` by stream; stamps moved by ``shift_ns``."""
    wrenches = _Feed(force[0] if force else None)
    feeds = [(stream, _Feed(stamps), values) for stream, (stamps, values) in drives.items()]

    def until(stamp_ns: int | None) -> Iterator[Event]:
        for stream, feed, values in feeds:
            for row, stamp in feed.take(stamp_ns):
                here = {name: float(column[row]) for name, column in values.items()}
                yield Actuation(stamp + shift_ns, here, stream)
        for row, stamp in wrenches.take(stamp_ns):
            assert force is not None
            yield Wrench(stamp + shift_ns, force[1][row], _NO_TORQUE, "sensor")

    for event in frames:
        yield from until(event.stamp_ns)
        if shift_ns and isinstance(event, Frame):
            yield Frame(event.stamp_ns + shift_ns, event.image, event.view)
        elif shift_ns and isinstance(event, Actuation):
            yield Actuation(event.stamp_ns + shift_ns, event.values, event.stream)
        else:
            yield event
    yield from until(None)


class _Feed:
    """Hands out the rows of a stream up to a time."""

    def __init__(self, stamps_ns: IntArray | None) -> None:
        self._stamps = np.empty(0, np.int64) if stamps_ns is None else stamps_ns
        self._next = 0

    def take(self, stamp_ns: int | None) -> Iterator[tuple[int, int]]:
        """(row, stamp) of the rows not yet taken, up to and with ``stamp_ns``; all of them for None."""
        end = len(self._stamps) if stamp_ns is None else int(np.searchsorted(self._stamps, stamp_ns, side="right"))
        while self._next < end:
            start = self._next
            self._next = min(end, start + _BLOCK)
            yield from enumerate(self._stamps[start : self._next].tolist(), start=start)
