"""Assumptions of a chair about a world that it has seen only a part of."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.geometry.outline import Footprint
from wheelchair_gym.geometry.planar import to_frame, to_world
from wheelchair_gym.maps import FREE, OCCUPIED, UNKNOWN, OccupancyGrid, open_floor
from wheelchair_gym.maps.distance import within_distance

MAP_MARGIN = 5.0  # m: policies extend a map by this, so that paths may lead through the unknown
BLIND = 1.5  # m: an unseen obstacle nearer than this may be hit before it is seen
BESIDE = 0.10  # m round the chair, where the space is taken to be free
BEHIND = 0.25  # m: stopping distance in reverse at 0.2 m/s
SPACING = 0.025  # m between the points under the outline, and the smallest move that is stamped
RESERVE = 128  # extra cells of the rasters of `FloorMemory` when they grow
# m: a square this wide must be all free to count as open floor; smaller free patches may be an
# error in where a wall lies
FLOOR = 0.2
MIN_TURN = 0.05  # rad: smallest turn that is stamped
JITTER = 2.0  # cells by which a wall may seem nearer when it is seen again


def assumed_maps(grid: OccupancyGrid, pose: Array, footprint: Footprint) -> list[OccupancyGrid]:
    """Return three maps to plan in; each is tried if the one before leads nowhere.

    1. Unknown space within `BLIND` is solid, except where the chair stands: it sees nothing behind
       it, so it drives forward before it turns.
    2. The same, but the circle in which the chair turns on the spot is free.
    3. The map as it is.

    Other unknown space stays unknown: planners take it for free (the free-space assumption: Koenig
    and Likhachev 2005), and the laser sees it before the chair is there. Callers rely on the order:
    `Surroundings.blocks_now` takes the second, `Search` treats the last differently.

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
    """Return a map in which unknown space under and beside the chair is free: paths begin there."""
    return _fill(grid, pose, FREE, _within(footprint.reach + BESIDE))


def _within(radius: float) -> Callable[[Array], NDArray[np.bool_]]:
    """Return which points (..., 2) [m] in the chair's frame lie near its axle's centre."""
    return lambda at: np.hypot(at[..., 0], at[..., 1]) < radius


def _fill(
    grid: OccupancyGrid, pose: Array, value: int, chosen: Callable[[Array], NDArray[np.bool_]]
) -> OccupancyGrid:
    """Return a map with a value in chosen unknown cells within `BLIND` of a pose.

    `chosen` tells which points (..., 2) [m] in the chair's frame are chosen.
    """
    cells, reach = grid.cells.copy(), math.ceil(BLIND / grid.resolution)
    middle = grid.to_cell(pose[:2])
    begin, end = np.maximum(middle - reach, 0), np.maximum(middle + reach + 1, 0)
    part = cells[begin[0] : end[0], begin[1] : end[1]]
    at = grid.to_world(begin + np.moveaxis(np.indices(part.shape), 0, -1))
    part[chosen(to_frame(at, pose)) & (part == UNKNOWN)] = value
    return OccupancyGrid(cells, grid.resolution, grid.origin)


