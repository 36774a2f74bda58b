"""Arrays by address: how a record points to the arrays that belong to it.

A compiled function takes a record of addresses in a microsecond, a tuple of arrays in ten; and a
row of a batch can point to arrays whose lengths differ from row to row. Whoever writes an address
keeps the array alive.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import numpy as np
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array, populate_array
from numba.np.numpy_support import from_dtype
from numpy.typing import NDArray


def address_of(array: NDArray[Any]) -> int:
    """The address of a contiguous array's first element.

    Raises:
        ValueError: the array is not contiguous.
    """
    if not array.flags.c_contiguous:
        raise ValueError(f"an array of shape {array.shape} is not contiguous")
    return int(array.ctypes.data)


def _viewer(item: Any, ndim: int) -> Any:
    """An intrinsic (address, *shape) -> array that owns nothing, so that nothing is counted."""
    array_type = types.Array(item, ndim, "C")

    def lower(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        array = make_array(array_type)(context, builder)  # type: ignore[no-untyped-call]
        size = context.get_abi_sizeof(context.get_data_type(item))
        itemsize = context.get_constant(types.intp, size)
        shape = [builder.sext(arg, itemsize.type) for arg in args[1:]]
        strides = [itemsize]
        for length in reversed(shape[1:]):
            strides.insert(0, builder.mul(strides[0], length))
        pack: Any = cgutils.pack_array
        fill: Any = populate_array
        fill(
            array,
            data=builder.inttoptr(args[0], context.get_data_type(item).as_pointer()),
            shape=pack(builder, shape),
            strides=pack(builder, strides),
            itemsize=itemsize,
            meminfo=None,
        )
        return array._getvalue()

    def three(typingctx: Any, address: Any, n: Any, m: Any, k: Any) -> Any:
        return array_type(types.uint64, types.int64, types.int64, types.int64), lower

    def one(typingctx: Any, address: Any, n: Any) -> Any:
        return array_type(types.uint64, types.int64), lower

    def two(typingctx: Any, address: Any, n: Any, m: Any) -> Any:
        return array_type(types.uint64, types.int64, types.int64), lower

    makers: tuple[Any, ...] = (one, two, three)
    return intrinsic(makers[ndim - 1])


def rows_of(dtype: np.dtype[Any]) -> Callable[[Any, int], NDArray[np.void]]:
    """A kernel function (address, n) -> records (n,) of a dtype."""
    viewer = _viewer(from_dtype(dtype), 1)
    viewer.source_digest = repr(dtype)  # a kernel that calls it is stale when the record changes
    return cast("Callable[[Any, int], NDArray[np.void]]", viewer)


# numba gives these the arguments that their callers see; mypy knows only how they are declared.
doubles_at = cast("Callable[[Any, int], NDArray[np.float64]]", _viewer(types.float64, 1))
floats_at = cast("Callable[[Any, int], NDArray[np.float32]]", _viewer(types.float32, 1))
words_at = cast("Callable[[Any, int], NDArray[np.uint32]]", _viewer(types.uint32, 1))
integers_at = cast("Callable[[Any, int], NDArray[np.int64]]", _viewer(types.int64, 1))
states_at = cast("Callable[[Any, int, int, int], NDArray[np.uint32]]", _viewer(types.uint32, 3))
moves_at = cast("Callable[[Any, int, int, int], NDArray[np.int32]]", _viewer(types.int32, 3))
table_at = cast("Callable[[Any, int, int], NDArray[np.float64]]", _viewer(types.float64, 2))
field_at = cast("Callable[[Any, int, int], NDArray[np.float32]]", _viewer(types.float32, 2))
