"""Drawing on a 5 cm raster: rectangles of cells, rotated rectangles, discs."""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.compiled.kernel import borrowing_kernel

Cells = NDArray[np.int8]
Rects = NDArray[np.void]

CELL: Final = 0.05  # m: the raster of every generated map
# A rectangle of whole cells, from (x0, y0) up to, not including, (x1, y1).
RECT: Final = np.dtype([(corner, np.int64) for corner in ("x0", "y0", "x1", "y1")])


def to_cells(metres: float) -> int:
    """A length [m] as a whole number of cells, rounded."""
    return round(metres / CELL)


cell_count = borrowing_kernel(to_cells)


@borrowing_kernel
def put(rects: Rects, k: int, x0: int, y0: int, x1: int, y1: int) -> int:
    """Write a rectangle; returns the index of the next."""
    rects[k].x0, rects[k].y0, rects[k].x1, rects[k].y1 = x0, y0, x1, y1
    return k + 1


def rotated_rectangle(x: float, y: float, length: float, width: float, yaw: float) -> Array:
    """Corners (4, 2) [m], counter-clockwise, of a rectangle about (x, y) turned by yaw [rad]."""
    along = np.array([math.cos(yaw), math.sin(yaw)]) * length / 2
    across = np.array([-math.sin(yaw), math.cos(yaw)]) * width / 2
    corners: Array = np.array([-along - across, along - across, along + across, across - along])
    corners += (x, y)
    return corners


@borrowing_kernel
def paint_discs(cells: Cells, discs: Array, x0: float, y0: float, value: int) -> None:
    """Set each cell whose square a disc reaches; the grid's lower-left corner is (x0, y0) [m]."""
    rows, cols = cells.shape
    for k in range(discs.shape[0]):
        x, y, radius = (discs[k, 0] - x0) / CELL, (discs[k, 1] - y0) / CELL, discs[k, 2] / CELL
        for row in range(max(0, int(y - radius)), min(rows, int(y + radius) + 1)):
            dy = max(abs(y - row - 0.5) - 0.5, 0.0)
            for col in range(max(0, int(x - radius)), min(cols, int(x + radius) + 1)):
                dx = max(abs(x - col - 0.5) - 0.5, 0.0)
                if dx * dx + dy * dy < radius * radius - 1e-6:  # touching is not reaching
                    cells[row, col] = value


@borrowing_kernel
def paint_rects(cells: Cells, rects: Rects, value: int) -> None:
    """Set the cells of rectangles."""
    for k in range(len(rects)):
        for row in range(rects[k].y0, rects[k].y1):
            for col in range(rects[k].x0, rects[k].x1):
                cells[row, col] = value


@borrowing_kernel
def paint_polygon(cells: Cells, polygon: Array, value: int) -> None:
    """Set each cell whose square a convex polygon (k, 2) [m], counter-clockwise, may reach.

    The grid's lower-left corner is (0, 0). Near a corner of the polygon a cell that it misses by
    less than its own diagonal may be set too.
    """
    rows, cols = cells.shape
    count = len(polygon)
    left, low, right, high = math.inf, math.inf, -math.inf, -math.inf
    for k in range(count):
        x, y = polygon[k, 0] / CELL, polygon[k, 1] / CELL
        left, low, right, high = min(left, x), min(low, y), max(right, x), max(high, y)
    for row in range(max(math.floor(low) - 1, 0), min(math.ceil(high) + 1, rows)):
        for col in range(max(math.floor(left) - 1, 0), min(math.ceil(right) + 1, cols)):
            inside = True
            for k in range(count):
                ax, ay = polygon[k, 0], polygon[k, 1]
                ex, ey = polygon[(k + 1) % count, 0] - ax, polygon[(k + 1) % count, 1] - ay
                reach = CELL / 2 * (abs(ex) + abs(ey))  # of a square across the edge's direction
                side = ex * ((row + 0.5) * CELL - ay) - ey * ((col + 0.5) * CELL - ax)
                if side < -reach:
                    inside = False
                    break
            if inside:
                cells[row, col] = value
