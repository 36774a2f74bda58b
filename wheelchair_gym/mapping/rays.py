"""Exact rays through a grid of log-odds, and the field that follows what they change.

Kernels; lengths are in cells from the lower-left corner of cell (0, 0).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.kernel import borrowing_kernel, inlined, kernel

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Index = NDArray[np.uint32]
Marks = NDArray[np.int32]
Mask = NDArray[np.bool_]


PARTS = 8  # of a cell's side: how finely the field knows where in its cell a surface is
_MOST_HITS = 128.0  # of which a cell keeps the mean; older ones count less and less from then on


class Odds(NamedTuple):
    """Log-odds of `MappingSettings`."""

    hit: float
    miss: float
    least: float
    most: float
    occupied: float


@borrowing_kernel
def cells_passed(x0: float, y0: float, x1: float, y1: float, cols: int, path: Index) -> int:
    """Cells that a segment passes, in order, its ends' cells included (Amanatides and Woo 1987).

    Args:
        x0: the segment's ends [cells].
        y0: see x0.
        x1: see x0.
        y1: see x0.
        cols: columns of the grid; all of the segment lies on it.
        path: (rows + cols,) or more, to be filled with row * cols + col.

    Returns:
        How many there are.
    """
    row, col = math.floor(y0), math.floor(x0)
    rise, run = math.floor(y1) - row, math.floor(x1) - col
    up, right = 1 if rise > 0 else -1, 1 if run > 0 else -1
    rise, run = abs(rise), abs(run)
    # Crossings are counted beforehand, and each is worked out from the start: nothing adds up, and
    # the last cell is reached whatever the rounding.
    per_y = up / (y1 - y0) if rise > 0 else 0.0
    per_x = right / (x1 - x0) if run > 0 else 0.0
    gap_y = row + 1 - y0 if up > 0 else y0 - row
    gap_x = col + 1 - x0 if right > 0 else x0 - col
    t_y = gap_y * per_y if rise > 0 else math.inf
    t_x = gap_x * per_x if run > 0 else math.inf
    cell, climb = row * cols + col, up * cols
    path[0] = cell
    count = rise + run + 1
    for k in range(1, count):
        if t_x < t_y:
            cell += right
            run -= 1
            gap_x += 1.0
            t_x = gap_x * per_x if run > 0 else math.inf
        else:
            cell += climb
            rise -= 1
            gap_y += 1.0
            t_y = gap_y * per_y if rise > 0 else math.inf
        path[k] = cell
    return count


@inlined
def part_of(x: float, y: float) -> int:
    """Which of its PARTS x PARTS parts a place in a cell lies in, from 0 to 1 each way."""
    u, v = min(int(PARTS * x), PARTS - 1), min(int(PARTS * y), PARTS - 1)
    return PARTS * v + u


@borrowing_kernel
def _lay(
    field: Floats,
    surface: Floats,
    row: int,
    col: int,
    weights: Floats,
    box: tuple[int, int, int, int],
) -> None:
    """Raise the field round an occupied cell, within a box of rows and columns."""
    around = weights[int(surface[row, col, 3])]
    reach = around.shape[0] // 2
    for r in range(max(row - reach, box[0]), min(row + reach + 1, box[1])):
        for c in range(max(col - reach, box[2]), min(col + reach + 1, box[3])):
            value = around[r - row + reach, c - col + reach]
            if value > field[r, c]:
                field[r, c] = value


@borrowing_kernel
def _renew(
    odds: Floats,
    field: Floats,
    surface: Floats,
    row: int,
    col: int,
    weights: Floats,
    limit: float,
) -> None:
    """Make the field anew round a cell that is no longer occupied, or whose surface moved."""
    rows, cols = odds.shape
    reach = weights.shape[1] // 2
    box = (max(row - reach, 0), min(row + reach + 1, rows),
           max(col - reach, 0), min(col + reach + 1, cols))  # fmt: skip
    for r in range(box[0], box[1]):
        for c in range(box[2], box[3]):
            field[r, c] = 0.0
    for r in range(max(box[0] - reach, 0), min(box[1] + reach, rows)):
        for c in range(max(box[2] - reach, 0), min(box[3] + reach, cols)):
            if odds[r, c] >= limit:
                _lay(field, surface, r, c, weights, box)


@kernel
def add_scan(
    odds: Floats,
    field: Floats,
    surface: Floats,
    struck: Marks,
    mark: int,
    points: Array,
    hits: Mask,
    pose: Array,
    law: Odds,
    weights: Floats,
    path: Index,
) -> None:
    """Add a scan to a map: cells passed are freer, cells hit are more occupied, both clamped.

    A cell hit by one beam is not freed by another of the same scan: those that graze a wall would
    rub it out. All of `points` must lie on the map.

    Args:
        odds: log-odds (rows, cols).
        field: (rows, cols), kept in step.
        surface: (rows, cols, 5) mean x and y of a cell's hits, in the cell; how many; in which part
            the field has them; from how many hits on it is asked again.
        struck: scratch (rows, cols): number of the last scan that hit a cell.
        mark: number of this scan, never used before.
        points: (n + 1, 2) [cells], in the chair's frame: where beams begin, then where they end.
        hits: (n,) whether a beam ends at an echo.
        pose: x, y [cells], yaw [rad].
        law: log-odds.
        weights: of the field (PARTS * PARTS, n, n), by the part of the cell with the surface.
        path: scratch (rows + cols,).
    """
    rows, cols = odds.shape
    c, s = math.cos(pose[2]), math.sin(pose[2])
    x0 = pose[0] + c * points[0, 0] - s * points[0, 1]
    y0 = pose[1] + s * points[0, 0] + c * points[0, 1]
    n = len(hits)
    flat, marks = odds.reshape(-1), struck.reshape(-1)
    least = np.float32(law.least)
    for k in range(n):
        if hits[k]:
            px, py = points[k + 1, 0], points[k + 1, 1]
            x, y = pose[0] + c * px - s * py, pose[1] + s * px + c * py
            col, row = math.floor(x), math.floor(y)
            struck[row, col] = mark
            before = odds[row, col]
            odds[row, col] = min(before + law.hit, law.most)
            own = surface[row, col]
            told = own[2]
            own[2] = min(told + 1.0, _MOST_HITS)
            own[0] += (x - col - own[0]) / own[2]
            own[1] += (y - row - own[1]) / own[2]
            if before < law.occupied <= odds[row, col]:
                own[3] = part_of(own[0], own[1])
                _lay(field, surface, row, col, weights, (0, rows, 0, cols))
            elif before >= law.occupied and told >= own[4]:
                # Asked seldom: a mean of few hits wanders, and each move costs.
                own[4] = 2.0 * told
                part = part_of(own[0], own[1])
                if part != own[3]:
                    own[3] = part
                    _renew(odds, field, surface, row, col, weights, law.occupied)
    for k in range(n):
        px, py = points[k + 1, 0], points[k + 1, 1]
        qx, qy = pose[0] + c * px - s * py, pose[1] + s * px + c * py
        for j in range(cells_passed(x0, y0, qx, qy, cols, path)):
            cell = path[j]  # unsigned: no test whether it counts from the end
            before = flat[cell]
            if before <= least or marks[cell] == mark:
                continue
            flat[cell] = max(before + law.miss, law.least)
            if before >= law.occupied > flat[cell]:
                row, col = int(cell) // cols, int(cell) % cols
                surface[row, col, 2] = 0.0
                surface[row, col, 4] = 0.0
                _renew(odds, field, surface, row, col, weights, law.occupied)
