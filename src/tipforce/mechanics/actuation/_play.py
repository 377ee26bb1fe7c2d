"""Backlash, and anything else that remembers."""

import math
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from ...types import FloatArray
from ._plays import march

__all__ = ["Hysteresis", "Play", "row_of"]


class Hysteresis(Protocol):
    """Turns an input into an output that depends on the inputs before it, not on their speed."""

    def step(self, value: float) -> float:
        """The next input -> its output."""
        ...

    def run(self, values: ArrayLike) -> FloatArray:
        """(n,) inputs in their order -> (n,) outputs; the same as n times `step`."""
        ...


class Play:
    """Play (backlash) of ``width``: the output stands still until the input has crossed the gap, then follows it.

    ``width`` is the whole gap, in the input's unit; the output never leaves input +- width / 2 (Krasnosel'skii and
    Pokrovskii 1989). ``output`` is where it stands now, at first 0. Raises ValueError for a negative width.

    >>> play = Play(1.0)
    >>> [play.step(knob_deg) for knob_deg in (0.4, 2.0, 1.2, 0.0)]
    [0.0, 1.5, 1.5, 0.5]
    """

    def __init__(self, width: float, output: float = 0.0) -> None:
        if not width >= 0:
            raise ValueError(f"width: expected 0 or more, got {width}")
        self.width = width
        self.output = output

    def step(self, value: float) -> float:
        """The next input -> its output."""
        if not math.isfinite(value):
            raise ValueError(f"expected a finite number, got {value}")
        half = 0.5 * self.width
        self.output = max(value - half, min(value + half, self.output))
        return self.output

    def run(self, values: ArrayLike) -> FloatArray:
        """(n,) inputs in their order -> (n,) outputs; the same as n times `step`."""
        inputs = row_of(values)
        outputs, memory = np.empty_like(inputs), np.array([self.output], np.float64)
        march(inputs, np.array([0.5 * self.width]), np.ones(1), 0.0, memory, outputs)
        self.output = float(memory[0])
        return outputs


def row_of(values: ArrayLike) -> FloatArray:
    """``values`` as a contiguous row of finite numbers; else ValueError."""
    row = np.ascontiguousarray(values, np.float64)
    if row.ndim != 1 or not np.isfinite(row).all():
        raise ValueError(f"expected a row of finite numbers, got shape {row.shape}")
    return row
