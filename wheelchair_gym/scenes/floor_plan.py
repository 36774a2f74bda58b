"""Homes and clinics, drawn at random."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.config import InputError, setting, settings
from wheelchair_gym.geometry import polygon_edges
from wheelchair_gym.maps import OCCUPIED, OccupancyGrid, geodesic
from wheelchair_gym.scenes.furniture import (
    CLINIC_ROOMS,
    HOME_ROOMS,
    LIVING_ROOM,
    LOBBY,
    Furniture,
    furnish,
)
from wheelchair_gym.scenes.layout import Layout, lay_out
from wheelchair_gym.scenes.poses import RADIUS, draw_pose
from wheelchair_gym.scenes.raster import CELL, Rect, paint_discs, paint_polygon
from wheelchair_gym.types import Episode

Array = NDArray[np.float64]

_TRIES = 50  # storeys drawn before the settings are called impossible
_GOALS = 3  # goals tried in each
_STARTS = 12  # starts tried for each goal


@settings
class FloorPlan:
    """A storey with corridors, rooms, doors and furniture; start and goal in different rooms.

    A way for the chair exists by construction (furniture leaves a passage round every piece, doors
    are kept clear on both sides) and is checked.
    """

    kind: Literal["any", "home", "clinic"] = setting(default="any", source="a coin is thrown")
    doors: tuple[float, float] = setting(
        default=(1.0, 1.2), unit="m", source="clear width from, to", low=0.7, high=2.0
    )
    corridors: tuple[float, float] = setting(
        default=(1.2, 1.8), unit="m", source="clear width from, to", low=0.8, high=4.0
    )
    size: tuple[float, float] = setting(
        default=(10.0, 18.0), unit="m", source="sides of the building from, to", low=9.0, high=40.0
    )
    furniture: float = setting(
        default=0.25, unit="1/m2", source="pieces tried per area of room", low=0.0, high=2.0
    )
    passage: float = setting(
        default=1.2, unit="m", source="clear width round furniture", low=0.7, high=3.0
    )
    way: tuple[float, float] = setting(
        default=(5.0, 30.0), unit="m", source="geodesic from start to goal: from, to", low=0.0
    )
    clearance: float = setting(
        default=0.15, unit="m", source="round the footprint at start and goal", low=0.0, high=0.5
    )

    def __post_init__(self) -> None:
        for name in ("doors", "corridors", "size", "way"):
            low, high = getattr(self, name)
            if low > high:
                raise InputError(f"FloorPlan.{name} is {low}, {high}; expected from, to")

    def draw(self, rng: np.random.Generator) -> tuple[Layout, Furniture]:
        """One storey and what stands in it."""
        home = self.kind == "home" or (self.kind == "any" and rng.random() < 0.5)
        least, most = self.size
        width = rng.uniform(least, most)
        height = rng.uniform(least, (least + most) / 2 if home else most)
        return self.building(rng, home, width, height)

    def building(
        self, rng: np.random.Generator, home: bool, width: float, height: float
    ) -> tuple[Layout, Furniture]:
        """One storey of a given kind and size [m]; which side is which is drawn."""
        layout = lay_out(rng, home, width, height, self.doors, self.corridors)
        zones = [door.zone for door in layout.doors]
        things = Furniture()
        for k, room in enumerate(layout.rooms):
            if k == 0 and layout.lobby:
                catalogue = LIVING_ROOM if home else LOBBY
            else:
                choices = HOME_ROOMS if home else CLINIC_ROOMS
                catalogue = choices[int(rng.integers(len(choices)))]
            count = round(self.furniture * room.width * room.height * CELL**2)
            near = [zone for zone in zones if zone.meets(room)]
            furnish(rng, room, near, catalogue, count, self.passage, things)
        return layout, things

    def sample(self, rng: np.random.Generator) -> Episode:
        """Draw storeys until one has a start and a goal.

        Raises:
            InputError: fifty storeys had none.
        """
        return self.storey(rng)[1]

    def storey(self, rng: np.random.Generator) -> tuple[Layout, Episode]:
        """The same, with the rooms, corridors and doors of the building.

        Raises:
            InputError: fifty storeys had none.
        """
        for _ in range(_TRIES):
            layout, things = self.draw(rng)
            grid, walls, discs = build(layout, things)
            for _ in range(_GOALS):
                found = self._ends(rng, layout.rooms, grid, walls, discs)
                if found is not None:
                    start, goal = found
                    episode = Episode(grid, start, goal, walls, discs, name="floor_plan")
                    return layout, episode
        raise InputError(f"FloorPlan: {_TRIES} storeys had no start and goal that fit {self}")

    def _ends(
        self,
        rng: np.random.Generator,
        rooms: tuple[Rect, ...],
        grid: OccupancyGrid,
        walls: Array,
        discs: Array,
    ) -> tuple[Array, Array] | None:
        """A start and a goal in different rooms, or None where the draw was unlucky."""

        def pose(room: Rect, tries: int) -> Array | None:
            low, high = np.array([room[:2], room[2:]]) * CELL

            def place() -> tuple[float, float]:
                x, y = rng.uniform(low + 0.4, high - 0.4)
                return x, y

            return draw_pose(rng, place, walls, discs, self.clearance, tries)

        there = int(rng.integers(len(rooms)))
        goal = pose(rooms[there], 20)
        if goal is None:
            return None
        ways = geodesic(grid, goal[:2], RADIUS)
        for _ in range(_STARTS):
            here = int(rng.integers(len(rooms)))
            start = pose(rooms[here], 5) if here != there else None
            if start is not None and self.way[0] <= ways.at(start[:2]) <= self.way[1]:
                return start, goal
        return None


def build(layout: Layout, things: Furniture) -> tuple[OccupancyGrid, Array, Array]:
    """The map, walls (n, 4) and discs (m, 3) of a furnished storey."""
    solid = layout.solid()
    for rect in things.rects:
        rect.paint(solid, 1)
    walls = OccupancyGrid(solid * np.int8(OCCUPIED), CELL).walls()
    walls = np.vstack([walls, *(polygon_edges(polygon) for polygon in things.polygons)])
    discs = np.array(things.discs, dtype=np.float64).reshape(-1, 3)
    for polygon in things.polygons:
        paint_polygon(solid, polygon, 1)
    paint_discs(solid, discs, 0.0, 0.0, CELL, 1)
    return OccupancyGrid(solid * np.int8(OCCUPIED), CELL), walls, discs
