"""Arrays by pointer in compiled code.

Taking over an array from Python costs compiled code about 0.1 us. A plant has a dozen; their addresses and shapes stand
in one table, which is taken over instead. Arrays made of it are not counted by reference either, which takes time too.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numba
import numpy as np
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

_LARGEST_DIMENSION = 3


def address_table(arrays: Iterable[NDArray[np.float64]]) -> NDArray[np.int64]:
    """Address and shape of each array, a row of four; valid as long as the arrays live.

    Parameters
    ----------
    arrays : iterable of ndarray
        C-contiguous, of one to three dimensions.
    """
    rows = []
    for array in arrays:
        assert array.flags.c_contiguous and array.dtype == np.float64
        rows.append([array.ctypes.data, *array.shape, *[0] * (_LARGEST_DIMENSION - array.ndim)])
    return np.array(rows, dtype=np.int64)


@intrinsic
def data(typingctx: Any, array: Any) -> Any:
    """Pointer to the first element of an array."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return context.make_array(signature.args[0])(context, builder, arguments[0]).data

    return types.CPointer(array.dtype)(array), generate


@intrinsic
def _pointer(typingctx: Any, address: Any) -> Any:
    """Pointer to what stands at an address."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], context.get_value_type(signature.return_type))

    return types.CPointer(types.float64)(address), generate


@numba.njit(inline="always")
def vector(table, n):
    """Array n of the table, which has one dimension."""
    return numba.carray(_pointer(table[n, 0]), (table[n, 1],))


@numba.njit(inline="always")
def matrix(table, n):
    """Array n of the table, which has two dimensions."""
    return numba.carray(_pointer(table[n, 0]), (table[n, 1], table[n, 2]))


@numba.njit(inline="always")
def stack(table, n):
    """Array n of the table, which has three dimensions."""
    return numba.carray(_pointer(table[n, 0]), (table[n, 1], table[n, 2], table[n, 3]))
