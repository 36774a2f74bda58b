"""What a chair assumes of a world that it has seen only a part of."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wheelchair_gym.geometry import Footprint
from wheelchair_gym.maps import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from wheelchair_gym.maps.distance import near

Array = NDArray[np.float64]

BLIND = 1.5  # m: what has not been seen so near the chair may be hit before it is seen
BESIDE = 0.10  # m round the circle in which the chair turns, where it is taken to stand free
JITTER = 2.0  # cells by which a wall that is seen anew may come nearer


def assumed(known: OccupancyGrid, pose: Array, footprint: Footprint) -> OccupancyGrid:
    """A map with what is unknown near the chair for solid, but where the chair could turn.

    What is unknown farther off is left so: planners take it for free (the free-space assumption:
    Koenig and Likhachev 2005), and the laser sees it before the chair is there.

    Args:
        known: what was seen so far.
        pose: of the chair (3,) [m, m, rad].
        footprint: of the chair.
    """
    turning = math.hypot(footprint.rear, footprint.half_width) + BESIDE
    return _told(_told(known, pose, turning, FREE), pose, BLIND, OCCUPIED)


def standing(known: OccupancyGrid, pose: Array, footprint: Footprint) -> OccupancyGrid:
    """A map with what the chair hides from itself for free, so that ways begin where it stands."""
    return _told(known, pose, footprint.reach, FREE)


def _told(known: OccupancyGrid, pose: Array, radius: float, value: int) -> OccupancyGrid:
    """A map with a value for all that is unknown within a radius [m] of a pose."""
    cells = known.cells.copy()
    (x, y), reach = known.to_lattice(pose[:2]), radius / known.resolution
    row, col = max(0, int(y - reach)), max(0, int(x - reach))
    part = cells[row : int(y + reach) + 1, col : int(x + reach) + 1]
    rows, cols = np.indices(part.shape)
    within = np.hypot(rows + row + 0.5 - y, cols + col + 0.5 - x) < reach
    part[within & (part == UNKNOWN)] = value
    return OccupancyGrid(cells, known.resolution, known.origin)


def walled(known: OccupancyGrid, way: ArrayLike, clearance: float) -> bool:
    """Whether anything solid stands nearer to a way (n, 2 or 3) [m] than it was planned to pass."""
    cells = known.to_cell(np.asarray(way, dtype=np.float64)[:, :2])
    cells = cells[((cells >= 0) & (cells < known.shape)).all(axis=1)]
    close = near(known.solid().view(np.int8), clearance / known.resolution - JITTER)
    return bool((close[cells[:, 0], cells[:, 1]] != 0).any())
