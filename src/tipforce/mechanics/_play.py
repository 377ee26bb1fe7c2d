"""Play (backlash) between the knob and the curvature: it depends on the earlier inputs, not on their speed."""

import math

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from ..types import FloatArray


@njit(cache=True, nogil=True, error_model="numpy")
def _follow(inputs: FloatArray, half_width: float, output: float, outputs: FloatArray) -> float:
    """Fills ``outputs`` (n,) from ``inputs`` (n,), starting at ``output``; returns the last output."""
    for i in range(inputs.size):
        output = max(inputs[i] - half_width, min(inputs[i] + half_width, output))
        outputs[i] = output
    return output


class Play:
    """Play (backlash): the output stays still until the input has crossed the gap, then follows it.

    The output never leaves input +- width / 2 (Krasnosel'skii and Pokrovskii 1989).

    Args:
        width: the whole gap, in the input's unit.
        output: present output.

    Raises:
        ValueError: the width is negative.

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
        """Returns the output for the next input.

        Raises:
            ValueError: the input is not finite.
        """
        if not math.isfinite(value):
            raise ValueError(f"expected a finite number, got {value}")
        half = 0.5 * self.width
        self.output = max(value - half, min(value + half, self.output))
        return self.output

    def run(self, values: ArrayLike) -> FloatArray:
        """Returns (n,) outputs for (n,) inputs in their order, the same as n times `step`.

        Raises:
            ValueError: the inputs have another shape, or one is not finite.
        """
        inputs = np.ascontiguousarray(values, np.float64)
        if inputs.ndim != 1 or not np.isfinite(inputs).all():
            raise ValueError(f"expected a row of finite numbers, got shape {inputs.shape}")
        outputs = np.empty_like(inputs)
        self.output = float(_follow(inputs, 0.5 * self.width, float(self.output), outputs))
        return outputs
