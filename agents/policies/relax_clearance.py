"""The plan at the widest clearance that leads to the goal, and leads ahead."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from agents.evaluation.path_metrics import backing
from planners import Planner
from planners.collision.space import Space
from planners.problem import Plan, Problem, Status
from wheelchair_gym.maps import FREE, UNKNOWN, OccupancyGrid, bottleneck

Array = NDArray[np.float64]

FINER = 0.04  # m: a plan that finds no way is tried again with this much less clearance,
BACKS = 0.3  # m: and once more if it leads so far in reverse, where nothing looks


def widest_plan(
    planner: Planner,
    known: OccupancyGrid,
    start: Array,
    goal: Array,
    clearance: float,
    least: float,
    rng: np.random.Generator,
) -> tuple[Plan, float]:
    """Plan in a map at the widest clearance that leads to the goal.

    Args:
        planner: makes the plans.
        known: the map; what is unknown is taken for free.
        start: pose (3,) [m, m, rad].
        goal: (2 or 3,) [m, m, rad].
        clearance: to begin with [m].
        least: to end with [m].
        rng: the planner's.

    Returns:
        The plan, the last one tried if none leads there, and its clearance [m].
    """
    space = Space.from_grid(known)
    free = np.where(known.cells == UNKNOWN, FREE, known.cells)
    taken = OccupancyGrid(free, known.resolution, known.origin)
    most = bottleneck(taken, start[:2], goal[:2]) + 0.5 * known.resolution
    while clearance > most and clearance - FINER >= least:
        clearance -= FINER  # what no disc passes is not worth a search
    best = math.inf  # m in reverse
    while True:
        plan = planner.plan(Problem(space, start, goal, clearance), rng)
        found, backs = plan.status is Status.SOLVED, backing(plan.path)
        second = best < math.inf
        if not second or (found and backs < best - BACKS):
            chosen = plan, clearance
        clearance -= FINER
        if second or (found and backs < BACKS) or clearance < least:
            return chosen
        best = backs if found else best  # once more: with less clearance it may lead ahead
