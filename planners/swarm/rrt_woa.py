"""P1's planner: the path of an RRT, smoothed by modified whales, with PCHIP through its points."""

from __future__ import annotations

import numpy as np

from planners.problem import Plan, Problem
from planners.swarm.objectives import Smooth
from planners.swarm.optimizers import WoaModified
from planners.swarm.planner import SwarmPlanner
from planners.swarm.state import FEWEST
from planners.trees.variants import Rrt
from wheelchair_gym.config import setting, settings

_P1 = "P1: Saleh, Borhan and Rahiman 2024"


@settings
class RrtWoa:
    """RRT, then whales whose C counts where the best path is free (P1).

    The first whale is the RRT's path, the others are points drawn from 100 along it, in order.
    """

    tree: Rrt = setting(default=Rrt(), source=_P1)
    whales: WoaModified = setting(default=WoaModified(), source=_P1 + " (17)-(19)")
    objective: Smooth = setting(default=Smooth(), source=_P1 + " (1)-(8)")
    population: int = setting(default=30, source="not given in P1; as swarm", low=FEWEST)
    iterations: int = setting(default=20, source=_P1, low=0)
    cycle: int = setting(default=20, source="as iterations: see swarm", low=1)

    @property
    def swarm(self) -> SwarmPlanner:
        """The same as settings of `swarm`: in a race only its optimizer differs."""
        return SwarmPlanner(
            optimizer=self.whales,
            objective=self.objective,
            curve="pchip",
            population=self.population,
            iterations=self.iterations,
            cycle=self.cycle,
            first=self.tree,
            scatter="along",
        )

    def plan(
        self, problem: Problem, rng: np.random.Generator, deadline: float | None = None
    ) -> Plan:
        """Answer a problem with the valid curve that costs least of all that the whales tried."""
        return self.swarm.plan(problem, rng, deadline)
