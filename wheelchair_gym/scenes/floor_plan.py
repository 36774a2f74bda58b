"""Homes and clinics, drawn at random."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.compiled.kernel import as_int, borrowing_kernel, kernel
from wheelchair_gym.config import InputError, setting, settings
from wheelchair_gym.geometry import Footprint
from wheelchair_gym.maps import FREE, OCCUPIED, OccupancyGrid, geodesic, interpolate
from wheelchair_gym.maps.grid import boundary
from wheelchair_gym.random import NumpyStream, numpy_integer, numpy_stream, numpy_uniform
from wheelchair_gym.scenes.furniture import Furniture, furnish
from wheelchair_gym.scenes.layout import Building, FloorLayout, generate_layout
from wheelchair_gym.scenes.poses import FOOTPRINT, passing_radius, sample_pose
from wheelchair_gym.scenes.raster import CELL, paint_discs, paint_polygon, paint_rects
from wheelchair_gym.types import Episode

Array = NDArray[np.float64]
Cells = NDArray[np.int8]
Field = NDArray[np.float32]
Index = NDArray[np.int64]

_TRIES = 50  # storeys drawn before the settings are called impossible
_GOALS = 3  # goals tried in each
_STARTS = 12  # starts tried for each goal


class FurnishedFloor(NamedTuple):
    """A storey furnished: its plan, the map, walls (n, 4) and discs (m, 3) [m]."""

    plan: FloorLayout
    cells: Cells
    walls: Array
    discs: Array


@settings
class FloorPlan:
    """A storey with corridors, rooms, doors and furniture; start and goal in different rooms.

    A way for the chair exists by construction (furniture leaves a passage round every piece, doors
    are kept clear on both sides) and is checked.
    """

    kind: Literal["any", "home", "clinic"] = setting(default="any", source="design choice")
    """Kind of building; any draws one of the two."""
    door_width: tuple[float, float] = setting(
        default=(1.0, 1.2), unit="m", low=0.7, high=2.0, source="design choice"
    )
    """Least and greatest clear width of doors."""
    corridor_width: tuple[float, float] = setting(
        default=(1.2, 1.8), unit="m", low=0.8, high=4.0, source="design choice"
    )
    """Least and greatest clear width of corridors."""
    building_size: tuple[float, float] = setting(
        default=(10.0, 18.0), unit="m", low=9.0, high=40.0, source="design choice"
    )
    """Least and greatest side of the building."""
    furniture_density: float = setting(
        default=0.25, unit="1/m2", low=0.0, high=2.0, source="design choice"
    )
    """Pieces of furniture that are tried per area of a room."""
    passage_width: float = setting(default=1.2, unit="m", low=0.7, high=3.0, source="design choice")
    """Clear width that furniture leaves."""
    path_length: tuple[float, float] = setting(
        default=(5.0, 30.0), unit="m", low=0.0, source="design choice"
    )
    """Least and greatest length of the shortest path from start to goal."""
    clearance: float = setting(default=0.15, unit="m", low=0.0, high=0.5, source="design choice")
    """Clearance of the footprint at start and goal."""

    def __post_init__(self) -> None:
        for name in ("door_width", "corridor_width", "building_size", "path_length"):
            low, high = getattr(self, name)
            if low > high:
                raise InputError(f"FloorPlan.{name} is {low}, {high}; expected from, to")

    def building(
        self, rng: np.random.Generator, home: bool, width: float, height: float
    ) -> FurnishedFloor:
        """One storey of a given kind and size [m]; which side is which is drawn."""
        return self._furnished(numpy_stream(rng), home, width, height)

    def _furnished(
        self, source: NumpyStream, home: bool, width: float, height: float
    ) -> FurnishedFloor:
        plan = generate_layout(source, home, width, height, self.door_width, self.corridor_width)
        things = furnish(source, plan, home, self.furniture_density, self.passage_width)
        return FurnishedFloor(plan, *_build(plan, things), things.discs)

    def sample(self, rng: np.random.Generator, footprint: Footprint = FOOTPRINT) -> Episode:
        """Draw storeys until one has a start and a goal for a chair of this footprint.

        Raises:
            InputError: fifty storeys had none.
        """
        return self._world(rng, footprint)[1]

    def sample_building(
        self, rng: np.random.Generator, footprint: Footprint = FOOTPRINT
    ) -> tuple[Building, Episode]:
        """The same, with the rooms, corridors and doors of the building.

        Raises:
            InputError: fifty storeys had none.
        """
        plan, episode = self._world(rng, footprint)
        return Building(plan), episode

    def _world(self, rng: np.random.Generator, footprint: Footprint) -> tuple[FloorLayout, Episode]:
        source = numpy_stream(rng)
        start, goal = np.empty(3), np.empty(3)
        least, most = self.building_size
        for _ in range(_TRIES):
            home = self.kind == "home" or (
                self.kind == "any" and numpy_uniform(source, 0.0, 1.0) < 0.5
            )
            width = numpy_uniform(source, least, most)
            height = numpy_uniform(source, least, (least + most) / 2 if home else most)
            storey = self._furnished(source, home, width, height)
            grid = OccupancyGrid(storey.cells, CELL)
            ground = storey.plan.rooms, storey.walls, storey.discs, footprint.array, self.clearance
            for _ in range(_GOALS):
                there = _draw_goal(source, *ground, goal)
                if there < 0:
                    continue
                ways = geodesic(grid, goal[:2], passing_radius(footprint))
                if _draw_start(source, *ground, there, ways.extended, self.path_length, start):
                    episode = Episode(
                        grid, start, goal, storey.walls, storey.discs, name="floor_plan"
                    )
                    return storey.plan, episode
        raise InputError(
            f"FloorPlan: {_TRIES} storeys had no start and goal that fit {footprint} in {self}"
        )


@kernel
def _build(plan: FloorLayout, things: Furniture) -> tuple[Cells, Array]:
    """The map and the walls (n, 4) [m] of a furnished floor."""
    cells = np.full((plan.height, plan.width), OCCUPIED, np.int8)
    paint_rects(cells, plan.rooms, as_int(FREE))
    paint_rects(cells, plan.halls, as_int(FREE))
    paint_rects(cells, plan.openings, as_int(FREE))
    paint_rects(cells, things.rects, as_int(OCCUPIED))
    straight = boundary(cells)
    n, count = len(straight), len(things.polygons)
    walls = np.empty((n + 4 * count, 4))
    for k in range(n):
        for i in range(4):
            walls[k, i] = straight[k, i] * CELL
    for k in range(count):
        polygon = things.polygons[k]
        paint_polygon(cells, polygon, as_int(OCCUPIED))
        for i in range(4):
            walls[n, 0], walls[n, 1] = polygon[i, 0], polygon[i, 1]
            walls[n, 2], walls[n, 3] = polygon[(i + 1) % 4, 0], polygon[(i + 1) % 4, 1]
            n += 1
    paint_discs(cells, things.discs, 0.0, 0.0, CELL, as_int(OCCUPIED))
    return cells, walls


@borrowing_kernel
def _draw_goal(
    source: NumpyStream,
    rooms: Index,
    walls: Array,
    discs: Array,
    outline: Array,
    clearance: float,
    goal: Array,
) -> int:
    """Write a goal; the number of its room, or -1 where the draw was unlucky."""
    there = numpy_integer(source, len(rooms))
    found = sample_pose(source, rooms[there], walls, discs, outline, clearance, as_int(20), goal)
    return there if found else -1


@borrowing_kernel
def _draw_start(
    source: NumpyStream,
    rooms: Index,
    walls: Array,
    discs: Array,
    outline: Array,
    clearance: float,
    there: int,
    ways: Field,
    way: tuple[float, float],
    start: Array,
) -> bool:
    """Whether a start in another room was found, with a path of the required length."""
    for _ in range(_STARTS):
        here = numpy_integer(source, len(rooms))
        if here != there and sample_pose(
            source, rooms[here], walls, discs, outline, clearance, as_int(5), start
        ):
            far = interpolate(ways, start[0] / CELL, start[1] / CELL)
            if way[0] <= far <= way[1]:
                return True
    return False
