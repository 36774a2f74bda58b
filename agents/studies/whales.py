"""The whales of both variants, as the thesis draws them (figures 2.6 and 2.7)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, Final

import numpy as np

from planners import Problem
from planners.collision.polygon_tests import blocked_edges
from planners.rrt_star_woa.local_steering import GOAL_HIDDEN_COST, NODE_HIDDEN_COST
from planners.rrt_star_woa.path_shortening import scatter_in_ellipses
from planners.rrt_star_woa.woa import WhaleParameters, move, new_whales, tell
from wheelchair_gym.arrays import Array
from wheelchair_gym.geometry import path_length
from wheelchair_gym.random import Stream, stream
from wheelchair_gym.rendering.palette import BLUE, GREEN, ORANGE, PURPLE, VERMILION, Colour

# Words, colour, and a path (n, 2) or a point (1, 2) [m].
Whale = tuple[str, Colour, Array]

# By whether a whale sees the node to extend, and the goal.
SIGHT: Final = {
    (False, False): ("sees neither", VERMILION),
    (True, False): ("sees the node", BLUE),
    (False, True): ("sees the goal", ORANGE),
    (True, True): ("sees both", GREEN),
}


def paths_of_whales(
    planner: Any, problem: Problem, path: Array, rng: np.random.Generator
) -> Iterator[list[Whale]]:
    """The whales of the global variant around the tree's path, before each move and at the end.

    With the generator as the tree leaves it, these are the whales of the plan.
    """
    space, n, best = problem.free.arrays, len(path) - 2, path
    if n < 1:
        return
    bounds, state = (planner.width_bound, planner.height_bound), stream(rng)
    population = scatter_in_ellipses(planner.whales.population, n, *bounds, state)

    def costs_of(shifts: Array) -> tuple[Array, list[Whale]]:
        whales = [np.vstack([path[:1], path[1:-1] + of.reshape(n, 2), path[-1:]]) for of in shifts]
        lengths = np.array([path_length(whale) for whale in whales])
        blocked = np.array([blocked_edges(space, whale).sum() for whale in whales])
        found: list[Whale] = [
            ("blocked path", VERMILION, whale) if hit else ("free path", BLUE, whale)
            for whale, hit in zip(whales, blocked, strict=True)
        ]
        costs = planner.shortness_weight * lengths + planner.collision_free_weight * blocked
        return costs, found

    for found, _ in _swim(
        planner.whales.parameters, population, np.tile(bounds, n), state, costs_of
    ):
        of = [] if planner.whales.leader == "latest" else [best]
        free = [*of, *(whale for words, _, whale in found if words == "free path")]
        best = min(free, key=path_length, default=path)
        yield [*found, ("best free path", GREEN, best)]


def points_of_whales(
    planner: Any, problem: Problem, node: Array, sample: Array, rng: np.random.Generator
) -> Iterator[list[Whale]]:
    """The whales of the local variant around a sample (2,) [m], before each move and at the end.

    They extend a node (2,) [m] of the tree; those of the planner itself are other draws.
    """
    space, goal, state = problem.free.arrays, problem.goal[:2], stream(rng)
    w, h = planner.width_bound, planner.height_bound
    # The first of a scattered population is not shifted.
    population = scatter_in_ellipses(planner.whales.population + 1, 1, w, h, state)[1:].copy()

    def costs_of(shifts: Array) -> tuple[Array, list[Whale]]:
        whales = sample + shifts
        near, far = (
            np.array([not blocked_edges(space, np.vstack([end, whale])).any() for whale in whales])
            for end in (node, goal)
        )
        costs = np.hypot(*shifts.T) + planner.goal_weight * np.hypot(*(whales - goal).T)
        found = [
            (*SIGHT[bool(a), bool(b)], w[None]) for a, b, w in zip(near, far, whales, strict=True)
        ]
        return costs + NODE_HIDDEN_COST * ~near + GOAL_HIDDEN_COST * ~far, found

    for found, leader in _swim(
        planner.whales.parameters, population, np.array([w, h]), state, costs_of
    ):
        yield [*found, ("best whale", PURPLE, (sample + leader)[None])]


def _swim(
    parameters: WhaleParameters, population: Array, upper: Array, state: Stream,
    costs_of: Callable[[Array], tuple[Array, list[Whale]]],
) -> Iterator[tuple[list[Whale], Array]]:  # fmt: skip
    """Move a population as algorithm 3 does; yield the whales with colours, and the leader."""
    whales = new_whales(population, parameters, -upper, upper)
    for t in range(parameters.iterations + 1):
        costs, found = costs_of(population)
        for i, cost in enumerate(costs):
            tell(whales, i, cost)
        yield found, whales.leader
        if t < parameters.iterations:
            move(whales, t / parameters.iterations, state)
