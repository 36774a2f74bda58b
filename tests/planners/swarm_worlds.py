"""Worlds that swarms are tested in: blocks, and the round obstacles of a paper."""

import numpy as np
import shapely

from planners import Problem, Space
from tests.planners.test_planners import on
from wheelchair_gym.scenes.published import CHAOTIC_PSO_DISCS

BLOCKS = [(2.0, 3.0, 6.0, 5.0), (5.0, 6.0, 8.0, 7.5), (0.0, 7.0, 3.0, 8.0)]


def among_blocks():
    return on(BLOCKS)


def among_discs():
    space = Space.from_walls(np.empty((0, 4)), CHAOTIC_PSO_DISCS, (0.0, 0.0, 10.0, 10.0))
    return Problem(space, np.array([1.0, 1.0]), np.array([9.0, 9.0]))


def nearest(line):
    """Return the minimum distance of a line to the discs' centres, relative to their radii."""
    way = shapely.LineString(line)
    return min(way.distance(shapely.Point(x, y)) / r for x, y, r in CHAOTIC_PSO_DISCS)
