"""A binary heap in two arrays, keys and items; the smallest key comes first, then item."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.arrays import Array
from wheelchair_gym.compiled.kernel import borrowing_kernel

Items = NDArray[np.int64]


@borrowing_kernel
def push(keys: Array, items: Items, size: int, key: float, item: int) -> None:
    """Put an item into a heap of `size` items; the arrays must be longer than that."""
    k = size
    while k > 0:
        up = (k - 1) // 2
        if keys[up] < key or (keys[up] == key and items[up] <= item):
            break
        keys[k], items[k] = keys[up], items[up]
        k = up
    keys[k], items[k] = key, item


@borrowing_kernel
def pop(keys: Array, items: Items, size: int) -> int:
    """Take the first item out of a heap of `size` items."""
    first, last = items[0], size - 1
    key, item = keys[last], items[last]
    k = 0
    while 2 * k + 1 < last:
        down = 2 * k + 1
        if down + 1 < last and (
            keys[down + 1] < keys[down]
            or (keys[down + 1] == keys[down] and items[down + 1] < items[down])
        ):
            down += 1
        if key < keys[down] or (key == keys[down] and item <= items[down]):
            break
        keys[k], items[k] = keys[down], items[down]
        k = down
    keys[k], items[k] = key, item
    return int(first)
