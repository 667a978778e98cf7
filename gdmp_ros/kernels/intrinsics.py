"""
Operations that kernels need and Numba does not offer: views of flat memory, calls by address.

Each view function works in plain Python too, so that the same layout code serves both sides.
"""
from __future__ import annotations

import functools
from typing import Any, TYPE_CHECKING

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic, lower_builtin, overload, type_callable
from numba.np import arrayobj
import numpy as np

VECTOR = types.Array(types.float64, 1, 'C')
MATRIX = types.Array(types.float64, 2, 'C')
POINTER = types.CPointer(types.float64)


def numbers_at(memory, at, count):
    """
    ``count`` numbers of a flat array from index ``at`` on.

    In kernels the result is a plain pointer: it has no size, no bounds check and no reference
    count, and compiles to one instruction where an array slice takes a hundred.
    """
    return memory[at:at + count]


def vector_at(memory, at, count):
    """As `numbers_at`, of an array of any shape; in kernels an array, without bounds check."""
    return memory.reshape(-1)[at:at + count]


def matrix_at(memory, at, rows, columns):
    """``rows × columns`` numbers of a flat array as a matrix; in kernels without bounds check."""
    return memory[at:at + rows * columns].reshape(rows, columns)


class Record:
    """
    One record in Python, with the fields as attributes, as kernels see it.

    NumPy's own records take ten times as long for it. All fields have one type.
    """

    __slots__ = ('numbers',)

    def __init__(self, numbers: np.ndarray):
        """:param numbers: a view of the memory, one number for each field"""
        self.numbers = numbers

    if TYPE_CHECKING:
        def __getattr__(self, name: str) -> Any: ...


@functools.cache
def _record_class(dtype: np.dtype) -> type[Record]:
    """Subclass with one property for each field."""
    def field(index: int) -> property:
        def get(record: Record) -> Any:
            return record.numbers.item(index)

        def set_(record: Record, value: float) -> None:
            record.numbers[index] = value
        return property(get, set_)
    fields: dict[str, Any] = {name: field(i) for i, name in enumerate(dtype.names or ())}
    return type('Record', (Record,), {'__slots__': (), **fields})


def records_at(memory, at, count, dtype):
    """``count`` records of a structured ``dtype`` in a flat float64 array; see `matrix_at`."""
    fields = len(dtype.names)
    numbers = memory[at:at + count * fields].view(dtype[0])
    record_class = _record_class(dtype)
    return [record_class(numbers[i * fields:(i + 1) * fields]) for i in range(count)]


def without_refcount(array):
    """
    The same array without its reference count.

    A kernel that cuts an array into many views would count each one with two locked instructions,
    more than a 3×3 product costs. The caller of the kernel keeps the array alive.
    """
    return array


def local_numbers(count):
    """
    ``count`` numbers for one call of a kernel, on its stack: they must not be returned.

    They cost nothing, where ``np.empty`` asks the system for memory. Not inside a loop.
    """
    return np.empty(count)


def local_zeros(count):
    """As `local_numbers`, all 0."""
    return np.zeros(count)


def local_matrix(rows, columns):
    """As `local_numbers`, as a matrix."""
    return np.empty((rows, columns))


# Overloads are functions of their own, with a stack of their own: these are built in place.

@type_callable(local_numbers)
def _type_local_numbers(context):
    return lambda count: VECTOR if isinstance(count, types.Integer) else None


@type_callable(local_zeros)
def _type_local_zeros(context):
    return lambda count: VECTOR if isinstance(count, types.Integer) else None


@type_callable(local_matrix)
def _type_local_matrix(context):
    return lambda rows, columns: (MATRIX if isinstance(rows, types.Integer)
                                  and isinstance(columns, types.Integer) else None)


@lower_builtin(local_numbers, types.Integer)
def _local_numbers(context, builder, signature, arguments):
    data, count = _on_stack(context, builder, signature.args, arguments)
    return _array_from(context, builder, VECTOR, data, [count],
                       [context.get_constant(types.intp, 8)])


@lower_builtin(local_zeros, types.Integer)
def _local_zeros(context, builder, signature, arguments):
    data, count = _on_stack(context, builder, signature.args, arguments)
    size = context.get_constant(types.intp, 8)
    cgutils.memset(builder, data, builder.mul(count, size), 0)
    return _array_from(context, builder, VECTOR, data, [count], [size])


