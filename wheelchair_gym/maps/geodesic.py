"""Shortest ways round obstacles to a goal: the one measure for guidance, solvability and SPL."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wheelchair_gym.geometry import path_length
from wheelchair_gym.kernel import kernel
from wheelchair_gym.maps.distance import chessboard
from wheelchair_gym.maps.grid import OccupancyGrid

Array = NDArray[np.float64]
Field = NDArray[np.float32]
Mask = NDArray[np.bool_]
Steps = NDArray[np.int16]

_GOAL = -1  # the parent of cells that see the goal itself
_NONE = -2
_STACKS = 8  # each for half a cell of length: a step is at most sqrt(2) long
_ROWS = (1, 0, -1, 0, 1, 1, -1, -1)
_COLS = (0, 1, 0, -1, 1, -1, 1, -1)
_MARGIN = 1.5  # cells beyond the radius in which a point still counts as beside reachable ground


@kernel
def sees(free: Mask, room: Steps, x0: float, y0: float, x1: float, y1: float) -> bool:
    """Whether the straight line between two points [cell centres] stays on free cells.

    It steps by the room round each point (`room`: king's steps to the nearest cell that is not
    free), so open ground costs a few steps only; a corner may be cut by a tenth of a cell.
    """
    length = math.hypot(x1 - x0, y1 - y0)
    if length == 0.0:
        return True
    ux, uy = (x1 - x0) / length, (y1 - y0) / length
    fastest = max(abs(ux), abs(uy))
    t = 0.0
    while t < length:
        x, y = x0 + t * ux, y0 + t * uy
        col, row = np.uint32(x + 0.5), np.uint32(y + 0.5)  # unsigned: no wrap-around test
        if not free[row, col]:
            return False
        t += max(0.2, (room[row, col] - 0.5 - max(abs(x - col), abs(y - row))) / fastest)
    return bool(free[np.uint32(y1 + 0.5), np.uint32(x1 + 0.5)])


@kernel
def _inherits(
    parent: NDArray[np.int32], cols: int, p: int, px: float, py: float, row: int, col: int
) -> bool:
    """Whether the two cells that the line to a parent enters next both see that parent.

    Then so does the cell itself: between two lines of sight a cell apart, nothing fits.
    """
    ex, ey = px - col, py - row
    if abs(ex) >= abs(ey):
        if abs(ex) < 2.0:
            return False
        step = 1 if ex > 0.0 else -1
        y = row + ey / abs(ex)
        below = math.floor(y)
        first = below * cols + col + step
        return bool(parent[first] == p and (y == below or parent[first + cols] == p))
    if abs(ey) < 2.0:
        return False
    step = 1 if ey > 0.0 else -1
    x = col + ex / abs(ey)
    below = math.floor(x)
    first = (row + step) * cols + below
    return bool(parent[first] == p and (x == below or parent[first + 1] == p))


@kernel
def _spread(
    free: Mask, room: Steps, goal_x: float, goal_y: float, seed: int
) -> tuple[Field, NDArray[np.int32]]:
    """Any-angle distances [cells] to the goal, and where each cell's way bends first.

    Theta* (Nash et al. 2007) run outwards from the goal over the whole grid: a cell takes over its
    neighbour's parent if it sees it. Cells wait in a ring of stacks, each for half a cell of
    length, and wait again if a shorter way turns up, so the order within a stack does not matter.
    """
    rows, cols = free.shape
    size = rows * cols
    length = np.full(size, np.inf, np.float32)
    parent = np.full(size, _NONE, np.int32)
    pending = np.zeros(size, np.bool_)
    below = np.empty(8 * size, np.int32)  # the entry beneath each one in its stack
    entry = np.empty(8 * size, np.int32)
    top = np.full(_STACKS, -1, np.int32)
    length[seed] = math.hypot(seed % cols - goal_x, seed // cols - goal_y)
    parent[seed] = _GOAL
    pending[seed] = True
    level = int(2.0 * length[seed])
    entry[0], below[0], entries = seed, -1, 1
    top[level % _STACKS] = 0
    idle = 0
    while idle < _STACKS:
        stack = level % _STACKS
        if top[stack] < 0:
            level += 1
            idle += 1
            continue
        idle = 0
        u = entry[top[stack]]
        top[stack] = below[top[stack]]
        if not pending[u]:
            continue
        pending[u] = False
        row = u // cols
        col = u - row * cols
        p = parent[u]
        px, py, base = goal_x, goal_y, 0.0
        if p != _GOAL:
            py = float(p // cols)
            px, base = p - py * cols, float(length[p])
        tight = room[row, col] < 2  # else all eight neighbours are free
        for k in range(8):
            dr, dc = _ROWS[k], _COLS[k]
            r, c = row + dr, col + dc
            v = u + dr * cols + dc
            if tight:
                if r < 0 or c < 0 or r >= rows or c >= cols or not free[r, c]:
                    continue
                if k > 3 and not (free[row, c] and free[r, col]):
                    continue
            if parent[np.uint32(v)] == p:
                continue
            ex, ey = c - px, r - py
            way = base + math.sqrt(ex * ex + ey * ey)
            if way >= length[v] - 1e-2:
                continue
            via = p
            if not (
                _inherits(parent, cols, p, px, py, r, c)
                or sees(free, room, float(c), float(r), px, py)
            ):
                way = length[u] + (math.sqrt(2.0) if k > 3 else 1.0)
                via = u
                if way >= length[v] - 1e-2:
                    continue
            length[v] = way
            parent[v] = via
            if entries < entry.size:
                pending[v] = True
                stack = max(level, int(2.0 * way)) % _STACKS
                entry[entries], below[entries] = v, top[stack]
                top[stack] = entries
                entries += 1
    return length.reshape(rows, cols), parent


@kernel
def _extended(length: Field, band: float) -> tuple[Field, NDArray[np.int32]]:
    """Distances carried on into cells within `band` [cells] of reachable ones, and from which.

    Two sweeps, down and up, hand the nearest reachable cell on from neighbour to neighbour.
    """
    rows, cols = length.shape
    out = length.copy()
    source = np.full((rows, cols), -1, np.int32)
    for row in range(rows):
        for col in range(cols):
            if length[row, col] < np.inf:
                source[row, col] = row * cols + col
    limit = band * band
    for turn in range(2):
        way = 1 if turn == 0 else -1
        for i in range(rows):
            row = i if turn == 0 else rows - 1 - i
            for j in range(cols):
                col = j if turn == 0 else cols - 1 - j
                if length[row, col] < np.inf:
                    continue
                best, least = -1, limit
                for k in range(5):  # its own source so far, then four neighbours
                    r, c = row - way * (k > 1), col - way if k == 1 else col
                    if k > 1:
                        c = col + k - 3
                    if r < 0 or c < 0 or r >= rows or c >= cols or source[r, c] < 0:
                        continue
                    y = source[r, c] // cols
                    x = source[r, c] - y * cols
                    gap = float((y - row) ** 2 + (x - col) ** 2)
                    if gap <= least:
                        best, least = source[r, c], gap
                if best >= 0:
                    source[row, col] = best
                    out[row, col] = length[best // cols, best % cols] + math.sqrt(least)
    return out, source.ravel()


@kernel
def interpolate(field: Field, x: float, y: float) -> float:
    """A field's value at a point [cells from the lower-left corner], bilinear over finite cells."""
    rows, cols = field.shape
    if not (-1.0 <= x <= cols + 1.0 and -1.0 <= y <= rows + 1.0):
        return math.inf
    x = min(max(x - 0.5, 0.0), cols - 1.0)
    y = min(max(y - 0.5, 0.0), rows - 1.0)
    col, row = min(int(x), max(cols - 2, 0)), min(int(y), max(rows - 2, 0))
    total, weights = 0.0, 0.0
    for r in range(row, min(row + 2, rows)):
        for c in range(col, min(col + 2, cols)):
            weight = (1.0 - abs(x - c)) * (1.0 - abs(y - r))
            if weight > 0.0 and field[r, c] < math.inf:
                total += weight * field[r, c]
                weights += weight
    return total / weights if weights > 0.0 else math.inf


