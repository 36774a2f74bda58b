"""Frontiers: free space beside unknown space (Yamauchi 1997)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from wheelchair_gym.maps import UNKNOWN, OccupancyGrid, geodesic

Array = NDArray[np.float64]


class Frontier(NamedTuple):
    """A stretch of cells where the unknown begins, as a chair can reach it."""

    place: Array  # (2,) m: its cell that is soonest reached
    path_length: float  # m to there
    length: float  # m, about: its cells


def find_frontiers(
    grid: OccupancyGrid, pose: ArrayLike, radius: float, min_length: float = 0.4
) -> list[Frontier]:
    """The frontiers on which a disc can stand and which it can reach, the nearest first.

    Args:
        grid: the map so far.
        pose: where the chair is (2 or 3,) [m, m, rad].
        radius: of the disc [m].
        min_length: shorter ones are gaps between beams [m].
    """
    unknown = np.pad(grid.cells == UNKNOWN, 1, constant_values=True)
    beside = unknown[:-2, 1:-1] | unknown[2:, 1:-1] | unknown[1:-1, :-2] | unknown[1:-1, 2:]
    edge = grid.traversable(radius) & beside
    labels, count = ndimage.label(edge, np.ones((3, 3)))
    if count == 0:
        return []
    cells = np.argwhere(edge)
    of = labels[edge] - 1
    places = grid.to_world(cells)
    ways = geodesic(grid, np.asarray(pose, dtype=np.float64)[:2], radius).at(places)
    lengths = np.bincount(of, minlength=count) * grid.resolution
    order = np.lexsort((ways, of))
    first = order[np.searchsorted(of[order], np.arange(count))]  # the soonest reached of each
    found = [
        Frontier(places[k], float(ways[k]), float(lengths[of[k]]))
        for k in first
        if np.isfinite(ways[k]) and lengths[of[k]] >= min_length
    ]
    return sorted(found, key=lambda one: one.path_length)
