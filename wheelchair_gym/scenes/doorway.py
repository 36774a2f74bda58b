"""One door off one corridor: how tight may it be?"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.config import InputError, setting, settings
from wheelchair_gym.geometry import Footprint
from wheelchair_gym.scenes.arena import make_arena
from wheelchair_gym.scenes.poses import FOOTPRINT, is_free_pose
from wheelchair_gym.scenes.raster import CELL
from wheelchair_gym.types import Episode

Array = NDArray[np.float64]

_WALL = 0.10  # m
_TRIES = 500
_TURN = np.linspace(0.0, 0.5 * math.pi, 4002)[1:-1]  # rad
_CLEARANCE = 0.06  # m round the footprint: a corridor of 0.90 m leaves 0.14 m


@settings
class Doorway:
    """A corridor, and a room behind a door in its side: a turn of 90 degrees into the door.

    The start is in the corridor, along it; the goal in the room.
    """

    door_width: float = setting(default=0.90, unit="m", source="clear width", low=0.65, high=2.0)
    corridor_width: float = setting(
        default=1.20, unit="m", source="clear width", low=0.75, high=4.0
    )
    corridor_length: float = setting(
        default=7.0, unit="m", source="of the corridor", low=4.0, high=30.0
    )
    room_depth: float = setting(
        default=3.5, unit="m", source="depth of the room", low=2.0, high=10.0
    )

    @property
    def margin(self) -> float:
        """What the default chair might grow by on every side and still get round the corner [m].

        No manoeuvre of a rigid outline has more; below 0 none exists.
        """
        return self.margin_for(FOOTPRINT)

    def margin_for(self, footprint: Footprint) -> float:
        """The same for a footprint; below -0.3 m it is -0.3 m or less."""
        half = 0.5 * min(self.door_width, self.corridor_width) - footprint.half_width
        if half <= -0.3:
            return half
        return _last(
            lambda grown: _turns(self.door_width, self.corridor_width, grown, footprint), -0.3, half
        )

    @staticmethod
    def narrowest_door(margin: float, corridor: float) -> float:
        """The narrowest door off a corridor [m] that leaves a margin [m] round the corner."""
        return -_last(lambda door: _turns(-door, corridor, margin, FOOTPRINT), -2.0, -0.5)

    def sample(self, rng: np.random.Generator, footprint: Footprint = FOOTPRINT) -> Episode:
        """Draw where the door is, which way round, and where the chair starts.

        Raises:
            InputError: a chair of this footprint does not get round the corner, or does not stand
                in the corridor.
        """
        margin = self.margin_for(footprint)
        if margin < 0.0:
            raise InputError(
                f"Doorway: {footprint} does not turn from a corridor of {self.corridor_width} m "
                f"into a door of {self.door_width} m: it is {-margin:.2f} m too large on every side"
            )
        low = self.corridor_width + _WALL
        for _ in range(_TRIES):
            middle = rng.uniform(0.35, 0.65) * self.corridor_length
            left = CELL * round(
                (middle - 0.5 * self.door_width) / CELL
            )  # so that the width is exact
            middle, right = left + 0.5 * self.door_width, left + self.door_width
            walls = [
                (0.0, self.corridor_width, left, low),
                (right, self.corridor_width, self.corridor_length, low),
            ]
            ground = make_arena((0.0, 0.0, self.corridor_length, low + self.room_depth), walls)
            side = rng.choice((-1.0, 1.0))
            away = rng.uniform(1.2, 1.8)
            start = np.array(
                [middle - side * away, 0.5 * self.corridor_width, 0.0 if side > 0 else math.pi]
            )
            goal = np.array(
                [middle + rng.uniform(-0.5, 0.5), low + 0.6 * self.room_depth, 0.5 * math.pi]
            )
            solid = ground.walls, ground.discs
            if all(is_free_pose(at, *solid, footprint, _CLEARANCE) for at in (start, goal)):
                return Episode(ground.map, start, goal, ground.walls, ground.discs, name="doorway")
        raise InputError(f"Doorway: {_TRIES} draws left no start for {footprint} in {self}")


def _last(holds: Callable[[float], bool], low: float, high: float) -> float:
    """The last number of an interval for which something holds that holds up to it."""
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


def _turns(door: float, corridor: float, grown: float, footprint: Footprint) -> bool:
    """Whether the outline, grown on every side [m], turns from a corridor into a door in its side.

    At an angle t from the corridor, one long side rests on the door's near post and a rear corner
    slides along the far wall. Its front may reach to the other post's face, or beside it, until the
    slab between both posts is as wide as the outline: from there on it goes in at any length. The
    least over t is the limit: a ladder round a corner, with a width, over a wall with a thickness.
    """
    length = footprint.front + footprint.rear + 2.0 * grown
    width = 2.0 * (footprint.half_width + grown)
    if width > min(door, corridor):
        return False
    s, c = np.sin(_TURN), np.cos(_TURN)
    rests = corridor * c - width  # of its right side, from the near post's lower edge
    face = door * c + corridor * s + rests * c / s
    beside = door / c + rests / (s * c)
    held = door * s - _WALL * c < width
    return bool(np.maximum(face, beside)[held].min(initial=math.inf) >= length)
