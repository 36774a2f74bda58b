"""OMPL's planners on our maps."""

from __future__ import annotations

import importlib
import math
from time import perf_counter
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from agents.peers.exact import collision_tests
from planners import Plan, Problem, Status
from wheelchair_gym.config import setting, settings

Array = NDArray[np.float64]


@settings
class Ompl:
    """A planner of OMPL with its default parameters.

    With `exact` its edges are tested by our exact test, which is favourable: its own test samples
    an edge, lets paths through walls, and takes longer. Without, it is as it comes. Its random
    numbers are one stream of the process, so its runs differ from one call to the next.
    """

    algorithm: Literal["RRTConnect", "InformedRRTstar", "BITstar"]
    exact: bool = setting(default=True, source="false: OMPL's DiscreteMotionValidator")
    limit: float = setting(default=10.0, unit="s", source="of a call without a deadline", low=0.0)

    def prepare(self, case: Any) -> OmplOnMap:
        """Prepare for a map."""
        return OmplOnMap(self, case.problem)


class OmplOnMap:
    """OMPL's description of one map, made once."""

    def __init__(self, own: Ompl, problem: Problem) -> None:
        base = importlib.import_module("ompl.base")
        util = importlib.import_module("ompl.util")
        util.setLogLevel(util.LOG_NONE)
        self.own = own
        edge_free, point_free = collision_tests(problem.free.arrays)
        space = base.RealVectorStateSpace(2)
        bounds = base.RealVectorBounds(2)
        for axis in range(2):
            bounds.setLow(axis, problem.free.bounds[axis])
            bounds.setHigh(axis, problem.free.bounds[axis + 2])
        space.setBounds(bounds)
        self.information = base.SpaceInformation(space)
        self.information.setStateValidityChecker(lambda state: point_free(state[0], state[1]))
        if own.exact:

            class ExactMotionValidator(base.MotionValidator):  # type: ignore[misc, name-defined]
                def checkMotion(self, a: Any, b: Any) -> bool:  # noqa: N802
                    return edge_free(a[0], a[1], b[0], b[1])

            self.validator = ExactMotionValidator(self.information)
            self.information.setMotionValidator(self.validator)
        self.information.setup()

    def plan(
        self, problem: Problem, rng: np.random.Generator, deadline: float | None = None
    ) -> Plan:
        """Answer with the best path at the deadline, or with the first path without one."""
        base = importlib.import_module("ompl.base")
        geometric = importlib.import_module("ompl.geometric")
        begun = perf_counter()
        definition = base.ProblemDefinition(self.information)
        ends = []
        for point in (problem.start, problem.goal):
            state = self.information.allocState()
            state[0], state[1] = float(point[0]), float(point[1])
            ends.append(state)
        definition.setStartAndGoalStates(*ends)
        left = self.own.limit
        if deadline is None:  # any path will do
            objective = base.PathLengthOptimizationObjective(self.information)
            objective.setCostThreshold(base.Cost(math.inf))
            definition.setOptimizationObjective(objective)
        else:
            left = max(deadline - (perf_counter() - begun), 0.0)
        planner = getattr(geometric, self.own.algorithm)(self.information)
        planner.setProblemDefinition(definition)
        planner.setup()
        planner.solve(base.timedPlannerTerminationCondition(left))
        timings = {"time_s": perf_counter() - begun}
        if not definition.hasExactSolution():
            return Plan(Status.EXHAUSTED, timings=timings)
        states = definition.getSolutionPath().getStates()
        path = np.array([(state[0], state[1]) for state in states])
        return Plan(Status.SOLVED, path, timings=timings)
