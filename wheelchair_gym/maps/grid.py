"""The occupancy grid: cells, coordinate transforms, and walls or polygons of occupied cells."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from wheelchair_gym.base.arrays import Array, Mask
from wheelchair_gym.base.files import check_cells
from wheelchair_gym.base.settings import FARTHEST, InputError
from wheelchair_gym.compiled.address import as_array
from wheelchair_gym.compiled.kernel import as_int, borrowing_kernel, kernel
from wheelchair_gym.geometry.planar import signed_area, to_frame, to_world
from wheelchair_gym.maps.distance import distance_to_occupied, rows_equal, within_distance

Cells = NDArray[np.int8]
Index = NDArray[np.int64]


@borrowing_kernel
def _put(out: Array, count: int, x0: int, y0: int, x1: int, y1: int) -> int:
    """Write a segment if it fits into the array; returns the new count."""
    if count < len(out):
        out[count, 0], out[count, 1], out[count, 2], out[count, 3] = x0, y0, x1, y1
    return count + 1


@borrowing_kernel
def _runs(solid: Cells, changed: Index, lines: int, out: Array) -> int:
    """Write the segments between padded cells that fit into the array; count them all.

    A run goes on while the same side is solid. Where solid cells touch only at a corner the side
    changes, so runs end there and loops never cross. Only lines where a row differs from the next
    matter: level segments run along them, and upright ones begin and end there.
    """
    count: int = as_int(0)
    for i in range(lines):
        line = changed[i]
        side, begin = 0, as_int(0)
        for k in range(solid.shape[1]):  # the padding at the end closes the last run
            here = int(solid[line + 1, k]) - int(solid[line, k])
            if here != side:
                # The padding shifts columns by one.
                if side > 0:
                    count = _put(out, count, begin - 1, line, k - 1, line)
                elif side < 0:
                    count = _put(out, count, k - 1, line, begin - 1, line)
                side, begin = here, k
    for k in range(solid.shape[1] - 1):
        side, begin = 0, as_int(0)
        for i in range(lines):
            line = changed[i]
            here = int(solid[line + 1, k + 1]) - int(solid[line + 1, k])
            if here != side:
                if side > 0:
                    count = _put(out, count, k, line, k, begin)
                elif side < 0:
                    count = _put(out, count, k, begin, k, line)
                side, begin = here, line
    return count


@kernel
def boundary(solid: Cells) -> Array:
    """Edges between solid cells (rows, cols) and the rest, merged as far as they run straight.

    Returns:
        (n, 4) [cells], x0, y0, x1, y1 from the lower-left corner; solid cells on the left.
    """
    rows, cols = solid.shape
    padded = np.zeros((rows + 2, cols + 2), np.int8)
    for row in range(rows):
        for col in range(cols):
            padded[row + 1, col + 1] = solid[row, col]
    changed, lines = np.empty(rows + 1, np.int64), as_int(0)
    for line in range(rows + 1):
        changed[lines] = line
        lines += not rows_equal(padded[line], padded[line + 1])
    out = np.empty((1024, 4))
    count = _runs(padded, changed, lines, out)
    if count > len(out):
        out = np.empty((count, 4))
        _runs(padded, changed, lines, out)
    return out[:count].copy()


FREE: Final = 0
OCCUPIED: Final = 100
UNKNOWN: Final = -1


@dataclass(frozen=True, eq=False)
class OccupancyGrid:
    """Square cells, row 0 lowest: free, occupied, unknown, or a degree between 1 and 99.

    Only OCCUPIED is solid and only FREE may be driven on; the other values are neither. On a given
    map they are taken for solid or for free, see `without_unknown`.

    Raises:
        InputError: the cells are no table of small integers, or a length is out of bounds.
    """

    cells: NDArray[np.int8]  # (rows, cols)
    resolution: float  # m
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)  # lower-left corner: x, y [m], yaw [rad]
    # The last result of `geodesic`, by goal and radius: it stays valid, as cells never change.
    geodesic_cache: dict[tuple[float, float, float], Any] = field(
        default_factory=dict, init=False, repr=False
    )

    def __post_init__(self) -> None:
        cells = as_array(self.cells, np.int8, (None, None), "OccupancyGrid.cells")
        if cells.size == 0:
            raise InputError(f"cells have shape {cells.shape}; expected (rows, cols), none is 0")
        if not 0.0 < self.resolution < math.inf:
            raise InputError(f"resolution is {self.resolution}; expected more than 0 m")
        x, y, yaw = as_array(
            self.origin, np.float64, (3,), "OccupancyGrid.origin", FARTHEST
        ).tolist()
        side = max(cells.shape) * float(self.resolution)
        if not side <= FARTHEST:
            raise InputError(f"a side of the grid is {side:g} m; expected at most {FARTHEST:g} m")
        object.__setattr__(self, "cells", cells)
        object.__setattr__(self, "origin", (x, y, yaw))

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.cells.shape[0], self.cells.shape[1]

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """The smallest upright rectangle round the grid [m]: xmin, ymin, xmax, ymax."""
        rows, cols = self.shape
        corners = self.from_lattice(np.array([(0, 0), (cols, 0), (cols, rows), (0, rows)]))
        (x0, y0), (x1, y1) = corners.min(axis=0), corners.max(axis=0)
        return float(x0), float(y0), float(x1), float(y1)

    @property
    def extent(self) -> str:
        """The place of the grid, for messages."""
        x0, y0, x1, y1 = self.bounds
        if self.origin[2] == 0.0:
            return f"{x0:g} to {x1:g} and {y0:g} to {y1:g} m"
        width, height = self.shape[1] * self.resolution, self.shape[0] * self.resolution
        x, y, yaw = self.origin
        return f"{width:g} m x {height:g} m from the corner ({x:g}, {y:g}), turned by {yaw:g} rad"

    def to_lattice(self, points: ArrayLike) -> Array:
        """Points (..., 2) [m] as (x, y) in cells from the lower-left corner of cell (0, 0)."""
        return to_frame(points, self.origin) / self.resolution

    def from_lattice(self, points: ArrayLike) -> Array:
        """The inverse of `to_lattice`: points (..., 2) [m]."""
        scaled = np.asarray(points, dtype=np.float64) * self.resolution
        return to_world(scaled, self.origin)

    def to_cell(self, points: ArrayLike) -> NDArray[np.int64]:
        """Cells (..., 2) (row, col) that hold the points (..., 2) [m]; they may lie outside."""
        return np.floor(self.to_lattice(points))[..., ::-1].astype(np.int64)

    def to_world(self, cells: ArrayLike) -> Array:
        """Centres (..., 2) [m] of cells (..., 2) (row, col)."""
        return self.from_lattice(np.asarray(cells, dtype=np.float64)[..., ::-1] + 0.5)

    def inside(self, points: ArrayLike) -> Mask:
        """Return which of the points (..., 2) [m] lie on the grid."""
        cell = self.to_cell(points)
        return np.asarray(((cell >= 0) & (cell < self.shape)).all(axis=-1))

    def extended_to(self, points: ArrayLike, margin: float) -> OccupancyGrid:
        """This grid, or a larger one with unknown cells round it, that holds points (n, 2) [m].

        The margin [m] is their minimum distance to its border.
        """
        rows, cols = self.shape
        lattice, rim = self.to_lattice(points).reshape(-1, 2), margin / self.resolution
        low = np.minimum(np.floor(lattice.min(axis=0) - rim), 0).astype(np.int64)
        high = np.maximum(np.ceil(lattice.max(axis=0) + rim), (cols, rows)).astype(np.int64)
        if not low.any() and (high == (cols, rows)).all():
            return self
        width, height = (high - low).tolist()
        check_cells(height, width, "a grid that holds all points")
        after = high - (cols, rows)
        pad = ((-low[1], after[1]), (-low[0], after[0]))
        cells = np.pad(self.cells, pad, constant_values=UNKNOWN)
        x, y = self.from_lattice(low.astype(np.float64)).tolist()
        return OccupancyGrid(cells, self.resolution, (x, y, self.origin[2]))

    def solid(self, unknown_is_solid: bool = False) -> Mask:
        """Cells (rows, cols) that are occupied; with `unknown_is_solid` all that are not free."""
        solid: Mask = self.cells != FREE if unknown_is_solid else self.cells == OCCUPIED
        return solid

    def walls(self, unknown_is_solid: bool = False) -> Array:
        """The exact outline of solid cells, as longest straight segments (n, 4) [m].

        The segments form closed loops that touch at most at corners, with solid cells on their
        left. Space off the grid is not solid.
        """
        lattice = boundary(self.solid(unknown_is_solid).view(np.int8))
        return self.from_lattice(lattice.reshape(-1, 2)).reshape(-1, 4)

    def without_unknown(self, unknown_is_solid: bool) -> OccupancyGrid:
        """Return this map with each cell that is neither free nor occupied made one of the two.

        The map itself is returned where all cells are free or occupied.
        """
        solid = self.solid(unknown_is_solid)
        if (solid == self.solid(not unknown_is_solid)).all():
            return self
        cells = np.where(solid, OCCUPIED, FREE).astype(np.int8)
        return OccupancyGrid(cells, self.resolution, self.origin)

    @property
    def n_walls(self) -> int:
        """The number of walls around occupied cells, which is that of their corners."""
        solid = np.pad(self.solid(), 1)
        low, high = solid[:-1, :-1] ^ solid[1:, :-1], solid[:-1, 1:] ^ solid[1:, 1:]
        touching = low & high & (solid[:-1, :-1] ^ solid[:-1, 1:])  # two cells at a corner
        return int(np.count_nonzero(low ^ high) + 2 * np.count_nonzero(touching))

    def distance(self) -> NDArray[np.float32]:
        """Distance (rows, cols) [m] from each cell's centre to the nearest occupied cell's square.

        Exact; 0 in occupied cells, infinite where nothing is occupied.
        """
        spread = distance_to_occupied(self.solid(), math.inf)
        return spread * np.float32(self.resolution)

    def traversable(self, radius: float) -> Mask:
        """Free cells (rows, cols) where a disc of this radius [m] touches no solid cell."""
        # A corridor exactly as wide as the disc is passable: the slack is float32's rounding.
        minimum = (radius - 1e-5) / self.resolution
        return np.asarray(
            (self.cells == FREE) & (within_distance(self.solid().view(np.int8), minimum) == 0)
        )


class PolygonWithHoles(NamedTuple):
    """A solid region: its outer polygon (k, 2) and the polygons of its holes."""

    outer: Array
    holes: tuple[Array, ...] = ()


def occupied_polygons(
    grid: OccupancyGrid, *, dilate: float = 0.0, epsilon: float = 0.0
) -> list[PolygonWithHoles]:
    """Return the outlines of all that is occupied, grown and simplified.

    The outline follows cell edges, and cuts inner corners by half a cell: with epsilon 0 no solid
    point is lost. Regions that touch at a corner are one.

    Args:
        grid: the map.
        dilate: growth [cells] of solid regions.
        epsilon: how far [cells] a simplified outline may leave the exact one (Douglas and Peucker).
            An obstacle that would become a line stays exact; such a hole is filled.

    Returns:
        outlines in the grid's frame [m], outer polygons counter-clockwise, holes clockwise.
    """
    reach = max(0.0, dilate)
    edge = math.ceil(reach) + 1  # room for growth beyond the grid
    rows, cols = grid.shape
    # On half cells, closed squares have lattice points as corners, so contours are cell edges.
    lattice = np.zeros((2 * (rows + 2 * edge) + 1, 2 * (cols + 2 * edge) + 1), dtype=np.uint8)
    lattice[2 * edge + 1 : -2 * edge : 2, 2 * edge + 1 : -2 * edge : 2] = grid.solid()
    lattice = np.asarray(cv2.dilate(lattice, np.ones((3, 3), dtype=np.uint8)), dtype=np.uint8)
    if reach > 0.0 and lattice.any():
        gap = cv2.distanceTransform(1 - lattice, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        lattice = np.asarray(gap <= 2.0 * reach + 1e-4, dtype=np.uint8)
    contours, tree = cv2.findContours(lattice, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)

    def polygon_of(k: int) -> Array:
        line = cv2.approxPolyDP(contours[k], 2.0 * epsilon, True)[:, 0]
        if len(line) < 3 and tree[0, k, 3] < 0:  # a thin obstacle stays as it is
            line = contours[k][:, 0]
        return grid.from_lattice(line / 2.0 - edge)

    found = []
    for k in range(len(contours)):
        if tree[0, k, 3] >= 0:  # a hole: taken with the region round it
            continue
        holes, hole = [], int(tree[0, k, 2])
        while hole >= 0:
            polygon = polygon_of(hole)
            if len(polygon) > 2:
                holes.append(_oriented(polygon, -1))
            hole = int(tree[0, hole, 0])
        found.append(PolygonWithHoles(_oriented(polygon_of(k), 1), tuple(holes)))
    return found


def _oriented(polygon: Array, sense: int) -> Array:
    """The polygon counter-clockwise (1) or clockwise (-1)."""
    return polygon if signed_area(polygon) * sense > 0.0 else polygon[::-1].copy()
