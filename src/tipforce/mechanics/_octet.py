"""Numbers that go through one instruction together, in compiled loops: eight lanes as one, or a single lane.

Loops whose every turn needs the last one's result are made of these: the compiler keeps such a number in a register,
where a row of eight would be written and read back between two turns. ``lanes``, a tuple of as many numbers as there
are lanes, one or eight, tells which kind is meant; a single lane is a plain float.
"""

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import extending
from numba.core import types

__all__ = ["fma", "inverse", "larger", "magnitude", "minus", "nothing", "put", "take", "times"]

_intrinsic: Any = extending.intrinsic
_Build = Callable[[Any, Any, Any], Any]

_LANES = 8
_VECTOR = ir.VectorType(ir.DoubleType(), _LANES)


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
    """Where lanes of element ``i`` begin in a row, as a pointer to all of them."""
    data = context.make_array(array)(context, builder, values[0]).data
    width = 1 if kind == types.float64 else _LANES
    first = builder.gep(data, [builder.mul(values[1], ir.Constant(ir.IntType(64), width))])
    return builder.bitcast(first, _low(kind).as_pointer())


@_intrinsic
def nothing(_: Any, lanes: Any) -> Any:
    """Zero in every lane."""
    kind = _kind(lanes)

    def build(_context: Any, _builder: Any, _signature: Any, _values: Any) -> Any:
        return ir.Constant(_low(kind), None)

    return kind(lanes), build


@_intrinsic
def take(_: Any, row: Any, i: Any, lanes: Any) -> Any:
    """The lanes of element ``i`` of a contiguous row."""
    kind = _kind(lanes)

    def build(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        return builder.load(_place(context, builder, row, values, kind), align=8)

    return (kind(row, types.int64, lanes), build) if isinstance(i, types.Integer) else None


@_intrinsic
def put(_: Any, row: Any, i: Any, value: Any) -> Any:
    """``value`` into the lanes of element ``i`` of a contiguous row."""

    def build(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        builder.store(values[2], _place(context, builder, row, values, value), align=8)
        return context.get_dummy_value()

    return (types.void(row, types.int64, value), build) if isinstance(i, types.Integer) else None


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
def times(_: Any, a: Any, b: Any) -> Any:
    """``a`` ``b``."""
    return _same(2, lambda builder, _, values: builder.fmul(*values), (a, b))


@_intrinsic
def minus(_: Any, a: Any) -> Any:
    """-``a``."""
    return _same(1, lambda builder, _, values: builder.fneg(*values), (a,))


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
    return _same(2, lambda builder, _, values: builder.select(builder.fcmp_ordered(">=", *values), *values), (a, b))


@_intrinsic
def magnitude(_: Any, a: Any) -> Any:
    """``a`` without its sign."""
    return _same(1, lambda builder, kind, values: _call(builder, "fabs", kind, values), (a,))
