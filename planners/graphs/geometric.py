"""The geometric method: a blocked straight line bends around a corner beside it, recursively."""

import math
from dataclasses import replace
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
import shapely

from planners.collision.boundary import NONE, blocking_segments
from planners.collision.polygon_tests import Index, SpaceArrays, edge_free
from planners.collision.space import Space
from planners.problem import Plan, PlannerBase, Problem, Status, answer, remaining
from planners.trees.rrt_star import RrtStarLimited
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import setting, settings
from wheelchair_gym.compiled.clock import clock
from wheelchair_gym.compiled.kernel import kernel

Point = tuple[float, float]  # m
MAX_TURNS = 200  # largest number of corners to go around: 20 are common on 50 m of clutter


class Obstacles(NamedTuple):
    """The connected obstacles of a space."""

    corners: Array  # (n, 2) m: those within the map
    owner: Index  # (n,) obstacle of each corner
    owner_of_segment: Index  # obstacle of each boundary segment; -1: none
    parts: int  # number of obstacles


_OBSTACLES: WeakKeyDictionary[Space, Obstacles] = WeakKeyDictionary()


def obstacles_of(space: Space) -> Obstacles:
    """Return the obstacles of a space, computed once; connected ones are one."""
    if space not in _OBSTACLES:
        parts = shapely.get_parts(space.solid)
        corners, owner = shapely.get_coordinates(parts, return_index=True)
        low, high = np.array(space.bounds).reshape(2, 2)
        within = ((low < corners) & (corners < high)).all(axis=1)
        segments = space.arrays.segments
        middles = shapely.points(0.5 * (segments[:, :2] + segments[:, 2:]))
        owner_of_segment = np.full(len(segments), -1, dtype=np.int64)
        if len(parts):
            which, nearest = shapely.STRtree(parts).query_nearest(
                middles, max_distance=1e-6, all_matches=False
            )
            owner_of_segment[which] = nearest
        owner = owner[within].astype(np.int64)
        _OBSTACLES[space] = Obstacles(corners[within], owner, owner_of_segment, len(parts))
    return _OBSTACLES[space]


@kernel
def corner_beside(
    arrays: SpaceArrays, obstacles: Obstacles, ax: float, ay: float, bx: float, by: float
) -> int:
    """Return the corner around which a blocked line [m] bends, or -1.

    Of the corners farthest to each side, of the obstacles hit, it is the one nearer to the line. Of
    corners at the same distance, it is the first: the path runs along the side between them.
    """
    hit = np.zeros(obstacles.parts + 1, np.bool_)  # the last one stands for no obstacle
    for segment in blocking_segments(arrays, ax, ay, bx, by)[0]:
        hit[obstacles.owner_of_segment[segment]] = True
    hit[-1] = False
    corners, chosen, minimum = obstacles.corners, -1, math.inf
    for side in (1.0, -1.0):
        maximum, near, found = 0.0, math.inf, -1  # most: distance times the line's length [m2]
        for exact in (False, True):
            for k in range(len(corners)):
                if hit[obstacles.owner[k]]:
                    x, y = corners[k, 0] - ax, corners[k, 1] - ay
                    off = side * ((bx - ax) * y - (by - ay) * x)
                    if not exact:
                        maximum = max(maximum, off)
                    elif off >= maximum * (1.0 - 1e-12) and math.hypot(x, y) < near:
                        found, near = k, math.hypot(x, y)
        if 0.0 < maximum < minimum:
            chosen, minimum = found, maximum
    return chosen


@settings
class Geometric(PlannerBase):
    """The geometric method of a thesis (its section 3.3), with exact edges.

    Where obstacles block the straight line, it has perpendiculars from their corners; of the
    longest on each side, the shorter one's corner becomes a point of the path, and so on for both
    halves. It is quick and short among few obstacles, may fail among many, and proves nothing.
    """

    def solve(self, problem: Problem, rng: np.random.Generator, end: float) -> Plan:
        """Return a path, or why the method ends; the generator is not used."""
        arrays, obstacles = problem.free.arrays, obstacles_of(problem.free)
        path, ahead = ([(float(at[0]), float(at[1]))] for at in (problem.start, problem.goal))
        asked: set[tuple[Point, Point]] = set()  # blocked lines
        note, tested = "", 0
        while ahead:
            a, b = path[-1], ahead[-1]
            if edge_free(arrays, *a, *b):
                tested += 1
                path.append(ahead.pop())
                continue
            if len(asked) == MAX_TURNS or (asked and clock() >= end):
                note = "more turns than allowed" if len(asked) == MAX_TURNS else "out of time"
                break
            tested += 1
            k = corner_beside(arrays, obstacles, *a, *b)
            if k == NONE:
                note = "no corner lies beside a line that is blocked"
                break
            corner = float(obstacles.corners[k, 0]), float(obstacles.corners[k, 1])
            if corner in (a, b) or (a, b) in asked:
                note = "a line that is blocked leads back to itself"
                break
            asked.add((a, b))
            ahead.append(corner)
        found = np.empty((0, 2)) if note else np.array(path)
        return answer(found, {"turns": len(asked), "edges_tested": tested}, note)


@settings
class GeometricThenLimited(PlannerBase):
    """The geometric method; where it fails, limited tree expansion: a thesis's future work.

    The first is quick and short where there is little in the way, the second finds its way through
    clutter (Larachi 2024, section 3.6.4).
    """

    limited: RrtStarLimited = setting(default=RrtStarLimited(), source="thesis, section 3.2")
    """The tree that answers where the first method fails."""

    def trivial(self, problem: Problem) -> Plan | None:
        """Return None: the planners of the two parts know trivial problems."""
        return None

    def solve(self, problem: Problem, rng: np.random.Generator, end: float) -> Plan:
        """Return the first path of the two; the counter `geometric` tells whether it is geometric.

        `edges_tested` counts the edges of both.
        """
        first = Geometric().plan(problem, rng, remaining(end))
        if first.status is not Status.EXHAUSTED or clock() >= end:
            return replace(first, counters={**first.counters, "geometric": 1})
        plan = self.limited.plan(problem, rng, remaining(end))
        tested = first.counters["edges_tested"] + plan.counters.get("edges_tested", 0)
        return replace(plan, counters={**plan.counters, "edges_tested": tested, "geometric": 0})
