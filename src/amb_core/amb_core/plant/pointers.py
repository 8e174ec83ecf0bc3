"""Arrays by pointer in compiled code."""

from __future__ import annotations

from typing import Any

import numba
from numba import types
from numba.extending import intrinsic


@intrinsic
def data(typingctx: Any, array: Any) -> Any:
    """Pointer to the first element of an array."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return context.make_array(signature.args[0])(context, builder, arguments[0]).data

    return types.CPointer(array.dtype)(array), generate


@numba.njit(inline="always")
def view(array):
    """A C-contiguous array without its owner: compiled code counts no references to it, which would cost time."""
    return numba.carray(data(array), array.shape)
