"""Telling the processor early what will be read: frames come from main memory, a hundred nanoseconds away."""

from typing import Any

from llvmlite import ir
from numba import extending
from numba.core import types

__all__ = ["prefetch"]

_intrinsic: Any = extending.intrinsic


@_intrinsic
def prefetch(_: Any, pixels: Any, i: Any) -> Any:
    """Begin to bring ``pixels[i]`` into the caches; ``i`` may lie anywhere, nothing is read."""

    def build(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        number, byte = ir.IntType(32), ir.IntType(8).as_pointer()
        name = "llvm.prefetch.p0"
        call = builder.module.globals.get(name)
        if call is None:
            call = ir.Function(builder.module, ir.FunctionType(ir.VoidType(), [byte, number, number, number]), name)
        data = context.make_array(pixels)(context, builder, values[0]).data
        place = builder.bitcast(builder.gep(data, [values[1]]), byte)
        # Of a read, to be kept in all caches, of data.
        builder.call(call, [place, number(0), number(3), number(1)])
        return context.get_dummy_value()

    return (types.void(pixels, types.int64), build) if isinstance(i, types.Integer) else None
