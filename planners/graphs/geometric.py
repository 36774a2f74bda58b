"""The geometric method: a blocked straight line bends around a corner beside it, recursively."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from planners.collision.boundary import blocking_segments
from planners.collision.polygon_tests import SpaceArrays, edge_free
from planners.collision.space import Space
from planners.problem import Plan, PlannerBase, Problem, Status, answer, chunks, remaining
from planners.trees.settings import RrtStarLimited
from wheelchair_gym.arrays import Array
from wheelchair_gym.compiled.clock import clock
from wheelchair_gym.compiled.kernel import borrowing_kernel, kernel
from wheelchair_gym.config import setting, settings

MAX_TURNS = 200  # largest number of corners to go around: 20 are common on 50 m of clutter
ENDS = (
    "",
    "more turns than allowed",
    "no corner lies beside a line that is blocked",
    "a line that is blocked leads back to itself",
)
WHOLE, GOES_ON, NO_CORNER, LOOP = range(len(ENDS))


class Obstacles(NamedTuple):
    """The connected obstacles of a space."""

    corners: Array  # (n, 2) m: those within the map
    owner: NDArray[np.int64]  # (n,) obstacle of each corner
    owner_of_segment: NDArray[np.int64]  # obstacle of each boundary segment; -1: none
    parts: int  # number of obstacles


def _obstacles(space: Space) -> Obstacles:
    """Return the obstacles; connected ones are one."""
    parts = shapely.get_parts(space.solid)
    corners, owner = shapely.get_coordinates(parts, return_index=True)
    xmin, ymin, xmax, ymax = space.bounds
    x, y = corners.T
    within = (xmin < x) & (x < xmax) & (ymin < y) & (y < ymax)
    segments = space.arrays.segments
    middles = shapely.points(0.5 * (segments[:, :2] + segments[:, 2:]))
    owner_of_segment = np.full(len(segments), -1, dtype=np.int64)
    if len(parts):
        which, nearest = shapely.STRtree(parts).query_nearest(
            middles, max_distance=1e-6, all_matches=False
        )
        owner_of_segment[which] = nearest
    return Obstacles(corners[within], owner[within].astype(np.int64), owner_of_segment, len(parts))


@borrowing_kernel
def farthest_corner(
    obstacles: Obstacles, hit: NDArray[np.bool_], ax: float, ay: float, bx: float, by: float,
    side: float,
) -> tuple[int, float]:  # fmt: skip
    """Return the corner of the obstacles hit that is farthest to one side of a line; -1: none.

    Of corners at the same distance, it is the first: the path runs along the side between them.
    Also returns its distance times the line's length [m2].
    """
    corners, found, most, near = obstacles.corners, -1, 0.0, math.inf
    for exact in (False, True):
        for k in range(corners.shape[0]):
            if not hit[obstacles.owner[k]]:
                continue
            x, y = corners[k, 0] - ax, corners[k, 1] - ay
            off = side * ((bx - ax) * y - (by - ay) * x)
            if not exact:
                most = max(most, off)
            elif most > 0.0 and off >= most * (1.0 - 1e-12) and math.hypot(x, y) < near:
                found, near = k, math.hypot(x, y)
    return found, most


@kernel
def bend(
    arrays: SpaceArrays, obstacles: Obstacles, path: Array, ahead: Array, asked: Array,
    counts: NDArray[np.int64], until: int,
) -> int:  # fmt: skip
    """Go around corners until the path is whole, the method ends, or `until` turns are made.

    Args:
        arrays: the space.
        obstacles: its obstacles.
        path: points (n, 2) [m] so far.
        ahead: points (n, 2) [m] that follow, the next one last.
        asked: blocked lines (n, 4) [m] so far.
        counts: (4,) points of the path and ahead, turns, and edges tested.
        until: number of turns.

    Returns:
        An index of `ENDS`.
    """
    hit = np.zeros(obstacles.parts + 1, np.bool_)
    while counts[1] > 0:
        ax, ay = path[counts[0] - 1]
        bx, by = ahead[counts[1] - 1]
        if edge_free(arrays, ax, ay, bx, by):
            counts[3] += 1
            path[counts[0]] = ahead[counts[1] - 1]
            counts[0], counts[1] = counts[0] + 1, counts[1] - 1
            continue
        if counts[2] >= until:
            return GOES_ON
        counts[3] += 1
        hit[:] = False
        for segment in blocking_segments(arrays, ax, ay, bx, by)[0]:
            owner = obstacles.owner_of_segment[segment]
            hit[owner if owner >= 0 else obstacles.parts] = True
        hit[obstacles.parts] = False
        k, far = farthest_corner(obstacles, hit, ax, ay, bx, by, 1.0)
        other, less = farthest_corner(obstacles, hit, ax, ay, bx, by, -1.0)
        if k < 0 or (other >= 0 and less < far):
            k = other
        if k < 0:
            return NO_CORNER
        x, y = obstacles.corners[k]
        if (x == ax and y == ay) or (x == bx and y == by):
            return LOOP
        for i in range(counts[2]):
            if asked[i, 0] == ax and asked[i, 1] == ay and asked[i, 2] == bx and asked[i, 3] == by:
                return LOOP
        asked[counts[2]] = ax, ay, bx, by
        ahead[counts[1]] = x, y
        counts[1], counts[2] = counts[1] + 1, counts[2] + 1
    return WHOLE


@settings
class Geometric(PlannerBase):
    """The geometric method of a thesis (its section 3.3), with exact edges.

    Where obstacles block the straight line, it has perpendiculars from their corners; of the
    longest on each side, the shorter one's corner becomes a point of the path, and so on for both
    halves. It is quick and short among few obstacles, may fail among many, and proves nothing.
    """

    def solve(self, problem: Problem, rng: np.random.Generator, end: float) -> Plan:
        """Return a path, or why the method ends; the generator is not used."""
        space = problem.free
        obstacles = _obstacles(space)
        most = MAX_TURNS
        path, ahead, asked = np.empty((most + 2, 2)), np.empty((most + 1, 2)), np.empty((most, 4))
        path[0], ahead[0] = problem.start[:2], problem.goal[:2]
        counts, code = np.array([1, 1, 0, 0]), GOES_ON
        for until in chunks(most, end):
            code = bend(space.arrays, obstacles, path, ahead, asked, counts, until)
            if code != GOES_ON:
                break
        note = ENDS[code] if code != GOES_ON or counts[2] == most else "out of time"
        path = np.empty((0, 2)) if note else path[: counts[0]].copy()
        return answer(path, {"turns": int(counts[2]), "edges_tested": int(counts[3])}, note)


@settings
class GeometricThenLimited(PlannerBase):
    """The geometric method; where it fails, limited tree expansion: a thesis's future work.

    The first is quick and short where there is little in the way, the second finds its way through
    clutter (Larachi 2024, section 3.6.4).
    """

    geometric: Geometric = setting(default=Geometric(), source="thesis, section 3.3")
    """The method that is tried first."""
    limited: RrtStarLimited = setting(default=RrtStarLimited(), source="thesis, section 3.2")
    """The tree that answers where the first method fails."""

    def trivial(self, problem: Problem) -> Plan | None:
        """Return None: the planners of the two parts know trivial problems."""
        return None

    def solve(self, problem: Problem, rng: np.random.Generator, end: float) -> Plan:
        """Return the first path of the two; the counter `geometric` tells whether it is geometric.

        `edges_tested` counts the edges of both.
        """
        first = self.geometric.plan(problem, rng, remaining(end))
        if first.status is not Status.EXHAUSTED or clock() >= end:
            return replace(first, counters={**first.counters, "geometric": 1})
        plan = self.limited.plan(problem, rng, remaining(end))
        tested = first.counters["edges_tested"] + plan.counters.get("edges_tested", 0)
        return replace(plan, counters={**plan.counters, "edges_tested": tested, "geometric": 0})
