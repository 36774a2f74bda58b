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
from wheelchair_gym.scenes.arena import make_arena
from wheelchair_gym.scenes.floor_plan import FloorPlan
from wheelchair_gym.scenes.layout import Building
from wheelchair_gym.scenes.poses import FOOTPRINT, is_free_pose, passing_radius
from wheelchair_gym.scenes.traffic import (
    DoorSettings,
    PeopleSettings,
    sample_doors,
    sample_furniture,
    sample_people,
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
    people: PeopleSettings = PeopleSettings()
    doors: DoorSettings = setting(default=DoorSettings(), source="of buildings")
    furniture_density: float = setting(
        default=0.01, unit="1/m2", source="pieces that can be pushed", low=0.0, high=1.0
    )
    building: FloorPlan = setting(default=FloorPlan(), source="of buildings")
    hall_size: tuple[float, float] = setting(
        default=(9.0, 14.0), unit="m", source="sides of a hall: from, to", low=5.0, high=60.0
    )

    def __post_init__(self) -> None:
        if self.hall_size[0] > self.hall_size[1]:
            raise InputError(f"Crowd.hall_size is {self.hall_size}; expected from, to")

    def sample(self, rng: np.random.Generator, footprint: Footprint = FOOTPRINT) -> Episode:
        """Draw a place for a chair of this footprint, then who and what moves in it.

        Raises:
            InputError: the settings leave no start and goal.
        """
        return self.sample_building(rng, footprint)[1]

    def sample_building(
        self, rng: np.random.Generator, footprint: Footprint = FOOTPRINT
    ) -> tuple[Building | None, Episode]:
        """The same, with the rooms, corridors and doors where it is a building."""
        layout: Building | None = None
        if self.place == "building" or (self.place == "any" and rng.random() < 0.5):
            layout, episode = self.building.sample_building(rng, footprint)
        else:
            episode = self._hall(rng, footprint)
        taken: list[Array] = []
        start, grid = episode.start, episode.map
        things = sample_furniture(rng, grid, self.furniture_density, start, taken)
        leaves = [] if layout is None else sample_doors(rng, grid, layout, self.doors)
        people = sample_people(rng, grid, start, self.people, taken, leaves)
        movers = together([*things, *leaves, *people])
        return layout, dataclasses.replace(episode, movers=movers, name="crowd")

    def _hall(self, rng: np.random.Generator, footprint: Footprint) -> Episode:
        """An open hall with a few columns; start and goal far apart."""
        for _ in range(_TRIES):
            width, height = rng.uniform(*self.hall_size, 2)
            count = round(_COLUMNS * width * height)
            discs = np.column_stack(
                [
                    rng.uniform(1.0, width - 1.0, count),
                    rng.uniform(1.0, height - 1.0, count),
                    rng.uniform(0.15, 0.30, count),
                ]
            )
            ground = make_arena((0.0, 0.0, width, height), discs=discs)
            drawn = [
                np.array([*rng.uniform(0.8, (width - 0.8, height - 0.8)), rng.uniform(-3, 3)])
                for _ in range(2)
            ]
            start, goal = drawn
            if not all(
                is_free_pose(pose, ground.walls, discs, footprint, _CLEARANCE) for pose in drawn
            ):
                continue
            far = float(geodesic(ground.map, goal[:2], passing_radius(footprint)).at(start[:2]))
            if 0.6 * self.hall_size[0] <= far < np.inf:
                return Episode(ground.map, start, goal, ground.walls, discs)
        raise InputError(f"Crowd: {_TRIES} halls had no start and goal for {footprint} in {self}")
