"""Obstacles as shapely geometry: unions, loops of walls, and inflation that is never too small.

Used once per map, never in a loop of a planner.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from numpy.typing import ArrayLike

from wheelchair_gym.base.arrays import Array, Mask

if TYPE_CHECKING:
    from wheelchair_gym.maps.grid import OccupancyGrid

GRID = 1e-9  # m: grown outlines are rounded to this; far below the precision of maps
ARC = math.pi / 8  # rad: at most this much of a round corner per side of its circumscribed polygon
DISC_SIDES = 32  # of the polygon around a disc: 0.5 % of the radius too large at its corners


def union(polygons: Iterable[ArrayLike]) -> Any:
    """Return the union of simple polygons (k, 2) [m], which may overlap.

    Raises:
        ValueError: a polygon with fewer than three corners, or a corner that is not finite.
    """
    solids = []
    for index, polygon in enumerate(polygons):
        corners = np.asarray(polygon, dtype=np.float64)
        if corners.ndim != 2 or corners.shape[1] != 2 or len(corners) < 3:
            raise ValueError(f"polygon {index} has shape {corners.shape}; expected (3 or more, 2)")
        if not np.isfinite(corners).all():
            raise ValueError(f"polygon {index} has a corner that is not finite")
        solids.append(shapely.make_valid(shapely.Polygon(corners)))
    return shapely.union_all(solids) if solids else shapely.MultiPolygon()


def disc(x: float, y: float, radius: float) -> Array:
    """Return the regular polygon (DISC_SIDES, 2) around a disc, whose sides touch it."""
    angles = np.arange(DISC_SIDES) * (2 * math.pi / DISC_SIDES)
    reach = radius / math.cos(math.pi / DISC_SIDES)
    return np.stack([x + reach * np.cos(angles), y + reach * np.sin(angles)], axis=1)


def non_zero(walls: ArrayLike) -> Any:
    """Return the geometry of the points that closed loops of walls (n, 4) [m] wind around."""
    segments = np.asarray(walls, dtype=np.float64).reshape(-1, 4)
    if not len(segments):
        return shapely.MultiPolygon()
    lines = shapely.union_all(shapely.linestrings(segments.reshape(-1, 2, 2)))
    faces = np.asarray(shapely.get_parts(shapely.polygonize(shapely.get_parts(lines))))
    inside = shapely.get_coordinates(shapely.point_on_surface(faces))
    x0, y0, x1, y1 = segments.T
    solid = []
    for face, (x, y) in zip(faces, inside, strict=True):
        straddles = (y0 <= y) != (y1 <= y)
        ax, ay, bx, by = x0[straddles], y0[straddles], x1[straddles], y1[straddles]
        right = ax + (y - ay) / (by - ay) * (bx - ax) > x
        if np.sign(by - ay)[right].sum() != 0.0:
            solid.append(face)
    return shapely.union_all(solid) if solid else shapely.MultiPolygon()


def cells(grid: OccupancyGrid, solid: Mask) -> Any:
    """Return the union of the squares of a grid's solid cells (rows, cols)."""
    padded = np.pad(solid.astype(np.int8), ((0, 0), (1, 1)))
    rows, begins = np.nonzero(np.diff(padded, axis=1) == 1)  # of runs along the rows
    _, ends = np.nonzero(np.diff(padded, axis=1) == -1)
    corners = np.stack([begins, rows, ends, rows, ends, rows + 1, begins, rows + 1], axis=-1)
    return shapely.union_all(shapely.polygons(grid.from_lattice(corners.reshape(-1, 4, 2))))


def rings(geometry: Any, solid_inside: bool) -> list[Array]:
    """Return rings (k, 2) of a geometry, without the repeated end, the solid on their left."""
    oriented = shapely.orient_polygons(geometry, exterior_cw=not solid_inside)
    polygons = [part for part in shapely.get_parts(oriented) if part.geom_type == "Polygon"]
    loops = [shapely.get_coordinates(r)[:-1] for p in polygons for r in shapely.get_rings(p)]
    return [loop[np.any(loop != np.roll(loop, 1, axis=0), axis=1)] for loop in loops]


def polygonal(geometry: Any) -> Any:
    """Return the polygons of a geometry, without the points and lines that an overlay leaves."""
    parts = shapely.get_parts(geometry)
    if any(part.geom_type == "GeometryCollection" for part in parts):
        parts = shapely.get_parts(parts)
    return shapely.MultiPolygon([part for part in parts if part.geom_type == "Polygon"])


def inflate(solid: Any, radius: float) -> Any:
    """Return a geometry that holds every point nearer than the radius [m] to a solid.

    Straight sides move out by the radius; round corners become polygons whose sides touch the arc.
    See `inflation` for when this is used, and why shapely's buffer is not.
    """
    radius += 2 * GRID  # rounding below may not bring anything nearer
    pieces = [solid]
    for ring in rings(solid, solid_inside=True):
        into = ring - np.roll(ring, 1, axis=0)  # (k, 2) edge that ends at each corner
        out = np.roll(ring, -1, axis=0) - ring
        ends = np.roll(ring, -1, axis=0)
        turns = np.arctan2(
            into[:, 0] * out[:, 1] - into[:, 1] * out[:, 0], np.sum(into * out, axis=1)
        )
        normals = np.stack([out[:, 1], -out[:, 0]], axis=1) * (
            radius / np.hypot(out[:, 0], out[:, 1])[:, None]
        )
        for corner, end, normal, turn in zip(ring, ends, normals, turns, strict=True):
            arc = np.empty((0, 2))
            if turn > 0.0:
                sides = math.ceil(turn / ARC)
                half = 0.5 * turn / sides
                angles = np.append(0.0, half * np.arange(1, 2 * sides, 2)) - turn
                far = np.append(1.0, np.full(sides, 1.0 / math.cos(half)))
                c, s = far * np.cos(angles), far * np.sin(angles)
                x, y = normal
                arc = corner + np.stack([c * x - s * y, s * x + c * y], axis=1)
            pieces.append(shapely.Polygon([corner, *arc, corner + normal, end + normal, end]))
    return polygonal(shapely.set_precision(shapely.union_all(pieces), GRID))
