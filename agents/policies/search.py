"""The world around a chair as it knows it when it plans, and its searches for a way there.

A search is made at the widest clearance, in the maps that a chair may assume, one by one.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from agents.control.followers import CREEP
from agents.control.local_map import (
    MAP_MARGIN,
    FloorMemory,
    LocalMap,
    assumed_maps,
    blind_behind,
    walls_block,
)
from agents.control.rollout import ReferencePath
from agents.evaluation.metrics import backing
from agents.policies.recoveries import place_aside
from planners import Planner
from planners.collision.space import Space
from planners.problem import Plan, Problem, Status, checked_plan, remaining
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.compiled.clock import clock
from wheelchair_gym.geometry.kinematics import corner_speed
from wheelchair_gym.geometry.outline import Footprint
from wheelchair_gym.maps import FREE, UNKNOWN, OccupancyGrid, bottleneck
from wheelchair_gym.types import Mission, Reading

ACTOR_RANGE = 2.5  # m: with an actor nearer, the chair reverses slowly: no sensor looks back
CRAWL = 0.04  # m/s of any part in reverse among people: a contact does no harm
AHEAD = 3.0  # m of the path on which temporary obstacles count
TOLERATED = 0.06  # m: allowance for cell size and sensor noise


class Surroundings:
    """The newest map, the local map, and what may be behind the chair.

    Attributes:
        draws: the chair draws its map itself.
        map: the newest one; one that the chair draws is free where the chair has stood.
        local_map: what the sensors have seen lately.
        floor: where the chair has stood, and what was free once, of a map that it draws.
    """

    def __init__(self, mission: Mission) -> None:
        self._mission, self.floor = mission, FloorMemory(mission.footprint)
        self.draws, self.local_map = mission.map is None, LocalMap(mission)
        self._met_actors = False  # on this drive
        self._unseen_behind = False
        self.update_map(mission.reading)

    def update_map(self, reading: Reading) -> None:
        """Take over the map of a reading."""
        self.map = self._mission.map_at(reading)
        if self.draws:
            self.map = self.floor.with_stood_cells_free(self.map, np.asarray(reading.pose))

    def update(self, reading: Reading, may_reverse_blind: bool) -> None:
        """Update everything from the next reading; the chair may reverse without a view, or not."""
        self.update_map(reading)
        local_map = self.local_map
        local_map.update(reading)
        self._met_actors |= len(local_map.actors) > 0
        if self.draws:
            unseen = blind_behind(self.map, local_map.pose, self._mission.footprint)
        else:  # an actor so near may be behind the chair the next moment
            distances = np.hypot(local_map.actors[:, 0], local_map.actors[:, 1])
            unseen = not local_map.looks_back and bool((distances < ACTOR_RANGE).any())
        self._unseen_behind, local_map.blind = unseen, unseen and not may_reverse_blind

    @property
    def has_obstacles(self) -> bool:
        """Whether there is an obstacle that is not on the map that the chair was given."""
        return len(self.local_map.temporary.points) > 0

    def obstacles_within(self, distance: float) -> Array:
        """Such obstacles (n, 2) [m] nearer to the axle's centre than a distance [m]."""
        points = self.local_map.temporary.points
        near: Array = points[np.hypot(*(points - self.local_map.pose[:2]).T) < distance]
        return near

    def reopened(self) -> OccupancyGrid | None:
        """The map in which all space that was free once is free; None if that changes nothing."""
        grid = self.floor.reopened(self.map) if self.draws else self.map
        return None if grid is self.map else grid

    def blocks(self, path: ReferencePath, clearance: float, ahead: float = AHEAD) -> bool:
        """Whether the newest map shows something on the next metres of a path."""
        rows = path.rows[path.at :]
        rows = rows[rows[:, 3] < path.way + ahead]
        if self.draws:
            reopened = self.reopened() if path.reopens else None
            return walls_block(reopened or self.map, rows, clearance)
        return self.local_map.temporary.blocks(rows, clearance - TOLERATED)

    def blocks_now(self, path: ReferencePath, clearance: float) -> bool:
        """Return True if the newest map blocks a followed path; update the follower's walls.

        Walls change only for a path through space that may have reopened.
        """
        if path.reopens:
            maps = assumed_maps(self.map, self.local_map.pose, self._mission.footprint)
            self.local_map.set_walls(maps[1])
        return self.blocks(path, clearance, math.inf if self.draws else AHEAD)

    @property
    def crawls(self) -> bool:
        """Whether people may be behind the chair, where no sensor looks."""
        return self._met_actors and not self.local_map.looks_back

    def limited(self, twist: Array | None, motion: Array) -> Array:
        """Return a twist (2,) slowed for unseen space, None as a stop; `motion`: `Body.state`."""
        if twist is None or (twist[0] < 0.0 and self.local_map.blind):
            twist = np.zeros(2)
        elif self.crawls and twist[0] < 0.0:  # no rear corner moves faster
            rear, half_width = self._mission.footprint.rear, self._mission.footprint.half_width
            twist = twist * min(1.0, CRAWL / corner_speed(twist[0], twist[1], rear, half_width))
        elif self._unseen_behind and twist[0] < -CREEP:
            twist = twist * (-CREEP / twist[0])
        limited: Array = self.local_map.limit_for_unseen_space(twist[None], motion)[0]
        return limited


