"""The hot loop of weighted play operators."""

from numba import njit

from ...types import FloatArray

__all__ = ["march"]


@njit(cache=True, nogil=True, error_model="numpy")
def march(
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
