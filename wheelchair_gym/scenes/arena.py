"""A closed arena with drawn obstacles, and the empty room.

It is the ground of every scene that is not a building.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wheelchair_gym.config import InputError, setting, settings
from wheelchair_gym.files import check_cells
from wheelchair_gym.geometry import Footprint, polygon_edges
from wheelchair_gym.maps import OCCUPIED, OccupancyGrid
from wheelchair_gym.scenes.poses import FOOTPRINT, is_free_pose
from wheelchair_gym.scenes.raster import CELL, Rect, paint_discs, paint_polygon, to_cells
from wheelchair_gym.types import Episode

Array = NDArray[np.float64]

WALL: Final = 0.10  # m: thickness of the wall round an arena


class Arena(NamedTuple):
    """What an episode needs of a world."""

    map: OccupancyGrid
    walls: Array  # (n, 4) m
    discs: Array  # (m, 3) m


def make_arena(
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
    x0, y0 = bounds[0] - WALL, bounds[1] - WALL
    shape = to_cells(bounds[3] + WALL - y0), to_cells(bounds[2] + WALL - x0)
    check_cells(*shape, "scene")
    cells = np.full(shape, OCCUPIED, dtype=np.int8)
    Rect(0, 0, shape[1], shape[0]).inflated(-to_cells(WALL)).paint(cells, 0)
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


def poses_along(start: tuple[float, float], goal: tuple[float, float]) -> tuple[Array, Array]:
    """Start and goal poses (3,) that both look from start to goal."""
    yaw = math.atan2(goal[1] - start[1], goal[0] - start[0])
    return np.array([*start, yaw]), np.array([*goal, yaw])


Pose = tuple[float, float, float]

_TRIES = 10_000  # a room of 2 m x 2 m takes hundreds
_EDGE = 0.5  # m: no axle is drawn nearer to a wall
_CLEARANCE = 0.15  # m round the footprint where drawn, as in the other scenes


@settings
class EmptyRoom:
    """An empty rectangular room, its lower-left corner at (0, 0): for first steps and physics."""

    size: tuple[float, float] = setting(default=(8.0, 6.0), unit="m", low=2.0, high=200.0)
    start: Pose | None = setting(default=None, unit="m, m, rad", source="none: drawn at random")
    goal: Pose | None = setting(default=None, unit="m, m, rad", source="none: drawn at random")
    min_distance: float = setting(default=2.0, unit="m", source="least from start to goal", low=0.0)

    def __post_init__(self) -> None:
        if self.min_distance > 0.4 * math.hypot(*self.size):
            raise InputError(
                f"EmptyRoom.min_distance is {self.min_distance}; too far for a room of {self.size}"
            )

    def sample(self, rng: np.random.Generator, footprint: Footprint = FOOTPRINT) -> Episode:
        """Draw what is not given, for a chair of this footprint.

        Raises:
            InputError: the given start or goal does not fit into the room, or nothing drawn does.
        """
        width, height = self.size
        ground = make_arena((0.0, 0.0, width, height))
        solid = ground.walls, ground.discs
        for name, pose in (("start", self.start), ("goal", self.goal)):
            outside = pose is not None and not (0 < pose[0] < width and 0 < pose[1] < height)
            if outside or (pose and not is_free_pose(np.array(pose), *solid, footprint, 0.0)):
                raise InputError(
                    f"EmptyRoom.{name} is {pose}; {footprint} must stand in a room of {self.size}"
                )
        for _ in range(_TRIES):
            drawn = [
                pose or (*rng.uniform(_EDGE, (width - _EDGE, height - _EDGE)), rng.uniform(-3, 3))
                for pose in (self.start, self.goal)
            ]
            start, goal = np.array(drawn)
            far = math.dist(start[:2], goal[:2]) >= self.min_distance
            given = self.start is not None and self.goal is not None
            if given or (
                far
                and all(is_free_pose(pose, *solid, footprint, _CLEARANCE) for pose in (start, goal))
            ):
                return Episode(ground.map, start, goal, ground.walls, ground.discs, name="empty")
        raise InputError(
            f"EmptyRoom: {_TRIES} draws found no start and goal for {footprint} in {self}"
        )
