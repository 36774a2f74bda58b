"""Map files, one module for each format; any of them, by the ending of its name."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from wheelchair_gym.arrays import Array
from wheelchair_gym.config import InputError
from wheelchair_gym.maps.grid import OccupancyGrid
from wheelchair_gym.maps.io.house_expo import read_house
from wheelchair_gym.maps.io.map_server import read_map
from wheelchair_gym.maps.io.moving_ai import read_moving_ai_map


class MapWithWalls(NamedTuple):
    """A map, and the closed loops of its walls, which may be finer than its cells."""

    grid: OccupancyGrid
    walls: Array  # (n, 4) m


def read_any_map(path: str | Path, unknown_is_solid: bool = False) -> MapWithWalls:
    """The map of a map_server `.yaml`, a MovingAI `.map` or a HouseExpo `.json`.

    Raises:
        InputError: the file cannot be read or is malformed, or has another ending.
    """
    ending = Path(path).suffix.lower()
    if ending == ".json":
        house = read_house(path)
        return MapWithWalls(house.grid(), house.walls)
    if ending == ".map":
        grid = read_moving_ai_map(path)
    elif ending in (".yaml", ".yml"):
        grid = read_map(path)
    else:
        expected = "expected .yaml (map_server), .map (MovingAI) or .json (HouseExpo)"
        raise InputError(f"{path}: not a known kind of map; {expected}")
    return MapWithWalls(grid, grid.walls(unknown_is_solid))
