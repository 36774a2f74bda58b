"""Rooms, corridors and doors of one storey, as rectangles of cells.

Corridors run side by side through the building, rooms lie in rows between them, and a lobby (a
home's living room) may close one end: in a home of one corridor, in a clinic of up to two joined
by a cross corridor. Everything is laid out with corridors along x, then perhaps mirrored.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.arrays import Array
from wheelchair_gym.compiled.kernel import as_int, borrowing_kernel, kernel
from wheelchair_gym.random import NumpyStream, numpy_integer, numpy_uniform
from wheelchair_gym.scenes.raster import CELL, RECT, Rects, cell_count, put, to_cells

Index = NDArray[np.int64]
Flags = NDArray[np.bool_]

OUTER = to_cells(0.20)  # thickness of outer walls
INNER = to_cells(0.10)
JAMB = to_cells(0.15)  # between a door and the corner of its room
ZONE = to_cells(1.30)  # kept clear on both sides of a door
_SECOND_CORRIDOR = to_cells(13.5)  # from this depth of the building on
_ROOM_LEAST = to_cells(2.6)
_NOOK = to_cells(2.5)  # width of an open waiting nook, at most


def sides(rects: Rects) -> tuple[Array, Array]:
    """Lengths [m] of rectangles along x and along y."""
    return (rects["x1"] - rects["x0"]) * CELL, (rects["y1"] - rects["y0"]) * CELL


class FloorLayout(NamedTuple):
    """One storey before it is furnished: rectangles of cells, see `raster.RECT`."""

    width: int  # cells
    height: int
    lobby: bool  # then it is the first room
    rooms: Rects
    corridors: Rects
    openings: Rects  # through walls
    along_x: Flags  # of openings: whether the wall runs along x
    is_door: Flags  # of openings: a real door, not the open end of a corridor
    zones: Rects  # of openings: what furniture keeps clear of, on both sides

    @property
    def opening_widths(self) -> Array:
        """Clear width [m] of each opening."""
        along, across = sides(self.openings)
        return np.where(self.along_x, along, across)

    @property
    def corridor_widths(self) -> Array:
        """Clear width [m] of each corridor."""
        return np.minimum(*sides(self.corridors))


@kernel
def _split(source: NumpyStream, length: int, parts: int, least: int) -> Index:
    """Whole numbers that sum to length, uneven by up to a quarter, none below least if possible."""
    share, total = np.empty(parts), 0.0
    for k in range(parts):
        share[k] = numpy_uniform(source, 0.75, 1.25)
        total += share[k]
    sizes = np.empty(parts, np.int64)
    rest, most = length, 0
    for k in range(parts):
        sizes[k] = max(int(share[k] / total * length), least)
        rest -= sizes[k]
        if sizes[k] > sizes[most]:
            most = k
    sizes[most] += rest
    return sizes


@borrowing_kernel
def _mirror(rects: Rects, width: int, height: int, swap: int, flip_x: int, flip_y: int) -> None:
    """Flip rectangles within a building, then swap x and y."""
    for k in range(len(rects)):
        x0, y0, x1, y1 = rects[k].x0, rects[k].y0, rects[k].x1, rects[k].y1
        if flip_x:
            x0, x1 = width - x1, width - x0
        if flip_y:
            y0, y1 = height - y1, height - y0
        if swap:
            x0, y0, x1, y1 = y0, x0, y1, x1
        put(rects, k, x0, y0, x1, y1)


@borrowing_kernel
def _doors_of_room(source: NumpyStream, below: bool, above: bool) -> tuple[int, int]:
    """Draw the first and the last side with a door: 0 towards a corridor below, 1 above."""
    first, last = (0 if below else 1), (1 if above else 0)
    if first < last and numpy_uniform(source, 0.0, 1.0) >= 0.3:
        first = last = numpy_integer(source, as_int(2))
    return first, last


@kernel
def _zones(openings: Rects, along_x: Flags) -> Rects:
    """The floor in front of openings and behind them, which stays free."""
    zones = np.empty(len(openings), RECT)
    for k in range(len(openings)):
        x0, y0, x1, y1 = openings[k].x0, openings[k].y0, openings[k].x1, openings[k].y1
        if along_x[k]:
            wide = max(0, ZONE - (x1 - x0) + 1) // 2
            put(zones, k, x0 - wide, y0 - ZONE, x1 + wide, y1 + ZONE)
        else:
            wide = max(0, ZONE - (y1 - y0) + 1) // 2
            put(zones, k, x0 - ZONE, y0 - wide, x1 + ZONE, y1 + wide)
    return zones


@kernel
def generate_layout(
    source: NumpyStream,
    home: bool,
    width: float,
    height: float,
    door_width: tuple[float, float],
    corridor_width: tuple[float, float],
) -> FloorLayout:
    """Draw rooms, corridors and doors."""
    w, h = cell_count(width), cell_count(height)
    outer = as_int(OUTER)
    left, right = outer, w - outer
    most = 1 + 3 * (w // cell_count(3.0) + 2)
    rooms, corridors, openings = np.empty(most, RECT), np.empty(3, RECT), np.empty(3 * most, RECT)
    along_x, is_door = np.zeros(3 * most, np.bool_), np.zeros(3 * most, np.bool_)
    n, d, two = as_int(0), as_int(0), as_int(2)
    lobby = home or numpy_uniform(source, 0.0, 1.0) < 0.6
    if lobby:
        low, high = (4.0, 5.5) if home else (3.0, 4.5)  # m
        deep = cell_count(numpy_uniform(source, low, high))
        n = put(rooms, n, left, outer, left + deep, h - outer)
        left += deep + INNER
    count = 1 if home or h < _SECOND_CORRIDOR else 2  # of corridors along the building
    depth = h - 2 * OUTER - 2 * count * INNER
    widths = np.empty(count, np.int64)
    for k in range(count):
        widths[k] = cell_count(numpy_uniform(source, corridor_width[0], corridor_width[1]))
        depth -= widths[k]
    row_depths = _split(source, depth, count + 1, _ROOM_LEAST)
    y = y0 = outer
    for k in range(count):
        y += row_depths[k] + INNER
        put(corridors, k, left, y, right, y + widths[k])
        if lobby:
            d = put(openings, d, left - INNER, y, left, y + widths[k])
        y += widths[k] + INNER
    corridor_count, end_1 = count, right
    if count == 2 and (not lobby or numpy_uniform(source, 0.0, 1.0) < 0.5):
        across = right - cell_count(numpy_uniform(source, corridor_width[0], corridor_width[1]))
        corridor_count = put(corridors, two, across, corridors[0].y1, right, corridors[1].y0)
        end_1 = across - INNER
    for k in range(count + 1):
        y1 = y0 + row_depths[k]
        end = end_1 if k == 1 else right
        apart = cell_count(numpy_uniform(source, 3.0, 4.8))
        parts = max(1, int(np.rint((end - left) / apart)))
        x = left
        sizes = _split(source, end - left - (parts - 1) * INNER, parts, _ROOM_LEAST)
        for number in range(parts):
            size = sizes[number]
            n = put(rooms, n, x, y0, x + size, y1)
            first, last = _doors_of_room(source, k > 0, k < count)
            for side in range(first, last + 1):
                wide = cell_count(numpy_uniform(source, door_width[0], door_width[1]))
                nook = not home and numpy_uniform(source, 0.0, 1.0) < 0.1
                if nook:  # a waiting nook stands open
                    wide = max(wide, min(size - 2 * JAMB, _NOOK))
                at = x + JAMB + numpy_integer(source, size - 2 * JAMB - wide + 1)
                along_x[d], is_door[d] = True, not nook
                wall = y1 if side else y0 - INNER
                d = put(openings, d, at, wall, at + wide, wall + INNER)
            if (number > 0 or lobby) and numpy_uniform(source, 0.0, 1.0) < (0.25 if home else 0.08):
                # From room to room.
                wide = cell_count(numpy_uniform(source, door_width[0], door_width[1]))
                at = y0 + JAMB + numpy_integer(source, y1 - y0 - 2 * JAMB - wide + 1)
                is_door[d] = True
                d = put(openings, d, x - INNER, at, x, at + wide)
            x += size + INNER
        if k < count:
            y0 = corridors[k].y1 + INNER
    rooms, corridors, openings = rooms[:n], corridors[:corridor_count], openings[:d]
    zones = _zones(openings, along_x)
    swap, flip_x = numpy_integer(source, two), numpy_integer(source, two)
    flip_y = numpy_integer(source, two)
    for rects in (rooms, corridors, openings, zones):
        _mirror(rects, w, h, swap, flip_x, flip_y)
    if swap:
        w, h = h, w
        along_x = ~along_x
    return FloorLayout(w, h, lobby, rooms, corridors, openings, along_x[:d], is_door[:d], zones)
