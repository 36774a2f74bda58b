"""Local steering: algorithm 4 of the thesis (section 2.7), and the planner `rrt_star_woa_local`.

From top to bottom: the cost of a whale, algorithm 4 as the function Steer of RRT*, and the planner.
"""

import math
from functools import partial
from typing import NamedTuple

import numpy as np

from planners.collision.polygon_tests import SpaceArrays, blocking_segment, blocks
from planners.problem import Plan, PlannerBase, Problem
from planners.rrt_star_woa.woa import ShiftBounds, Whales, WhaleSettings, move, new_whales, tell
from planners.trees.rrt import TreeSearch, extend, next_iteration, sample, solve
from planners.trees.rrt_star import RrtStar, add_node
from planners.trees.tree import nearest
from wheelchair_gym.base.settings import setting, settings
from wheelchair_gym.compiled.kernel import absorbed_kernel, borrowing_kernel
from wheelchair_gym.compiled.random import Stream, next_in_disc

# The thesis gives x_near the higher priority, and no costs. To be hidden from x_near must outweigh
# any path's length; to be hidden from the goal need not.
NODE_HIDDEN_COST, GOAL_HIDDEN_COST = 1000.0, 10.0
Point = tuple[float, float]  # m


class Steering(NamedTuple):
    """A swarm of points relative to the sample, so that the map's origin has no influence."""

    whales: Whales  # (k, 2) m
    goal_weight: float  # cost per metre from the goal; a metre from the sample costs 1


@borrowing_kernel
def find_blocker(space: SpaceArrays, ax: float, ay: float, bx: float, by: float, last: int) -> int:
    """Return the first segment found to block the line from a to b, `last` first; -1: none."""
    if last >= 0 and blocks(space.segments, space.before, last, ax, ay, bx, by):
        return last
    return blocking_segment(space, ax, ay, bx, by)


@absorbed_kernel
def whale_cost(
    space: SpaceArrays, steering: Steering, goal: Point, near: Point, sample: Point,
    whale: Point, blockers: tuple[int, int],
) -> tuple[float, tuple[int, int]]:  # fmt: skip
    """Return the cost of a whale, relative to a sample: CalculateFitness.

    Its four terms: the distances to x_rand and x_goal, and the visibility of x_goal and x_near.
    Lines of sight are tested only while the whale can still lead. The goal comes first: the segment
    that hides it from one whale hides it from most. Also returns the last ones that hid each.
    """
    (x, y), (u, v), (from_goal, from_near) = sample, whale, blockers
    minimum = steering.whales.leader_cost[0]
    to_goal = math.sqrt((goal[0] - x - u) ** 2 + (goal[1] - y - v) ** 2)
    cost = math.sqrt(u * u + v * v) + steering.goal_weight * to_goal
    if cost < minimum:
        hidden = find_blocker(space, goal[0], goal[1], x + u, y + v, from_goal)
        if hidden != -1:
            cost, from_goal = cost + GOAL_HIDDEN_COST, hidden
    if cost < minimum:
        hidden = find_blocker(space, near[0], near[1], x + u, y + v, from_near)
        if hidden != -1:
            cost, from_near = cost + NODE_HIDDEN_COST, hidden
    return cost, (from_goal, from_near)


@absorbed_kernel
def steer(
    search: TreeSearch, steering: Steering, near: int, x: float, y: float, state: Stream
) -> tuple[float, float]:
    """Return x*, the point that whales find around a sample (x, y) [m]: algorithm 4, to line 15."""
    whales, node, space = steering.whales, search.tree.nodes[near], search.space
    x_goal, x_near = (search.goal[0], search.goal[1]), (node.x, node.y)
    population, leader, parameters = whales.population, whales.leader, whales.parameters
    for i in range(parameters.population):  # line 1
        u, v = next_in_disc(state)
        population[i, 0], population[i, 1] = u * whales.upper[0], v * whales.upper[1]
    leader[0], leader[1], whales.leader_cost[0] = 0.0, 0.0, math.inf
    blockers = -1, -1
    for t in range(parameters.iterations + 1):  # line 3
        for i in range(parameters.population):  # lines 2 and 14
            whale = population[i, 0], population[i, 1]
            cost, blockers = whale_cost(space, steering, x_goal, x_near, (x, y), whale, blockers)
            tell(whales, i, cost)
        if t < parameters.iterations:
            move(whales, t / parameters.iterations, state)  # lines 4 to 13
    return x + leader[0], y + leader[1]


@borrowing_kernel
def grow(search: TreeSearch, until: int, state: Stream, steering: Steering) -> None:
    """Grow a tree to iteration `until`, or to an earlier end: RRT* with `steer` as its Steer."""
    tree = search.tree
    while next_iteration(search, until):
        x, y = sample(search, state)  # x_rand
        near = nearest(tree, x, y)  # x_near
        x, y = steer(search, steering, near, x, y, state)
        x, y, edge, free = extend(search, tree, near, x, y, search.options.step)  # line 16
        if free:
            add_node(search, near, x, y, edge, state)


@settings
class RrtStarWoaLocal(ShiftBounds, PlannerBase):
    """RRT* whose steering is a swarm of points (thesis, section 2.7 and algorithm 4).

    Around each random sample, whales search the point to extend towards: near the sample and the
    goal, visible from the node to extend, and, with less weight, with the goal in sight.
    """

    tree: RrtStar = setting(default=RrtStar(return_on_first_path=True), source="thesis, figure 3.1")
    """The tree search."""
    whales: WhaleSettings = setting(default=WhaleSettings(), source="thesis, figure 3.1")
    """The swarm."""
    goal_weight: float = setting(default=1.0, low=0.0)
    """Cost of the distance from the goal, in multiples of that from the random sample."""

    def solve(self, problem: Problem, rng: np.random.Generator, end: float) -> Plan:
        """Return the first path, or the best of all samples, as `tree` says."""
        upper = np.array([self.width_bound, self.height_bound])
        population = np.zeros((self.whales.population, 2))
        whales = new_whales(population, self.whales.parameters, -upper, upper)
        steering = Steering(whales, self.goal_weight)
        return solve(problem, rng, end, self.tree.options, partial(grow, steering=steering))
