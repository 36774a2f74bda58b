"""The outline of solid cells as straight segments."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.kernel import borrowing_kernel, kernel, whole
from wheelchair_gym.maps.distance import same

Array = NDArray[np.float64]
Cells = NDArray[np.int8]
Index = NDArray[np.int64]


@borrowing_kernel
def _put(out: Array, count: int, x0: int, y0: int, x1: int, y1: int) -> int:
    """Write a segment if there is room; how many there are then."""
    if count < len(out):
        out[count, 0], out[count, 1], out[count, 2], out[count, 3] = x0, y0, x1, y1
    return count + 1


@borrowing_kernel
def _runs(solid: Cells, changed: Index, lines: int, out: Array) -> int:
    """Write the segments between padded cells while there is room; count them all.

    A run goes on while the same side is solid. Where solid cells touch only at a corner the side
    changes, so runs end there and loops never cross. Only lines where a row differs from the next
    are looked at: along them run the level segments, and upright ones begin and end there.
    """
    count: int = whole(0)
    for i in range(lines):
        line = changed[i]
        side, begin = 0, whole(0)
        for k in range(solid.shape[1]):  # the padding at the end closes the last run
            here = int(solid[line + 1, k]) - int(solid[line, k])
            if here != side:
                # The padding shifts columns by one.
                if side > 0:
                    count = _put(out, count, begin - 1, line, k - 1, line)
                elif side < 0:
                    count = _put(out, count, k - 1, line, begin - 1, line)
                side, begin = here, k
    for k in range(solid.shape[1] - 1):
        side, begin = 0, whole(0)
        for i in range(lines):
            line = changed[i]
            here = int(solid[line + 1, k + 1]) - int(solid[line + 1, k])
            if here != side:
                if side > 0:
                    count = _put(out, count, k, line, k, begin)
                elif side < 0:
                    count = _put(out, count, k, begin, k, line)
                side, begin = here, line
    return count


@kernel
def boundary(solid: Cells) -> Array:
    """Edges between solid cells (rows, cols) and the rest, merged as far as they run straight.

    Args:
        solid: a number or, where free, 0.

    Returns:
        (n, 4) [cells], x0, y0, x1, y1 from the lower-left corner; solid cells on the left.
    """
    rows, cols = solid.shape
    padded = np.zeros((rows + 2, cols + 2), np.int8)
    for row in range(rows):
        for col in range(cols):
            padded[row + 1, col + 1] = solid[row, col]
    changed, lines = np.empty(rows + 1, np.int64), whole(0)
    for line in range(rows + 1):
        changed[lines] = line
        lines += not same(padded[line], padded[line + 1])
    out = np.empty((1024, 4))
    count = _runs(padded, changed, lines, out)
    if count > len(out):
        out = np.empty((count, 4))
        _runs(padded, changed, lines, out)
    return out[:count].copy()
