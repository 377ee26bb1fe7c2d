"""Sine and cosine of many angles at once, several lanes at a time."""

import math
from typing import Any

from numba import njit

from ...types import FloatArray
from ._octet import alike, choose, fma, whole

__all__ = ["circle", "sincos"]

_HALF_PI_HIGH, _HALF_PI_LOW = 1.57079632673412561417, 6.07710050650619224932e-11
"""Pi / 2 in two parts: a small whole number times the first is exact."""


@njit(cache=True, error_model="numpy")
def circle(angle: Any) -> tuple[Any, Any]:
    """Cosine and sine of a float or an octet, to the last bit or two within 1e5 rad.

    Minimax coefficients on a quarter turn are those of fdlibm (Sun Microsystems 1993).
    """
    half, one, two = alike(0.5, angle), alike(1.0, angle), alike(2.0, angle)
    quarter = whole(fma(angle, alike(2.0 / math.pi, angle), half))
    r = fma(quarter, alike(-_HALF_PI_LOW, angle), fma(quarter, alike(-_HALF_PI_HIGH, angle), angle))
    z = r * r
    tail = fma(z, alike(1.58969099521155010221e-10, angle), alike(-2.50507602534068634195e-08, angle))
    tail = fma(z, tail, alike(2.75573137070700676789e-06, angle))
    tail = fma(z, tail, alike(-1.98412698298579493134e-04, angle))
    tail = fma(z, tail, alike(8.33333333332248946124e-03, angle))
    s = fma(r * z, fma(z, tail, alike(-1.66666666666666324348e-01, angle)), r)
    tail = fma(z, alike(-1.13596475577881948265e-11, angle), alike(2.08757232129817482790e-09, angle))
    tail = fma(z, tail, alike(-2.75573143513906633035e-07, angle))
    tail = fma(z, tail, alike(2.48015872894767294178e-05, angle))
    tail = fma(z, tail, alike(-1.38888888888741095749e-03, angle))
    c = one - (half * z - z * z * fma(z, tail, alike(4.16666666666666019037e-02, angle)))
    # Of the four quarters the odd ones swap the two; the sine is negative in the last two, the cosine in the middle.
    below, above = whole(half * quarter), whole(half * (quarter + one))
    odd = quarter - two * below
    sine_sign = one - two * (below - two * whole(half * below))
    cosine_sign = one - two * (above - two * whole(half * above))
    return choose(odd, s, c) * cosine_sign, choose(odd, c, s) * sine_sign


@njit(cache=True, error_model="numpy")
def sincos(angle: FloatArray, cosine: FloatArray, sine: FloatArray) -> None:
    """Fill ``cosine`` and ``sine``.

    One angle after the other, as the library's functions take them, cost more than half of a solve.
    """
    for i in range(angle.size):
        cosine[i], sine[i] = circle(angle[i])
