"""The planners of one growing tree, as settings: RRT, RRT* and the thesis's two whale variants."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from planners.draws import stream
from planners.space import Bounds
from planners.swarm.whale_path import shorten
from planners.swarm.woa import WhaleSettings
from planners.trees.growth import Growth, grow, new_room
from planners.trees.steering import Pull, new_school
from planners.trees.tree import NONE, branch, edges, new_tree
from planners.types import Plan, Problem, Status, trivial
from wheelchair_gym.config import setting, settings

Array = NDArray[np.float64]

_NO_PULL = Pull(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
_FIGURE = "thesis, figure 3.1"
_ROOM = "rooms and doors of buildings"


def _grown(
    problem: Problem,
    rng: np.random.Generator,
    growth: Growth,
    nodes: int,
    whales: WhaleSettings | None = None,
    pull: Pull = _NO_PULL,
) -> Plan:
    """The plan that one growing tree of at most so many nodes makes."""
    began = perf_counter()
    answer = trivial(problem)
    if answer is not None:
        return answer
    arrays = problem.free.arrays
    start, goal = (np.array(end[:2], dtype=np.float64) for end in (problem.start, problem.goal))
    tree = new_tree(arrays.bounds, min(nodes, growth.iterations + 1))
    swarm = (whales or WhaleSettings(population=1)).values
    last, iterations, first = grow(
        arrays,
        tree,
        start,
        goal,
        growth,
        swarm,
        pull,
        new_school(swarm, pull),
        new_room(len(tree.nodes)),
        stream(rng),
    )
    grown = tree.nodes[: tree.grid["count"][0]]
    counters = {"nodes": len(grown), "iterations": iterations}
    path = np.empty((0, 2))
    if last != NONE:
        counters["first_path_iterations"] = first
        path = branch(grown, last)
        if (path[-1] != goal).any():
            path = np.vstack([path, goal])
    return Plan(
        Status.EXHAUSTED if last == NONE else Status.SOLVED,
        path,
        edges(grown),
        counters,
        {"time_s": perf_counter() - began},
    )


@settings
class Rrt:
    """A rapidly exploring random tree (LaValle 1998); it ends with its first path."""

    iterations: int = setting(default=20_000, source="doors of 1 m on maps of 50 m", low=1)
    nodes: int = setting(default=20_000, source="as the iterations", low=2)
    step: float = setting(default=2.0, unit="m", source=_ROOM, low=1e-3)
    goal_bias: float = setting(default=0.05, source="LaValle and Kuffner 2001", low=0.0, high=1.0)
    goal_reach: float = setting(default=2.0, unit="m", source="as the step", low=0.0)

    def plan(self, problem: Problem, rng: np.random.Generator) -> Plan:
        """Answer a problem with the first path found."""
        growth = Growth(
            iterations=self.iterations,
            step=self.step,
            goal_bias=self.goal_bias,
            reach=self.goal_reach,
            rewiring=False,
            radius=0.0,
            gamma=0.0,
            stop_at_first=True,
            whales=False,
        )
        return _grown(problem, rng, growth, self.nodes)


@settings
class RrtStar:
    """RRT* (Karaman and Frazzoli 2011): the best parent is chosen, and neighbours are rewired.

    Neighbours lie within `search_radius`, or, where that is null, within the radius
    gamma sqrt(log n / n) that shrinks as the tree of n nodes fills the map; gamma is
    `radius_factor` times the least value that makes the paths converge to the shortest.
    """

    iterations: int = setting(default=10_000, source="thesis, figure 3.1; about 20 ms", low=1)
    nodes: int = setting(default=100_000, source="more than the iterations", low=2)
    step: float = setting(default=4.0, unit="m", source=_ROOM, low=1e-3)
    search_radius: float | None = setting(default=None, unit="m", low=1e-3)
    radius_factor: float = setting(default=1.2, source="measured: see the benchmark", low=0.1)
    goal_bias: float = setting(default=0.05, source="LaValle and Kuffner 2001", low=0.0, high=1.0)
    goal_reach: float = setting(default=4.0, unit="m", source="as the step", low=0.0)
    return_on_first_path: bool = setting(default=False, source="more samples, shorter paths")

    @classmethod
    def thesis(cls) -> RrtStar:
        """The settings of the thesis's figure 3.1, which ends with the first path."""
        return cls(
            iterations=10_000,
            step=1.0,
            search_radius=1.5,
            goal_reach=1.0,
            return_on_first_path=True,
        )

    def growth(self, bounds: Bounds, whales: bool = False) -> Growth:
        """The values of the loop on a map with these bounds (4,) [m]."""
        area = (bounds[2] - bounds[0]) * (bounds[3] - bounds[1])
        least = 2.0 * math.sqrt(1.5 * area / math.pi)  # Karaman and Frazzoli 2011, d = 2
        return Growth(
            iterations=self.iterations,
            step=self.step,
            goal_bias=self.goal_bias,
            reach=self.goal_reach,
            rewiring=True,
            radius=self.search_radius or 0.0,
            gamma=self.radius_factor * least,
            stop_at_first=self.return_on_first_path,
            whales=whales,
        )

    def plan(self, problem: Problem, rng: np.random.Generator) -> Plan:
        """Answer a problem with the best path of all samples, or with the first."""
        return _grown(problem, rng, self.growth(problem.space.bounds), self.nodes)


