"""One empty room."""

from __future__ import annotations

import math

import numpy as np

from wheelchair_gym.config import InputError, setting, settings
from wheelchair_gym.geometry import Footprint
from wheelchair_gym.scenes.arena import arena
from wheelchair_gym.scenes.poses import FOOTPRINT, stands
from wheelchair_gym.types import Episode

Pose = tuple[float, float, float]

_TRIES = 10_000  # a room of 2 m x 2 m takes hundreds
_EDGE = 0.5  # m: no axle is drawn nearer to a wall
_CLEARANCE = 0.15  # m round the footprint where drawn, as in the other scenes


@settings
class EmptyRoom:
    """An empty rectangular room, its lower-left corner at (0, 0): for first steps and physics."""

    size: tuple[float, float] = setting(default=(8.0, 6.0), unit="m", low=2.0, high=200.0)
    start: Pose | None = setting(default=None, unit="m, m, rad", source="none: drawn at random")
    goal: Pose | None = setting(default=None, unit="m, m, rad", source="none: drawn at random")
    apart: float = setting(default=2.0, unit="m", source="least from start to goal", low=0.0)

    def __post_init__(self) -> None:
        if self.apart > 0.4 * math.hypot(*self.size):
            raise InputError(f"EmptyRoom.apart is {self.apart}; too far for a room of {self.size}")

    def sample(self, rng: np.random.Generator, footprint: Footprint = FOOTPRINT) -> Episode:
        """Draw what is not given, for a chair of this footprint.

        Raises:
            InputError: the given start or goal does not fit into the room, or nothing drawn does.
        """
        width, height = self.size
        ground = arena((0.0, 0.0, width, height))
        solid = ground.walls, ground.discs
        for name, pose in (("start", self.start), ("goal", self.goal)):
            outside = pose is not None and not (0 < pose[0] < width and 0 < pose[1] < height)
            if outside or (pose and not stands(np.array(pose), *solid, footprint, 0.0)):
                raise InputError(
                    f"EmptyRoom.{name} is {pose}; {footprint} must stand in a room of {self.size}"
                )
        for _ in range(_TRIES):
            drawn = [
                pose or (*rng.uniform(_EDGE, (width - _EDGE, height - _EDGE)), rng.uniform(-3, 3))
                for pose in (self.start, self.goal)
            ]
            start, goal = np.array(drawn)
            far = math.dist(start[:2], goal[:2]) >= self.apart
            given = self.start is not None and self.goal is not None
            if given or (
                far and all(stands(pose, *solid, footprint, _CLEARANCE) for pose in (start, goal))
            ):
                return Episode(ground.map, start, goal, ground.walls, ground.discs, name="empty")
        raise InputError(
            f"EmptyRoom: {_TRIES} draws found no start and goal for {footprint} in {self}"
        )
