"""Which part of a row of pixels a straight edge leaves over."""

from numba import njit


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def columns(low: int, high: int, slope: float, value: float) -> tuple[int, int]:
    """Returns the columns u where ``slope`` u + ``value`` >= 0 may hold, and one more to be safe.

    Args:
        low: first column.
        high: end of the columns, exclusive.
        slope: change of the value from one column to the next.
        value: value at column 0.

    Returns:
        First column and end, exclusive.
    """
    if slope > 1e-6:  # below 1e-6 the edge is nearly along the row: all columns; 1e6 keeps the quotient an integer
        return max(low, int(max(-value / slope, -1e6))), high
    if slope < -1e-6:
        return low, min(high, int(min(-value / slope, 1e6)) + 2)
    return low, high
