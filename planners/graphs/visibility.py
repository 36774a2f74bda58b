"""The exact optimum, by lines of sight between the corners of what is solid."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from planners.erosion import ARC, SHIFT
from planners.graphs.cones import shortest
from planners.types import Plan, Problem, Status, begin, trivial
from wheelchair_gym.config import settings

ALL = 2**62  # cones: more than there is room for
FIRST, MORE = (
    20_000,
    4,
)  # cones before the clock is looked at (some 20 ms); how many times more next


@settings
class Visibility:
    """Shortest paths, exactly; it proves it where there is none.

    With a clearance the optimum is that among obstacles whose grown corners are polygons; see
    `optima` for how near that is.
    """

    def plan(
        self, problem: Problem, rng: np.random.Generator, deadline: float | None = None
    ) -> Plan:
        """Find the shortest path; the generator is not used.

        A search that would outlast the deadline [s] begins anew with more cones while there is
        time, and ends `exhausted`; what a map needs once (arrays, triangles) is not cut short.
        """
        began, ends = begin(deadline)
        plan = trivial(problem)
        if plan is not None:
            return plan
        mesh, corners = problem.free.mesh, problem.free.corners
        start, goal = (np.array(p[:2], dtype=np.float64) for p in (problem.start, problem.goal))
        most = ALL if deadline is None else FIRST
        while True:
            path, proven, settled, cones = shortest(mesh, corners, start, goal, most)
            if proven or time.perf_counter() >= ends:
                break
            most *= MORE
        failed = Status.NO_PATH if proven else Status.EXHAUSTED
        return Plan(
            Status.SOLVED if len(path) else failed,
            path,
            counters={"nodes": settled, "corners": len(corners.place), "cones": cones},
            timings={"time_s": time.perf_counter() - began},
        )


class Optima(NamedTuple):
    """Lengths [m] of the shortest paths of a problem; infinite where there is none."""

    touching: float  # of a point, which may touch what is solid
    at_least: float  # the optimum with the clearance is no shorter
    constrained: float  # of a path that keeps the clearance


def optima(problem: Problem) -> Optima:
    """The optimum at the problem's clearance, within bounds, beside that of a touching point.

    A grown corner is a polygon whose sides touch the arc, so the path found keeps the clearance
    and is no shorter than the optimum. Obstacles grown by so much less that their polygons lie
    inside those arcs give a bound from below. Ends that are not free there give infinity.
    """
    inner = problem.clearance * math.cos(0.5 * ARC) / (1.0 + SHIFT) ** 2
    rng = np.random.default_rng(0)
    touching, least, constrained = (
        Visibility().plan(replace(problem, clearance=clearance), rng).length
        for clearance in (0.0, inner, problem.clearance)
    )
    return Optima(touching, least, constrained)
