"""OMPL's planners for the chair's footprint, with the connections and the cost of our planners."""

import importlib
import math
from typing import Any, Literal

import numpy as np

from planners.collision.footprint import FootprintPlanner, gaps_at, goal_poses, start_and_goal
from planners.collision.nearby import nearby
from planners.problem import Plan, Problem, Status
from planners.rrt_star_woa.poses import ROOTS, SHARPEST_TURN
from planners.steering import LONGEST_PIECE, SteeringContext, connect, new_context, poses_along
from planners.trees.pose_tree import new_path
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.errors import InputError
from wheelchair_gym.base.settings import setting, settings
from wheelchair_gym.compiled.clock import clock
from wheelchair_gym.compiled.kernel import kernel

MODULES = "ompl.base", "ompl.geometric", "ompl.util"
RANGE = 2.0  # m: longest edge of a tree, where the algorithm has such a parameter


@kernel
def connection_cost(
    context: SteeringContext, x: float, y: float, yaw: float, tx: float, ty: float, tyaw: float
) -> tuple[int, float]:
    """Write the cheapest free connection of two poses; the number of its pieces and cost [s]."""
    _, count, cost = connect(context, (x, y, yaw), 0, (tx, ty, tyaw), 0, math.inf, 0)
    return count, cost


@settings
class OmplFootprint(FootprintPlanner):
    """A planner of OMPL in SE(2), for the chair's rectangle.

    OMPL searches; poses are connected, tested and charged for as in `se2_rrt_star_woa`: by
    pivot, straight and pivot, or by two arcs, ahead or back. So the searches are compared.
    OMPL's random numbers are one stream of the process: equal calls give different paths.
    """

    algorithm: Literal["RRTConnect", "RRTstar", "InformedRRTstar", "BITstar"] = "RRTstar"
    limit: float = setting(default=10.0, unit="s", low=0.0, source="design choice")
    """Time limit of a call without a deadline."""

    def solve(self, problem: Problem, rng: np.random.Generator, end: float) -> Plan:
        """The cheapest path at the deadline, or the first path without one."""
        try:
            base, geometric, util = map(importlib.import_module, MODULES)
        except ImportError:
            raise InputError("OMPL's planners need: pip install 'wheelchair_gym[peers]'") from None
        util.setLogLevel(util.LOG_NONE)
        near = nearby(problem.space, self.footprint.reach + LONGEST_PIECE + self.desired_clearance)
        status, motion = self.fit(problem, near)
        if status is not None:
            return Plan(status)
        context = new_context(near, motion, SHARPEST_TURN)
        known: dict[tuple[float, ...], float] = {}

        def cost(a: Any, b: Any) -> float:
            """Seconds of a connection, infinite where there is none; OMPL asks twice."""
            ends = _pose(a) + _pose(b)
            if ends not in known:
                if len(known) > 100_000:
                    known.clear()
                known[ends] = connection_cost(context, *ends)[1]
            return known[ends]

        class Validator(base.MotionValidator):  # type: ignore[misc, name-defined]
            def checkMotion(self, a: Any, b: Any) -> bool:  # noqa: N802
                return cost(a, b) < math.inf

        class Objective(base.OptimizationObjective):  # type: ignore[misc, name-defined]
            def stateCost(self, state: Any) -> Any:  # noqa: N802
                return base.Cost(0.0)

            def motionCost(self, a: Any, b: Any) -> Any:  # noqa: N802
                return base.Cost(cost(a, b))

            def motionCostHeuristic(self, a: Any, b: Any) -> Any:  # noqa: N802
                far = math.hypot(b.getX() - a.getX(), b.getY() - a.getY())
                return base.Cost(far / motion.forward)

            def isSymmetric(self) -> bool:  # noqa: N802
                return False

        space, bounds = base.SE2StateSpace(), base.RealVectorBounds(2)
        for axis in range(2):
            bounds.setLow(axis, float(problem.space.bounds[axis]))
            bounds.setHigh(axis, float(problem.space.bounds[axis + 2]))
        space.setBounds(bounds)
        information = base.SpaceInformation(space)
        information.setStateValidityChecker(
            lambda state: bool(
                gaps_at(context.around, np.array([_pose(state)]))[0] >= motion.margin
            )
        )
        validator = Validator(information)  # OMPL does not keep it alive
        information.setMotionValidator(validator)
        information.setup()
        definition = base.ProblemDefinition(information)
        start, goal = start_and_goal(problem)
        definition.addStartState(_state(space, start))
        ends = base.GoalStates(information)
        for pose in goal_poses(context.around, goal, ROOTS):
            ends.addState(_state(space, pose))
        definition.setGoal(ends)
        objective = Objective(information)
        if math.isinf(end):  # any path will do
            objective.setCostThreshold(base.Cost(math.inf))
            end = clock() + self.limit
        definition.setOptimizationObjective(objective)
        planner = getattr(geometric, self.algorithm)(information)
        if hasattr(planner, "setRange"):
            planner.setRange(RANGE)
        planner.setProblemDefinition(definition)
        planner.setup()
        planner.solve(base.PlannerTerminationCondition(lambda: clock() >= end))
        if not definition.hasExactSolution():
            return Plan(Status.EXHAUSTED)
        states = definition.getSolutionPath().getStates()
        return Plan(Status.SOLVED, _poses(context, np.array([_pose(state) for state in states])))


def _pose(state: Any) -> tuple[float, float, float]:
    return state.getX(), state.getY(), state.getYaw()


def _state(space: Any, pose: Array) -> Any:
    state = space.allocState()
    state.setXY(float(pose[0]), float(pose[1]))
    state.setYaw(float(pose[2]))
    return state


def _poses(context: SteeringContext, states: Array) -> Array:
    """The poses (n, 3) of the connections between states (m, 3)."""
    path = new_path(states[-1])
    for k in range(len(states) - 1):
        count, _ = connection_cost(context, *states[k], *states[k + 1])
        at = int(path.size[0])
        path.pieces[at : at + count] = context.candidate[:count]
        path.size[0] = at + count
    end = path.pieces[path.size[0]]
    end["x"], end["y"], end["yaw"] = states[-1]
    return poses_along(path.pieces[: path.size[0] + 1])
