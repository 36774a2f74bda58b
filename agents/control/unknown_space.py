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

BEYOND = 5.0  # m: ways through the unknown may lead so far round
BLIND = 1.5  # m: what has not been seen so near the chair may be hit before it is seen
BESIDE = 0.10  # m round the chair, where it is taken to stand free
BEHIND = 0.25  # m: backing at 0.2 m/s comes to rest within
JITTER = 2.0  # cells by which a wall that is seen anew may come nearer


def assumed(known: OccupancyGrid, pose: Array, footprint: Footprint) -> list[OccupancyGrid]:
    """Maps to plan in, the next one where the last leads nowhere.

    What is unknown near the chair is solid in the first but where the chair stands: it sees nothing
    behind it, and had better go ahead before it turns. In the second it may turn, in the third it
    may go anywhere. What is unknown farther off is left so: planners take it for free (the
    free-space assumption: Koenig and Likhachev 2005), and the laser sees it before the chair is
    there.

    Args:
        known: what was seen so far.
        pose: of the chair (3,) [m, m, rad].
        footprint: of the chair.
    """
    low, high = footprint.corners[0] - BESIDE, footprint.corners[2] + BESIDE
    turning = math.hypot(footprint.rear, footprint.half_width) + BESIDE
    stands = _told(known, pose, FREE, lambda at: ((at > low) & (at < high)).all(axis=-1))
    turns = _told(known, pose, FREE, _round(turning))
    return [_told(each, pose, OCCUPIED, _round(BLIND)) for each in (stands, turns)] + [known]


def standing(known: OccupancyGrid, pose: Array, footprint: Footprint) -> OccupancyGrid:
    """A map with what the chair hides from itself for free, so that ways begin where it stands."""
    return _told(known, pose, FREE, _round(footprint.reach + BESIDE))


def _round(radius: float) -> Callable[[Array], NDArray[np.bool_]]:
    """Which points (..., 2) [m] in the chair's frame lie within a radius of its axle's centre."""
    return lambda at: np.hypot(at[..., 0], at[..., 1]) < radius


def _told(
    known: OccupancyGrid, pose: Array, value: int, chosen: Callable[[Array], NDArray[np.bool_]]
) -> OccupancyGrid:
    """A map with a value for what is unknown near a pose, where that is chosen.

    Args:
        known: the map.
        pose: (3,) [m, m, rad].
        value: of cells.
        chosen: which points (..., 2) [m] in the chair's frame, none farther than BLIND.
    """
    cells, reach = known.cells.copy(), math.ceil(BLIND / known.resolution)
    middle = known.to_cell(pose[:2])
    begin, end = np.maximum(middle - reach, 0), np.maximum(middle + reach + 1, 0)
    part = cells[begin[0] : end[0], begin[1] : end[1]]
    at = known.to_world(begin + np.moveaxis(np.indices(part.shape), 0, -1))
    part[chosen(to_frame(at, pose)) & (part == UNKNOWN)] = value
    return OccupancyGrid(cells, known.resolution, known.origin)


def blind_behind(known: OccupancyGrid, pose: Array, footprint: Footprint) -> bool:
    """Whether a strip behind the chair, as long as BEHIND, holds anything that was never seen."""
    x = -footprint.rear - np.linspace(0.0, BEHIND, 8)
    y = np.linspace(-footprint.half_width, footprint.half_width, 15)
    strip = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    cells = known.to_cell(to_world(strip, pose))
    on = ((cells >= 0) & (cells < known.shape)).all(axis=1)
    return bool(not on.all() or (known.cells[tuple(cells.T)] == UNKNOWN).any())


def walled(known: OccupancyGrid, way: ArrayLike, clearance: float) -> bool:
    """Whether anything solid stands nearer to a way (n, 2 or 3) [m] than it was planned to pass."""
    cells = known.to_cell(np.asarray(way, dtype=np.float64)[:, :2])
    cells = cells[((cells >= 0) & (cells < known.shape)).all(axis=1)]
    close = within_distance(known.solid().view(np.int8), clearance / known.resolution - JITTER)
    return bool((close[cells[:, 0], cells[:, 1]] != 0).any())
