"""What is free: a map without what is solid, as polygons, and as arrays for exact kernels.

The boundary belongs to what is free: a path may touch an obstacle, run along its side, pass through
its corner, or between two obstacles that meet in one point. It may not enter an obstacle, nor leave
the map; where an obstacle touches the map's border, nothing passes.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import cached_property
from typing import Any, Protocol

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from planners import solids
from planners.exact import (
    SpaceArrays,
    clearance,
    edge_free,
    fill_buckets,
    mark_corners,
    point_free,
)

__all__ = ["Space", "SpaceArrays", "clearance", "edge_free", "point_free"]

Array = NDArray[np.float64]
Bounds = tuple[float, float, float, float]

MOST_BUCKETS = 200_000


class Grid(Protocol):
    """What a space needs of an occupancy grid."""

    @property
    def bounds(self) -> Bounds:
        """(xmin, ymin, xmax, ymax) [m]."""
        ...

    def walls(self, unknown_is_solid: bool = False) -> Array:
        """The boundary of what is solid, (n, 4) [m]."""
        ...


class Space:
    """What is free on a map, exactly.

    Attributes:
        solid: what is solid, a shapely geometry; it may reach beyond the bounds.
        bounds: (xmin, ymin, xmax, ymax) [m] of the map; an empty map has its maxima below.
        discs: (m, 3) x, y, radius [m]: what of the solid is known to be round, for costs that
            measure from centres; the solid holds polygons round them.
    """

    def __init__(self, solid: Any, bounds: ArrayLike, discs: ArrayLike = ()) -> None:
        """Take what is solid, the map's bounds [m], and the discs (m, 3) [m] that it holds."""
        xmin, ymin, xmax, ymax = map(float, np.asarray(bounds, dtype=np.float64))
        if not all(map(math.isfinite, (xmin, ymin, xmax, ymax))):
            raise ValueError(f"bounds are {bounds!r}; expected four finite numbers")
        self.solid = solid
        self.bounds: Bounds = (xmin, ymin, xmax, ymax)
        self.discs: Array = np.array(discs, dtype=np.float64).reshape(-1, 3)
        self._inflated: dict[float, Space] = {}

    @classmethod
    def from_polygons(cls, polygons: Iterable[ArrayLike], bounds: ArrayLike) -> Space:
        """A map with solid polygons (k, 2) [m], which may overlap."""
        return cls(solids.union(polygons), bounds)

    @classmethod
    def from_rectangles(cls, rectangles: ArrayLike, bounds: ArrayLike) -> Space:
        """A map with solid rectangles (n, 4) [m]: xmin, ymin, xmax, ymax; they may overlap."""
        corners = np.asarray(rectangles, dtype=np.float64).reshape(-1, 4)
        return cls(solids.union(corners[:, [0, 1, 2, 1, 2, 3, 0, 3]].reshape(-1, 4, 2)), bounds)

    @classmethod
    def from_walls(cls, walls: ArrayLike, discs: ArrayLike, bounds: ArrayLike) -> Space:
        """A map with walls (n, 4) [m], closed loops, and discs (m, 3) [m]: x, y, radius.

        What lies inside an odd number of loops is solid; a disc becomes a polygon round it.
        """
        round_ones = np.asarray(discs, dtype=np.float64).reshape(-1, 3)
        solid = solids.union(solids.disc(x, y, radius) for x, y, radius in round_ones)
        return cls(shapely.union(solids.even_odd(walls), solid), bounds, round_ones)

    @classmethod
    def from_grid(cls, grid: Grid, unknown_is_solid: bool = False) -> Space:
        """The map of an occupancy grid; its walls say what is solid."""
        return cls(solids.even_odd(grid.walls(unknown_is_solid)), grid.bounds)

    def inflated(self, radius: float) -> Space:
        """Where a disc of a radius [m] may have its centre: never nearer to anything than that.

        Raises:
            ValueError: the radius is negative or not finite.
        """
        if not 0.0 <= radius < math.inf:
            raise ValueError(f"radius is {radius}; expected a finite number of at least 0")
        if radius == 0.0:
            return self
        if radius not in self._inflated:
            xmin, ymin, xmax, ymax = self.bounds
            bounds = (xmin + radius, ymin + radius, xmax - radius, ymax - radius)
            discs = self.discs + np.array([0.0, 0.0, radius])
            self._inflated[radius] = Space(solids.grown(self.solid, radius), bounds, discs)
        return self._inflated[radius]

    @cached_property
    def free(self) -> Any:
        """What is free, as a shapely geometry of polygons."""
        xmin, ymin, xmax, ymax = self.bounds
        if xmin >= xmax or ymin >= ymax:
            return shapely.MultiPolygon()
        return solids.polygonal(shapely.difference(shapely.box(*self.bounds), self.solid))

    @cached_property
    def arrays(self) -> SpaceArrays:
        """The boundary of what is free, as kernels take it."""
        segments, before = _boundary(self.free)
        xmin, ymin, xmax, ymax = self.bounds
        width, height = max(xmax - xmin, 0.0), max(ymax - ymin, 0.0)
        # About two buckets a segment: long edges pass few, short ones meet few segments.
        size = math.sqrt((width * height or 1.0) / min(2 * len(segments) + 16, MOST_BUCKETS))
        size = max(size, width / 2000, height / 2000)
        grid = np.array([xmin - 0.5 * size, ymin - 0.5 * size, size])
        columns, rows = int(width / size) + 2, int(height / size) + 2
        counts = np.zeros(rows * columns, dtype=np.int64)
        fill_buckets(segments, grid, rows, columns, counts, np.empty(0, dtype=np.int32))
        first = np.concatenate([[0], np.cumsum(counts)])
        members = np.empty(first[-1], dtype=np.int32)
        fill_buckets(segments, grid, rows, columns, first[:-1].copy(), members)
        arrays = SpaceArrays(
            np.array(self.bounds),
            segments,
            before,
            grid,
            first,
            members,
            np.zeros((rows, columns), dtype=np.bool_),
        )
        mark_corners(arrays)
        return arrays


def _boundary(free: Any) -> tuple[Array, Array]:
    """Segments (n, 4), solid on their left, and the corner (n, 2) before each."""
    loops = solids.rings(free, solid_inside=False)
    if not loops:
        return np.empty((0, 4)), np.empty((0, 2))
    starts = np.concatenate(loops)
    ends = np.concatenate([np.roll(loop, -1, axis=0) for loop in loops])
    before = np.concatenate([np.roll(loop, 1, axis=0) for loop in loops])
    # Where loops meet in a corner, what is solid between two sides may belong to two loops: each
    # side that leaves takes the next one that arrives, counter-clockwise, as the one before.
    _, which, times = np.unique(starts, axis=0, return_inverse=True, return_counts=True)
    which = which.ravel()
    for corner in np.flatnonzero(times > 1):
        meeting = np.flatnonzero(which == corner)
        origin = starts[meeting[0]]
        leave = np.arctan2(*(ends[meeting] - origin).T[::-1])
        arrive = np.arctan2(*(before[meeting] - origin).T[::-1])
        turn = (arrive[None, :] - leave[:, None]) % (2 * math.pi)  # (leaving, arriving)
        turn[turn == 0.0] = 2 * math.pi
        before[meeting] = before[meeting][np.argmin(turn, axis=1)]
    return np.hstack([starts, ends]), before
