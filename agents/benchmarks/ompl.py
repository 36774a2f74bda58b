"""OMPL's planners on our maps, with our exact tests."""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable
from functools import partial
from time import perf_counter
from types import SimpleNamespace
from typing import Any, Literal, cast

import numba
import numpy as np

from planners import Plan, Problem, Status
from planners.collision import polygon_tests
from planners.collision.polygon_tests import SpaceArrays
from wheelchair_gym.base.settings import setting, settings

EdgeTest = Callable[[float, float, float, float], bool]
PointTest = Callable[[float, float], bool]


def collision_tests(arrays: SpaceArrays) -> tuple[EdgeTest, PointTest]:
    """Our exact tests of edges and points, compiled for one map.

    Passing a map's arrays takes 9 us a call, more than a test; compiling takes a second.
    """
    edge, point = polygon_tests.edge_free, polygon_tests.point_free

    @numba.njit(error_model="numpy")
    def edge_free(ax: float, ay: float, bx: float, by: float) -> bool:
        return edge(arrays, ax, ay, bx, by)

    @numba.njit(error_model="numpy")
    def point_free(x: float, y: float) -> bool:
        return point(arrays, x, y)

    edge_free(0.0, 0.0, 0.0, 0.0)
    point_free(0.0, 0.0)
    return cast(EdgeTest, edge_free), cast(PointTest, point_free)


@settings
class Ompl:
    """A planner of OMPL with its default parameters.

    Its random numbers are one stream of the process, so equal calls give different paths.
    """

    algorithm: Literal["RRTConnect", "InformedRRTstar", "BITstar"]
    limit: float = setting(default=10.0, unit="s", low=0.0)
    """Time limit of a call without a deadline."""

    def prepare(self, case: Any) -> SimpleNamespace:
        """Return the planner for the map of a case of `planner_benchmark`."""
        base = importlib.import_module("ompl.base")
        util = importlib.import_module("ompl.util")
        util.setLogLevel(util.LOG_NONE)
        free = case.problem.free
        edge_free, point_free = collision_tests(free.arrays)
        space, bounds = base.RealVectorStateSpace(2), base.RealVectorBounds(2)
        for axis in range(2):
            bounds.setLow(axis, free.bounds[axis])
            bounds.setHigh(axis, free.bounds[axis + 2])
        space.setBounds(bounds)
        information = base.SpaceInformation(space)
        information.setStateValidityChecker(lambda state: point_free(state[0], state[1]))

        class ExactMotionValidator(base.MotionValidator):  # type: ignore[misc, name-defined]
            def checkMotion(self, a: Any, b: Any) -> bool:  # noqa: N802
                return edge_free(a[0], a[1], b[0], b[1])

        validator = ExactMotionValidator(information)
        information.setMotionValidator(validator)
        information.setup()
        # OMPL does not keep the validator alive.
        return SimpleNamespace(plan=partial(self.plan, information), validator=validator)

    def plan(
        self,
        information: Any,
        problem: Problem,
        rng: np.random.Generator,
        deadline: float | None = None,
    ) -> Plan:
        """The best path at the deadline, or the first path without one."""
        base = importlib.import_module("ompl.base")
        geometric = importlib.import_module("ompl.geometric")
        begun = perf_counter()
        definition = base.ProblemDefinition(information)
        ends = []
        for point in (problem.start, problem.goal):
            state = information.allocState()
            state[0], state[1] = float(point[0]), float(point[1])
            ends.append(state)
        definition.setStartAndGoalStates(*ends)
        left = self.limit
        if deadline is None:  # any path will do
            objective = base.PathLengthOptimizationObjective(information)
            objective.setCostThreshold(base.Cost(math.inf))
            definition.setOptimizationObjective(objective)
        else:
            left = max(deadline - (perf_counter() - begun), 0.0)
        planner = getattr(geometric, self.algorithm)(information)
        planner.setProblemDefinition(definition)
        planner.setup()
        planner.solve(base.timedPlannerTerminationCondition(left))
        timings = {"time_s": perf_counter() - begun}
        if not definition.hasExactSolution():
            return Plan(Status.EXHAUSTED, timings=timings)
        states = definition.getSolutionPath().getStates()
        path = np.array([(state[0], state[1]) for state in states])
        return Plan(Status.SOLVED, path, timings=timings)
