"""The geometric method: a blocked straight line bends around a corner beside it, recursively."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from planners.collision.boundary import blocking_segments
from planners.collision.polygon_tests import edge_free
from planners.collision.space import Space
from planners.problem import Plan, PlannerBase, Problem, Status
from wheelchair_gym.compiled.clock import clock
from wheelchair_gym.config import setting, settings

Array = NDArray[np.float64]
Point = tuple[float, float]


class Obstacles(NamedTuple):
    """The connected obstacles of a space."""

    corners: Array  # (n, 2) m: those within the map
    owner: NDArray[np.int64]  # (n,) whose corner each is
    owner_of_segment: NDArray[np.int64]  # of each boundary segment; -1: of none


def _obstacles(space: Space) -> Obstacles:
    """The obstacles; connected ones are one."""
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
    return Obstacles(corners[within], owner[within].astype(np.int64), owner_of_segment)


def _turn(space: Space, obstacles: Obstacles, a: Point, b: Point) -> Point | None:
    """The corner to go around from a to b: see `Geometric`; None if there is none."""
    hit = obstacles.owner_of_segment[blocking_segments(space.arrays, *a, *b)[0]]
    corners = obstacles.corners[np.isin(obstacles.owner, hit[hit >= 0])]
    off = (b[0] - a[0]) * (corners[:, 1] - a[1]) - (b[1] - a[1]) * (corners[:, 0] - a[0])
    longest = []
    for beside in (off, -off):
        if (beside > 0.0).any():
            # Of corners that are equally far, the first: the way runs along the side between them.
            far = corners[beside >= beside.max() * (1.0 - 1e-12)]
            k = int(np.hypot(*(far - a).T).argmin())
            longest.append((float(beside.max()), (float(far[k, 0]), float(far[k, 1]))))
    return min(longest)[1] if longest else None


@settings
class Geometric(PlannerBase):
    """The geometric method of a thesis (its section 3.3), with exact edges.

    Where obstacles block the straight line, it has perpendiculars from their corners; of the
    longest on each side, the shorter one's corner becomes a point of the path, and so on for both
    halves. It is quick and short among few obstacles, may fail among many, and proves nothing.
    """

    max_turns: int = setting(
        default=200, low=0, source="design choice: 20 are common on 50 m of clutter"
    )
    """Largest number of corners to go around."""

    def solve(self, problem: Problem, rng: np.random.Generator, end: float) -> Plan:
        """A path, or why the method ends; the generator is not used."""
        space = problem.free
        obstacles = _obstacles(space)
        start: Point = (float(problem.start[0]), float(problem.start[1]))
        path, ahead = [start], [(float(problem.goal[0]), float(problem.goal[1]))]
        asked: set[tuple[Point, Point]] = set()
        note, tested = "", 0
        while ahead:
            edge = (path[-1], ahead[-1])
            tested += 1
            if edge_free(space.arrays, *edge[0], *edge[1]):
                path.append(ahead.pop())
                continue
            corner = _turn(space, obstacles, *edge)
            if corner is None:
                note = "no corner lies beside a line that is blocked"
            elif edge in asked or corner in edge:
                note = "a line that is blocked leads back to itself"
            elif len(asked) >= self.max_turns:
                note = "more turns than allowed"
            elif clock() >= end:
                note = "out of time"
            if note or corner is None:
                break
            asked.add(edge)
            ahead.append(corner)
        return Plan(
            Status.EXHAUSTED if note else Status.SOLVED,
            np.empty((0, 2)) if note else np.array(path),
            counters={"turns": len(asked), "edges_tested": tested},
            note=note,
        )
