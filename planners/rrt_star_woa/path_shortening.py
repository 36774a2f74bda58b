"""Path shortening: algorithm 5 of the thesis (section 2.8), and the planner `rrt_star_woa_global`.

A whale is a path: the shifts of all inner points of the path of RRT*. It costs its weighted length
and each blocked edge (`LengthFree`). Algorithm 5 is the first population here, then the search of
the planner `swarm` (`planners.swarm.search.iterate`) with the moves of whales (`woa.move`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from planners.collision.polygon_tests import SpaceArrays
from planners.problem import Plan, PlannerBase, Problem, Status
from planners.rrt_star_woa.woa import ShiftBounds, WhaleSettings
from planners.smoothing.curves import POLYLINE
from planners.swarm.optimizers import WHALES, MoveParameters
from planners.swarm.path_cost import LengthFree, PathProblem
from planners.swarm.search import InitialSwarm, new_search, run
from planners.trees.settings import RrtStar
from wheelchair_gym.arrays import Array
from wheelchair_gym.compiled.clock import clock
from wheelchair_gym.compiled.kernel import kernel
from wheelchair_gym.config import setting, settings
from wheelchair_gym.random import Stream, next_in_disc, stream


@kernel
def scatter_in_ellipses(k: int, n: int, width: float, height: float, state: Stream) -> Array:
    """Return shifts (k, 2 n) [m] of n points: line 1.

    The first path is not shifted. The points of the others are drawn within ellipses.
    """
    population = np.zeros((k, 2 * n))
    for j in range(n):
        for i in range(1, k):
            u, v = next_in_disc(state)
            population[i, 2 * j] = u * width
            population[i, 2 * j + 1] = v * height
    return population


@settings
class RrtStarWoaGlobal(LengthFree, ShiftBounds, PlannerBase):
    """RRT* whose path a swarm of paths then shortens (thesis, section 2.8 and algorithm 5)."""

    whales: WhaleSettings = setting(
        default=WhaleSettings(population=30, iterations=100), source="thesis, figure 3.1"
    )
    """The swarm."""
    tree: RrtStar = setting(default=RrtStar(return_on_first_path=True), source="thesis, figure 3.1")
    """The tree search."""

    def solve(self, problem: Problem, rng: np.random.Generator, end: float) -> Plan:
        """Return a free path, with the best leader never longer than that of the tree.

        The deadline is that of the tree; the run of the swarm, some ms, follows in one piece.
        """
        began = clock()
        plan = self.tree.solve(problem, rng, end)
        if plan.status != Status.SOLVED:
            return plan
        tree_s = clock() - began
        path, _ = self.shorten(problem.free.arrays, plan.path, stream(rng))
        return replace(plan, path=path, timings={"tree_s": tree_s})

    def shorten(self, space: SpaceArrays, path: Array, state: Stream) -> tuple[Array, Array]:
        """Return the best free path and the leader's path near a free path (n, 2) [m].

        If the weights favour a path through a wall, the leader is not free. The best free path is
        never longer than the given path; with the latest leader it is the best of the last
        population alone and may be longer.
        """
        n, bounds = len(path) - 2, (self.width_bound, self.height_bound)
        if n < 1:
            return path, path
        anchors, upper = np.ascontiguousarray(path[1:-1]), np.tile(bounds, n)
        population = scatter_in_ellipses(self.whales.population, n, *bounds, state)
        problem = PathProblem(
            space, np.empty((0, 3)), path[0], path[-1], anchors, POLYLINE, False, 1
        )
        start = InitialSwarm(problem, population, -upper, upper)  # line 1
        search = new_search(start, self.path_cost, MoveParameters(WHALES, self.whales.parameters))
        found = run(search, self.whales.iterations, max(1, self.whales.iterations), state)
        return found.line if len(found.line) else path, found.way_points
