"""BARN's worlds of cylinders: read from a JSON file, or drawn as the benchmark drew its own."""

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.ndimage import label

from wheelchair_gym.base import files
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.errors import shorten
from wheelchair_gym.base.settings import InputError, setting, settings
from wheelchair_gym.geometry.outline import Footprint
from wheelchair_gym.maps import OCCUPIED, OccupancyGrid, geodesic
from wheelchair_gym.scenes.arena import FOOTPRINT
from wheelchair_gym.scenes.raster import CELL, paint_discs, to_cells
from wheelchair_gym.types import Episode

_CYLINDER = 0.075  # m: radius of BARN's; a cell of its grids is one's diameter
_SIDE = 30  # cells of the cluttered square
_LANE = 33  # rows of cells before it, empty between two walls
_START = (-2.25, 3.0, math.pi / 2)  # m, m, rad: in the lane
_GOAL = (-2.25, 13.0)  # m: beyond the square
_FILLS = (0.15, 0.20, 0.25, 0.30)  # share of cells filled at first; generator.py of the dataset
_SMOOTHINGS = (2, 3, 4)  # steps of the cellular automaton
_BORN, _DIES = 5, 1  # filled neighbours from which a cell is filled, and up to which it is emptied
_PASSAGE_MARGIN = 0.05  # m on each side of the chair at the narrowest spot of drawn worlds
_TRIES = 200  # squares drawn before the settings are called impossible


