"""Backlash and hysteresis: plays, and sums of plays. All of them depend on the inputs before, not on their speed."""

import math
from typing import Protocol

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from ...types import FloatArray, frozen


@njit(cache=True, nogil=True, error_model="numpy")
def _integrate(
    inputs: FloatArray,
    half_widths: FloatArray,
    weights: FloatArray,
    slope: float,
    memory: FloatArray,
    outputs: FloatArray,
) -> None:
    """``inputs`` (n,) -> ``outputs`` (n,) = slope x input + weights . plays; ``memory`` (k,) of the plays goes on."""
    for i in range(inputs.size):
        u = inputs[i]
        total = slope * u
        for j in range(half_widths.size):
            memory[j] = max(u - half_widths[j], min(u + half_widths[j], memory[j]))
            total += weights[j] * memory[j]
        outputs[i] = total


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
        _integrate(inputs, np.array([0.5 * self.width]), np.ones(1), 0.0, memory, outputs)
        self.output = float(memory[0])
        return outputs


def row_of(values: ArrayLike) -> FloatArray:
    """``values`` as a contiguous row of finite numbers; else ValueError."""
    row = np.ascontiguousarray(values, np.float64)
    if row.ndim != 1 or not np.isfinite(row).all():
        raise ValueError(f"expected a row of finite numbers, got shape {row.shape}")
    return row


class PrandtlIshlinskii:
    """Sum of plays: output = ``slope`` x input + sum of ``weights`` x play of half width ``half_widths``.

    ``half_widths`` (k,) positive, in the input's unit; ``weights`` (k,) in the output's unit over the input's. From
    rest the output runs along `loading_curve`; after a turn along the same curve, twice as large. ``memory`` (k,)
    holds the plays. (Krejci and Kuhnen 2001; with weights of any sign, not always invertible.)

    Raises ValueError where shapes or half widths do not fit.

    >>> soft = PrandtlIshlinskii([0.5, 1.0], [0.6, 0.4])
    >>> soft.run([0.5, 1.0, 3.0, 2.0]).round(3)
    array([0. , 0.3, 2.3, 2.3])
    """

    def __init__(self, half_widths: ArrayLike, weights: ArrayLike, slope: float = 0.0) -> None:
        self.half_widths: FloatArray = frozen("half_widths", half_widths, (None,))
        self.weights: FloatArray = frozen("weights", weights, self.half_widths.shape)
        self.slope = float(slope)
        if not ((self.half_widths > 0).all() and np.isfinite(self.half_widths).all()):
            raise ValueError(f"half_widths: expected finite positive numbers, got {self.half_widths.tolist()}")
        if not (np.isfinite(self.weights).all() and np.isfinite(self.slope)):
            raise ValueError(f"weights and slope: expected finite numbers, got {self.weights.tolist()}, {slope}")
        self.memory: FloatArray = np.zeros(self.half_widths.size)

    @classmethod
    def from_loading_curve(cls, inputs: ArrayLike, outputs: ArrayLike) -> "PrandtlIshlinskii":
        """The operator whose `loading_curve` joins the points ``inputs`` (k,), ``outputs`` (k,); (0, 0) comes before.

        Raises ValueError where the inputs do not rise from above 0.
        """
        edges, heights = np.append(0.0, row_of(inputs)), np.append(0.0, row_of(outputs))
        if edges.shape != heights.shape or edges.size < 2 or not (np.diff(edges) > 0).all():
            raise ValueError(
                f"a loading curve needs rising inputs above 0 and as many outputs, got {inputs}, {outputs}"
            )
        slopes = np.diff(heights) / np.diff(edges)
        return cls(edges[1:-1], np.diff(slopes), slopes[0])

    def loading_curve(self, inputs: ArrayLike) -> FloatArray:
        """(n,) inputs -> (n,): the output had the input risen (or fallen) to it straight from rest."""
        values = row_of(inputs)
        beyond = np.maximum(0.0, np.abs(values)[:, None] - self.half_widths)
        return self.slope * values + np.sign(values) * (beyond @ self.weights)

    def reset(self) -> None:
        """Back to rest: as if nothing had happened, at input 0."""
        self.memory = np.zeros(self.half_widths.size)

    def step(self, value: float) -> float:
        """The next input -> its output."""
        return float(self.run([value])[0])

    def run(self, values: ArrayLike) -> FloatArray:
        """(n,) inputs in their order -> (n,) outputs; the same as n times `step`."""
        inputs = row_of(values)
        outputs = np.empty_like(inputs)
        _integrate(inputs, self.half_widths, self.weights, self.slope, self.memory, outputs)
        return outputs
