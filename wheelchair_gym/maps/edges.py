"""The outline of solid cells as straight segments."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.kernel import kernel

Array = NDArray[np.float64]


@kernel
def _runs(solid: NDArray[np.int8], upright: bool, out: Array, count: int) -> int:
    """Write the segments along the rows of padded cells while there is room; count them all.

    A run goes on while the same side is solid. Where solid cells touch only at a corner the side
    changes, so runs end there and loops never cross.
    """
    for line in range(solid.shape[0] - 1):
        side, begin = 0, 0
        for k in range(solid.shape[1]):  # the padding at the end closes the last run
            here = int(solid[line + 1, k]) - int(solid[line, k])
            if here == side:
                continue
            if side != 0:
                if count < out.shape[0]:
                    # The padding shifts columns by one.
                    first, last = (
                        (begin - 1, k - 1) if (side > 0) != upright else (k - 1, begin - 1)
                    )
                    if upright:
                        out[count, 0], out[count, 1] = line, first
                        out[count, 2], out[count, 3] = line, last
                    else:
                        out[count, 0], out[count, 1] = first, line
                        out[count, 2], out[count, 3] = last, line
                count += 1
            side, begin = here, k
    return count


def boundary(solid: NDArray[np.bool_]) -> Array:
    """Edges between solid cells (rows, cols) and the rest, merged as far as they run straight.

    Returns:
        (n, 4) [cells], x0, y0, x1, y1 from the lower-left corner; solid cells on the left.
    """
    flat = np.pad(solid.view(np.int8), 1)  # signed: differences count
    upright = np.ascontiguousarray(flat.T)
    out = np.empty((1024, 4))
    count = _runs(upright, True, out, _runs(flat, False, out, 0))
    if count > len(out):
        out = np.empty((count, 4))
        _runs(upright, True, out, _runs(flat, False, out, 0))
    return out[:count].copy()
