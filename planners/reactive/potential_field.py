"""The potential field: the goal attracts, obstacles repel, and each step is the lowest one."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from planners.collision.polygon_tests import SpaceArrays, clearance, edge_free
from planners.problem import Plan, PlannerBase, Problem, Status
from wheelchair_gym.compiled.clock import clock
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.config import setting, settings

Array = NDArray[np.float64]

CHUNK = 1000  # steps between two looks at the clock: some 10 ms
WALKING, ARRIVED, HELD = 0, 1, 2


class Field(NamedTuple):
    """A potential field, as kernels take it."""

    x: float  # m: the goal
    y: float  # m
    strength: float  # m^3: of what repels
    reach: float  # m: how far it does
    step: float  # m
    headings: int


@borrowing_kernel
def potential(arrays: SpaceArrays, field: Field, x: float, y: float) -> float:
    """Potential [m] at a point: the distance to the goal, and more near what is solid.

    Repulsion as in Khatib 1986, (3.4), fading at the goal as in Ge and Cui 2000, so that the goal
    is the lowest point even beside a wall.
    """
    left = math.hypot(field.x - x, field.y - y)
    distance = clearance(arrays, x, y)
    if distance >= field.reach or left == 0.0:
        return left
    fading = min(1.0, left / field.reach) ** 2
    return left + 0.5 * field.strength * fading * (1.0 / distance - 1.0 / field.reach) ** 2


@borrowing_kernel
def descend(
    arrays: SpaceArrays, field: Field, path: Array, count: int, budget: int, least: float
) -> tuple[int, int]:
    """Take steps down from the last of `count` points of a path (n, 2) [m], up to `budget` points.

    Where no heading leads down by a step of at least `least` [m], the walk is held. Returns how
    many points there are, and WALKING, ARRIVED or HELD.
    """
    while count < budget:
        x, y = path[count - 1, 0], path[count - 1, 1]
        near = math.hypot(field.x - x, field.y - y) <= field.step
        if near and edge_free(arrays, x, y, field.x, field.y):
            path[count, 0], path[count, 1] = field.x, field.y
            return count + 1, ARRIVED
        lowest, step, found = potential(arrays, field, x, y), field.step, False
        while step >= least and not found:
            for k in range(field.headings):
                angle = 2.0 * math.pi * k / field.headings
                to_x, to_y = x + step * math.cos(angle), y + step * math.sin(angle)
                low = potential(arrays, field, to_x, to_y)
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

    In a local minimum it ends `stuck`; the tree shows how far it came.
    """

    iterations: int = setting(default=20_000, low=1, source="design choice: 2 km")
    """Largest number of steps."""
    step: float = setting(
        default=0.1, unit="m", low=1e-3, source="design choice: a tenth of the width of a door"
    )
    """Length of a step."""
    min_step: float = setting(
        default=1e-3, unit="m", low=1e-9, source="design choice: far below the errors of a chair"
    )
    """Shortest step that is tried before a local minimum is reported."""
    headings: int = setting(default=32, low=3, source="design choice: 11 deg")
    """Headings tried at each step."""
    obstacle_range: float = setting(
        default=1.0, unit="m", low=1e-3, source="design choice: the width of a door"
    )
    """Distance from which on obstacles do not repel."""
    repulsion: float = setting(
        default=0.05, unit="m^3", low=0.0, source="design choice: equals the goal at 0.33 m"
    )
    """Weight of the repulsive potential."""

    def solve(self, problem: Problem, rng: np.random.Generator, end: float) -> Plan:
        """Walk down to the goal, or until nothing leads down; the generator is not used."""
        x, y = (float(v) for v in problem.goal[:2])
        field = Field(x, y, self.repulsion, self.obstacle_range, self.step, self.headings)
        walk = np.empty((self.iterations + 2, 2))
        walk[0] = problem.start[:2]
        count, how, status, note = 1, WALKING, Status.EXHAUSTED, "steps or time ran out"
        while how == WALKING and count <= self.iterations:
            budget = min(count + CHUNK, self.iterations + 1)
            count, how = descend(problem.free.arrays, field, walk, count, budget, self.min_step)
            if clock() >= end:
                break
        if how == HELD:
            status, note = Status.STUCK, f"a local minimum at {walk[count - 1].round(2).tolist()}"
        elif how == ARRIVED:
            status, note = Status.SOLVED, ""
        walk = walk[:count]
        return Plan(
            status,
            walk.copy() if how == ARRIVED else np.empty((0, 2)),
            np.hstack([walk[:-1], walk[1:]]),
            {"iterations": count - 1},
            note=note,
        )
