"""The shortest path of an episode: a length that no drive without a contact can beat.

A chair turns in place about the centre of its axle, so that point keeps at least the footprint's
smallest distance, min(front, rear, half width), from all that stands still. The shortest path of a
disc of that radius to the goal's region is therefore no longer than any drive. SPL (Anderson et al.
2018) and SCT (Yokoyama et al. 2021) refer to it.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import shapely

from planners.collision import solids
from planners.collision.space import Space
from planners.graphs.visibility import Visibility
from planners.problem import Problem
from wheelchair_gym.arrays import Array
from wheelchair_gym.task.task import Task
from wheelchair_gym.types import Episode

SIDES = 16  # of each quarter of a polygon that stands for a circle: 0.12 % of the radius
MARGIN = 1e-6  # m: far above the rounding of shapely's buffers
OVERSPEED = 1.1  # times its limit: no chair is faster
MOST_WALLS = 50_000  # of a world: about 12 s


class Shortest(NamedTuple):
    """A lower bound of the driven length [m], and whether obstacles count in it."""

    length: float
    is_exact: bool  # False: the straight line to the goal's region


NO_SHORTEST = Shortest(math.nan, False)


def shortest_path(task: Task, episode: Episode, start: Array) -> Shortest:
    """Return the length of the shortest path from a start to the goal's region.

    Only walls and discs of the episode are obstacles: people, doors and temporary obstacles may
    move away, and a chair can drive through unknown cells and over an open border of the map. The
    region is a disc; a rectangle (`Arrival`) counts as the disc around it. The straight line stands
    in where a world is too large or its shapes leave no path.

    The driven length is that between recorded poses. A straight line between two of them may cut
    a corner that the chair drove around, so the clearance is smaller by that: 3 mm at 10 Hz.

    Args:
        task: of the environment: footprint, tolerance, limits and control period.
        episode: the world and its goal.
        start: (2 or 3,) true pose at which the drive began [m, m, rad].
    """
    outline, tolerance = task.footprint, task.tolerance
    radius = min(outline.front, outline.rear, outline.half_width)
    step = OVERSPEED * max(task.limits.forward, task.limits.backward) * task.period
    clearance = math.sqrt(max(0.0, radius * radius - 0.25 * step * step))
    if episode.arrival is not None:
        tolerance = math.hypot(episode.arrival.along, episode.arrival.across)
    world, goal = (episode.walls.tobytes(), episode.discs.tobytes()), episode.goal[:2]
    return _shortest(world, start[:2].tobytes(), goal.tobytes(), float(tolerance), clearance)


@lru_cache(8)
def _grown(world: tuple[bytes, bytes], clearance: float) -> Any:
    """Walls and discs grown by a clearance [m]; polygons that stand for arcs lie inside them."""
    walls, discs = np.frombuffer(world[0]).reshape(-1, 4), np.frombuffer(world[1]).reshape(-1, 3)
    reach = max(0.0, clearance - MARGIN)
    centres = shapely.points(discs[:, :2])
    circles = shapely.buffer(centres, discs[:, 2] + reach, quad_segs=SIDES)
    solid = shapely.buffer(solids.non_zero(walls), reach, quad_segs=SIDES)
    return shapely.union_all([solid, *circles])


@lru_cache(1000)
def _shortest(
    world: tuple[bytes, bytes], start: bytes, goal: bytes, tolerance: float, clearance: float
) -> Shortest:
    """`shortest_path` of arrays by their bytes: others drive the same world next."""
    a, b = np.frombuffer(start), np.frombuffer(goal)
    straight = max(0.0, math.hypot(*(b - a)) - tolerance)
    if straight == 0.0 or len(world[0]) > MOST_WALLS * 32:
        return Shortest(straight, straight == 0.0)
    try:
        # Obstacles inside the goal's region are removed. From where it enters the region, a path
        # to the goal itself then goes straight on, which adds exactly the region's radius.
        outer = tolerance / math.cos(math.pi / (4 * SIDES))  # a polygon around the region
        region = shapely.buffer(shapely.Point(b), outer, quad_segs=SIDES)
        solid = shapely.difference(_grown(world, clearance), region)
        xmin, ymin, xmax, ymax = shapely.union(solid, shapely.LineString([a, b])).bounds
        space = Space(solids.polygonal(solid), (xmin - 1.0, ymin - 1.0, xmax + 1.0, ymax + 1.0))
        found = Visibility().plan(Problem(space, a, b), np.random.default_rng(0)).length
    except (ValueError, shapely.errors.GEOSException):
        found = math.inf
    if not math.isfinite(found):
        return Shortest(straight, False)
    return Shortest(max(straight, found - tolerance - MARGIN), True)
