"""Map files, one module for each format; any of them, by the ending of its name."""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.files import LIMITS, read_json
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.maps.grid import OccupancyGrid
from wheelchair_gym.maps.io.floor_plan import (
    IMAGES,
    polygons_map,
    read_floor_plan_image,
    read_house,
)
from wheelchair_gym.maps.io.map_server import read_map, read_moving_ai_map


class MapWithWalls(NamedTuple):
    """A map, and the closed loops of its walls, which may be finer than its cells."""

    grid: OccupancyGrid
    walls: Array  # (n, 4) m


def read_any_map(
    path: str | Path, unknown_is_solid: bool | None = None, resolution: float | None = None
) -> MapWithWalls:
    """Read a map to drive or to plan on, and its walls; the arguments are those of `read_grid`.

    Raises:
        InputError: as `read_grid`, or there are more walls than the limit.
    """
    grid, walls = _read(path, unknown_is_solid, resolution)
    if walls is None:
        count, maximum = grid.n_walls, LIMITS["walls"].maximum
        if count > maximum:
            raise InputError(
                f"{path}: {count:,} walls; expected at most {maximum:,}; clean it of specks, by a "
                "median filter of its image, or give it larger cells"
            )
        walls = grid.walls()
    return MapWithWalls(grid, walls)


def read_grid(
    path: str | Path, unknown_is_solid: bool | None = None, resolution: float | None = None
) -> OccupancyGrid:
    """Read the cells of a map file: its kind follows from the ending of its name.

    Args:
        path: a map_server `.yaml`, a MovingAI `.map`, a HouseExpo `.json`, polygons (`.json`), or
            an image of a floor plan.
        unknown_is_solid: unknown cells become occupied; False: free; None: they stay unknown.
        resolution: edge of a pixel [m]; for an image, and for nothing else.

    Raises:
        InputError: the file cannot be read or is malformed, has another ending, or the resolution
            is missing or not needed.
    """
    return _read(path, unknown_is_solid, resolution)[0]


def _read(
    path: str | Path, unknown_is_solid: bool | None, resolution: float | None
) -> tuple[OccupancyGrid, Array | None]:
    """Read a map, and the walls that are finer than its cells, if it has any."""
    ending = Path(path).suffix.lower()
    if ending in IMAGES:
        if resolution is None:
            raise InputError(
                f"{path}: an image has no scale; give the resolution, the metres of one pixel"
            )
        return read_floor_plan_image(path, resolution), None
    if resolution is not None:
        raise InputError(f"{path}: the resolution is for images; this file has its own scale")
    if ending == ".json":
        data = read_json(path)
        if isinstance(data, Mapping) and "polygons" in data:
            return polygons_map(data, path)
        house = read_house(path)
        return house.grid(), house.walls
    if ending == ".map":
        grid = read_moving_ai_map(path)
    elif ending in (".yaml", ".yml"):
        grid = read_map(path)
        if unknown_is_solid is not None:
            grid = grid.without_unknown(unknown_is_solid)
    else:
        expected = (
            "expected .yaml (map_server), .map (MovingAI), .json (HouseExpo, polygons) or .png"
        )
        raise InputError(f"{path}: not a known kind of map; {expected}")
    return grid, None
