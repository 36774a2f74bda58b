"""Grid maps and scenarios of the MovingAI benchmarks: `.map` of type octile, `.scen`.

A map is text, its top row first: '.' and 'G' are ground, 'S' is swamp, all free; '@' and 'O' are
out of bounds, 'T' trees and 'W' water, all solid. It has no scale: a cell is one metre if not told
(Sturtevant 2012, Benchmarks for grid-based pathfinding).
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from wheelchair_gym.arrays import Array
from wheelchair_gym.errors import InputError
from wheelchair_gym.files import check_cells, is_coordinate, read_text
from wheelchair_gym.maps.grid import FREE, OCCUPIED, OccupancyGrid

_DIGITS: Final = re.compile(r"[1-9][0-9]{0,17}")
PASSABLE: Final = ".GS"
SOLID: Final = "@OTW"


class ScenarioTask(NamedTuple):
    """One line of a scenario, in the frame of the map it names."""

    map: str  # file name
    start: Array  # (2,) m: the centre of its cell
    goal: Array  # (2,) m
    length: float  # m: the shortest way over cells, as published; a path of any angle is no longer
    bucket: int


def _size(line: str, key: str, where: str) -> int:
    words = line.split()
    if len(words) != 2 or words[0] != key or not _DIGITS.fullmatch(words[1]):
        raise InputError(f"{where} is {line.strip()[:40]!r}; expected '{key} N', N at least 1")
    return int(words[1])


def read_moving_ai_map(path: str | Path, resolution: float = 1.0) -> OccupancyGrid:
    """The grid of a `.map` file; its lower-left corner is (0, 0).

    Args:
        path: of the file.
        resolution: side of a cell [m].

    Raises:
        InputError: the file cannot be read, or a line is not what the format says.
    """
    path = Path(path)
    lines = read_text(path).splitlines()
    head = [*lines[:4], *([""] * 4)][:4]
    if head[0].split() != ["type", "octile"]:
        raise InputError(f"{path}: line 1 is {head[0][:40]!r}; expected 'type octile'")
    height = _size(head[1], "height", f"{path}: line 2")
    width = _size(head[2], "width", f"{path}: line 3")
    if head[3].strip() != "map":
        raise InputError(f"{path}: line 4 is {head[3][:40]!r}; expected 'map'")
    check_cells(height, width, str(path))
    rows = [line.rstrip("\r\n") for line in lines[4:]]
    while len(rows) > height and not rows[-1].strip():
        rows.pop()
    if len(rows) != height:
        raise InputError(f"{path}: has {len(rows)} rows; expected height {height}")
    cells = np.empty((height, width), dtype=np.int8)
    for k, row in enumerate(rows):
        if len(row) != width:
            raise InputError(f"{path}: line {k + 5} has {len(row)} cells; expected width {width}")
        for column, sign in enumerate(row if row.strip(PASSABLE + SOLID) else ""):
            if sign not in PASSABLE + SOLID:
                place = f"{path}: line {k + 5}, column {column + 1}"
                raise InputError(f"{place} is {sign!r}; expected one of {PASSABLE + SOLID}")
        letters = np.frombuffer(row.encode("ascii"), dtype=np.uint8)
        solid = np.isin(letters, np.frombuffer(SOLID.encode("ascii"), dtype=np.uint8))
        cells[height - 1 - k] = np.where(solid, OCCUPIED, FREE)
    return OccupancyGrid(cells, resolution)


def read_moving_ai_scenario(path: str | Path, resolution: float = 1.0) -> list[ScenarioTask]:
    """The tasks of a `.scen` file.

    Args:
        path: of the file.
        resolution: side of a cell [m].

    Raises:
        InputError: the file cannot be read, or a line is not what the format says.
    """
    path = Path(path)
    lines = read_text(path).splitlines()
    if not lines or lines[0].split()[:1] != ["version"]:
        first = lines[0][:40] if lines else ""
        raise InputError(f"{path}: line 1 is {first!r}; expected 'version 1'")
    tasks = []
    for k, line in enumerate(lines[1:], start=2):
        if not line.strip():
            continue
        words = line.split("\t") if "\t" in line else line.split()
        try:
            bucket, name, width, height = int(words[0]), words[1], int(words[2]), int(words[3])
            x0, y0, x1, y1 = (int(word) for word in words[4:8])
            length = float(words[8])
        except (ValueError, IndexError, OverflowError):
            expected = "expected bucket, map, width, height, start x y, goal x y, length"
            raise InputError(f"{path}: line {k} is {line[:60]!r}; {expected}") from None
        inside = all(0 <= x < width for x in (x0, x1)) and all(0 <= y < height for y in (y0, y1))
        small = length >= 0.0 and all(map(is_coordinate, (width, height, length)))
        if not inside or not small:
            raise InputError(f"{path}: line {k}: start, goal or length lies outside its map")
        start, goal = (
            resolution * np.array([x + 0.5, height - 0.5 - y]) for x, y in ((x0, y0), (x1, y1))
        )
        tasks.append(ScenarioTask(name, start, goal, resolution * length, bucket))
    return tasks
