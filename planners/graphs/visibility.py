"""The exact optimum, by lines of sight between the corners of what is solid."""

from __future__ import annotations

import time

import numpy as np

from planners.graphs.cones import shortest
from planners.types import Plan, Problem, Status, trivial
from wheelchair_gym.config import settings


@settings
class Visibility:
    """Shortest paths, exactly; it proves it where there is none."""

    def plan(
        self, problem: Problem, rng: np.random.Generator, deadline: float | None = None
    ) -> Plan:
        """Find the shortest path; the generator is not used."""
        began = time.perf_counter()
        plan = trivial(problem)
        if plan is not None:
            return plan
        mesh, corners = problem.free.mesh, problem.free.corners
        start, goal = (np.array(p[:2], dtype=np.float64) for p in (problem.start, problem.goal))
        path, settled, cones = shortest(mesh, corners, start, goal)
        return Plan(
            Status.SOLVED if len(path) else Status.NO_PATH,
            path,
            counters={"nodes": settled, "corners": len(corners.place), "cones": cones},
            timings={"time_s": time.perf_counter() - began},
        )
