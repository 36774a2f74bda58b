"""Obstacles that appear on the way of the chair, and go again."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.config import InputError, setting, settings
from wheelchair_gym.geometry import Footprint
from wheelchair_gym.maps import geodesic
from wheelchair_gym.physics.actors.records import Mover, obstacle, together
from wheelchair_gym.scenes.floor_plan import FloorPlan
from wheelchair_gym.scenes.layout import Building
from wheelchair_gym.scenes.poses import FOOTPRINT, passing_radius
from wheelchair_gym.types import Episode

Array = NDArray[np.float64]

_ENDS = 2.0  # m of the way at start and goal where nothing appears


@settings
class Temporary:
    """A floor plan; round things appear on the shortest way ahead of the chair, for a while.

    T1's temporary obstacles: a plan from where the chair is must lead round them, or the chair
    waits until they are gone.
    """

    count: tuple[int, int] = setting(default=(1, 3), source="obstacles: from, to", low=0, high=20)
    radius: tuple[float, float] = setting(
        default=(0.15, 0.35), unit="m", source="a bag to a trolley: from, to", low=0.05, high=1.0
    )
    trigger_distance: tuple[float, float] = setting(
        default=(1.5, 3.0), unit="m", source="it appears once the chair is so near: from, to",
        low=0.1,
    )  # fmt: skip
    min_distance: float = setting(
        default=1.2, unit="m", source="never nearer: a stop from 0.8 m/s takes 0.88 m", low=0.9
    )
    duration: tuple[float, float] = setting(
        default=(5.0, 20.0), unit="s", source="how long: from, to", low=0.1, high=600.0
    )
    lateral_offset: float = setting(
        default=0.15, unit="m", source="off the way, at most", low=0.0, high=1.0
    )
    building: FloorPlan = FloorPlan()

    def __post_init__(self) -> None:
        for name in ("count", "radius", "trigger_distance", "duration"):
            low, high = getattr(self, name)
            if low > high:
                raise InputError(f"Temporary.{name} is {low}, {high}; expected from, to")
        if self.trigger_distance[0] <= self.min_distance:
            raise InputError(
                f"Temporary.trigger_distance is {self.trigger_distance}; expected more than "
                f"min_distance, {self.min_distance} m"
            )

    def sample(self, rng: np.random.Generator, footprint: Footprint = FOOTPRINT) -> Episode:
        """Draw a floor plan, and what appears on the way through it.

        Raises:
            InputError: the plan's settings leave no start and goal.
        """
        return self.sample_building(rng, footprint)[1]

    def sample_building(
        self, rng: np.random.Generator, footprint: Footprint = FOOTPRINT
    ) -> tuple[Building, Episode]:
        """The same, with the rooms, corridors and doors of the building."""
        layout, episode = self.building.sample_building(rng, footprint)
        radius = passing_radius(footprint)
        path = geodesic(episode.map, episode.goal[:2], radius).path(episode.start[:2])
        way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
        things: list[Mover] = []
        count = int(rng.integers(self.count[0], self.count[1] + 1))
        if way[-1] > 2.0 * _ENDS:
            spots = np.sort(rng.uniform(_ENDS, way[-1] - _ENDS, count))
            for at in spots:
                x, y = (float(np.interp(at, way, path[:, k])) for k in range(2))
                things.append(
                    obstacle(
                        (
                            x + rng.uniform(-self.lateral_offset, self.lateral_offset),
                            y + rng.uniform(-self.lateral_offset, self.lateral_offset),
                        ),
                        float(rng.uniform(*self.radius)),
                        near=float(rng.uniform(*self.trigger_distance)),
                        least=self.min_distance,
                        stay=float(rng.uniform(*self.duration)),
                    )
                )
        return layout, dataclasses.replace(episode, movers=together(things), name="temporary")
