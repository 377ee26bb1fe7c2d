"""Sine and cosine of a row of angles in a loop that the compiler can run several lanes at a time."""

import math

from numba import njit

from ..types import FloatArray

__all__ = ["sincos"]

_HALF_PI_HIGH, _HALF_PI_LOW = 1.57079632673412561417, 6.07710050650619224932e-11
"""Pi / 2 in two parts: a small whole number times the first is exact."""


@njit(cache=True, error_model="numpy")
def sincos(angle: FloatArray, cosine: FloatArray, sine: FloatArray) -> None:
    """Fill ``cosine`` and ``sine``, to the last bit or two for angles within 1e5 rad.

    One angle after the other, as the library's functions take them, cost more than half of a solve. Minimax
    coefficients on a quarter turn are those of fdlibm (Sun Microsystems 1993).
    """
    for i in range(angle.size):
        quarter = math.floor(angle[i] * (2.0 / math.pi) + 0.5)
        r = (angle[i] - quarter * _HALF_PI_HIGH) - quarter * _HALF_PI_LOW
        z = r * r
        tail = 2.75573137070700676789e-06 + z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)
        tail = 8.33333333332248946124e-03 + z * (-1.98412698298579493134e-04 + z * tail)
        s = r + r * z * (-1.66666666666666324348e-01 + z * tail)
        tail = -2.75573143513906633035e-07 + z * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11)
        tail = -1.38888888888741095749e-03 + z * (2.48015872894767294178e-05 + z * tail)
        c = 1.0 - (0.5 * z - z * z * (4.16666666666666019037e-02 + z * tail))
        # Which quarter it is, as 0, 1, 2 or 3: the odd ones swap the two, the signs follow.
        turn = quarter - 4.0 * math.floor(0.25 * quarter)
        odd = turn == 1.0 or turn == 3.0
        cosine[i] = (s if odd else c) * (-1.0 if turn == 1.0 or turn == 2.0 else 1.0)
        sine[i] = (c if odd else s) * (-1.0 if turn >= 2.0 else 1.0)
