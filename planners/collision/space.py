"""Free space: a map without obstacles, as polygons, and as arrays for exact kernels.

The boundary belongs to free space: a path may touch an obstacle, run along its side, pass through
its corner, or between two obstacles that meet in one point. It may not enter an obstacle, nor leave
the map; where an obstacle touches the map's border, nothing passes.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from numpy.typing import ArrayLike

from planners.collision import solids
from planners.collision.boundary import (
    Boundary,
    Corners,
    boundary,
    build_space_arrays,
    convex_corners,
    edges_within_frame,
)
from planners.collision.inflation import inflated_boundary
from planners.collision.polygon_tests import SpaceArrays, clearance, edge_free, point_free
from planners.collision.triangulation import Mesh, mesh
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.geometry.planar import polygon_edges, to_frame, to_world

if TYPE_CHECKING:
    from wheelchair_gym.maps.grid import OccupancyGrid

__all__ = ["Space", "SpaceArrays", "clearance", "edge_free", "point_free"]

Bounds = tuple[float, float, float, float]
Pose = tuple[float, float, float]


class Space:
    """The free space of a map, exactly.

    Attributes:
        bounds: (xmin, ymin, xmax, ymax) [m] of the map; an empty map has its maxima below.
        discs: (m, 3) x, y, radius [m]: round obstacles, for costs that measure from centres; the
            solid geometry has polygons around them.
        frame: origin x, y [m] and yaw [rad] of a rotated map, in which planners search; all that
            lies in the bounds but outside of such a map is solid.
        in_frame: the same space in the coordinates of that frame; itself where the map is upright.
    """

    def __init__(
        self, solid: Any, bounds: ArrayLike, discs: ArrayLike = (), edges: Array | None = None
    ) -> None:
        """Take the solid geometry, or the edges (n, 4) of free space, and the map's bounds [m].

        Args:
            solid: a shapely geometry, or None where edges are given.
            bounds: (xmin, ymin, xmax, ymax) [m].
            discs: (m, 3) [m] within the solid geometry.
            edges: (n, 4) [m] of free space.
        """
        xmin, ymin, xmax, ymax = map(float, np.asarray(bounds, dtype=np.float64))
        if not all(map(math.isfinite, (xmin, ymin, xmax, ymax))):
            raise ValueError(f"bounds are {bounds!r}; expected four finite numbers")
        self._solid, self._edges = solid, edges
        self.bounds: Bounds = (xmin, ymin, xmax, ymax)
        self.discs: Array = np.array(discs, dtype=np.float64).reshape(-1, 3)
        self._inflated: dict[float, Space] = {}
        self._grid: OccupancyGrid | None = None
        self._unknown_is_solid = False
        self.frame: Pose = (0.0, 0.0, 0.0)
        self.in_frame = self

    @classmethod
    def from_outlines(
        cls, outlines: Iterable[tuple[Array, Sequence[Array]]], bounds: ArrayLike
    ) -> Space:
        """Return a map with solid polygons (k, 2) [m], each with the polygons of its holes."""
        pieces = [
            shapely.difference(solids.union([outer]), solids.union(holes))
            for outer, holes in outlines
        ]
        return cls(solids.polygonal(shapely.union_all(pieces)), bounds)

    @classmethod
    def from_rectangles(cls, rectangles: ArrayLike, bounds: ArrayLike) -> Space:
        """Return a map with solid rectangles (n, 4) [m]: xmin, ymin, xmax, ymax; may overlap."""
        sides = np.asarray(rectangles, dtype=np.float64).reshape(-1, 4)
        corners = sides[:, [0, 1, 2, 1, 2, 3, 0, 3]].reshape(-1, 4, 2)
        return cls(solids.union(corners), bounds)

    @classmethod
    def from_walls(cls, walls: ArrayLike, discs: ArrayLike, bounds: ArrayLike) -> Space:
        """Return a map with walls (n, 4) [m], closed loops, and discs (m, 3) [m]: x, y, radius.

        A point is solid where the loops wind around it (non-zero rule): loops that overlap are
        united, and a hole runs against the loop around it. A disc becomes a polygon around it.
        """
        round_ones = np.asarray(discs, dtype=np.float64).reshape(-1, 3)
        solid = solids.union(solids.disc(x, y, radius) for x, y, radius in round_ones)
        return cls(shapely.union(solids.non_zero(walls), solid), bounds, round_ones)

    @classmethod
    def from_map(cls, grid: OccupancyGrid, walls: ArrayLike, discs: ArrayLike = ()) -> Space:
        """Return the map of a grid with walls (n, 4) and discs (m, 3) [m] finer than its cells.

        The border is the grid's own, rotated or not.
        """
        if grid.origin[2] == 0.0:
            return cls.from_walls(walls, discs, grid.bounds)
        lines = to_frame(np.asarray(walls).reshape(-1, 2), grid.origin)
        round_ones = np.array(discs, dtype=np.float64).reshape(-1, 3)
        round_ones[:, :2] = to_frame(round_ones[:, :2], grid.origin)
        upright = replace(grid, origin=(0.0, 0.0, 0.0))
        return cls.from_walls(lines, round_ones, upright.bounds).placed(grid.origin)

    @classmethod
    def from_grid(cls, grid: OccupancyGrid, unknown_is_solid: bool = False) -> Space:
        """Return the map of an occupancy grid, whose border is the grid's own, rotated or not."""
        if grid.origin[2] != 0.0:
            upright = replace(grid, origin=(0.0, 0.0, 0.0))
            return cls.from_grid(upright, unknown_is_solid).placed(grid.origin)
        edges = edges_within_frame(grid.walls(unknown_is_solid), grid.bounds)
        space = cls(None, grid.bounds, edges=edges)
        space._grid, space._unknown_is_solid = grid, unknown_is_solid
        return space

    def placed(self, frame: Pose) -> Space:
        """Return this space in world coordinates, for a map whose frame lies at a pose."""
        x0, y0, x1, y1 = self.bounds
        corners = to_world([(x0, y0), (x1, y0), (x1, y1), (x0, y1)], frame)
        discs = self.discs.copy()
        discs[:, :2] = to_world(discs[:, :2], frame)
        space = Space(None, (*corners.min(axis=0), *corners.max(axis=0)), discs)
        space.frame, space.in_frame = frame, self
        return space

    def inflated(self, radius: float) -> Space:
        """Return the space of the centres of a disc of a radius [m], never nearer to anything.

        It keeps a millionth of the radius more, and up to 2 % more at convex corners, where
        polygons replace arcs. So a gap exactly as wide as the disc is shut.

        Raises:
            ValueError: the radius is negative or not finite.
        """
        if not 0.0 <= radius < math.inf:
            raise ValueError(f"radius is {radius}; expected a finite number of at least 0")
        if radius == 0.0:
            return self
        if self.in_frame is not self and radius not in self._inflated:
            self._inflated[radius] = self.in_frame.inflated(radius).placed(self.frame)
        if radius not in self._inflated:
            xmin, ymin, xmax, ymax = self.bounds
            bounds = (xmin + radius, ymin + radius, xmax - radius, ymax - radius)
            discs = self.discs + np.array([0.0, 0.0, radius])
            try:
                grown = Space(None, bounds, discs, inflated_boundary(self.arrays, radius))
                grown.mesh  # noqa: B018 - which proves that the edges form loops that never cross
            except ValueError:
                grown = Space(solids.inflate(self.solid, radius), bounds, discs)
            self._inflated[radius] = grown
        return self._inflated[radius]

    @cached_property
    def solid(self) -> Any:
        """The solid geometry (shapely), which may reach beyond the bounds.

        The geometry of a grid is made of its cells, that of others of the polygons given.
        """
        if self._grid is not None:
            return solids.cells(self._grid, self._grid.solid(self._unknown_is_solid))
        if self._solid is not None:
            return self._solid
        return shapely.difference(shapely.box(*self.bounds), self.free)

    @cached_property
    def free(self) -> Any:
        """The free geometry (shapely), of polygons."""
        if self.in_frame is not self:
            return shapely.transform(self.in_frame.free, lambda at: to_world(at, self.frame))
        if self._edges is not None and self._grid is None:
            lines = shapely.linestrings(self._edges.reshape(-1, 2, 2))
            faces = np.asarray(shapely.get_parts(shapely.polygonize(lines)))
            inside = shapely.get_coordinates(shapely.point_on_surface(faces))
            kept = [point_free(self.arrays, *at) for at in inside]
            return shapely.MultiPolygon(faces[kept].tolist())
        xmin, ymin, xmax, ymax = self.bounds
        if xmin >= xmax or ymin >= ymax:
            return shapely.MultiPolygon()
        return solids.polygonal(shapely.difference(shapely.box(*self.bounds), self.solid))

    @cached_property
    def boundary(self) -> Boundary:
        """The boundary of free space; the solid lies on the left of its segments."""
        if self._edges is not None:
            return boundary(self._edges)
        loops = solids.rings(self.free, solid_inside=False)
        return boundary(np.concatenate([np.empty((0, 4)), *map(polygon_edges, loops)]))

    @cached_property
    def arrays(self) -> SpaceArrays:
        """The boundary of free space, as kernels take it."""
        edge = self.boundary
        return build_space_arrays(edge.segments, edge.points[edge.before], np.array(self.bounds))

    @cached_property
    def mesh(self) -> Mesh:
        """The triangles of free space."""
        return mesh(self.boundary)

    @cached_property
    def corners(self) -> Corners:
        """The convex corners of obstacles."""
        return convex_corners(self.boundary)
