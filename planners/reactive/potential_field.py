"""The potential field: the goal attracts, obstacles repel, and each step is the lowest one."""

import math

import numpy as np

from planners.collision.polygon_tests import SpaceArrays, clearance, edge_free
from planners.problem import Plan, PlannerBase, Problem, Status, answer, chunks
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import setting, settings
from wheelchair_gym.compiled.kernel import borrowing_kernel

WALKING, ARRIVED, HELD = 0, 1, 2
# Design choices:
STEP = 0.1  # m: a tenth of the width of a door
MIN_STEP = 1e-3  # m: the shortest that is tried before a local minimum is reported
HEADINGS = 32  # tried at each step: 11 deg apart
OBSTACLE_RANGE = 1.0  # m, from which on obstacles do not repel: the width of a door
REPULSION = 0.05  # m^3: equals the attraction of the goal at 0.33 m


@borrowing_kernel
def potential(arrays: SpaceArrays, goal_x: float, goal_y: float, x: float, y: float) -> float:
    """Return the potential [m] at a point: the distance to the goal, and more near obstacles.

    Repulsion as in Khatib 1986, (3.4), fading at the goal as in Ge and Cui 2000, so that the goal
    is the lowest point even beside a wall.
    """
    left = math.hypot(goal_x - x, goal_y - y)
    distance = clearance(arrays, x, y)
    if distance >= OBSTACLE_RANGE or left == 0.0:
        return left
    fading = min(1.0, left / OBSTACLE_RANGE) ** 2
    return left + 0.5 * REPULSION * fading * (1.0 / distance - 1.0 / OBSTACLE_RANGE) ** 2


@borrowing_kernel
def descend(
    arrays: SpaceArrays, goal_x: float, goal_y: float, path: Array, count: int, budget: int
) -> tuple[int, int]:
    """Take steps down from the last of `count` points of a path (n, 2) [m], up to `budget` points.

    Where no heading leads down by a step of at least `MIN_STEP`, the walk is held. Returns the
    number of points, and WALKING, ARRIVED or HELD.
    """
    while count < budget:
        x, y = path[count - 1, 0], path[count - 1, 1]
        near = math.hypot(goal_x - x, goal_y - y) <= STEP
        if near and edge_free(arrays, x, y, goal_x, goal_y):
            path[count, 0], path[count, 1] = goal_x, goal_y
            return count + 1, ARRIVED
        lowest, step, found = potential(arrays, goal_x, goal_y, x, y), STEP, False
        while step >= MIN_STEP and not found:
            for k in range(HEADINGS):
                angle = 2.0 * math.pi * k / HEADINGS
                to_x, to_y = x + step * math.cos(angle), y + step * math.sin(angle)
                low = potential(arrays, goal_x, goal_y, to_x, to_y)
                if low < lowest and edge_free(arrays, x, y, to_x, to_y):
                    lowest, found = low, True
                    path[count, 0], path[count, 1] = to_x, to_y
            step *= 0.5
        if not found:
            return count, HELD
        count += 1
    return count, WALKING


@settings
class PotentialField(PlannerBase):
    """An artificial potential field (Khatib 1986), followed downwards in free steps.

    In a local minimum it ends `stuck`; the tree shows the walk up to there.
    """

    iterations: int = setting(default=20_000, low=1, high=10_000_000, source="2 km")
    """Largest number of steps."""

    def solve(self, problem: Problem, rng: np.random.Generator, end: float) -> Plan:
        """Walk down to the goal, or to a local minimum; the generator is not used."""
        x, y = (float(v) for v in problem.goal[:2])
        walk = np.empty((self.iterations + 2, 2))
        walk[0] = problem.start[:2]
        count, how, failure, note = 1, WALKING, Status.EXHAUSTED, "steps or time ran out"
        for until in chunks(self.iterations, end):
            count, how = descend(problem.free.arrays, x, y, walk, count, until + 1)
            if how != WALKING:
                break
        if how == HELD:
            failure, note = Status.STUCK, f"a local minimum at {walk[count - 1].round(2).tolist()}"
        walk = walk[:count]
        path, tree = walk[: count if how == ARRIVED else 0].copy(), np.hstack([walk[:-1], walk[1:]])
        return answer(path, {"iterations": count - 1}, note, failure, tree)
