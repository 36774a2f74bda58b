"""The probabilistic roadmap: random free points, joined where a straight way between them is."""

from __future__ import annotations

import math
from time import perf_counter

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from planners.draws import Stream, stream, uniform
from planners.exact import SpaceArrays, point_free
from planners.graphs.roadmap import shortest
from planners.types import Plan, Problem, Status, begin, trivial
from wheelchair_gym.config import setting, settings
from wheelchair_gym.kernel import kernel

Array = NDArray[np.float64]


@kernel
def _free_samples(arrays: SpaceArrays, count: int, state: Stream) -> Array:
    """Those of so many points, uniform on the map, that are free (k, 2) [m]."""
    bounds = arrays.bounds
    found = np.empty((count, 2))
    k = 0
    for _ in range(count):
        x = bounds[0] + uniform(state) * (bounds[2] - bounds[0])
        y = bounds[1] + uniform(state) * (bounds[3] - bounds[1])
        if point_free(arrays, x, y):
            found[k, 0], found[k, 1] = x, y
            k += 1
    return found[:k].copy()


@settings
class Prm:
    """A roadmap over random points (Kavraki et al. 1996), joined within the radius of PRM*.

    The radius gamma sqrt(log n / n) shrinks as n nodes fill the map; gamma is `radius_factor` times
    the least value for which the paths converge to the shortest (Karaman and Frazzoli 2011). Where
    the points do not join start and goal, there will be twice as many.
    """

    iterations: int = setting(default=40_000, source="points drawn: doors of 1 m", low=1)
    first: int = setting(default=500, source="points of the first roadmap", low=1)
    radius_factor: float = setting(default=1.1, source="above 1, so that it converges", low=0.1)

    def plan(
        self, problem: Problem, rng: np.random.Generator, deadline: float | None = None
    ) -> Plan:
        """Answer with the shortest way over the first roadmap that joins start and goal.

        A roadmap proves nothing, so failure is `exhausted`.
        """
        began, end = begin(deadline)
        plan = trivial(problem)
        if plan is not None:
            return plan
        arrays, state = problem.free.arrays, stream(rng)
        least = 2.0 * math.sqrt(1.5 * problem.free.free.area / math.pi)  # d = 2
        nodes = np.array([problem.start[:2], problem.goal[:2]], dtype=np.float64)
        drawn, tested = 0, 0
        path, pairs = np.empty((0, 2)), np.empty((0, 2), dtype=np.int64)
        while drawn < self.iterations and not len(path):
            more = min(max(drawn, self.first), self.iterations - drawn)
            nodes = np.vstack([nodes, _free_samples(arrays, more, state)])
            drawn += more
            radius = self.radius_factor * least * math.sqrt(math.log(len(nodes)) / len(nodes))
            pairs = cKDTree(nodes).query_pairs(radius, output_type="ndarray").astype(np.int64)
            way = shortest(arrays, nodes, pairs, end)
            path, tested = way.path, tested + way.tested
            if perf_counter() >= end:
                break
        return Plan(
            Status.SOLVED if len(path) else Status.EXHAUSTED,
            path,
            np.hstack([nodes[pairs[:, 0]], nodes[pairs[:, 1]]]) if len(path) else np.empty((0, 4)),
            counters={"nodes": len(nodes), "iterations": drawn, "edges_tested": tested},
            timings={"time_s": perf_counter() - began},
            note="" if len(path) else f"{drawn} points do not join start and goal",
        )
