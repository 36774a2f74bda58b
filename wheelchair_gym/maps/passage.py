"""Width: of passages from start to goal, for discs and footprints; and floor that is open."""

from bisect import bisect_left

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage, sparse
from scipy.sparse import csgraph

from wheelchair_gym.base.arrays import Array, Mask
from wheelchair_gym.geometry.outline import Footprint
from wheelchair_gym.maps.grid import FREE, OccupancyGrid

_CELL = 0.02  # m, of the flood of poses
_HEADINGS = np.radians(np.arange(0.0, 180.0, 3.0))  # of a rectangle, which is the same half round
_ROUND = 1.5  # m round everything, for ways that lead outside
_RIM = 4  # cells: poses beside each other move no corner as far
_SHIFT = 4  # bits of a cell that drawing knows


def bottleneck(
    grid: OccupancyGrid, start: ArrayLike, goal: ArrayLike, *, corners: bool = True
) -> float:
    """The greatest radius [m] of a disc that gets from start to goal, measured at cell centres.

    It is the largest minimum of the distance to what is solid, over all ways; -inf where there is
    no way at all. Found by bisection over the connected regions of each radius.

    Args:
        grid: the map; unknown cells are not entered.
        start: (2,) [m].
        goal: (2,) [m].
        corners: a way may lead between cells that touch at a corner only; those of `geodesic` never
            do.
    """
    if not (grid.inside(start) and grid.inside(goal)):
        return -np.inf
    (r0, c0), (r1, c1) = grid.to_cell(start), grid.to_cell(goal)
    gap = np.where(grid.cells == FREE, grid.distance(), -1.0)
    levels = np.unique(gap[(gap >= 0.0) & (gap <= min(gap[r0, c0], gap[r1, c1]))])

    def is_stuck(radius: float) -> bool:
        wide = (gap >= radius).astype(np.uint8)
        _, region = cv2.connectedComponents(wide, connectivity=8 if corners else 4)
        return bool(not region[r0, c0] or region[r0, c0] != region[r1, c1])

    passing = bisect_left(levels, True, key=is_stuck)  # how many of the radii pass
    return float(levels[passing - 1]) if passing else -np.inf


def open_floor(grid: OccupancyGrid, side: float) -> Mask:
    """Cells (rows, cols) of squares with a side [m] of free cells alone."""
    n = max(1, round(side / grid.resolution))
    square, free = np.ones((n, n), np.uint8), (grid.cells == FREE).view(np.uint8)
    # Anchors at opposite corners: about the middle, squares of an even side come out a cell off.
    corners = cv2.erode(free, square, anchor=(0, 0), borderValue=0)
    return cv2.dilate(corners, square, anchor=(n - 1, n - 1), borderValue=0) > 0


def footprint_margin(
    walls: Array, discs: Array, start: ArrayLike, goal: ArrayLike, footprint: Footprint
) -> float:
    """Return how far [m] an outline may grow on every side and still get from start to goal.

    A flood of poses on 2 cm and 3 degrees, in steps of 1 cm from -5 to 10 cm: right to about 1 cm.
    Any rigid motion counts, turns included, and at the goal any heading.

    Args:
        walls: (n, 4) [m].
        discs: (m, 3) [m].
        start: (3,) [m, m, rad].
        goal: (2,) [m] or more.
        footprint: the outline.
    """
    ends = np.asarray(start, dtype=np.float64), np.asarray(goal, dtype=np.float64)[:2]
    seen = np.vstack([walls.reshape(-1, 2), discs[:, :2], ends[0][:2], ends[1]])
    low = seen.min(axis=0) - _ROUND  # nothing is farther out
    cols, rows = np.ceil((seen.max(axis=0) + _ROUND - low) / _CELL).astype(int) + 1
    solid = np.zeros((rows, cols), np.uint8)
    fine = 1 << _SHIFT
    for wall in walls:
        a, b = np.round((wall.reshape(2, 2) - low) / _CELL * fine).astype(int)
        cv2.line(solid, a.tolist(), b.tolist(), 1, 1, cv2.LINE_8, _SHIFT)
    for *centre, radius in discs:
        at = np.round((np.array(centre) - low) / _CELL * fine).astype(int)
        inner = max(0, round((radius / _CELL - 0.5) * fine))
        cv2.circle(solid, at.tolist(), inner, 1, -1, cv2.LINE_8, _SHIFT)
    ahead = 0.5 * (footprint.front - footprint.rear)  # from the axle to the outline's middle
    half = np.array([0.5 * (footprint.front + footprint.rear), footprint.half_width])

    def passes(growth: int) -> bool:  # of cm
        free = _free(solid, (half + 0.01 * growth) / _CELL)
        return _connected(free, low, ahead, *ends)

    return 0.01 * (10 - bisect_left(range(10, -5, -1), True, key=passes))


def _free(solid: NDArray[np.uint8], half: Array) -> NDArray[np.bool_]:
    """Return a rectangle's free poses (heading, row, column) in half a turn; half sides [cells]."""
    reach = int(np.hypot(*half)) + 2
    u, v = np.meshgrid(*2 * [np.arange(-reach, reach + 1)])
    layers = []
    for yaw in _HEADINGS:
        c, s = np.cos(yaw), np.sin(yaw)
        far = np.maximum(np.abs(c * u + s * v) - half[0], np.abs(c * v - s * u) - half[1])
        # The rim will do: no motion brings what is solid to its inside, and steps are shorter.
        rim = ((far <= 0.0) & (far > -_RIM)).astype(np.uint8)
        layers.append(cv2.dilate(solid, rim) == 0)
    return np.array(layers)


def _connected(
    free: NDArray[np.bool_], low: Array, ahead: float, start: Array, goal: Array
) -> bool:
    """Whether poses lead from one to the other."""
    regions, count = ndimage.label(free)
    joined = (regions[0] > 0) & (regions[-1] > 0)  # half a turn on, a rectangle is the same
    pairs = regions[0][joined], regions[-1][joined]
    graph = sparse.coo_matrix((np.ones(len(pairs[0])), pairs), shape=(count + 1, count + 1))
    groups = csgraph.connected_components(graph, directed=False)[1]

    def at(x: float, y: float, yaw: float) -> int:
        """The group of the pose whose axle's centre is there; -1 where it is not free."""
        k = round(yaw % np.pi / _HEADINGS[1]) % len(_HEADINGS)
        middle = np.array([x + ahead * np.cos(yaw), y + ahead * np.sin(yaw)])
        col, row = np.round((middle - low) / _CELL).astype(int)
        inside = 0 <= row < free.shape[1] and 0 <= col < free.shape[2]
        return int(groups[regions[k, row, col]]) if inside and free[k, row, col] else -1

    begin = at(start[0], start[1], start[2])
    turns = (*_HEADINGS, *(_HEADINGS + np.pi))
    return begin >= 0 and begin in {at(goal[0], goal[1], yaw) for yaw in turns}
