"""Splits interlaced video: a frame holds two fields, its even and its odd rows, half a frame period apart.

Each field becomes an image of its own with its own stamp (FFmpeg's filter ``bwdif`` interpolates the rows between).
The file states whether the fields of a frame were taken at two instants, often wrongly. The images show it, too: where
an object moves, rows of two instants form a comb.
"""

from collections.abc import Callable, Iterable, Iterator
from typing import Literal

import av
import av.error
import av.filter
import numpy as np

from ...types import FloatArray, Image

FieldOrder = Literal["tff", "bff", "one instant"]
"""The earlier field of a frame: "tff" the even rows, "bff" the odd rows, or neither."""
_FIELD_ORDERS: dict[int, FieldOrder] = {2: "tff", 3: "bff", 4: "bff", 5: "tff"}
"""FFmpeg's ``AVFieldOrder``; other values are a progressive or unknown order."""

MIN_MOVED_GREY = 12.0
"""Pixels that change by more grey levels between two frames show whether their rows form a comb."""
MIN_PIXELS, MIN_PAIRS = 1000, 8
"""Fewest such pixels, and fewest pairs of frames, for a decision."""
MIN_COMB_EXCESS = 0.15
"""In the worse of the two pairings, the comb of two frames must exceed that of one frame by this share."""
MIN_ONE_INSTANT_SHARE, MAX_TWO_INSTANTS_SHARE = 0.6, 0.3
"""Above the first share the fields of a frame show one instant, below the second two: see `FieldEvidence`."""


def stated_order(stream: av.VideoStream) -> FieldOrder:
    """Returns the order of the fields that a file states; "one instant" where it states none."""
    return _FIELD_ORDERS.get(stream.codec_context.field_order, "one instant")


class FieldEvidence:
    """Determines from the images whether the two fields of a frame show one instant or two.

    For two successive frames the even field of each is joined with the odd field of the other, in both pairings. If a
    frame is one instant, both pairings form a comb of equal strength. If it is two, one of the pairings joins two
    fields half a frame period apart, like those of one frame, and its comb is no stronger than theirs. ``share``:
    excess of the weaker comb over that of one frame, relative to the excess of the stronger one; 1 for one instant, 0
    for two. Noise and still structure are the same in all three and cancel.
    """

    def __init__(self) -> None:
        self._previous: FloatArray | None = None
        self._combed = np.zeros(3)  # summed combs of one frame, and of the two pairings of two frames: see `add`
        self._pixels = self._pairs = 0

    def add(self, grey: Image) -> None:
        """Adds the next frame, (h, w) uint8, as stored."""
        sample = grey[: grey.shape[0] // 2 * 2, ::4].astype(np.float64)  # whole pairs of rows, every fourth column
        previous, self._previous = self._previous, sample
        if previous is None or previous.shape != sample.shape:
            return
        even, odd = sample[::2], sample[1::2]
        previous_even, previous_odd = previous[::2], previous[1::2]
        moved = (np.abs(even - previous_even) > MIN_MOVED_GREY) | (np.abs(odd - previous_odd) > MIN_MOVED_GREY)
        moved = moved[1:-1]  # the outer rows have neighbours on one side only
        count = int(np.count_nonzero(moved))
        if not count:
            return
        pairings = ((even, odd), (even, previous_odd), (previous_even, odd))
        self._combed += [_combing(*fields)[moved].sum() for fields in pairings]
        self._pixels, self._pairs = self._pixels + count, self._pairs + 1

    @property
    def share(self) -> float | None:
        """Share from 0 (two instants) to 1 (one instant), see the class; None while too few pixels have moved."""
        one_frame, weaker, stronger = self._combed[0], min(self._combed[1:]), max(self._combed[1:])
        if self._pixels < MIN_PIXELS or self._pairs < MIN_PAIRS or stronger < (1.0 + MIN_COMB_EXCESS) * one_frame:
            return None
        return float((weaker - one_frame) / (stronger - one_frame))

    @property
    def two_instants(self) -> bool | None:
        """Whether a frame holds two instants; None while it is not yet clear."""
        share = self.share
        if share is None or MAX_TWO_INSTANTS_SHARE <= share <= MIN_ONE_INSTANT_SHARE:
            return None
        return share < MAX_TWO_INSTANTS_SHARE

    @property
    def earlier_field(self) -> Literal["tff", "bff"]:
        """The earlier field where there are two instants: "tff" the even rows, "bff" the odd rows.

        A frame's earlier field and the later field of the frame before it are half a period apart: their comb is weak.
        """
        return "tff" if self._combed[1] < self._combed[2] else "bff"


def _combing(even: FloatArray, odd: FloatArray) -> FloatArray:
    """Returns (n - 2, w): squared difference of each row from the mean of its neighbours in the other field, summed."""
    of_odd = odd[1:-1] - 0.5 * (even[1:-1] + even[2:])
    of_even = even[1:-1] - 0.5 * (odd[:-2] + odd[1:-1])
    return of_odd**2 + of_even**2


def split_fields(
    frames: Iterable[tuple[int, av.VideoFrame]], stream: av.VideoStream, order: Callable[[], FieldOrder]
) -> Iterator[tuple[int, av.VideoFrame]]:
    """Yields stamp and image of each field of the frames that are marked as interlaced; other frames as they are.

    The stamp of the second field is half a frame period later than that of its frame: half the shorter of the intervals
    to the frames before and after it, so that no field is in the middle of a gap.

    Args:
        frames: stamp in ns and decoded frame, in order.
        stream: the stream of these frames.
        order: called once, at the first frame that is marked; at "one instant" all frames are yielded as they are.
    """
    graph: av.filter.Graph | None = None
    field_order: FieldOrder | None = None
    stamps: list[int] = []
    for stamp_ns, decoded in frames:
        if field_order is None and decoded.interlaced_frame:
            field_order = order()
            graph = None if field_order == "one instant" else _deinterlacer(stream, field_order)
        if graph is None:
            yield stamp_ns, decoded
            continue
        decoded.pts = len(stamps)  # the filter numbers the fields 2 k and 2 k + 1
        stamps.append(stamp_ns)
        graph.push(decoded)
        yield from _pulled(graph, stamps)
    if graph is not None:
        graph.push(None)
        yield from _pulled(graph, stamps)


def _deinterlacer(stream: av.VideoStream, order: FieldOrder) -> av.filter.Graph:
    """Returns FFmpeg's filter that makes two images of each frame that is marked as interlaced."""
    graph = av.filter.Graph()
    source = graph.add_buffer(template=stream)
    fields = graph.add("bwdif", f"mode=send_field:parity={order}:deint=interlaced")
    source.link_to(fields)
    fields.link_to(graph.add("buffersink"))
    graph.configure()
    return graph


def _pulled(graph: av.filter.Graph, stamps: list[int]) -> Iterator[tuple[int, av.VideoFrame]]:
    """Yields stamp in ns and image of the fields that the filter has finished; ``stamps`` are those of all frames."""
    while True:
        try:
            field = graph.pull()
        except (av.error.BlockingIOError, av.error.EOFError):
            return
        assert isinstance(field, av.VideoFrame)
        assert field.pts is not None
        number, second = divmod(field.pts, 2)
        intervals = np.diff(stamps[max(0, number - 1) : number + 2])  # before and after the frame
        if not second:
            yield stamps[number], field
        elif len(intervals):
            yield stamps[number] + int(intervals.min()) // 2, field
