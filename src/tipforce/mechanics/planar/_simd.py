"""Eight float64 as one number of compiled loops: numba types and LLVM intrinsics for the batch of planar rods.

What a loop makes of such numbers stays in vector registers, where an array of eight would be written and read back
between two turns, and nothing is left to the compiler's guess of which arrays may overlap. ``lanes``, a tuple of as
many numbers as there are lanes, one or eight, tells which kind is meant; a single lane is a plain float. Octets can be
added, subtracted and multiplied as floats can.

This is the only file with hand-written vector code. It stays because plain loops took twice its time or more from
a cold start (docs/log.md, "Mechanics and simulation").
"""

import math
import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import extending
from numba.core import types
from numba.core.typing import templates

from ._compile import compiled

EIGHT = (0.0,) * 8
"""For ``lanes``: eight of them."""

_intrinsic: Any = extending.intrinsic
_infer_global: Any = templates.infer_global
_Build = Callable[[Any, Any, Any], Any]

_LANES = len(EIGHT)
_INT = ir.IntType(32)
_VECTOR, _ZEROS = ir.VectorType(ir.DoubleType(), _LANES), ir.VectorType(_INT, _LANES)


class _Octet(types.Type):
    """Eight float64."""

    def __init__(self) -> None:
        super().__init__(name="octet")


_OCTET = _Octet()


@extending.register_model(_Octet)
class _OctetModel(extending.models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _VECTOR)


def _kind(lanes: Any) -> Any:
    if lanes.count not in (1, _LANES):
        raise ValueError(f"lanes: expected 1 or {_LANES}, got {lanes.count}")
    return types.float64 if lanes.count == 1 else _OCTET


def _low(kind: Any) -> Any:
    return _VECTOR if kind is _OCTET else ir.DoubleType()


def _place(context: Any, builder: Any, array: Any, values: Any, kind: Any) -> Any:
    """Place ``j`` of a row, as a pointer to all lanes from there on."""
    first = builder.gep(context.make_array(array)(context, builder, values[0]).data, [values[1]])
    return builder.bitcast(first, _low(kind).as_pointer())


def _add_operator(symbol: Any, name: str) -> None:
    class _Typed(templates.ConcreteTemplate):
        cases = (templates.signature(_OCTET, _OCTET, _OCTET),)

    def build(_context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        return getattr(builder, name)(*values)

    _infer_global(symbol)(_Typed)
    extending.lower_builtin(symbol, _OCTET, _OCTET)(build)


for _symbol, _name in ((operator.add, "fadd"), (operator.sub, "fsub"), (operator.mul, "fmul")):
    _add_operator(_symbol, _name)


@_intrinsic
def nothing(_: Any, lanes: Any) -> Any:
    """Zero in every lane."""
    kind = _kind(lanes)

    def build(_context: Any, _builder: Any, _signature: Any, _values: Any) -> Any:
        return ir.Constant(_low(kind), None)

    return kind(lanes), build


@_intrinsic
def take(_: Any, row: Any, j: Any, lanes: Any) -> Any:
    """The lanes from place ``j`` of a contiguous row on."""
    kind = _kind(lanes)

    def build(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        return builder.load(_place(context, builder, row, values, kind), align=8)

    return (kind(row, types.int64, lanes), build) if isinstance(j, types.Integer) else None


@_intrinsic
def put(_: Any, row: Any, j: Any, value: Any) -> Any:
    """``value`` to place ``j`` of a contiguous row and on."""

    def build(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        builder.store(values[2], _place(context, builder, row, values, value), align=8)
        return context.get_dummy_value()

    return (types.void(row, types.int64, value), build) if isinstance(j, types.Integer) else None


def _call(builder: Any, name: str, kind: Any, values: Any) -> Any:
    """What the compiler itself knows under that name."""
    low = _low(kind)
    full = f"llvm.{name}.{'f64' if kind == types.float64 else f'v{_LANES}f64'}"
    function = builder.module.globals.get(full)
    if function is None:
        function = ir.Function(builder.module, ir.FunctionType(low, [low] * len(values)), full)
    return builder.call(function, values)


def _same(count: int, make: _Build, given: tuple[Any, ...]) -> Any:
    """What an intrinsic of ``count`` numbers of one kind returns: its signature, and how ``make`` builds it of them."""
    kind = _OCTET if _OCTET in given else types.float64

    def build(_context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        return make(builder, kind, values)

    return kind(*[kind] * count), build


@_intrinsic
def fma(_: Any, a: Any, b: Any, c: Any) -> Any:
    """``a`` ``b`` + ``c``, rounded once: so it is the same wherever it is inlined."""
    return _same(3, lambda builder, kind, values: _call(builder, "fma", kind, values), (a, b, c))


@_intrinsic
def inverse(_: Any, a: Any) -> Any:
    """1 / ``a``."""

    def build(builder: Any, kind: Any, values: Any) -> Any:
        one = ir.Constant(ir.DoubleType(), 1.0)
        return builder.fdiv(ir.Constant(_VECTOR, [one] * _LANES) if kind is _OCTET else one, *values)

    return _same(1, build, (a,))


@_intrinsic
def larger(_: Any, a: Any, b: Any) -> Any:
    """The larger one; ``b`` where that is not a number."""
    return _same(2, lambda builder, _, values: builder.select(builder.fcmp_ordered(">", *values), *values), (a, b))


@_intrinsic
def magnitude(_: Any, a: Any) -> Any:
    """``a`` without its sign."""
    return _same(1, lambda builder, kind, values: _call(builder, "fabs", kind, values), (a,))


@_intrinsic
def whole(_: Any, a: Any) -> Any:
    """The largest whole number that is not above ``a``."""
    return _same(1, lambda builder, kind, values: _call(builder, "floor", kind, values), (a,))


@_intrinsic
def choose(_: Any, test: Any, a: Any, b: Any) -> Any:
    """``a`` where ``test`` > 0, else ``b``."""

    def build(builder: Any, kind: Any, values: Any) -> Any:
        return builder.select(builder.fcmp_ordered(">", values[0], ir.Constant(_low(kind), None)), *values[1:])

    return _same(3, build, (test, a, b))


@_intrinsic
def alike(_: Any, value: Any, like: Any) -> Any:
    """A float, in every lane of what is of the kind of ``like``."""

    def build(_context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        if like is not _OCTET:
            return values[0]
        empty = ir.Constant(_VECTOR, ir.Undefined)
        first = builder.insert_element(empty, values[0], ir.Constant(_INT, 0))
        return builder.shuffle_vector(first, empty, ir.Constant(_ZEROS, None))

    return (like(types.float64, like), build) if isinstance(value, types.Float) else None


@_intrinsic
def largest_of(_: Any, octet: Any, lanes: Any) -> Any:
    """The largest in each lane of eight places of a row: of a single lane, the largest of all eight."""
    kind = _kind(lanes)

    def build(_context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        if kind is _OCTET:
            return values[0]
        largest = builder.extract_element(values[0], ir.Constant(_INT, 0))
        for k in range(1, _LANES):
            other = builder.extract_element(values[0], ir.Constant(_INT, k))
            largest = builder.select(builder.fcmp_ordered(">", largest, other), largest, other)
        return largest

    return kind(octet, lanes), build


_HALF_PI_HIGH, _HALF_PI_LOW = 1.57079632673412561417, 6.07710050650619224932e-11
"""Pi / 2 in two parts: a small whole number times the first is exact."""


@compiled
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
