"""Asking for memory before it is needed: an instruction of the processor that numba lacks."""

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, overload


def prefetch(array: Any, row: int, column: int) -> None:
    """Bring array[row, column] into the cache, for kernels; the place must exist."""


@intrinsic
def _prefetch(_: Any, array: Any, row: Any, column: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        made = context.make_array(array)(context, builder, args[0])
        place = cgutils.get_item_pointer(context, builder, array, made, args[1:], wraparound=False)
        number, byte = ir.IntType(32), ir.IntType(8).as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [byte, number, number, number])
        function = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0i8")
        read, keep, data = number(0), number(3), number(1)
        builder.call(function, [builder.bitcast(place, byte), read, keep, data])
        return context.get_dummy_value()

    return types.void(array, types.intp, types.intp), generate


@overload(prefetch, inline="always")
def _compiled(array, row, column):  # numba compares the names and types of both signatures
    return lambda array, row, column: _prefetch(array, row, column)
