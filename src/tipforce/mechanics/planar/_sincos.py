"""Cosine and sine in a few instructions without a branch, so that a loop over angles becomes vector instructions."""

import math
from collections.abc import Sequence
from typing import Any

from llvmlite import ir
from numba import extending
from numba.core import types

from ._compile import compiled

_intrinsic: Any = extending.intrinsic


def _llvm(name: str, count: int) -> Any:
    """Returns signature and code of an LLVM intrinsic of ``count`` float64 arguments."""
    double = ir.DoubleType()

    def build(_context: Any, builder: Any, _signature: Any, values: Sequence[Any]) -> Any:
        function = builder.module.globals.get(f"llvm.{name}.f64")
        if function is None:
            function = ir.Function(builder.module, ir.FunctionType(double, [double] * count), f"llvm.{name}.f64")
        return builder.call(function, values)

    return types.float64(*[types.float64] * count), build


@_intrinsic
def fma(_: Any, a: Any, b: Any, c: Any) -> Any:
    """Returns ``a`` ``b`` + ``c``, rounded once, so that the result does not depend on inlining.

    Args:
        _: typing context of the compiler.
        a: factor, as all of them a 64-bit float.
        b: factor.
        c: summand.

    Returns:
        In compiled code the number; to the compiler signature and code.
    """
    del a, b, c
    return _llvm("fma", 3)


@_intrinsic
def floor(_: Any, value: Any) -> Any:
    """Returns the largest whole number that is not above ``value``.

    Args:
        _: typing context of the compiler.
        value: a 64-bit float.

    Returns:
        In compiled code the number, a 64-bit float; to the compiler signature and code.
    """
    del value
    return _llvm("floor", 1)


_HALF_PI_HIGH, _HALF_PI_LOW = 1.57079632673412561417, 6.07710050650619224932e-11
"""Pi / 2 in two parts: a small whole number times the first is exact."""


@compiled
def cosine_and_sine(angle: float) -> tuple[float, float]:
    """Returns cosine and sine, accurate to the last one or two bits within 1e5 rad.

    Minimax coefficients on a quarter turn are those of fdlibm (Sun Microsystems 1993).
    """
    # The angle is a whole number of quarter turns and a remainder r; both series are polynomials of z = r^2.
    quarter = floor(fma(angle, 2.0 / math.pi, 0.5))
    r = fma(quarter, -_HALF_PI_LOW, fma(quarter, -_HALF_PI_HIGH, angle))
    z = r * r
    series = fma(z, 1.58969099521155010221e-10, -2.50507602534068634195e-08)
    series = fma(z, series, 2.75573137070700676789e-06)
    series = fma(z, series, -1.98412698298579493134e-04)
    series = fma(z, series, 8.33333333332248946124e-03)
    sine = fma(r * z, fma(z, series, -1.66666666666666324348e-01), r)
    series = fma(z, -1.13596475577881948265e-11, 2.08757232129817482790e-09)
    series = fma(z, series, -2.75573143513906633035e-07)
    series = fma(z, series, 2.48015872894767294178e-05)
    series = fma(z, series, -1.38888888888741095749e-03)
    cosine = 1.0 - (0.5 * z - z * z * fma(z, series, 4.16666666666666019037e-02))
    # Of the four quarters the odd ones swap the two; the sine is negative in the last two, the cosine in the middle.
    below, above = floor(0.5 * quarter), floor(0.5 * (quarter + 1.0))
    odd = quarter - 2.0 * below
    sine_sign = 1.0 - 2.0 * (below - 2.0 * floor(0.5 * below))
    cosine_sign = 1.0 - 2.0 * (above - 2.0 * floor(0.5 * above))
    return (sine if odd > 0.0 else cosine) * cosine_sign, (cosine if odd > 0.0 else sine) * sine_sign
