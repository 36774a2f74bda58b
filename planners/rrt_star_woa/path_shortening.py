"""Path shortening: algorithm 5 of the thesis (section 2.8), and the planner `rrt_star_woa_global`.

A whale is a path: the shifts of all inner points of the path of RRT*. From top to bottom: the first
population, algorithm 5, and the planner. A whale costs its weighted length and each blocked edge
(`LengthFree`), where the thesis has one term for all edges.
"""

import math
from dataclasses import replace

import numpy as np

from planners.collision.polygon_tests import SpaceArrays
from planners.problem import Plan, PlannerBase, Problem, Status
from planners.rrt_star_woa.woa import ShiftBounds, Whales, WhaleSettings, move, new_whales, tell
from planners.smoothing.curves import POLYLINE
from planners.swarm.path_cost import (
    LengthFree,
    PathCost,
    PathProblem,
    PathWorkspace,
    evaluate,
    new_workspace,
    write_way_points,
)
from planners.trees.rrt_star import RrtStar
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import setting, settings
from wheelchair_gym.compiled.clock import clock
from wheelchair_gym.compiled.kernel import borrowing_kernel, kernel
from wheelchair_gym.compiled.random import Stream, next_in_disc, stream


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


@borrowing_kernel
def shorten(
    problem: PathProblem, path_cost: PathCost, whales: Whales, free: Array,
    workspace: PathWorkspace, state: Stream,
) -> float:  # fmt: skip
    """Run algorithm 5; write the best free path to `free` and return its cost, or infinity.

    The leader's path, which need not be free, is in the workspace's points afterwards.
    """
    parameters, line, best = whales.parameters, workspace.line, math.inf
    for t in range(parameters.iterations + 1):  # line 3
        if parameters.latest:
            best = math.inf
        for i in range(parameters.population):  # lines 2 and 14
            cost, free_cost = evaluate(
                problem, path_cost, whales.population[i], whales.leader_cost[0], best, workspace
            )
            if free_cost < best:
                best = free_cost
                for k in range(line.shape[0]):
                    free[k, 0], free[k, 1] = line[k, 0], line[k, 1]
            tell(whales, i, cost)
        if t < parameters.iterations:
            move(whales, t / parameters.iterations, state)  # lines 4 to 13
    write_way_points(problem, whales.leader, workspace.points)
    return best


@settings
class RrtStarWoaGlobal(LengthFree, ShiftBounds, PlannerBase):
    """RRT* whose path a swarm of paths then shortens (thesis, section 2.8 and algorithm 5)."""

    whales: WhaleSettings = setting(default=WhaleSettings(population=30, iterations=100))
    """The swarm; figure 3.1 of the thesis has 10 whales and 10 iterations."""
    tree: RrtStar = setting(default=RrtStar(return_on_first_path=True), source="thesis, figure 3.1")
    """The tree search."""

    def solve(self, problem: Problem, rng: np.random.Generator, end: float) -> Plan:
        """Return a free path, with `leader="best"` never longer than that of the tree.

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
        whales = new_whales(population, self.whales.parameters, -upper, upper)
        problem = PathProblem(
            space, np.empty((0, 3)), path[0], path[-1], anchors, POLYLINE, False, 1
        )
        workspace, free = new_workspace(problem), np.empty_like(path)
        cost = shorten(problem, self.path_cost, whales, free, workspace, state)
        return free if cost < np.inf else path, workspace.points
