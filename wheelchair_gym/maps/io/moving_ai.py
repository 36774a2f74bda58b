"""Grid maps of the MovingAI benchmarks: `.map` of type octile.

A map is text, its top row first: '.' and 'G' are ground, 'S' is swamp, all free; '@' and 'O' are
out of bounds, 'T' trees and 'W' water, all solid. It has no scale: a cell is one metre if not told
(Sturtevant 2012, Benchmarks for grid-based pathfinding).
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

import numpy as np

from wheelchair_gym.base.errors import InputError
from wheelchair_gym.base.files import check_cells, read_text
from wheelchair_gym.maps.grid import FREE, OCCUPIED, OccupancyGrid

_DIGITS: Final = re.compile(r"[1-9][0-9]{0,17}")
PASSABLE: Final = ".GS"
SOLID: Final = "@OTW"


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