@lower_builtin(local_matrix, types.Integer, types.Integer)
def _local_matrix(context, builder, signature, arguments):
    size = context.get_constant(types.intp, 8)
    rows, columns = (context.cast(builder, value, kind, types.intp)
                     for value, kind in zip(arguments, signature.args))
    data = builder.alloca(context.get_value_type(types.float64), builder.mul(rows, columns))
    return _array_from(context, builder, MATRIX, data, [rows, columns],
                       [builder.mul(columns, size), size])


def _on_stack(context: Any, builder: Any, kinds: Any, arguments: Any) -> tuple[Any, Any]:
    """Pointer to numbers on the stack, and their count."""
    count = context.cast(builder, arguments[0], kinds[0], types.intp)
    return builder.alloca(context.get_value_type(types.float64), count), count


def _data_of(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """Pointer to the first number of an array, or the pointer itself."""
    if isinstance(kind, types.Array):
        return context.make_array(kind)(context, builder, value).data
    return value


def _array_from(context: Any, builder: Any, kind: Any, data: Any, shape: list[Any],
                strides: list[Any]) -> Any:
    """Array structure around existing memory."""
    result = context.make_array(kind)(context, builder)
    size = context.get_constant(types.intp, context.get_abi_sizeof(
        context.get_data_type(kind.dtype)))
    arrayobj.populate_array(result, data=builder.bitcast(data, result.data.type), shape=shape,
                            strides=strides, itemsize=size, meminfo=None)
    return result._getvalue()  # noqa: SLF001  Numba has no public name for it


@intrinsic
def _numbers_at(typing_context, memory, at, count):
    def build(context, builder, signature, arguments):
        data = _data_of(context, builder, memory, arguments[0])
        return builder.gep(data, [arguments[1]])

    return POINTER(memory, types.intp, types.intp), build


@intrinsic
def _vector_at(typing_context, memory, at, count):
    def build(context, builder, signature, arguments):
        data = builder.gep(_data_of(context, builder, memory, arguments[0]), [arguments[1]])
        return _array_from(context, builder, VECTOR, data, [arguments[2]],
                           [context.get_constant(types.intp, 8)])

    return VECTOR(memory, types.intp, types.intp), build


@intrinsic
def _matrix_at(typing_context, memory, at, rows, columns):
    def build(context, builder, signature, arguments):
        array, at, rows, columns = arguments
        data = builder.gep(_data_of(context, builder, memory, array), [at])
        size = context.get_constant(types.intp, 8)
        return _array_from(context, builder, MATRIX, data, [rows, columns],
                           [builder.mul(columns, size), size])

    return MATRIX(memory, types.intp, types.intp, types.intp), build


@intrinsic
def _records_at(typing_context, memory, at, count, dtype):
    view_type = types.Array(dtype.dtype, 1, 'C')

    def build(context, builder, signature, arguments):
        data = builder.gep(_data_of(context, builder, memory, arguments[0]), [arguments[1]])
        size = context.get_constant(types.intp, dtype.dtype.size)
        return _array_from(context, builder, view_type, data, [arguments[2]], [size])

    return view_type(memory, types.intp, types.intp, dtype), build


@intrinsic
def _without_refcount(typing_context, array):
    def build(context, builder, signature, arguments):
        result = context.make_array(array)(context, builder, arguments[0])
        result.meminfo = cgutils.get_null_value(result.meminfo.type)
        result.parent = cgutils.get_null_value(result.parent.type)
        return result._getvalue()  # noqa: SLF001  Numba has no public name for it

    return array(array), build


# Not ``inline='always'``: after inlining an overload Numba removes statements that it takes
# for dead, such as assignments to elements of an attribute of a named tuple.

@overload(numbers_at)
def _overload_numbers_at(memory, at, count):
    return lambda memory, at, count: _numbers_at(memory, at, count)


@overload(vector_at)
def _overload_vector_at(memory, at, count):
    return lambda memory, at, count: _vector_at(memory, at, count)


@overload(matrix_at)
def _overload_matrix_at(memory, at, rows, columns):
    return lambda memory, at, rows, columns: _matrix_at(memory, at, rows, columns)


@overload(records_at)
def _overload_records_at(memory, at, count, dtype):
    return lambda memory, at, count, dtype: _records_at(memory, at, count, dtype)


@overload(without_refcount)
def _overload_without_refcount(array):
    return lambda array: _without_refcount(array)


def kernel_signature(arrays: int) -> Any:
    """Argument types of a kernel that is called by address: a size and flat arrays."""
    return (types.int64, *[VECTOR] * arrays)


def _call(result: Any, context: Any, builder: Any, signature: Any, values: Any) -> Any:
    """Emit a call with Numba's own calling convention; kernels do not raise."""
    address, size, packed = values
    kinds, parts = signature.args[2].types, cgutils.unpack_tuple(builder, packed)
    arrays, item = [], context.get_constant(types.intp, 8)
    for k in range(0, len(parts), 3):
        data = _data_of(context, builder, kinds[k], parts[k])
        start, end = (context.cast(builder, parts[i], kinds[i], types.intp)
                      for i in (k + 1, k + 2))
        arrays.append(_array_from(context, builder, VECTOR, builder.gep(data, [start]),
                                  [builder.sub(end, start)], [item]))
    kernel_type = kernel_signature(len(arrays))
    function = context.call_conv.get_function_type(result, kernel_type).as_pointer()
    _, returned = context.call_conv.call_function(
        builder, builder.inttoptr(address, function), result, kernel_type,
        [context.cast(builder, size, signature.args[1], kernel_type[0]), *arrays])
    return returned


@intrinsic
def call_kernel(typing_context, address, size, parts):
    """
    Call the kernel ``f(size, *arrays)`` at an address.

    :param parts: a flat tuple; three entries for each array: numbers, first index, end
    """
    def build(context, builder, signature, values):
        _call(types.none, context, builder, signature, values)
        return context.get_dummy_value()

    return types.none(types.int64, types.int64, parts), build


@intrinsic
def measure_with_kernel(typing_context, address, size, parts):
    """Call a kernel as `call_kernel` does, and return the distance that it returns."""
    def build(context, builder, signature, values):
        return _call(types.float64, context, builder, signature, values)

    return types.float64(types.int64, types.int64, parts), build


@intrinsic
def call_c(typing_context, address, arguments):
    """
    Call a C function at an address, and return nothing.

    :param arguments: a tuple: numbers are passed as they are, arrays as the address of their first
        number
    """
    def build(context, builder, signature, values):
        _call_c(ir.VoidType(), context, builder, signature, values)
        return context.get_dummy_value()

    return types.none(types.int64, arguments), build


@intrinsic
def ask_c(typing_context, address, arguments):
    """As `call_c`, of a function that returns an ``int``."""
    def build(context, builder, signature, values):
        return _call_c(ir.IntType(32), context, builder, signature, values)

    return types.int32(types.int64, arguments), build


def _call_c(result: Any, context: Any, builder: Any, signature: Any, values: Any) -> Any:
    """Emit a call with the convention of C."""
    kinds, parts = signature.args[1].types, cgutils.unpack_tuple(builder, values[1])
    data = [_data_of(context, builder, kind, part) for kind, part in zip(kinds, parts)]
    kind = ir.FunctionType(result, [part.type for part in data]).as_pointer()
    return builder.call(builder.inttoptr(values[0], kind), data)


@intrinsic
def bytes_at(typing_context, address, count):
    """``count`` bytes of memory at an address."""
    kind = types.Array(types.uint8, 1, 'C')

    def build(context, builder, signature, arguments):
        return _array_from(context, builder, kind,
                           builder.inttoptr(arguments[0], ir.IntType(8).as_pointer()),
                           [arguments[1]], [context.get_constant(types.intp, 1)])

    return kind(types.int64, types.intp), build


@intrinsic
def noinline(typing_context):
    """
    First statement of a large kernel: keep it out of its callers' machine code.

    Otherwise LLVM may copy and optimise it again in every kernel above it.
    """
    def build(context, builder, signature, arguments):
        builder.function.attributes.discard('alwaysinline')
        builder.function.attributes.add('noinline')
        return context.get_dummy_value()

    return types.none(), build
