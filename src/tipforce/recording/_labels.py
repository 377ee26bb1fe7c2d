"""The force at each picture's mid-exposure."""

from dataclasses import dataclass

from ..types import BoolArray, FloatArray, IntArray
from ._reader import RecordingReader

__all__ = ["Labels", "labels"]


@dataclass(frozen=True, slots=True, eq=False)
class Labels:
    """``stamp_ns`` (n,) of the frames; ``force_n`` (n, 3): tissue on tip, base frame, NaN where none; ``known`` (3,)."""

    stamp_ns: IntArray
    force_n: FloatArray
    known: BoolArray


def labels(reader: RecordingReader, *, camera: str = "camera", force: str = "force", max_gap_s: float = 0.05) -> Labels:
    """Force at every frame: clock offset applied, tare subtracted, rotated into the base frame, linear in time.

    NaN where the readings around a frame lie more than ``max_gap_s`` apart or on one side only.
    """
    raise NotImplementedError