def _smooth(cells: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """One step of the automaton (rows, cols); beyond the side walls all cells count as filled."""
    around = np.pad(cells, ((1, 1), (0, 0)))
    around = np.pad(around, ((0, 0), (1, 1)), constant_values=True).astype(np.int64)
    near: NDArray[np.int64] = sliding_window_view(around, (3, 3)).sum(axis=(2, 3)) - cells
    return (cells | (near >= _BORN)) & (near > _DIES)


def _clear_lane(square: NDArray[np.bool_], width: int) -> None:
    """Clear a lane of `width` cells between the regions reached from below and from above."""
    part, _ = label(~sliding_window_view(square, (width, width)).any(axis=(2, 3)))
    below, above = (np.bincount(part[row][part[row] > 0], minlength=1) for row in (0, -1))
    first, last = int(below.argmax()), int(above.argmax())
    if 0 in (first, last) or first == last:  # walled off at its very edge, or open
        return
    row, col = np.argwhere(part == first)[-1]
    end, aside = np.argwhere(part == last)[0]
    low, high = sorted((row, end))
    square[low : high + width, col : col + width] = False
    low, high = sorted((col, aside))
    square[end : end + width, low : high + width] = False


def _draw_discs(rng: np.random.Generator, width: int) -> Array:
    """Cylinders (m, 3) [m] of a world drawn as the dataset was (Perille et al. 2020)."""
    square = rng.random((_SIDE, _SIDE)) < rng.choice(_FILLS)
    square[:, [0, -1]] = True
    for _ in range(int(rng.choice(_SMOOTHINGS))):
        square = _smooth(square)
    _clear_lane(square, width)
    lane = np.zeros((_LANE, _SIDE), dtype=np.bool_)
    lane[:, [0, -1]] = lane[0] = True
    rows, cols = np.nonzero(np.vstack([lane, square]))
    side = 2.0 * _CYLINDER
    x, y = (cols - _SIDE + 0.5) * side, (rows + 0.5) * side
    return np.column_stack([x, y, np.full(len(x), _CYLINDER)])


def _parse_world(data: Any, where: str) -> tuple[Array, Array, Array, float | None]:
    """Start (3,), goal (3,), circles (m, 3) and length of BARN's own path of one world."""
    if not isinstance(data, Mapping):
        raise InputError(f"{where} is {shorten(data)}; expected an object")
    for key in ("world", "start", "goal", "circles"):
        if key not in data:
            raise InputError(f"{where}.{key} is missing")
    if not isinstance(data["world"], int | str):
        raise InputError(f"{where}.world is {shorten(data['world'])}; expected a number or a name")
    start = files.coordinates(data["start"], (3,), f"{where}.start")
    goal = files.coordinates(data["goal"], (2, 3), f"{where}.goal")
    circles = files.coordinate_lists(data["circles"], 3, f"{where}.circles")
    for k, (_, _, radius) in enumerate(circles):
        if radius <= 0.0:
            raise InputError(f"{where}.circles[{k}] has radius {radius}; expected more than 0")
    yaw = math.atan2(goal[1] - start[1], goal[0] - start[0])
    length = data.get("reference_path_length")
    if length is not None:
        (length,) = files.coordinates([length], (1,), f"{where}.reference_path_length")
    return np.array(start), np.array([*goal, yaw][:3]), np.array(circles).reshape(-1, 3), length


_MAP_MARGIN = 1.5  # m from cylinders, start and goal to the border of the map


@lru_cache(maxsize=4)
def _worlds(path: Path, stamp: int) -> list[Any]:
    """The file's content; the stamp makes an edited file be read again."""
    data = files.read_json(path)
    if not isinstance(data, list) or not data:
        raise InputError(f"{path}: expected a list of worlds")
    return data


@settings
class Barn:
    """A world of the BARN benchmark: cylinders only, a goal at 10 m, to within 1 m, in 100 s.

    Drawn by the benchmark's own cellular automaton, or one of a file.
    """

    path: str = setting(default="")
    """JSON file of worlds, [{world, start, goal, circles}, ...]; empty draws new worlds."""
    world: int | None = setting(default=None)
    """Number of one world of the file; null draws any of them."""

    def sample(self, rng: np.random.Generator, footprint: Footprint = FOOTPRINT) -> Episode:
        """The world of the settings, or one that a chair of this footprint can pass.

        Raises:
            InputError: the file cannot be read or is malformed, or has no such world; or none of
                those drawn can be passed.
        """
        if self.path:
            return self._read(rng)
        if self.world is not None:
            raise InputError("Barn.world is a world of a file; Barn.path is not given")
        goal = np.array([*_GOAL, _START[2]])
        radius = footprint.half_width + _PASSAGE_MARGIN
        width = math.ceil(radius / _CYLINDER)
        for _ in range(_TRIES if width <= _SIDE else 0):
            discs = _draw_discs(rng, width)
            episode = self._episode(np.array(_START), goal, discs, "barn")
            if np.isfinite(geodesic(episode.map, goal, radius).at(episode.start[:2])):
                return episode
        raise InputError(
            f"Barn: none of {_TRIES} worlds leaves {_PASSAGE_MARGIN} m beside {footprint}"
        )

    def _read(self, rng: np.random.Generator) -> Episode:
        path = Path(self.path)
        worlds = _worlds(path, files.modified(path))
        index = int(rng.integers(len(worlds)))
        if self.world is not None:
            named = world_numbers(path)
            if self.world not in named:
                raise InputError(f"{path}: has no world {self.world}; Barn.world must name one")
            index = named.index(self.world)
        start, goal, discs, length = _parse_world(worlds[index], f"{path}: [{index}]")
        name = f"barn_{worlds[index]['world']}"
        return replace(self._episode(start, goal, discs, name), reference_length=length)

    def _episode(self, start: Array, goal: Array, discs: Array, name: str) -> Episode:
        points = np.vstack([discs[:, :2], start[:2], goal[:2]])
        low = np.floor((points.min(axis=0) - _MAP_MARGIN) / CELL) * CELL
        cols, rows = (to_cells(side) for side in points.max(axis=0) + _MAP_MARGIN - low)
        files.check_cells(rows, cols, name)
        cells = np.zeros((rows, cols), dtype=np.int8)
        paint_discs(cells, discs, low[0], low[1], OCCUPIED)
        grid = OccupancyGrid(cells, CELL, (low[0], low[1], 0.0))
        return Episode(grid, start, goal, discs=discs, tolerance=1.0, time_limit=100.0, name=name)


def world_numbers(path: str | Path) -> list[Any]:
    """The worlds' numbers in a file.

    Raises:
        InputError: the file cannot be read, or holds no list of worlds.
    """
    path = Path(path)
    worlds = _worlds(path, files.modified(path))
    return [world.get("world") if isinstance(world, Mapping) else None for world in worlds]
