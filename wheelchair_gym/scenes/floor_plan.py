"""Homes and clinics, drawn at random."""

import math
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import InputError, Range, setting, settings
from wheelchair_gym.compiled.kernel import as_int, borrowing_kernel, kernel
from wheelchair_gym.compiled.random import NumpyStream, numpy_integer, numpy_stream, numpy_uniform
from wheelchair_gym.geometry.outline import Footprint, footprint_clearance
from wheelchair_gym.maps import FREE, OCCUPIED, OccupancyGrid, geodesic, interpolate
from wheelchair_gym.maps.grid import boundary
from wheelchair_gym.scenes.arena import CLEARANCE, FOOTPRINT, passing_radius
from wheelchair_gym.scenes.layout import FloorLayout, furnish, generate_layout, min_side
from wheelchair_gym.scenes.raster import CELL, paint_discs, paint_polygon, paint_rects
from wheelchair_gym.types import Episode

Cells = NDArray[np.int8]
Field = NDArray[np.float32]

_TRIES = 50  # storeys drawn before the settings are called impossible
_GOALS = 3  # goals tried in each
_STARTS = 12  # starts tried for each goal
_PASSAGE_WIDTH = 1.2  # m that furniture leaves clear
_INSET = 0.4  # m: from the axle to the walls of a room, at least


class Storey(NamedTuple):
    """A furnished storey: its layout, the map, walls (n, 4) and discs (m, 3) [m]."""

    layout: FloorLayout
    cells: Cells
    walls: Array
    discs: Array


class Building:
    """A scene that tells of a building, too: `sample_building` gives its layout and the episode."""

    sample_building: Any

    def sample(self, rng: np.random.Generator, footprint: Footprint = FOOTPRINT) -> Episode:
        """Draw a world with a start and a goal for a chair of this footprint.

        Raises:
            InputError: the settings leave none.
        """
        episode: Episode = self.sample_building(rng, footprint)[1]
        return episode


@settings
class FloorPlan(Building):
    """A storey with corridors, rooms, doors and furniture; start and goal in different rooms.

    A way for the chair exists by construction (furniture leaves a passage round every piece, doors
    are kept clear on both sides) and is checked.
    """

    kind: Literal["any", "home", "clinic"] = setting(default="any")
    """Kind of building; any draws one of the two."""
    door_width: Range[float] = setting(default=(1.0, 1.2), unit="m", low=0.7, high=2.0)
    """Minimum and maximum clear width of doors."""
    corridor_width: Range[float] = setting(default=(1.2, 1.8), unit="m", low=0.8, high=4.0)
    """Minimum and maximum clear width of corridors."""
    building_size: Range[float] = setting(default=(10.0, 18.0), unit="m", low=9.0, high=60.0)
    """Minimum and maximum side of the building."""
    furniture_density: float = setting(default=0.25, unit="1/m2", low=0.0, high=2.0)
    """Pieces of furniture that are tried per area of a room."""
    path_length: Range[float] = setting(default=(5.0, 30.0), unit="m", low=0.0)
    """Minimum and maximum length of the shortest path from start to goal."""

    def __post_init__(self) -> None:
        least = CELL * min_side(self.door_width, self.corridor_width)
        if self.building_size[0] < least - 1e-9:
            raise InputError(
                f"FloorPlan.building_size is from {self.building_size[0]:g} m; expected at least "
                f"{least:.2f} m for doors and corridors of these widths"
            )

    def sample_building(
        self, rng: np.random.Generator, footprint: Footprint = FOOTPRINT
    ) -> tuple[FloorLayout, Episode]:
        """Draw storeys until one has a start and a goal; with its rooms, corridors and doors.

        Raises:
            InputError: fifty storeys had none.
        """
        source = numpy_stream(rng)
        start, goal = np.empty(3), np.empty(3)
        minimum, maximum = self.building_size
        sizes = self.door_width, self.corridor_width, self.furniture_density
        for _ in range(_TRIES):
            home = self.kind == "home" or (
                self.kind == "any" and numpy_uniform(source, 0.0, 1.0) < 0.5
            )
            width = numpy_uniform(source, minimum, maximum)
            height = numpy_uniform(source, minimum, (minimum + maximum) / 2 if home else maximum)
            storey = _draw_storey(source, home, width, height, *sizes)
            layout, cells, walls, discs = storey
            grid, outline = OccupancyGrid(cells, CELL), footprint.array
            for _ in range(_GOALS):
                goal_room = numpy_integer(source, len(layout.rooms))
                if not sample_pose(source, storey, goal_room, outline, 20, goal):
                    continue
                lengths = geodesic(grid, goal[:2], passing_radius(footprint)).extended
                bounds = self.path_length
                if _draw_start(source, storey, goal_room, outline, lengths, bounds, start):
                    return layout, Episode(grid, start, goal, walls, discs, name="floor_plan")
        raise InputError(
            f"FloorPlan: {_TRIES} storeys had no start and goal that fit {footprint} in {self}"
        )


