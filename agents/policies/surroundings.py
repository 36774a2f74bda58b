"""The world around a chair as it knows it when it plans, and the limits that follow in reverse."""

from __future__ import annotations

import math

import numpy as np

from agents.control.followers import CREEP
from agents.control.local_map import LocalMap
from agents.control.rollout import ReferencePath
from agents.control.unknown_space import FloorMemory, assumed_maps, blind_behind, walls_block
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.geometry.kinematics import corner_speed
from wheelchair_gym.maps import OccupancyGrid
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
