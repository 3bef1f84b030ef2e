"""Asking for memory before it is needed: an instruction of the processor that numba lacks."""

from typing import Any

from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, overload


def prefetch(array: Any, row: int, byte: int) -> None:
    """Bring what lies `byte` bytes into array[row] into the cache; for kernels.

    The row must exist.
    """


@intrinsic
def _prefetch(_: Any, array: Any, row: Any, byte: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        made = context.make_array(array)(context, builder, args[0])
        first = [context.get_constant(types.intp, 0)] * (array.ndim - 1)
        start = cgutils.get_item_pointer(
            context, builder, array, made, [args[1], *first], wraparound=False
        )
        number, pointer = cgutils.int32_t, cgutils.voidptr_t
        place = cgutils.pointer_add(builder, start, args[2], pointer)
        kind = cgutils.ir.FunctionType(cgutils.ir.VoidType(), [pointer, number, number, number])
        function = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0i8")
        read, keep, data = number(0), number(3), number(1)
        builder.call(function, [place, read, keep, data])
        return context.get_dummy_value()

    return types.void(array, types.intp, types.intp), generate


@overload(prefetch, inline="always")
def _compiled(array, row, byte):  # numba compares the names and types of both signatures
    return lambda array, row, byte: _prefetch(array, row, byte)
