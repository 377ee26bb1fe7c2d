"""What the sensor shows without contact."""

from ..types import FloatArray, IntArray
from ._facts import Tare

__all__ = ["find_tare", "stated_tare"]


def stated_tare(stamps_ns: IntArray, force_n: FloatArray, start_s: float, end_s: float) -> Tare:
    """The mean of a stretch that a person calls free of contact."""
    raise NotImplementedError


def find_tare(stamps_ns: IntArray, force_n: FloatArray) -> Tare:
    """The mean of the quiet stretches; ``how="none"`` with the reason where there is none."""
    raise NotImplementedError
