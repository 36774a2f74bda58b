"""How tight a place is: the widest way between two points, and its narrowest spot."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import ArrayLike

from wheelchair_gym.maps.grid import FREE, OccupancyGrid


def bottleneck(grid: OccupancyGrid, start: ArrayLike, goal: ArrayLike) -> float:
    """The greatest radius [m] of a disc that gets from start to goal, measured at cell centres.

    It is the largest minimum of the distance to what is solid, over all ways; -inf where there is
    no way at all. Found by bisection over the connected regions of each radius.

    Args:
        grid: the map; unknown cells are not entered.
        start: (2,) [m].
        goal: (2,) [m].
    """
    if not (grid.inside(start) and grid.inside(goal)):
        return -np.inf
    (r0, c0), (r1, c1) = grid.to_cell(start), grid.to_cell(goal)
    gap = np.where(grid.cells == FREE, grid.distance(), -1.0)
    low, high = -np.inf, float(min(gap[r0, c0], gap[r1, c1]))
    levels = np.unique(gap[(gap >= 0.0) & (gap <= high)])
    first, last = 0, len(levels)  # the answer's index is below last; below first all radii pass
    while first < last:
        middle = (first + last) // 2
        wide = (gap >= levels[middle]).astype(np.uint8)
        _, region = cv2.connectedComponents(wide, connectivity=8)
        if region[r0, c0] and region[r0, c0] == region[r1, c1]:
            low, first = float(levels[middle]), middle + 1
        else:
            last = middle
    return low
