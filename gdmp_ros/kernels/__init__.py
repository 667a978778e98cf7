"""Compiled kernels: decorators, views of flat memory, and the cache of machine code."""
from gdmp_ros.kernels.cache import (
    allocating,
    always_inline,
    cache_folder,
    inlined,
    is_warm,
    jitable,
    kernel,
    on_compile,
    remove_stale,
)
from gdmp_ros.kernels.intrinsics import (
    ask_c,
    bytes_at,
    call_c,
    call_kernel,
    local_matrix,
    local_numbers,
    local_zeros,
    matrix_at,
    measure_with_kernel,
    noinline,
    numbers_at,
    records_at,
    vector_at,
)

__all__ = ['allocating', 'always_inline', 'ask_c', 'bytes_at', 'cache_folder', 'call_c',
           'call_kernel', 'inlined', 'is_warm', 'jitable', 'kernel', 'local_matrix',
           'local_numbers', 'local_zeros', 'matrix_at', 'measure_with_kernel', 'noinline',
           'numbers_at', 'on_compile', 'records_at', 'remove_stale', 'vector_at']
