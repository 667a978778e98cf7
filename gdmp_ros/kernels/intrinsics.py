"""
Operations that kernels need and Numba does not offer: views of flat memory, calls by address.

Each view function works in plain Python too, so that the same layout code serves both sides.
"""
from __future__ import annotations

import functools
from typing import Any, TYPE_CHECKING

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic, lower_builtin, type_callable
from numba.np import arrayobj
import numpy as np

VECTOR = types.Array(types.float64, 1, 'C')
MATRIX = types.Array(types.float64, 2, 'C')
POINTER = types.CPointer(types.float64)
#: What a view can be cut from.
_MEMORY = (types.Array, types.CPointer)


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


# Overloads are functions of their own, with a stack of their own, and may not return views: these
# are built in place.

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


@type_callable(numbers_at)
def _type_numbers_at(context):
    return lambda memory, at, count: POINTER if isinstance(memory, _MEMORY) else None


@type_callable(vector_at)
def _type_vector_at(context):
    return lambda memory, at, count: VECTOR if isinstance(memory, _MEMORY) else None


@type_callable(matrix_at)
def _type_matrix_at(context):
    return lambda memory, at, rows, columns: MATRIX if isinstance(memory, _MEMORY) else None


@type_callable(records_at)
def _type_records_at(context):
    return lambda memory, at, count, dtype: (
        types.Array(dtype.dtype, 1, 'C') if isinstance(memory, _MEMORY) else None)


def _view_of(context: Any, builder: Any, signature: Any, arguments: Any) -> tuple[Any, Any]:
    """Pointer to what a view begins with, and the sizes that the view function was given."""
    sizes = [context.cast(builder, value, kind, types.intp) for value, kind
             in zip(arguments[1:], signature.args[1:]) if isinstance(kind, types.Integer)]
    data = _data_of(context, builder, signature.args[0], arguments[0])
    return builder.gep(data, [sizes[0]]), sizes[1:]


def _numbers_at(context, builder, signature, arguments):
    return _view_of(context, builder, signature, arguments)[0]


def _vector_at(context, builder, signature, arguments):
    data, sizes = _view_of(context, builder, signature, arguments)
    return _array_from(context, builder, VECTOR, data, sizes,
                       [context.get_constant(types.intp, 8)])


def _matrix_at(context, builder, signature, arguments):
    data, sizes = _view_of(context, builder, signature, arguments)
    size = context.get_constant(types.intp, 8)
    return _array_from(context, builder, MATRIX, data, sizes,
                       [builder.mul(sizes[1], size), size])


def _records_at(context, builder, signature, arguments):
    data, sizes = _view_of(context, builder, signature, arguments)
    kind = signature.return_type
    return _array_from(context, builder, kind, data, sizes,
                       [context.get_constant(types.intp, kind.dtype.size)])


for _memory in _MEMORY:
    for _function, _build, _rest in (
            (numbers_at, _numbers_at, (types.Integer,)), (vector_at, _vector_at, (types.Integer,)),
            (matrix_at, _matrix_at, (types.Integer, types.Integer)),
            (records_at, _records_at, (types.Integer, types.DType))):
        lower_builtin(_function, _memory, types.Integer, *_rest)(_build)


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