@settings
class RrtStarWoaLocal:
    """RRT* whose steering is a swarm of points (thesis, section 2.7 and algorithm 4).

    Round each random sample whales look for the point to extend towards: near the sample and the
    goal, seen from the node to extend, and, what counts less, with the goal in sight.
    """

    tree: RrtStar = setting(default=RrtStar(return_on_first_path=True))
    whales: WhaleSettings = setting(default=WhaleSettings())
    width_bound: float = setting(default=2.5, unit="m", source=_FIGURE, low=0.0)
    height_bound: float = setting(default=2.5, unit="m", source=_FIGURE, low=0.0)
    sample_weight: float = setting(default=1.0, unit="1/m", source="as the goal's", low=0.0)
    goal_weight: float = setting(default=1.0, unit="1/m", source="as the sample's", low=0.0)
    near_hidden: float = setting(default=1000.0, source="above all lengths on a map", low=0.0)
    goal_hidden: float = setting(default=10.0, source="below near_hidden", low=0.0)

    @classmethod
    def thesis(cls) -> RrtStarWoaLocal:
        """The settings of the thesis's figure 3.1; the four weights are not given there."""
        return cls(tree=RrtStar.thesis(), whales=WhaleSettings(a=4.0))

    def plan(self, problem: Problem, rng: np.random.Generator) -> Plan:
        """Answer a problem with the first path, or the best of all samples, as `tree` says."""
        pull = Pull(
            width=self.width_bound,
            height=self.height_bound,
            to_sample=self.sample_weight,
            to_goal=self.goal_weight,
            hidden_near=self.near_hidden,
            hidden_goal=self.goal_hidden,
        )
        growth = self.tree.growth(problem.space.bounds, whales=True)
        return _grown(problem, rng, growth, self.tree.nodes, self.whales, pull)


@settings
class RrtStarWoaGlobal:
    """RRT* whose path a swarm of paths then shortens (thesis, section 2.8 and algorithm 5)."""

    tree: RrtStar = setting(default=RrtStar(return_on_first_path=True))
    whales: WhaleSettings = setting(default=WhaleSettings(population=30, iterations=100))
    shortness_weight: float = setting(default=10.0, unit="1/m", source=_FIGURE, low=0.0)
    collision_free_weight: float = setting(
        default=1e4, source="above all lengths on a map, so that free paths lead", low=0.0
    )
    width_bound: float = setting(default=2.5, unit="m", source=_FIGURE, low=0.0)
    height_bound: float = setting(default=2.5, unit="m", source=_FIGURE, low=0.0)

    @classmethod
    def thesis(cls) -> RrtStarWoaGlobal:
        """The settings of the thesis's figure 3.1."""
        return cls(tree=RrtStar.thesis(), whales=WhaleSettings(a=4.0), collision_free_weight=1.0)

    def plan(self, problem: Problem, rng: np.random.Generator) -> Plan:
        """Answer a problem with a free path, never longer than the tree's own."""
        began = perf_counter()
        plan = self.tree.plan(problem, rng)
        if plan.status != Status.SOLVED:
            return plan
        tree_s = perf_counter() - began
        path = shorten(
            problem.free.arrays,
            plan.path,
            self.whales.values,
            self.shortness_weight,
            self.collision_free_weight,
            self.width_bound,
            self.height_bound,
            stream(rng),
        )
        timings: Mapping[str, float] = {"tree_s": tree_s, "time_s": perf_counter() - began}
        return replace(plan, path=path, timings=timings)