@kernel
def _interpolated(field: Field, points: Array) -> Array:
    out = np.empty(points.shape[0])
    for k in range(points.shape[0]):
        out[k] = interpolate(field, points[k, 0], points[k, 1])
    return out


@dataclass(frozen=True, eq=False)
class Geodesic:
    """Shortest ways to one goal for a disc: lengths everywhere, and the way from any start."""

    grid: OccupancyGrid
    goal: Array  # (2,) m
    radius: float  # m
    field: Field  # (rows, cols) m; infinite where the goal cannot be reached
    extended: Field  # the same, carried on a radius and a cell into what is too near obstacles
    _free: Mask
    _room: Steps
    _parent: NDArray[np.int32]  # (rows * cols,): where each cell's way bends first
    _source: NDArray[np.int32]  # (rows * cols,): the nearest reachable cell, -1 if none is near

    def at(self, points: ArrayLike) -> Array:
        """Length of the shortest way [m] from points (..., 2) [m].

        A point slightly too near an obstacle counts from the nearest reachable cell; far from
        reachable ground the length is infinite.
        """
        lattice = self.grid.to_lattice(points)
        return _interpolated(self.extended, lattice.reshape(-1, 2)).reshape(lattice.shape[:-1])

    def path(self, start: ArrayLike) -> Array:
        """The shortest way (n, 2) [m] from a start (2,) [m] to the goal, empty if there is none."""
        begin = self.grid.to_lattice(start)[:2] - 0.5  # (x, y) from the centre of cell (0, 0)
        rows, cols = self.grid.shape
        col, row = math.floor(begin[0]), math.floor(begin[1])
        around = [(r, c) for r in (row, row + 1) for c in (col, col + 1)]
        near = {
            int(self._source[r * cols + c]) for r, c in around if 0 <= r < rows and 0 <= c < cols
        }
        if near <= {-1} or not self.grid.inside(np.asarray(start)[:2]):
            return np.empty((0, 2))
        ways = [self._way(begin, cell) for cell in sorted(near - {-1})]
        return self.grid.from_lattice(min(ways, key=path_length) + 0.5)

    def _way(self, begin: Array, cell: int) -> Array:
        """The way (n, 2) [cell centres] from a point by a cell beside it, needless bends out."""
        cols = self.grid.shape[1]
        bends = [begin]
        while cell >= 0:
            bends.append(np.array([cell % cols, cell // cols], dtype=np.float64))
            cell = int(self._parent[cell])
        bends.append(self.grid.to_lattice(self.goal) - 0.5)
        way = [begin]
        for bend, after in itertools.pairwise(bends[1:]):
            if not sees(self._free, self._room, *way[-1], *after):
                way.append(bend)
        return np.array([*way, bends[-1]])


def geodesic(grid: OccupancyGrid, goal: ArrayLike, radius: float) -> Geodesic:
    """Shortest ways over free cells for a disc that keeps `radius` from all that is occupied.

    Lengths are those of ways that bend at cell centres, at most 1 % longer than the shortest.

    Args:
        grid: the map; unknown cells are not entered.
        goal: (2,) [m]; if it lies too near an obstacle, ways end at the nearest cell that does not.
        radius: of the disc [m].
    """
    target = np.asarray(goal, dtype=np.float64)[:2]
    free = grid.traversable(radius)
    room = chessboard(free)
    band = radius / grid.resolution + _MARGIN
    lattice = grid.to_lattice(target) - 0.5
    rows, cols = free.shape
    x, y = np.clip(lattice, 0.0, (cols - 1, rows - 1))
    seed = _nearest(free, x, y, band) if grid.inside(target) else -1
    if seed < 0:
        length = np.full(free.shape, np.inf, dtype=np.float32)
        parent = np.full(free.size, _NONE, dtype=np.int32)
    else:
        length, parent = _spread(free, room, float(x), float(y), seed)
    extended, source = _extended(length, band)
    scale = np.float32(grid.resolution)
    return Geodesic(
        grid, target, radius, length * scale, extended * scale, free, room, parent, source
    )


def _nearest(free: Mask, x: float, y: float, band: float) -> int:
    """Index of the free cell nearest to a point [cell centres] and within `band` of it, or -1."""
    cols = free.shape[1]
    r0, c0 = max(0, math.floor(y - band)), max(0, math.floor(x - band))
    window = free[r0 : max(0, math.ceil(y + band) + 1), c0 : max(0, math.ceil(x + band) + 1)]
    row, col = np.nonzero(window)
    if len(row) == 0:
        return -1
    gap = np.hypot(row + r0 - y, col + c0 - x)
    best = int(gap.argmin())
    return int((row[best] + r0) * cols + col[best] + c0) if gap[best] <= band else -1