FINER = 0.04  # m: a plan that finds no way is tried again with this much less clearance,
REVERSE_WAY = 0.3  # m: and once more if it leads so far in reverse, where no sensor looks
NEARER = 0.1  # m of clearance that a place nearer to the goal by a metre is worth


def clearest_place(grid: OccupancyGrid, goal: Array, clearance: float, radius: float) -> Array:
    """Return the place (2,) with the best balance of clearance and nearness to a goal (2,) [m].

    Clearance counts up to `clearance` [m]; no place is farther from the goal than `radius` [m].
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


class Answer(NamedTuple):
    """A plan, and what it was made of."""

    plan: Plan
    clearance: float  # m: asked for last
    start: Array  # (3,) m, m, rad
    searched: int = 0  # maps
    walls_index: int = 0  # index of the map whose walls the follower must respect
    unseen: bool = False  # unseen space was assumed free, even beside the chair
    reopens: bool = False  # space that was free once was assumed free
    walls: OccupancyGrid | None = None  # for the follower, where the chair draws the map itself

    @property
    def solved(self) -> bool:
        """Whether the plan leads to the goal."""
        return self.plan.status is Status.SOLVED

    @property
    def length(self) -> float:
        """Length [m] of the path, turns included; infinite where there is none."""
        return ReferencePath(self.plan.path, self.start).left if self.solved else math.inf


@dataclass(frozen=True)
class Search:
    """Everything that a plan is made of, so that it can be made beside the loop."""

    planner: Planner
    clearance: float  # m: asked for first
    minimum: float  # m: asked for last
    rng: np.random.Generator
    start: Array  # (3,) m, m, rad
    maps: list[OccupancyGrid]  # to be tried in turn
    around: float = 0.0  # m from an occupied goal without heading, within which a path may end
    drawn: Footprint | None = None  # of a chair that draws the only map itself; None: a given map
    # The next three apply only to a map that the chair draws.
    beyond: float = MAP_MARGIN  # m: how far beyond what is known paths may lead
    reopened: OccupancyGrid | None = None  # the map in which all space that was free once is free
    detour: float = 0.0  # m that a path may be longer than one in that map

    def plan(self, goal: Array, end: float) -> Answer:
        """Plan to a goal (2 or 3,), until `clock` shows `end` [s], in one map after another.

        In each, at the widest clearance that leads to the goal; or, where the goal is occupied and
        has no heading, to the free place beside it.
        """
        if self.drawn is None:
            return self._first(self.maps, goal, end)
        maps = self._assumed(self.maps[0], goal, self.drawn)
        if self.reopened is None:
            answer = self._first(maps, goal, end)
        else:  # half of the time for each
            answer = self._first(maps, goal, end if end == math.inf else 0.5 * (clock() + end))
            other = self._first(self._assumed(self.reopened, goal, self.drawn), goal, end)
            searched = answer.searched + other.searched
            if other.length + self.detour < answer.length:
                answer = other._replace(reopens=True)
            answer = answer._replace(searched=searched)
        return answer._replace(walls=maps[answer.walls_index])

    def _assumed(self, grid: OccupancyGrid, goal: Array, drawn: Footprint) -> list[OccupancyGrid]:
        ends = np.stack([self.start[:2], goal[:2]])
        return assumed_maps(grid.extended_to(ends, self.beyond), self.start, drawn)

    def _first(self, maps: list[OccupancyGrid], goal: Array, end: float) -> Answer:
        """The plan in the first map in which one leads to the goal."""
        for k, grid in enumerate(maps):
            found = self.widest(grid, goal, end)
            if found[0].status is Status.GOAL_OCCUPIED and len(goal) == 2:
                beside = clearest_place(grid, goal, self.clearance, self.around)
                found = self.widest(grid, beside, end)
            last = self.drawn is not None and k == len(maps) - 1
            walls_index = k - 1 if last else k  # the last has no walls in unseen space
            answer = Answer(*found, self.start, k + 1, walls_index, last)
            if answer.solved:
                break
        return answer

    def widest(self, grid: OccupancyGrid, goal: Array, end: float) -> tuple[Plan, float]:
        """Plan in a map at the widest clearance that leads to a goal; unknown space is free.

        Returns:
            The plan, the last one tried if none leads there, and its clearance [m].
        """
        space, clearance, minimum = Space.from_grid(grid), self.clearance, self.minimum
        free = np.where(grid.cells == UNKNOWN, FREE, grid.cells)
        assumed = OccupancyGrid(free, grid.resolution, grid.origin)
        maximum = bottleneck(assumed, self.start[:2], goal[:2]) + 0.5 * grid.resolution
        while clearance > maximum and clearance - FINER >= minimum:
            clearance -= FINER  # where no disc passes a search is in vain

        def planned(clearance: float) -> Plan:
            problem = Problem(space, self.start, goal, clearance)
            timed = {} if end == math.inf else {"deadline": remaining(end)}
            return checked_plan(self.planner, self.planner.plan(problem, self.rng, **timed))

        best = math.inf  # m in reverse
        while True:
            plan = planned(clearance)
            found, reverse = plan.status is Status.SOLVED, backing(plan.path)
            second = best < math.inf
            if not second or (found and reverse < best - REVERSE_WAY):
                chosen = plan, clearance
            clearance -= FINER
            if second or (found and reverse < REVERSE_WAY) or clearance < minimum:
                break
            best = reverse if found else best  # once more: with less clearance it may lead ahead
        (plan, clearance), solved = chosen, chosen[0].status is Status.SOLVED
        between = clearance + 0.5 * FINER
        if solved and minimum + FINER < between < min(maximum, minimum + 2.0 * FINER):
            wider = planned(between)  # where so little is left beside the chair, half a step counts
            more = backing(wider.path) - backing(plan.path)
            if wider.status is Status.SOLVED and more < REVERSE_WAY:
                return wider, between
        return chosen

    def plan_aside(self, blocking: Array, end: float) -> Answer:
        """Plan to where there is room to what blocks the path (n, 2) [m]; see `place_aside`."""
        place = place_aside(self.maps[0], self.start, blocking)
        if place is None:
            return Answer(Plan(Status.EXHAUSTED), self.minimum, self.start)
        return self.plan(place, end)
