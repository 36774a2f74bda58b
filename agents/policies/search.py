"""Searches for a way: at the widest clearance, in the maps that a chair may assume, one by one."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.control.rollout import ReferencePath
from agents.control.unknown_space import BEYOND, assumed_maps
from agents.evaluation.metrics import backing
from agents.policies.recoveries import place_aside
from planners import Planner
from planners.collision.space import Space
from planners.problem import Plan, Problem, Status, checked_plan, remaining
from wheelchair_gym.geometry import Footprint
from wheelchair_gym.maps import FREE, UNKNOWN, OccupancyGrid, bottleneck

Array = NDArray[np.float64]

ASSUMED = 3  # maps in which a chair plans that draws one itself; then in those that reopen


class Answer(NamedTuple):
    """A plan, and what it was made of."""

    plan: Plan
    clearance: float  # m: asked for last
    start: Array  # (3,) m, m, rad
    maps: list[OccupancyGrid]  # to be tried in turn
    tried: int  # of them

    @property
    def solved(self) -> bool:
        """Whether the plan leads to the goal."""
        return self.plan.status is Status.SOLVED

    @property
    def reopens(self) -> bool:
        """Whether the plan leads through what was free once, in the chair's drawing."""
        return self.solved and self.tried > ASSUMED

    @property
    def length(self) -> float:
        """Length [m] of the path, turns included."""
        return ReferencePath(self.plan.path, self.start).left


@dataclass(frozen=True)
class Search:
    """Everything that a plan is made of, so that it can be made beside the loop."""

    planner: Planner
    clearance: float  # m: asked for first
    least: float  # m: asked for last
    rng: np.random.Generator
    start: Array  # (3,) m, m, rad
    maps: list[OccupancyGrid]  # to be tried in turn
    drawn: Footprint | None = None  # the chair's, where it draws the only map itself
    beyond: float = BEYOND  # m: then paths may lead so far beyond what is known
    around: float = 0.0  # m from a goal without heading, where a path may end if that is occupied
    detour: float = 0.0  # m by which a path may be longer than one through what was free once

    def plan(self, goal: Array, end: float) -> Answer:
        """Plan to a goal (2 or 3,), until `clock` shows `end` [s], in one map after another.

        In each, at the widest clearance that leads to the goal; or, where the goal is occupied and
        has no heading, to the free place beside it.
        """
        maps = self.maps
        if self.drawn is not None:
            ends = np.stack([self.start[:2], goal[:2]])
            drawn = [grid.extended_to(ends, self.beyond) for grid in maps]
            maps = [each for grid in drawn for each in assumed_maps(grid, self.start, self.drawn)]
        answer = self._first(maps, 0, goal, end)
        if not answer.solved or answer.tried > ASSUMED or len(maps) <= ASSUMED:
            return answer
        other = self._first(maps, ASSUMED, goal, end)
        shorter = other.solved and other.length + self.detour < answer.length
        return other if shorter else answer

    def _first(self, maps: list[OccupancyGrid], begin: int, goal: Array, end: float) -> Answer:
        """The plan in the first of some maps, from one on, in which one leads to the goal."""
        for k, grid in enumerate(maps[begin:], begin):
            plan = partial(widest_plan, self.planner, grid, self.start)
            found = plan(goal, self.clearance, self.least, self.rng, end)
            if found[0].status is Status.GOAL_OCCUPIED and len(goal) == 2:
                beside = clearest_place(grid, goal, self.clearance, self.around)
                found = plan(beside, self.clearance, self.least, self.rng, end)
            answer = Answer(*found, self.start, maps, k + 1)
            if answer.solved:
                break
        return answer

    def plan_aside(self, blocking: Array, end: float) -> Answer:
        """Plan to where there is room to what blocks the path (n, 2) [m]; see `place_aside`."""
        place = place_aside(self.maps[0], self.start, blocking)
        if place is None:
            return Answer(Plan(Status.EXHAUSTED), self.least, self.start, self.maps, 0)
        return self.plan(place, end)


FINER = 0.04  # m: a plan that finds no way is tried again with this much less clearance,
REVERSE_WAY = 0.3  # m: and once more if it leads so far in reverse, where no sensor looks
NEARER = 0.1  # m of clearance that a place nearer to the goal by a metre is worth


def clearest_place(grid: OccupancyGrid, goal: Array, clearance: float, radius: float) -> Array:
    """The place (2,) nearest to a goal (2,) [m] with a clearance [m], at most a radius [m] from it.

    Or that of most clearance, where none has as much.
    """
    reach = np.arange(-(radius // grid.resolution), radius // grid.resolution + 1)
    places = goal + grid.resolution * np.stack(np.meshgrid(reach, reach), axis=-1).reshape(-1, 2)
    away = np.hypot(*(places - goal).T)
    places = places[(away <= radius) & grid.inside(places)]
    if len(places) == 0:
        return goal
    free = grid.distance()[tuple(grid.to_cell(places).T)]
    score = np.minimum(free, clearance) - NEARER * np.hypot(*(places - goal).T)
    best: Array = places[int(np.argmax(score))]
    return best


def widest_plan(
    planner: Planner,
    grid: OccupancyGrid,
    start: Array,
    goal: Array,
    clearance: float,
    least: float,
    rng: np.random.Generator,
    end: float = math.inf,
) -> tuple[Plan, float]:
    """Plan in a map at the widest clearance that leads to the goal.

    Args:
        planner: makes the plans.
        grid: the map; unknown space is taken for free.
        start: pose (3,) [m, m, rad].
        goal: (2 or 3,) [m, m, rad].
        clearance: to begin with [m].
        least: to end with [m].
        rng: the planner's.
        end: `clock` [s] by which the planner ends.

    Returns:
        The plan, the last one tried if none leads there, and its clearance [m].
    """
    space = Space.from_grid(grid)
    free = np.where(grid.cells == UNKNOWN, FREE, grid.cells)
    assumed = OccupancyGrid(free, grid.resolution, grid.origin)
    most = bottleneck(assumed, start[:2], goal[:2]) + 0.5 * grid.resolution
    while clearance > most and clearance - FINER >= least:
        clearance -= FINER  # where no disc passes a search is in vain

    def planned(clearance: float) -> Plan:
        problem = Problem(space, start, goal, clearance)
        timed = {} if end == math.inf else {"deadline": remaining(end)}
        return checked_plan(planner, planner.plan(problem, rng, **timed))

    best = math.inf  # m in reverse
    while True:
        plan = planned(clearance)
        found, reverse = plan.status is Status.SOLVED, backing(plan.path)
        second = best < math.inf
        if not second or (found and reverse < best - REVERSE_WAY):
            chosen = plan, clearance
        clearance -= FINER
        if second or (found and reverse < REVERSE_WAY) or clearance < least:
            break
        best = reverse if found else best  # once more: with less clearance it may lead ahead
    (plan, clearance), solved = chosen, chosen[0].status is Status.SOLVED
    between = clearance + 0.5 * FINER
    if solved and least + FINER < between < min(most, least + 2.0 * FINER):
        wider = planned(between)  # where so little is left beside the chair, half a step counts
        more = backing(wider.path) - backing(plan.path)
        if wider.status is Status.SOLVED and more < REVERSE_WAY:
            return wider, between
    return chosen
