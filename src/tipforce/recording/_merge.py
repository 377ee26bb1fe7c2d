"""Streams of different rate, merged in the order of their stamps while they are written."""

from collections.abc import Iterable, Iterator

import numpy as np

from ..types import Actuation, Event, FloatArray, Frame, IntArray, Wrench

__all__ = ["merged", "overlap_ns"]

_NO_TORQUE = np.full(3, np.nan)


def merged(
    frames: Iterable[Event],
    force: tuple[IntArray, FloatArray] | None,
    drives: tuple[IntArray, dict[str, FloatArray]] | None,
    shift_ns: int,
) -> Iterator[Event]:
    """``frames`` (and what comes with them), force readings and drive readings; every stamp moved by ``shift_ns``."""
    wrenches = _Feed(force[0] if force else None)
    knobs = _Feed(drives[0] if drives else None)

    def until(stamp_ns: int | None) -> Iterator[Event]:
        for row, stamp in knobs.take(stamp_ns):
            assert drives is not None
            yield Actuation(stamp + shift_ns, {name: float(values[row]) for name, values in drives[1].items()})
        for row, stamp in wrenches.take(stamp_ns):
            assert force is not None
            yield Wrench(stamp + shift_ns, force[1][row], _NO_TORQUE, "sensor")

    for event in frames:
        yield from until(event.stamp_ns)
        if shift_ns and isinstance(event, Frame):
            yield Frame(event.stamp_ns + shift_ns, event.image, event.view)
        elif shift_ns and isinstance(event, Actuation):
            yield Actuation(event.stamp_ns + shift_ns, event.values)
        else:
            yield event
    yield from until(None)


class _Feed:
    """Hands out the rows of a stream up to a time."""

    def __init__(self, stamps_ns: IntArray | None) -> None:
        self._stamps = np.empty(0, np.int64) if stamps_ns is None else stamps_ns
        self._next = 0

    def take(self, stamp_ns: int | None) -> list[tuple[int, int]]:
        """(row, stamp) of the rows not yet taken, up to and with ``stamp_ns``; all of them for None."""
        start = self._next
        end = len(self._stamps) if stamp_ns is None else int(np.searchsorted(self._stamps, stamp_ns, side="right"))
        self._next = max(end, start)
        return list(enumerate(self._stamps[start : self._next].tolist(), start=start))


def overlap_ns(frames: tuple[int, int], force: IntArray) -> int:
    """Nanoseconds in which both run; negative: the gap between them."""
    return min(frames[1], int(force[-1])) - max(frames[0], int(force[0]))
