"""Drawing on a 5 cm raster: rectangles of cells, turned rectangles, discs."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.compiled.kernel import borrowing_kernel

Array = NDArray[np.float64]
Cells = NDArray[np.int8]

CELL: Final = 0.05  # m: the raster of every generated map


class Rect(NamedTuple):
    """A rectangle of whole cells: from (x0, y0) up to, not including, (x1, y1)."""

    x0: int
    y0: int
    x1: int
    y1: int

    @property
    def width(self) -> int:
        """Along x [cells]."""
        return self.x1 - self.x0

    @property
    def height(self) -> int:
        """Along y [cells]."""
        return self.y1 - self.y0

    def inflated(self, by: int) -> Rect:
        """The rectangle with every side moved out."""
        return Rect(self.x0 - by, self.y0 - by, self.x1 + by, self.y1 + by)

    def meets(self, other: Rect) -> bool:
        """Whether the two share a cell."""
        return (
            self.x0 < other.x1 and other.x0 < self.x1 and self.y0 < other.y1 and other.y0 < self.y1
        )

    def swapped(self) -> Rect:
        """Mirrored in the diagonal: x for y."""
        return Rect(self.y0, self.x0, self.y1, self.x1)

    def paint(self, cells: Cells, value: int) -> None:
        """Set its cells."""
        cells[self.y0 : self.y1, self.x0 : self.x1] = value


def to_cells(metres: float) -> int:
    """A length [m] as a whole number of cells, rounded."""
    return round(metres / CELL)


@borrowing_kernel
def cell_count(metres: float) -> int:
    """The same for kernels."""
    return int(np.rint(metres / CELL))


def rotated_rectangle(x: float, y: float, length: float, width: float, yaw: float) -> Array:
    """Corners (4, 2) [m], counter-clockwise, of a rectangle about (x, y) turned by yaw [rad]."""
    along = np.array([math.cos(yaw), math.sin(yaw)]) * length / 2
    across = np.array([-math.sin(yaw), math.cos(yaw)]) * width / 2
    corners: Array = np.array([-along - across, along - across, along + across, across - along])
    corners += (x, y)
    return corners


@borrowing_kernel
def paint_discs(cells: Cells, discs: Array, x0: float, y0: float, size: float, value: int) -> None:
    """Set each cell whose square a disc reaches."""
    rows, cols = cells.shape
    for k in range(discs.shape[0]):
        x, y, radius = (discs[k, 0] - x0) / size, (discs[k, 1] - y0) / size, discs[k, 2] / size
        for row in range(max(0, int(y - radius)), min(rows, int(y + radius) + 1)):
            dy = max(abs(y - row - 0.5) - 0.5, 0.0)
            for col in range(max(0, int(x - radius)), min(cols, int(x + radius) + 1)):
                dx = max(abs(x - col - 0.5) - 0.5, 0.0)
                if dx * dx + dy * dy < radius * radius - 1e-6:  # touching is not reaching
                    cells[row, col] = value


@borrowing_kernel
def paint_rects(cells: Cells, rects: NDArray[np.int64], value: int) -> None:
    """Set the cells of rectangles (n, 4) of whole cells: x0, y0, x1, y1."""
    for k in range(len(rects)):
        for row in range(rects[k, 1], rects[k, 3]):
            for col in range(rects[k, 0], rects[k, 2]):
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
