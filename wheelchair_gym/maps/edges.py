"""The outline of solid cells as straight segments."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.kernel import kernel

Array = NDArray[np.float64]
Cells = NDArray[np.int8]
Index = NDArray[np.int64]


@kernel
def _put(out: Array, count: int, upright: bool, line: int, first: int, last: int) -> int:
    """Write a segment along a line if there is room; how many there are then."""
    if count < len(out):
        if upright:
            out[count, 0], out[count, 1], out[count, 2], out[count, 3] = line, first, line, last
        else:
            out[count, 0], out[count, 1], out[count, 2], out[count, 3] = first, line, last, line
    return count + 1


@kernel
def _runs(solid: Cells, changed: Index, lines: int, out: Array) -> int:
    """Write the segments between padded cells while there is room; count them all.

    A run goes on while the same side is solid. Where solid cells touch only at a corner the side
    changes, so runs end there and loops never cross. Only lines where a row differs from the next
    are looked at: along them run the level segments, and upright ones begin and end there.
    """
    count = 0
    for i in range(lines):
        line = changed[i]
        side, begin = 0, 0
        for k in range(solid.shape[1]):  # the padding at the end closes the last run
            here = int(solid[line + 1, k]) - int(solid[line, k])
            if here != side:
                # The padding shifts columns by one.
                if side > 0:
                    count = _put(out, count, False, line, begin - 1, k - 1)
                elif side < 0:
                    count = _put(out, count, False, line, k - 1, begin - 1)
                side, begin = here, k
    for k in range(solid.shape[1] - 1):
        side, begin = 0, 0
        for i in range(lines):
            line = changed[i]
            here = int(solid[line + 1, k + 1]) - int(solid[line + 1, k])
            if here != side:
                if side > 0:
                    count = _put(out, count, True, k, line, begin)
                elif side < 0:
                    count = _put(out, count, True, k, begin, line)
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
    changed, lines = np.empty(rows + 1, np.int64), 0
    for line in range(rows + 1):
        one, other = padded[line], padded[line + 1]
        differ = np.int8(0)
        for col in range(cols + 2):
            differ |= one[col] ^ other[col]
        changed[lines] = line
        lines += differ != 0
    out = np.empty((1024, 4))
    count = _runs(padded, changed, lines, out)
    if count > len(out):
        out = np.empty((count, 4))
        _runs(padded, changed, lines, out)
    return out[:count].copy()
