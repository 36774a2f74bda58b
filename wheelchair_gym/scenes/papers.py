"""The worlds of two papers on swarm planners, exactly as published."""

from __future__ import annotations

from typing import Final, Literal

import numpy as np

from wheelchair_gym.config import setting, settings
from wheelchair_gym.geometry import Footprint
from wheelchair_gym.scenes.arena import arena, facing
from wheelchair_gym.scenes.poses import FOOTPRINT
from wheelchair_gym.types import Episode

CHAOTIC_PSO_DISCS: Final = (
    (1.0, 8.0, 0.32),
    (1.5, 4.5, 0.62),
    (3.0, 7.0, 0.32),
    (4.0, 3.0, 0.32),
    (9.0, 4.0, 0.82),
    (8.0, 8.0, 0.32),
    (6.0, 6.0, 0.52),
    (9.0, 1.0, 0.62),
)
GREY_WOLF_DISCS: Final = ((6.5, 7.5, 5.5), (17.0, 13.0, 3.33), (11.0, 18.0, 3.0))
GREY_WOLF_GOALS: Final = {
    "5,20": (5.0, 20.0),
    "15,5": (15.0, 5.0),
    "12,12": (12.0, 12.0),
    "15,22": (15.0, 22.0),
    "20,20": (20.0, 20.0),
    "10,2.5": (10.0, 2.5),
}


@settings
class ChaoticPso:
    """10 m x 10 m, eight round obstacles, (1, 1) to (9, 9): the paper on chaotic PSO for robots.

    A wall round the ground keeps the chair in; it touches nothing of the paper.
    """

    def sample(self, rng: np.random.Generator, footprint: Footprint = FOOTPRINT) -> Episode:
        """The one world there is, whatever the footprint."""
        ground = arena((0.0, 0.0, 10.0, 10.0), discs=CHAOTIC_PSO_DISCS)
        start, goal = facing((1.0, 1.0), (9.0, 9.0))
        return Episode(ground.map, start, goal, ground.walls, ground.discs, name="chaotic_pso")


@settings
class GreyWolf:
    """25 x 25, three round obstacles, (0, 0) to one of six goals: the report on PSO with GWO.

    A margin beyond its ground lets the chair stand at the start in its corner.
    """

    goal: Literal["5,20", "15,5", "12,12", "15,22", "20,20", "10,2.5"] = setting(
        default="20,20", source="of the report's six, beyond all obstacles"
    )
    margin: float = setting(
        default=2.0, unit="m", source="ground beyond 0 and 25, room for the chair", low=1.0
    )

    def sample(self, rng: np.random.Generator, footprint: Footprint = FOOTPRINT) -> Episode:
        """The one world there is, whatever the footprint."""
        low, high = -self.margin, 25.0 + self.margin
        ground = arena((low, low, high, high), discs=GREY_WOLF_DISCS)
        start, goal = facing((0.0, 0.0), GREY_WOLF_GOALS[self.goal])
        return Episode(ground.map, start, goal, ground.walls, ground.discs, name="grey_wolf")
