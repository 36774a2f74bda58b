"""Rooms, corridors and doors of one storey, as rectangles of cells.

Corridors run side by side through the building, rooms lie in rows between them, and a lobby (a
home's living room) may close one end: in a home of one corridor, in a clinic of up to two joined
by a cross corridor. Everything is laid out with corridors along x, then perhaps mirrored.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.compiled.kernel import as_int, borrowing_kernel, kernel
from wheelchair_gym.random import NumpyStream, numpy_integer, numpy_uniform
from wheelchair_gym.scenes.raster import CELL, Rect, cell_count, to_cells

Index = NDArray[np.int64]
Flags = NDArray[np.bool_]

OUTER = to_cells(0.20)  # thickness of outer walls
INNER = to_cells(0.10)
JAMB = to_cells(0.15)  # between a door and the corner of its room
ZONE = to_cells(1.30)  # kept clear on both sides of a door
_SECOND_CORRIDOR = to_cells(13.5)  # from this depth of the building on
_ROOM_LEAST = to_cells(2.6)
_NOOK = to_cells(2.5)  # width of an open waiting nook, at most


class Door(NamedTuple):
    """An opening through a wall; leaf: a real door, and not the open end of a corridor."""

    opening: Rect
    along_x: bool  # the wall runs along x
    leaf: bool
    zone: Rect  # what furniture keeps clear of, on both sides

    @property
    def width(self) -> float:
        """Clear width [m]."""
        return (self.opening.width if self.along_x else self.opening.height) * CELL


class FloorLayout(NamedTuple):
    """One storey before it is furnished; rectangles (n, 4) of cells: x0, y0, x1, y1."""

    width: int  # cells
    height: int
    lobby: bool  # then it is the first room
    rooms: Index
    halls: Index
    openings: Index
    along_x: Flags  # of openings: whether the wall runs along x
    leaf: Flags  # of openings: real doors
    zones: Index  # of openings: what furniture keeps clear of, on both sides


class Building:
    """The plan of a storey in words."""

    def __init__(self, plan: FloorLayout) -> None:
        self.rooms = [Rect(*map(int, rect)) for rect in plan.rooms]  # the lobby is the first
        self.lobby = bool(plan.lobby)
        self.corridors = [Rect(*map(int, rect)) for rect in plan.halls]
        self.doors = [
            Door(Rect(*map(int, rect)), bool(along_x), bool(leaf), Rect(*map(int, zone)))
            for rect, along_x, leaf, zone in zip(
                plan.openings, plan.along_x, plan.leaf, plan.zones, strict=True
            )
        ]

    @property
    def corridor_widths(self) -> list[float]:
        """Of each corridor [m]."""
        return [min(rect.width, rect.height) * CELL for rect in self.corridors]


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
def put(rects: Index, k: int, x0: int, y0: int, x1: int, y1: int) -> int:
    """Write a rectangle; the number of the next."""
    rects[k, 0], rects[k, 1], rects[k, 2], rects[k, 3] = x0, y0, x1, y1
    return k + 1


@borrowing_kernel
def _mirror(rects: Index, width: int, height: int, swap: int, flip_x: int, flip_y: int) -> None:
    """Flip rectangles within a building, then swap x and y."""
    for k in range(len(rects)):
        x0, y0, x1, y1 = rects[k, 0], rects[k, 1], rects[k, 2], rects[k, 3]
        if flip_x:
            x0, x1 = width - x1, width - x0
        if flip_y:
            y0, y1 = height - y1, height - y0
        if swap:
            x0, y0, x1, y1 = y0, x0, y1, x1
        put(rects, k, x0, y0, x1, y1)


@kernel
def generate_layout(
    source: NumpyStream,
    home: bool,
    width: float,
    height: float,
    doors: tuple[float, float],
    corridors: tuple[float, float],
) -> FloorLayout:
    """Draw rooms, corridors and doors."""
    w, h = cell_count(width), cell_count(height)
    outer = as_int(OUTER)
    left, right = outer, w - outer
    most = 1 + 3 * (w // cell_count(3.0) + 2)
    rooms, halls = np.empty((most, 4), np.int64), np.empty((3, 4), np.int64)
    openings = np.empty((3 * most, 4), np.int64)
    along_x, leaf = np.zeros(3 * most, np.bool_), np.zeros(3 * most, np.bool_)
    n, d, two = as_int(0), as_int(0), as_int(2)
    lobby = home or numpy_uniform(source, 0.0, 1.0) < 0.6
    if lobby:
        deep = numpy_uniform(source, 4.0, 5.5) if home else numpy_uniform(source, 3.0, 4.5)
        n = put(rooms, n, left, outer, left + cell_count(deep), h - outer)
        left += cell_count(deep) + INNER
    spines = 1 if home or h < _SECOND_CORRIDOR else 2
    depth = h - 2 * OUTER - 2 * spines * INNER
    for k in range(spines):
        halls[k, 3] = cell_count(numpy_uniform(source, corridors[0], corridors[1]))
        depth -= halls[k, 3]
    rows = _split(source, depth, spines + 1, _ROOM_LEAST)
    y = outer
    for k in range(spines):
        y += rows[k] + INNER
        put(halls, k, left, y, right, y + halls[k, 3])
        y = halls[k, 3] + INNER
        if lobby:
            d = put(openings, d, left - INNER, halls[k, 1], left, halls[k, 3])
    corridor_count, end_1 = spines, right
    if spines == 2 and (not lobby or numpy_uniform(source, 0.0, 1.0) < 0.5):
        across = right - cell_count(numpy_uniform(source, corridors[0], corridors[1]))
        corridor_count = put(halls, two, across, halls[0, 3], right, halls[1, 1])
        end_1 = across - INNER
    y0 = outer
    for k in range(spines + 1):
        y1 = y0 + rows[k]
        end = end_1 if k == 1 else right
        apart = cell_count(numpy_uniform(source, 3.0, 4.8))
        parts = max(1, int(np.rint((end - left) / apart)))
        x = left
        sizes = _split(source, end - left - (parts - 1) * INNER, parts, _ROOM_LEAST)
        for number in range(parts):
            size = sizes[number]
            n = put(rooms, n, x, y0, x + size, y1)
            # Towards the corridor below, the one above, or both.
            first, last = (0 if k > 0 else 1), (1 if k < spines else 0)
            if first < last and numpy_uniform(source, 0.0, 1.0) >= 0.3:
                first = last = numpy_integer(source, two)
            for side in range(first, last + 1):
                wide = cell_count(numpy_uniform(source, doors[0], doors[1]))
                nook = not home and numpy_uniform(source, 0.0, 1.0) < 0.1
                if nook:  # a waiting nook stands open
                    wide = max(wide, min(size - 2 * JAMB, _NOOK))
                at = x + JAMB + numpy_integer(source, size - 2 * JAMB - wide + 1)
                along_x[d], leaf[d] = True, not nook
                wall = y1 if side else y0 - INNER
                d = put(openings, d, at, wall, at + wide, wall + INNER)
            if (number > 0 or lobby) and numpy_uniform(source, 0.0, 1.0) < (0.25 if home else 0.08):
                wide = cell_count(numpy_uniform(source, doors[0], doors[1]))  # from room to room
                at = y0 + JAMB + numpy_integer(source, y1 - y0 - 2 * JAMB - wide + 1)
                leaf[d] = True
                d = put(openings, d, x - INNER, at, x, at + wide)
            x += size + INNER
        if k < spines:
            y0 = halls[k, 3] + INNER
    rooms, halls, openings = rooms[:n], halls[:corridor_count], openings[:d]
    zones = np.empty((d, 4), np.int64)
    for k in range(d):
        x0, low, x1, high = openings[k, 0], openings[k, 1], openings[k, 2], openings[k, 3]
        if along_x[k]:
            wide = max(0, ZONE - (x1 - x0) + 1) // 2
            put(zones, k, x0 - wide, low - ZONE, x1 + wide, high + ZONE)
        else:
            wide = max(0, ZONE - (high - low) + 1) // 2
            put(zones, k, x0 - ZONE, low - wide, x1 + ZONE, high + wide)
    swap, flip_x, flip_y = (
        numpy_integer(source, two),
        numpy_integer(source, two),
        numpy_integer(source, two),
    )
    _mirror(rooms, w, h, swap, flip_x, flip_y)
    _mirror(halls, w, h, swap, flip_x, flip_y)
    _mirror(openings, w, h, swap, flip_x, flip_y)
    _mirror(zones, w, h, swap, flip_x, flip_y)
    if swap:
        w, h = h, w
        for k in range(d):
            along_x[k] = not along_x[k]
    return FloorLayout(w, h, lobby, rooms, halls, openings, along_x[:d], leaf[:d], zones)
