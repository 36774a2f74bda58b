"""The thesis's two whale variants of RRT*, as settings: local steering and global shortening."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from time import perf_counter

import numpy as np

from planners.draws import stream
from planners.swarm.whale_path import shorten
from planners.swarm.woa import WhaleSettings
from planners.trees.rrt import RrtStar
from planners.trees.search import search
from planners.trees.steering import Pull
from planners.types import Plan, Problem, Status
from wheelchair_gym.config import setting, settings

_FIGURE = "thesis, figure 3.1"


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

    def plan(
        self, problem: Problem, rng: np.random.Generator, deadline: float | None = None
    ) -> Plan:
        """Answer a problem with the first path, or the best of all samples, as `tree` says."""
        pull = Pull(
            width=self.width_bound,
            height=self.height_bound,
            to_sample=self.sample_weight,
            to_goal=self.goal_weight,
            hidden_near=self.near_hidden,
            hidden_goal=self.goal_hidden,
        )
        growth = self.tree.growth._replace(whales=True)
        swarm = self.whales.values
        return search(problem, rng, deadline, growth, self.tree.iterations, swarm, pull)


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

    def plan(
        self, problem: Problem, rng: np.random.Generator, deadline: float | None = None
    ) -> Plan:
        """Answer a problem with a free path, never longer than the tree's own.

        A deadline is the tree's; the swarm's run after it, of some ms, is one piece of work.
        """
        began = perf_counter()
        plan = self.tree.plan(problem, rng, deadline)
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
