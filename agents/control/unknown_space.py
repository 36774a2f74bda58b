"""What a chair assumes of a world that it has seen only a part of."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wheelchair_gym.geometry import Footprint, to_frame, to_world
from wheelchair_gym.maps import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from wheelchair_gym.maps.distance import within_distance

Array = NDArray[np.float64]

BEYOND = 5.0  # m: paths through unknown space may lead so far round
BLIND = 1.5  # m: an unseen obstacle so near the chair may be hit before it is seen
BESIDE = 0.10  # m round the chair, where the space is taken to be free
BEHIND = 0.25  # m: backing at 0.2 m/s comes to rest within
JITTER = 2.0  # cells by which a wall that is seen anew may come nearer


def assumed_maps(grid: OccupancyGrid, pose: Array, footprint: Footprint) -> list[OccupancyGrid]:
    """Maps to plan in, the next one where the last leads nowhere.

    Unknown space near the chair is solid in the first except where the chair stands: it sees
    nothing behind it, and had better go ahead before it turns. In the second it may turn, in the
    third it may go anywhere. Unknown space farther off stays unknown: planners take it for free
    (the free-space assumption: Koenig and Likhachev 2005), and the laser sees it before the chair
    is there.

    Args:
        grid: what was seen so far.
        pose: of the chair (3,) [m, m, rad].
        footprint: of the chair.
    """
    low, high = footprint.corners[0] - BESIDE, footprint.corners[2] + BESIDE
    turning = math.hypot(footprint.rear, footprint.half_width) + BESIDE
    stands = _fill(grid, pose, FREE, lambda at: ((at > low) & (at < high)).all(axis=-1))
    turns = _fill(grid, pose, FREE, _within(turning))
    return [_fill(each, pose, OCCUPIED, _within(BLIND)) for each in (stands, turns)] + [grid]


def with_free_footprint(grid: OccupancyGrid, pose: Array, footprint: Footprint) -> OccupancyGrid:
    """A map in which the unknown space under and beside the chair is free, so that paths begin."""
    return _fill(grid, pose, FREE, _within(footprint.reach + BESIDE))


def _within(radius: float) -> Callable[[Array], NDArray[np.bool_]]:
    """Which points (..., 2) [m] in the chair's frame lie within a radius of its axle's centre."""
    return lambda at: np.hypot(at[..., 0], at[..., 1]) < radius


def _fill(
    grid: OccupancyGrid, pose: Array, value: int, chosen: Callable[[Array], NDArray[np.bool_]]
) -> OccupancyGrid:
    """A map with a value for chosen unknown cells near a pose, none farther than BLIND.

    `chosen` tells which points (..., 2) [m] in the chair's frame.
    """
    cells, reach = grid.cells.copy(), math.ceil(BLIND / grid.resolution)
    middle = grid.to_cell(pose[:2])
    begin, end = np.maximum(middle - reach, 0), np.maximum(middle + reach + 1, 0)
    part = cells[begin[0] : end[0], begin[1] : end[1]]
    at = grid.to_world(begin + np.moveaxis(np.indices(part.shape), 0, -1))
    part[chosen(to_frame(at, pose)) & (part == UNKNOWN)] = value
    return OccupancyGrid(cells, grid.resolution, grid.origin)


def blind_behind(grid: OccupancyGrid, pose: Array, footprint: Footprint) -> bool:
    """Whether a strip behind the chair, as long as BEHIND, holds anything that was never seen."""
    x = -footprint.rear - np.linspace(0.0, BEHIND, 8)
    y = np.linspace(-footprint.half_width, footprint.half_width, 15)
    strip = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    cells = grid.to_cell(to_world(strip, pose))
    on = ((cells >= 0) & (cells < grid.shape)).all(axis=1)
    return bool(not on.all() or (grid.cells[tuple(cells.T)] == UNKNOWN).any())


def walls_block(grid: OccupancyGrid, way: ArrayLike, clearance: float) -> bool:
    """Whether a wall is nearer to a way (n, 2 or 3) [m] than it was planned to pass."""
    cells = grid.to_cell(np.asarray(way, dtype=np.float64)[:, :2])
    cells = cells[((cells >= 0) & (cells < grid.shape)).all(axis=1)]
    close = within_distance(grid.solid().view(np.int8), clearance / grid.resolution - JITTER)
    return bool((close[cells[:, 0], cells[:, 1]] != 0).any())