@settings
class InBuilding(Building):
    """A scene in a building."""

    building: FloorPlan = FloorPlan()


@kernel
def _draw_storey(
    source: NumpyStream,
    home: bool,
    width: float,
    height: float,
    door_width: Range[float],
    corridor_width: Range[float],
    furniture_density: float,
) -> Storey:
    """Lay out and furnish a storey of a kind and size [m]; write its map and its walls."""
    layout = generate_layout(source, home, width, height, door_width, corridor_width)
    furniture = furnish(source, layout, home, furniture_density, _PASSAGE_WIDTH)
    cells = np.full((layout.height, layout.width), OCCUPIED, np.int8)
    for rects in (layout.rooms, layout.corridors, layout.openings):
        paint_rects(cells, rects, as_int(FREE))
    paint_rects(cells, furniture.rects, as_int(OCCUPIED))
    upright = boundary(cells) * CELL
    n, count = len(upright), len(furniture.polygons)
    walls = np.empty((n + 4 * count, 4))
    walls[:n] = upright
    for k in range(count):
        polygon = furniture.polygons[k]
        paint_polygon(cells, polygon, as_int(OCCUPIED))
        for i in range(4):
            walls[n, :2], walls[n, 2:] = polygon[i], polygon[(i + 1) % 4]
            n += 1
    paint_discs(cells, furniture.discs, 0.0, 0.0, as_int(OCCUPIED))
    return Storey(layout, cells, walls, furniture.discs)


@borrowing_kernel
def sample_pose(
    source: NumpyStream, storey: Storey, room: int, outline: Array, tries: int, pose: Array
) -> bool:
    """Draw poses in a room until the footprint is free; whether one was found."""
    place, reach = storey.layout.rooms[room], CLEARANCE + 0.01
    x0, y0, x1, y1 = place.x0, place.y0, place.x1, place.y1
    for _ in range(tries):
        pose[0] = numpy_uniform(source, x0 * CELL + _INSET, x1 * CELL - _INSET)
        pose[1] = numpy_uniform(source, y0 * CELL + _INSET, y1 * CELL - _INSET)
        pose[2] = numpy_uniform(source, -math.pi, math.pi)
        gap = footprint_clearance(
            pose[0], pose[1], pose[2], outline, storey.walls, storey.discs, reach
        )
        if gap >= CLEARANCE:
            return True
    return False


@borrowing_kernel
def _draw_start(
    source: NumpyStream, storey: Storey, goal_room: int, outline: Array, lengths: Field,
    path_length: Range[float], start: Array,
) -> bool:  # fmt: skip
    """Whether a start in another room was found, with a path of the required length."""
    for _ in range(_STARTS):
        room = numpy_integer(source, len(storey.layout.rooms))
        if room != goal_room and sample_pose(source, storey, room, outline, as_int(5), start):
            length = interpolate(lengths, start[0] / CELL, start[1] / CELL)
            if path_length[0] <= length <= path_length[1]:
                return True
    return False
