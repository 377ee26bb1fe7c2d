"""What a thing covers of a canvas: its own few pixels instead of a whole picture."""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

__all__ = ["Part", "Patch", "Picture"]

Picture = npt.NDArray[np.float32]
Part = tuple[slice, slice]
"""Rows and columns of a canvas."""


@dataclass(frozen=True, slots=True, eq=False)
class Patch:
    """How much of each pixel of a canvas of ``shape`` a thing covers: ``values`` in ``part``, nothing elsewhere."""

    shape: tuple[int, int]
    part: Part
    values: Picture

    @classmethod
    def of(cls, shape: tuple[int, int], part: Part, values: Picture) -> "Patch":
        """``values`` in ``part``, without borders that have nothing."""
        ends: list[slice] = []
        for axis in (1, 0):
            some = np.flatnonzero(values.any(axis=axis))
            ends.append(slice(int(some[0]), int(some[-1]) + 1) if some.size else slice(0, 0))
        rows, columns = ends
        (top, left), patch = (side.start for side in part), values[rows, columns]
        if not patch.size:
            return cls(shape, (slice(0, 0), slice(0, 0)), np.zeros((0, 0), np.float32))
        found = slice(top + rows.start, top + rows.stop), slice(left + columns.start, left + columns.stop)
        return cls(shape, found, patch)

    def around(self, reach: float) -> Part:
        """The part and ``reach`` px more on every side, within the canvas."""
        more = math.ceil(reach)
        rows, columns = (
            slice(max(0, side.start - more), min(side.stop + more, size))
            for side, size in zip(self.part, self.shape, strict=True)
        )
        return rows, columns

    def within(self, part: Part) -> Picture:
        """The cover in ``part``, which holds all of it."""
        whole = np.zeros((part[0].stop - part[0].start, part[1].stop - part[1].start), np.float32)
        whole[self.seen_from(part)] = self.values
        return whole

    def seen_from(self, part: Part) -> Part:
        """Its own part, counted from the corner of ``part``, which holds all of it."""
        (top, left), (rows, columns) = (side.start for side in part), self.part
        return slice(rows.start - top, rows.stop - top), slice(columns.start - left, columns.stop - left)

    def times(self, share: float) -> "Patch":
        """Of something that lets light through."""
        return Patch(self.shape, self.part, self.values * np.float32(share))

    def joined(self, other: "Patch") -> "Patch":
        """The greater cover of both."""
        if not self.values.size or not other.values.size:
            return self if self.values.size else other
        rows, columns = (
            slice(min(a.start, b.start), max(a.stop, b.stop)) for a, b in zip(self.part, other.part, strict=True)
        )
        whole = rows, columns
        return Patch(self.shape, whole, np.maximum(self.within(whole), other.within(whole)))
