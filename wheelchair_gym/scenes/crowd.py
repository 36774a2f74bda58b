"""Buildings and halls with people in them."""

from __future__ import annotations

import dataclasses
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.config import InputError, setting, settings
from wheelchair_gym.geometry import Footprint
from wheelchair_gym.maps import geodesic
from wheelchair_gym.physics.actors.records import together
from wheelchair_gym.scenes.arena import arena
from wheelchair_gym.scenes.floor_plan import FloorPlan
from wheelchair_gym.scenes.layout import Layout
from wheelchair_gym.scenes.poses import FOOTPRINT, passing_radius, stands
from wheelchair_gym.scenes.traffic import (
    DoorsOfScene,
    PeopleOfScene,
    draw_leaves,
    draw_light,
    draw_people,
)
from wheelchair_gym.types import Episode

Array = NDArray[np.float64]

_TRIES = 200  # halls drawn before the settings are called impossible
_CLEARANCE = 0.15  # m round the footprint at start and goal, as in the other scenes
_COLUMNS = 0.02  # 1/m2 of a hall


@settings
class Crowd:
    """People who walk through a building or a hall, with powered doors and light furniture."""

    place: Literal["any", "building", "hall"] = setting(default="any", source="a coin is thrown")
    people: PeopleOfScene = PeopleOfScene()
    doors: DoorsOfScene = setting(default=DoorsOfScene(), source="of buildings")
    light: float = setting(
        default=0.01, unit="1/m2", source="pieces that can be pushed", low=0.0, high=1.0
    )
    plan: FloorPlan = setting(default=FloorPlan(), source="of buildings")
    hall: tuple[float, float] = setting(
        default=(9.0, 14.0), unit="m", source="sides of a hall: from, to", low=5.0, high=60.0
    )

    def __post_init__(self) -> None:
        if self.hall[0] > self.hall[1]:
            raise InputError(f"Crowd.hall is {self.hall}; expected from, to")

    def sample(self, rng: np.random.Generator, footprint: Footprint = FOOTPRINT) -> Episode:
        """Draw a place for a chair of this footprint, then who and what moves in it.

        Raises:
            InputError: the settings leave no start and goal.
        """
        return self.storey(rng, footprint)[1]

    def storey(
        self, rng: np.random.Generator, footprint: Footprint = FOOTPRINT
    ) -> tuple[Layout | None, Episode]:
        """The same, with the rooms, corridors and doors where it is a building."""
        layout: Layout | None = None
        if self.place == "building" or (self.place == "any" and rng.random() < 0.5):
            layout, episode = self.plan.storey(rng, footprint)
        else:
            episode = self._hall(rng, footprint)
        taken: list[Array] = []
        start, grid = episode.start, episode.map
        things = draw_light(rng, grid, self.light, start, taken)
        leaves = [] if layout is None else draw_leaves(rng, grid, layout, self.doors)
        people = draw_people(rng, grid, start, self.people, taken, leaves)
        movers = together([*things, *leaves, *people])
        return layout, dataclasses.replace(episode, movers=movers, name="crowd")

    def _hall(self, rng: np.random.Generator, footprint: Footprint) -> Episode:
        """An open hall with a few columns; start and goal far apart."""
        for _ in range(_TRIES):
            width, height = rng.uniform(*self.hall, 2)
            count = round(_COLUMNS * width * height)
            discs = np.column_stack(
                [
                    rng.uniform(1.0, width - 1.0, count),
                    rng.uniform(1.0, height - 1.0, count),
                    rng.uniform(0.15, 0.30, count),
                ]
            )
            ground = arena((0.0, 0.0, width, height), discs=discs)
            drawn = [
                np.array([*rng.uniform(0.8, (width - 0.8, height - 0.8)), rng.uniform(-3, 3)])
                for _ in range(2)
            ]
            start, goal = drawn
            if not all(stands(pose, ground.walls, discs, footprint, _CLEARANCE) for pose in drawn):
                continue
            far = float(geodesic(ground.map, goal[:2], passing_radius(footprint)).at(start[:2]))
            if 0.6 * self.hall[0] <= far < np.inf:
                return Episode(ground.map, start, goal, ground.walls, discs)
        raise InputError(f"Crowd: {_TRIES} halls had no start and goal for {footprint} in {self}")
