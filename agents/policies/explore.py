"""Exploring an unknown world: to one frontier after another, then to the goal."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.control.unknown_space import with_free_footprint
from agents.policies.planned import Planned
from wheelchair_gym.config import setting, settings
from wheelchair_gym.localization.occupancy import Frontier, find_frontiers
from wheelchair_gym.maps import UNKNOWN, geodesic
from wheelchair_gym.types import Command, Mission, Reading

Array = NDArray[np.float64]
SAME = 1.0  # m: a frontier that recedes is the same one so far away
MORE = 1.02  # times as many explored cells: frontiers that were given up are tried again


@settings
class Explore:
    """Explore by frontiers (Yamauchi 1997), as T1 in a house without a map.

    The chair draws its map and localizes on it (pose source `slam`), drives to the frontier that is
    nearest, counting the rest of the way to the goal, and plans to the goal once a path over
    explored space leads there. Without a goal it stops when no frontier is left.
    """

    planner: Mapping[str, Any] = field(
        default_factory=lambda: {"name": "lattice"}, metadata={"source": "design choice"}
    )
    """Name and settings of the planner."""
    follower: Mapping[str, Any] = field(
        default_factory=lambda: {"name": "window"}, metadata={"source": "league: most arrivals"}
    )
    """Name and settings of the follower."""
    seek: bool = setting(default=True)
    """Drive to the goal; false: map all there is."""
    towards: float = setting(default=1.0, low=0.0, source="design choice")
    """Weight of the distance from a frontier to the goal, against the path to the frontier."""
    gain: float = setting(default=0.5, low=0.0, source="design choice")
    """Path length that a metre of frontier is worth."""
    clearance: float = setting(
        default=0.36, unit="m", low=0.0, source="half the chair's width and a cell"
    )
    """Clearance of the paths to frontiers."""
    least: float = setting(default=0.4, unit="m", low=0.0, source="design choice")
    """Least length of a frontier; shorter ones are gaps between beams."""
    look: float = setting(default=1.0, unit="s", low=0.1, source="design choice")
    """Time between two searches for frontiers."""
    patience: float = setting(default=25.0, unit="s", low=1.0, source="design choice")
    """Time for one frontier, after which it is given up."""
    seed: int = setting(default=0, low=0, source="design choice")
    """Seed of the planner, with the episode's key."""

    def __post_init__(self) -> None:
        self.planned()

    def planned(self) -> Planned:
        """What drives to each place."""
        return Planned(planner=self.planner, follower=self.follower, seed=self.seed)

    def make(self) -> Explorer:
        """A fresh policy."""
        return Explorer(self)


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
        self._spent = self._since = 0.0  # s on this frontier, and since the last search
        self._seen = 0  # explored cells when frontiers were last given up
        self.state = "explore"
        self._driver = self.config.planned().make()
        self._driver.reset(mission)
        self._choose(mission.reading)

    def act(self, reading: Reading) -> Command:
        """See `Policy.act`; done one period after nothing was left to see."""
        if self.state == "done":
            return Command(np.zeros(2), self._driver.shown, done=True)
        period = self._mission.period
        self._since += period
        self._spent += period
        if self.state == "explore" and (self._since >= self.config.look or self._driver.ended):
            self._choose(reading)
        if self.state == "done":
            return Command(np.zeros(2), self._driver.shown)
        return self._driver.act(reading)

    def _choose(self, reading: Reading) -> None:
        """Aim at the goal if a path to it is explored, or else at the frontier of least cost."""
        config, mission = self.config, self._mission
        pose, goal = reading.pose, mission.goal[:2]
        grid = with_free_footprint(mission.map_at(reading), pose, mission.footprint)
        self._since = 0.0
        if config.seek and np.isfinite(geodesic(grid, goal, config.clearance).at(pose[:2])):
            self.state = "drive"
            self._driver.aim(mission.goal, reading)
            return
        aim = self._driver.goal[:2]
        over = self._driver.ended or not self._driver.solved or self._spent > config.patience
        if over:
            self._given_up.append(aim)
        found = find_frontiers(grid, pose, config.clearance, config.least)
        for one in sorted(found, key=self._cost):
            away = [np.hypot(*(one.place - place)) for place in self._given_up]
            if min(away, default=np.inf) < config.clearance:
                continue
            if np.hypot(*(one.place - aim)) < SAME and not over:
                return  # on the way there
            self._driver.aim(one.place, reading)
            self._spent = 0.0
            if self._driver.solved:
                return
            self._given_up.append(one.place)
        seen = int((grid.cells != UNKNOWN).sum())
        if found and seen > MORE * self._seen:  # much was seen since: a path there may be open now
            self._seen = seen
            self._given_up.clear()
            return
        self.state = "drive" if config.seek else "done"
        self._driver.aim(mission.goal if config.seek else pose, reading)

    def _cost(self, one: Frontier) -> float:
        """What a frontier costs [m]: the way there and on to the goal, less what it may show."""
        rest = self.config.towards * float(np.hypot(*(one.place - self._mission.goal[:2])))
        return one.path_length + (rest if self.config.seek else 0.0) - self.config.gain * one.length
