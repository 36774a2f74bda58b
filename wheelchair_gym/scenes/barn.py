"""BARN's worlds of cylinders, read from a JSON file of its importer's form."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.config import InputError, read_json, setting, settings
from wheelchair_gym.maps import OCCUPIED, OccupancyGrid
from wheelchair_gym.scenes.raster import CELL, paint_discs, to_cells
from wheelchair_gym.types import Episode

Array = NDArray[np.float64]


def _numbers(value: Any, lengths: tuple[int, ...], where: str) -> list[float]:
    good = isinstance(value, list) and len(value) in lengths
    if not good or not all(
        isinstance(v, int | float) and not isinstance(v, bool) and math.isfinite(v) for v in value
    ):
        wanted = " or ".join(map(str, lengths))
        raise InputError(f"{where} is {str(value)[:60]}; expected {wanted} numbers")
    return [float(v) for v in value]


def _world(data: Any, where: str) -> tuple[Array, Array, Array]:
    """Start (3,), goal (3,) and circles (m, 3) of one world."""
    if not isinstance(data, Mapping):
        raise InputError(f"{where} is {str(data)[:60]}; expected an object")
    for key in ("world", "start", "goal", "circles"):
        if key not in data:
            raise InputError(f"{where}.{key} is missing")
    start = _numbers(data["start"], (3,), f"{where}.start")
    goal = _numbers(data["goal"], (2, 3), f"{where}.goal")
    if not isinstance(data["circles"], list):
        raise InputError(f"{where}.circles is {str(data['circles'])[:60]}; expected a list")
    circles = [
        _numbers(circle, (3,), f"{where}.circles[{k}]") for k, circle in enumerate(data["circles"])
    ]
    for k, circle in enumerate(circles):
        if circle[2] <= 0.0:
            raise InputError(f"{where}.circles[{k}] has radius {circle[2]}; expected more than 0")
    yaw = math.atan2(goal[1] - start[1], goal[0] - start[0])
    return np.array(start), np.array([*goal, yaw][:3]), np.array(circles).reshape(-1, 3)


@lru_cache(maxsize=4)
def _worlds(path: Path, stamp: int) -> list[Any]:
    """The file's content; the stamp makes an edited file be read again."""
    data = read_json(path)
    if not isinstance(data, list) or not data:
        raise InputError(f"{path}: expected a list of worlds")
    return data


@settings
class Barn:
    """A world of the BARN benchmark: cylinders only, 10 m to go, reach within 1 m, 100 s."""

    path: str = setting(default="", source="JSON: [{world, start, goal, circles}, ...]")
    world: int | None = setting(default=None, source="its number; none: drawn at random")
    margin: float = setting(
        default=1.5, unit="m", source="of the map round cylinders, start and goal", low=0.5
    )

    def sample(self, rng: np.random.Generator) -> Episode:
        """The world asked for, or any.

        Raises:
            InputError: the file cannot be read or is malformed, or has no such world.
        """
        if not self.path:
            raise InputError("Barn.path is not given; expected a JSON file of BARN worlds")
        path = Path(self.path)
        worlds = _worlds(path, path.stat().st_mtime_ns if path.exists() else 0)
        index = int(rng.integers(len(worlds)))
        if self.world is not None:
            named = [w.get("world") if isinstance(w, Mapping) else None for w in worlds]
            if self.world not in named:
                raise InputError(f"{path}: has no world {self.world}; Barn.world must name one")
            index = named.index(self.world)
        start, goal, discs = _world(worlds[index], f"{path}: [{index}]")
        points = np.vstack([discs[:, :2], start[:2], goal[:2]])
        low = np.floor((points.min(axis=0) - self.margin) / CELL) * CELL
        cols, rows = (to_cells(side) for side in points.max(axis=0) + self.margin - low)
        cells = np.zeros((rows, cols), dtype=np.int8)
        paint_discs(cells, discs, low[0], low[1], CELL, OCCUPIED)
        grid = OccupancyGrid(cells, CELL, (low[0], low[1], 0.0))
        name = f"barn_{worlds[index]['world']}"
        return Episode(grid, start, goal, discs=discs, tolerance=1.0, time_limit=100.0, name=name)