class FloorMemory:
    """Memory of floor that the newest map lacks, for a chair that draws its map itself.

    Floor on which the chair has stood is free, even if the laser never saw it. Floor that was open
    may be open again: a door opens, a person goes on.

    Args:
        footprint: of the chair.
    """

    def __init__(self, footprint: Footprint) -> None:
        low, high = footprint.corners[0], footprint.corners[2]
        sides = [np.arange(a, b, SPACING) for a, b in zip(low, high, strict=True)]
        self._under = np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 2)
        self._stood = np.zeros((0, 0), np.bool_)  # raster of cells on which the chair has stood
        self._open = np.zeros((0, 0), np.bool_)  # raster of cells that have been open floor
        self._first = np.zeros(2, np.int64)  # row and column of their first cell, from (0, 0)
        self._pose = np.full(3, np.inf)  # where cells were last added
        self._grid: OccupancyGrid | None = None  # the last map given
        self._freed_grid: OccupancyGrid | None = None  # the map returned for it

    def with_stood_cells_free(self, grid: OccupancyGrid, pose: Array) -> OccupancyGrid:
        """Return a map in which unknown cells where the chair stands (pose (3,)) or stood are free.

        The cells of all maps given must be those of one endless grid about (0, 0), as SLAM's are.
        """
        distance, turn = np.hypot(*(pose[:2] - self._pose[:2])), abs(pose[2] - self._pose[2])
        moved = distance > SPACING or turn > MIN_TURN
        if moved:
            at = np.floor(to_world(self._under, pose) / grid.resolution).astype(np.int64)[:, ::-1]
            self._grow_to_hold(at.min(axis=0), at.max(axis=0) + 1)
            self._stood[tuple((at - self._first).T)] = True
            self._pose = pose.copy()
        if grid is not self._grid:
            begin = _first_cell(grid)
            self._grow_to_hold(begin, begin + grid.shape)
            row, column = begin - self._first
            part = self._open[row : row + grid.shape[0], column : column + grid.shape[1]]
            part |= open_floor(grid, FLOOR)
        if moved or grid is not self._grid or self._freed_grid is None:
            self._freed_grid = self._freed(grid, self._stood, UNKNOWN)
            self._grid = grid
        return self._freed_grid

    def reopened(self, grid: OccupancyGrid) -> OccupancyGrid:
        """Return the map with occupied cells freed where floor was open; itself if none are."""
        return self._freed(grid, self._open, OCCUPIED)

    def forget_open(self) -> None:
        """Forget all floor that was open."""
        self._open[:] = False

    def _freed(self, grid: OccupancyGrid, where: NDArray[np.bool_], old: int) -> OccupancyGrid:
        """Return the map with the cells freed that have an old value and are set in a raster."""
        first = self._first - _first_cell(grid)  # in the map's rows and columns
        begin = np.maximum(first, 0)
        end = np.minimum(first + where.shape, grid.shape)
        if (begin >= end).any():
            return grid
        (row, column), (last_row, last_column) = begin - first, end - first
        part = np.s_[begin[0] : end[0], begin[1] : end[1]]
        chosen = where[row:last_row, column:last_column] & (grid.cells[part] == old)
        if not chosen.any():
            return grid
        cells = grid.cells.copy()
        cells[part][chosen] = FREE
        return OccupancyGrid(cells, grid.resolution, grid.origin)

    def _grow_to_hold(self, begin: NDArray[np.int64], end: NDArray[np.int64]) -> None:
        """Grow the rasters until they hold the cells from begin to end."""
        if not self._stood.size:
            self._first = begin
        last = self._first + self._stood.shape
        before = np.where(begin < self._first, self._first - begin + RESERVE, 0)
        after = np.where(end > last, end - last + RESERVE, 0)
        if before.any() or after.any():
            around = np.stack([before, after], axis=-1)
            self._stood, self._open = np.pad(self._stood, around), np.pad(self._open, around)
            self._first = self._first - before


def _first_cell(grid: OccupancyGrid) -> NDArray[np.int64]:
    """Row and column (2,) of a map's first cell, counted from (0, 0) [m]."""
    left, bottom = np.round(np.array(grid.origin[:2]) / grid.resolution).astype(np.int64)
    return np.array([bottom, left])


def blind_behind(grid: OccupancyGrid, pose: Array, footprint: Footprint) -> bool:
    """Return True if a strip of length `BEHIND` behind the chair has a cell that was never seen.

    Cells behind a wall do not count: nothing comes through, and the chair does not drive there.
    """
    x = -footprint.rear - np.linspace(0.0, BEHIND, 8)
    y = np.linspace(-footprint.half_width, footprint.half_width, 15)
    there = cells_at(grid, to_world(np.stack(np.meshgrid(x, y), axis=-1), pose))  # (15, 8)
    open_so_far = np.logical_and.accumulate(there != OCCUPIED, axis=1)
    return bool(((there == UNKNOWN) & open_so_far).any())


def cells_at(grid: OccupancyGrid, points: Array) -> NDArray[np.int8]:
    """Return a grid's cells (...) at points (..., 2) [m]; unknown outside the grid."""
    cells = grid.to_cell(points)
    on = ((cells >= 0) & (cells < grid.shape)).all(axis=-1)
    found = np.full(on.shape, UNKNOWN, np.int8)
    found[on] = grid.cells[tuple(cells[on].T)]
    return found


def walls_block(grid: OccupancyGrid, path: ArrayLike, clearance: float) -> bool:
    """Return True if a wall is nearer to a path (n, 2 or 3) [m] than its planned clearance."""
    cells = grid.to_cell(np.asarray(path, dtype=np.float64)[:, :2])
    cells = cells[((cells >= 0) & (cells < grid.shape)).all(axis=1)]
    close = within_distance(grid.solid().view(np.int8), clearance / grid.resolution - JITTER)
    return bool((close[cells[:, 0], cells[:, 1]] != 0).any())
