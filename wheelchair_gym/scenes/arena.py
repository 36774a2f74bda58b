"""A closed arena with drawn obstacles: the ground of every scene that is not a building."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wheelchair_gym.files import check_cells
from wheelchair_gym.geometry import polygon_edges
from wheelchair_gym.maps import OCCUPIED, OccupancyGrid
from wheelchair_gym.scenes.raster import CELL, Rect, paint_discs, paint_polygon, to_cells

Array = NDArray[np.float64]

FRAME: Final = 0.10  # m: thickness of the wall round an arena


class Arena(NamedTuple):
    """What an episode needs of a world."""

    map: OccupancyGrid
    walls: Array  # (n, 4) m
    discs: Array  # (m, 3) m


def arena(
    bounds: tuple[float, float, float, float],
    rects: Sequence[tuple[float, float, float, float]] = (),
    polygons: Sequence[ArrayLike] = (),
    discs: ArrayLike = (),
) -> Arena:
    """An arena whose wall stands outside its bounds.

    Args:
        bounds: free ground [m]: xmin, ymin, xmax, ymax; sides are rounded to the raster.
        rects: upright obstacles [m], rounded to the raster; they may touch and overlap.
        polygons: convex, counter-clockwise, (k, 2) [m]; they touch nothing.
        discs: (m, 3) [m]: x, y, radius.
    """
    x0, y0 = bounds[0] - FRAME, bounds[1] - FRAME
    shape = to_cells(bounds[3] + FRAME - y0), to_cells(bounds[2] + FRAME - x0)
    check_cells(*shape, "scene")
    cells = np.full(shape, OCCUPIED, dtype=np.int8)
    Rect(0, 0, shape[1], shape[0]).grown(-to_cells(FRAME)).paint(cells, 0)
    for left, low, right, high in rects:
        corners = (left - x0, low - y0, right - x0, high - y0)
        Rect(*(max(0, to_cells(value)) for value in corners)).paint(cells, OCCUPIED)
    origin = (x0, y0, 0.0)
    outlines = [np.asarray(polygon, dtype=np.float64) for polygon in polygons]
    walls = OccupancyGrid(cells.copy(), CELL, origin).walls()
    walls = np.vstack([walls, *(polygon_edges(outline) for outline in outlines)])
    for outline in outlines:
        paint_polygon(cells, outline - (x0, y0), OCCUPIED)
    round_things = np.asarray(discs, dtype=np.float64).reshape(-1, 3)
    paint_discs(cells, round_things, x0, y0, CELL, OCCUPIED)
    return Arena(OccupancyGrid(cells, CELL, origin), walls, round_things)


def facing(start: tuple[float, float], goal: tuple[float, float]) -> tuple[Array, Array]:
    """Start and goal poses (3,) that both look from start to goal."""
    yaw = math.atan2(goal[1] - start[1], goal[0] - start[0])
    return np.array([*start, yaw]), np.array([*goal, yaw])
