"""The open list of a search, and the path to one of its nodes.

The list is a binary heap in arrays; the smallest key comes first, of equal keys the smallest item.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.compiled.kernel import absorbed_kernel, kernel


class Heap(NamedTuple):
    """Items that wait, by their keys."""

    keys: Array  # (capacity,)
    items: NDArray[np.int64]  # (capacity,)
    size: NDArray[np.int64]  # (1,)


@kernel
def new_heap(capacity: int) -> Heap:
    """Return an empty heap; unused capacity takes no memory and no time."""
    return Heap(np.empty(capacity), np.empty(capacity, np.int64), np.zeros(1, np.int64))


@kernel
def enlarged(heap: Heap, capacity: int) -> Heap:
    """Return a heap with the same items and another capacity."""
    new, n = new_heap(capacity), heap.size[0]
    new.keys[:n], new.items[:n], new.size[0] = heap.keys[:n], heap.items[:n], n
    return new


@absorbed_kernel
def push(heap: Heap, key: float, item: int) -> None:
    """Put an item into a heap, which must have space for it."""
    keys, items, k = heap.keys, heap.items, heap.size[0]
    heap.size[0] += 1
    while k > 0:
        up = (k - 1) // 2
        if keys[up] < key or (keys[up] == key and items[up] <= item):
            break
        keys[k], items[k] = keys[up], items[up]
        k = up
    keys[k], items[k] = key, item


@absorbed_kernel
def pop(heap: Heap) -> int:
    """Take the first item out of a heap."""
    keys, items, last = heap.keys, heap.items, heap.size[0] - 1
    heap.size[0] = last
    first, key, item = items[0], keys[last], items[last]
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


@kernel
def nodes_to(parent: NDArray[np.int64], i: int) -> NDArray[np.int64]:
    """Return the nodes from the root to node i; the root's parent is below 0, or itself."""
    count, k = 1, i
    while 0 <= parent[k] != k:
        count, k = count + 1, parent[k]
    nodes = np.empty(count, np.int64)
    for m in range(count - 1, -1, -1):
        nodes[m], i = i, parent[i]
    return nodes
