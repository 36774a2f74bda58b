"""The plain trees, as settings: RRT, RRT-Connect and RRT*."""

from __future__ import annotations

import math

import numpy as np

from planners.trees.search import search
from planners.trees.values import Growth
from planners.types import Plan, Problem
from wheelchair_gym.config import setting, settings

_ROOM = "rooms and doors of buildings"
# Karaman and Frazzoli 2011, d = 2: 2 sqrt((1 + 1/d) area / pi) is gamma's least value.
LEAST_GAMMA = 2.0 * math.sqrt(1.5 / math.pi)


@settings
class Rrt:
    """A rapidly exploring random tree (LaValle 1998); it ends with its first path."""

    iterations: int = setting(default=20_000, source="doors of 1 m on maps of 50 m", low=1)
    nodes: int = setting(default=20_000, source="as the iterations", low=2)
    step: float = setting(default=2.0, unit="m", source=_ROOM, low=1e-3)
    goal_bias: float = setting(default=0.05, source="LaValle and Kuffner 2001", low=0.0, high=1.0)
    goal_reach: float = setting(default=2.0, unit="m", source="as the step", low=0.0)

    def plan(
        self, problem: Problem, rng: np.random.Generator, deadline: float | None = None
    ) -> Plan:
        """Answer a problem with the first path found."""
        growth = Growth(self.step, self.goal_reach, self.nodes, goal_bias=self.goal_bias)
        return search(problem, rng, deadline, growth, self.iterations)


@settings
class RrtConnect:
    """Two trees that reach for each other (Kuffner and LaValle 2000): quick, not short.

    A share of the samples falls near corners of what is solid (Amato et al. 1998), where doors are.
    """

    iterations: int = setting(default=100_000, source="mazes take some thousands", low=1)
    nodes: int = setting(default=20_000, source="of each tree", low=2)
    step: float = setting(default=4.0, unit="m", source=_ROOM, low=1e-3)
    corner_share: float = setting(default=0.5, source="measured", low=0.0, high=1.0)
    corner_radius: float = setting(
        default=1.0, unit="m", source="about the width of doors", low=0.0
    )

    def plan(
        self, problem: Problem, rng: np.random.Generator, deadline: float | None = None
    ) -> Plan:
        """Answer a problem with the first path found; the straight line is tried before all."""
        growth = Growth(
            self.step,
            math.inf,
            self.nodes,
            both_ways=True,
            corner_share=self.corner_share,
            corner_radius=self.corner_radius,
        )
        return search(problem, rng, deadline, growth, self.iterations)


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

    @property
    def growth(self) -> Growth:
        """The values of the loop."""
        return Growth(
            self.step,
            self.goal_reach,
            self.nodes,
            goal_bias=self.goal_bias,
            stop_at_first=self.return_on_first_path,
            rewiring=True,
            radius=self.search_radius or 0.0,
            gamma=self.radius_factor * LEAST_GAMMA,
        )

    def plan(
        self, problem: Problem, rng: np.random.Generator, deadline: float | None = None
    ) -> Plan:
        """Answer a problem with the best path of all samples, or with the first."""
        return search(problem, rng, deadline, self.growth, self.iterations)
