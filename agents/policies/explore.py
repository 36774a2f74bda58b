"""Exploring an unknown world: to one frontier after another, then to the goal."""

from collections.abc import Mapping
from dataclasses import field, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from agents.control.local_map import with_free_footprint
from agents.policies.planned import Planned, PlannedDriver
from agents.policies.search import Answer, Search
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import setting, settings
from wheelchair_gym.maps import UNKNOWN, geodesic
from wheelchair_gym.perception.occupancy import Frontier, find_frontiers
from wheelchair_gym.types import Command, Mission, Reading

SAME = 1.0  # m: a frontier that recedes is the same one so far away
MORE = 1.02  # times as many explored cells: frontiers that were given up are tried again
MIN_LENGTH = 0.4  # m: a shorter frontier may be a gap between beams, and is taken last
SHORTEST = 0.1  # m: in a door of 0.82 m, seen edge-on, a frontier is no longer than this
TOWARDS = 1.0  # weight of the distance from a frontier to the goal, against the path there
GAIN = 0.5  # m of path that a metre of frontier is worth
CLEARANCE = 0.36  # m of paths to frontiers: half the chair's width and a cell
LOOK = 1.0  # s between two searches for frontiers
PATIENCE = 25.0  # s for one frontier, after which it is given up
GAP = 1.0  # m2 of unknown space: a short frontier with less beyond is a gap between beams


@settings
class Explore(Planned):
    """Explore by frontiers (Yamauchi 1997), as T1 in a house without a map.

    The chair draws its map and localizes on it (pose source `slam`), drives to the frontier that is
    nearest, counting the rest of the way to the goal, and plans to the goal once a path over
    explored space leads there. Without a goal it stops when no frontier is left. To each place it
    drives as `Planned` with the same settings; the deadline is that of a choice with its plans.
    """

    planner: Mapping[str, Any] = field(
        default_factory=lambda: {"name": "lattice"}, metadata={"source": "design choice"}
    )
    """Name and settings of the planner."""
    seek: bool = setting(default=True)
    """Drive to the goal; false: map all there is."""

    def make(self) -> "Explorer":
        """A fresh policy."""
        return Explorer(self)


class Choice(NamedTuple):
    """The next place to drive to, and the search's state after it."""

    state: str
    answers: list[tuple[Array, Answer]]  # places (2 or 3,) planned to, of which the last is taken
    given_up: list[Array]  # places (2,)
    seen: int  # explored cells when frontiers were last given up


class Explorer:
    """Drives to frontiers, then to the goal.

    Attributes:
        state: `explore`, `drive` (to the goal) or `done` (nothing is left to see).
    """

    def __init__(self, config: Explore) -> None:
        self.config = config

    def reset(self, mission: Mission) -> None:
        """See `Policy.reset`."""
        self._mission = mission
        self._given_up: list[Array] = []  # places (2,) that were in vain
        self._spent = 0.0  # s on this frontier
        self._since = np.inf  # s since the last search
        self._seen = 0  # explored cells when frontiers were last given up
        self.state = "explore"
        self._driver = PlannedDriver(self.config)
        self._driver.reset(mission)
        self.planning = self._driver.planning
        if not self.planning.busy:
            self._choose(mission.reading)

    def act(self, reading: Reading) -> Command:
        """See `Policy.act`; done one period after nothing was left to see."""
        driver = self._driver
        if self.state == "done":
            return Command(np.zeros(2), driver.shown, done=True)
        period = self._mission.period
        self._since += period
        self._spent += period
        due = self._since >= LOOK or driver.ended
        if self.state == "explore" and due and not self.planning.busy:
            self._choose(reading)
        if self.state == "done":
            return Command(np.zeros(2), driver.shown)
        return driver.act(reading)

    def _choose(self, reading: Reading) -> None:
        """Ask where to drive next, with plans to there."""
        driver = self._driver
        over = driver.ended or not driver.answer.solved or self._spent > PATIENCE
        self._since = 0.0
        search = replace(driver.search(reading), reopened=None)  # frontiers lie in the plain map
        choose = partial(self._choice, search, reading.pose, driver.goal[:2], over)
        self.planning.ask(choose, self._chosen)

    def _chosen(self, choice: Choice) -> None:
        self.state, answers, self._given_up, self._seen = choice
        for place, answer in answers:
            self._spent = 0.0
            self._driver.aim(place, answer)

    def _choice(self, search: Search, pose: Array, aim: Array, over: bool, end: float) -> Choice:
        """Choose the goal if a path to it is explored, or else the cheapest frontier.

        This is made beside the loop, and changes nothing that the loop knows. The search plans from
        a pose (3,) [m, m, rad] until `clock` shows `end` [s]. The last choice was a place (2,) [m],
        `aim`; it is over if it was reached, or led nowhere.
        """
        config, mission, answers = self.config, self._mission, list[tuple[Array, Answer]]()
        grid = with_free_footprint(search.maps[0], pose, mission.footprint)
        goal, given_up, seen = mission.goal, [*self._given_up], self._seen

        def plan(to: Array) -> bool:
            answers.append((to, search.plan(to, end)))
            return answers[-1][1].solved

        def chosen(state: str) -> Choice:
            return Choice(state, answers, given_up, seen)

        if config.seek and np.isfinite(geodesic(grid, goal[:2], CLEARANCE).at(pose[:2])):
            plan(goal)
            return chosen("drive")
        if over:
            given_up.append(aim)
        found = find_frontiers(grid, pose, CLEARANCE, SHORTEST)
        found = [one for one in found if not self._is_short(one) or one.beyond >= GAP]
        for one in sorted(found, key=lambda one: (self._is_short(one), self._cost(one))):
            away = [np.hypot(*(one.place - place)) for place in given_up]
            if min(away, default=np.inf) < CLEARANCE:
                continue
            same = CLEARANCE if self._is_short(one) else SAME
            if np.hypot(*(one.place - aim)) < same and not over:
                return chosen("explore")  # on the way there
            if plan(one.place):
                return chosen("explore")
            given_up.append(one.place)
        explored = int((grid.cells != UNKNOWN).sum())
        if found and explored > MORE * seen:  # much was seen since: a path may be open now
            seen = explored
            given_up.clear()
            return chosen("explore")
        plan(goal if config.seek else pose)
        return chosen("drive" if config.seek else "done")

    def _is_short(self, one: Frontier) -> bool:
        """Return True if it may be a gap between beams."""
        return one.length < MIN_LENGTH

    def _cost(self, one: Frontier) -> float:
        """Return a frontier's cost [m]: the way there and on to the goal, less its length."""
        rest = TOWARDS * float(np.hypot(*(one.place - self._mission.goal[:2])))
        return one.path_length + (rest if self.config.seek else 0.0) - GAIN * one.length
