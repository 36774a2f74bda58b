"""Rooms, corridors, doors and furniture of one storey, as rectangles of cells.

Corridors run side by side through the building, rooms lie in rows between them, and a lobby (a
home's living room) may close one end: in a home of one corridor, in a clinic of up to two joined
by a cross corridor. Everything is laid out with corridors along x, then perhaps mirrored.
Furniture is placed so that the chair can still pass.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.compiled.kernel import as_int, borrowing_kernel, kernel
from wheelchair_gym.compiled.random import NumpyStream, numpy_integer, numpy_uniform
from wheelchair_gym.geometry.planar import body_to_world
from wheelchair_gym.scenes.arena import read_table
from wheelchair_gym.scenes.raster import CELL, RECT, Rects, cell_count, put, to_cells

Index = NDArray[np.int64]
Flags = NDArray[np.bool_]

OUTER = to_cells(0.20)  # thickness of outer walls
INNER = to_cells(0.10)
JAMB = to_cells(0.15)  # between a door and the corner of its room
ZONE = to_cells(1.30)  # kept clear on both sides of a door
_SECOND_CORRIDOR = to_cells(13.5)  # from this depth of the building on
_ROOM_MIN = to_cells(2.6)
_NOOK = to_cells(2.5)  # width of an open waiting nook, at most


def sides(rects: Rects) -> tuple[Array, Array]:
    """Return the lengths [m] of rectangles along x and along y."""
    return (rects["x1"] - rects["x0"]) * CELL, (rects["y1"] - rects["y0"]) * CELL


def min_side(door_width: tuple[float, float], corridor_width: tuple[float, float]) -> int:
    """Return the side [cells] of a building for two rows of rooms with doors and a corridor."""
    row = to_cells(door_width[1]) + 2 * JAMB
    return 2 * (OUTER + row + INNER) + to_cells(corridor_width[1])


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
def _split(source: NumpyStream, length: int, parts: int, minimum: int, with_door: int) -> Index:
    """Whole numbers that sum to length, uneven by up to a quarter, none below minimum if possible.

    Where one would be below `with_door`, all are even.
    """
    share, total = np.empty(parts), 0.0
    for k in range(parts):
        share[k] = numpy_uniform(source, 0.75, 1.25)
        total += share[k]
    sizes = np.empty(parts, np.int64)
    rest, longest = length, 0
    for k in range(parts):
        sizes[k] = max(int(share[k] / total * length), minimum)
        rest -= sizes[k]
        if sizes[k] > sizes[longest]:
            longest = k
    sizes[longest] += rest
    if sizes[longest] < with_door:
        for k in range(parts):
            sizes[k] = (k + 1) * length // parts - k * length // parts
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
    """Return the floor in front of openings and behind them, which stays free."""
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
    limit = 1 + 3 * (w // cell_count(3.0) + 2)
    rooms, corridors, openings = np.empty(limit, RECT), np.empty(3, RECT), np.empty(3 * limit, RECT)
    along_x, is_door = np.zeros(3 * limit, np.bool_), np.zeros(3 * limit, np.bool_)
    n, d, two = as_int(0), as_int(0), as_int(2)
    lobby = home or numpy_uniform(source, 0.0, 1.0) < 0.6
    if lobby:
        low, high = (4.0, 5.5) if home else (3.0, 4.5)  # m
        deep = cell_count(numpy_uniform(source, low, high))
        n = put(rooms, n, left, outer, left + deep, h - outer)
        left += deep + INNER
    with_door = cell_count(door_width[1]) + 2 * JAMB  # a room that holds a door
    widest = cell_count(corridor_width[1])
    need = 2 * widest + 3 * _ROOM_MIN + 2 * OUTER + 4 * INNER
    count = 1 if home or h < max(_SECOND_CORRIDOR, need) else 2  # of corridors along the building
    depth = h - 2 * OUTER - 2 * count * INNER
    widths = np.empty(count, np.int64)
    for k in range(count):
        widths[k] = cell_count(numpy_uniform(source, corridor_width[0], corridor_width[1]))
        depth -= widths[k]
    row_depths = _split(source, depth, count + 1, _ROOM_MIN, with_door)
    y = y0 = outer
    for k in range(count):
        y += row_depths[k] + INNER
        put(corridors, k, left, y, right, y + widths[k])
        if lobby:
            d = put(openings, d, left - INNER, y, left, y + widths[k])
        y += widths[k] + INNER
    corridor_count, end_1 = count, right
    crosses = count == 2 and (not lobby or numpy_uniform(source, 0.0, 1.0) < 0.5)
    if crosses and right - left - widest >= _ROOM_MIN + INNER:
        across = right - cell_count(numpy_uniform(source, corridor_width[0], corridor_width[1]))
        corridor_count = put(corridors, two, across, corridors[0].y1, right, corridors[1].y0)
        end_1 = across - INNER
    for k in range(count + 1):
        y1 = y0 + row_depths[k]
        end = end_1 if k == 1 else right
        apart = cell_count(numpy_uniform(source, 3.0, 4.8))
        parts = min(int(np.rint((end - left) / apart)), (end - left + INNER) // (with_door + INNER))
        parts = max(1, parts)
        x = left
        sizes = _split(source, end - left - (parts - 1) * INNER, parts, _ROOM_MIN, with_door)
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


_STANCES: Final = ("wall", "free", "round")  # where a piece stands: at a wall, or free in the room
WALL, FREE, ROUND = range(len(_STANCES))
_TABLE: Final = read_table("layout")
_HOME_ROOMS, _LOBBY = 1, 1 + len(_TABLE["HOME_ROOMS"])  # indices of catalogues
_CLINIC_ROOMS = _LOBBY + 1
_HOMES, _CLINICS = len(_TABLE["HOME_ROOMS"]), len(_TABLE["CLINIC_ROOMS"])
_CATALOGUES: Final = (
    _TABLE["LIVING_ROOM"], *_TABLE["HOME_ROOMS"], _TABLE["LOBBY"], *_TABLE["CLINIC_ROOMS"]
)  # fmt: skip
# For kernels: where each catalogue begins, and the pieces of all, one after another.
_BEGIN: Final = np.cumsum([0, *map(len, _CATALOGUES)])
_SIDES: Final = ("along_min", "along_max", "deep_min", "deep_max")  # m
_PIECES: Final = np.array(
    [
        (*sides, _STANCES.index(stance))
        for names in _CATALOGUES
        for *sides, stance in map(_TABLE["PIECES"].get, names)
    ],
    dtype=[*((side, np.float64) for side in _SIDES), ("stance", np.int64)],
)


class Furniture(NamedTuple):
    """The furniture of one floor."""

    rects: Rects  # (k,) upright
    polygons: Array  # (k, 4, 2) [m]: turned rectangles, counter-clockwise
    discs: Array  # (k, 3) [m]: x, y, radius


@borrowing_kernel
def _meet(a: Rects, i: int, b: Rects, j: int, apart: int) -> bool:
    """Return True if two rectangles are less than `apart` cells from each other, in x and in y."""
    return bool(
        a[i].x0 - apart < b[j].x1
        and b[j].x0 < a[i].x1 + apart
        and a[i].y0 - apart < b[j].y1
        and b[j].y0 < a[i].y1 + apart
    )


@borrowing_kernel
def _place_free(source: NumpyStream, room: Rects, half: int, gap: int, box: Rects) -> bool:
    """Place a square of 2 x half cells in the room, a gap from its walls; False: no room."""
    apart = gap + half
    wide, high = room[0].x1 - room[0].x0 - 2 * apart, room[0].y1 - room[0].y0 - 2 * apart
    if wide < 1 or high < 1:
        return False
    x = room[0].x0 + apart + numpy_integer(source, wide)
    y = room[0].y0 + apart + numpy_integer(source, high)
    put(box, as_int(0), x - half, y - half, x + half, y + half)
    return True


@borrowing_kernel
def _place_at_wall(
    source: NumpyStream,
    room: Rects,
    side: int,
    along: int,
    deep: int,
    gap: int,
    neighbour: Rects,
    box: Rects,
) -> bool:
    """Place a piece at a wall (0, 1 along x; 2, 3 along y): in a corner, by another or free."""
    begin, end, low, high = room[0].x0, room[0].x1, room[0].y0, room[0].y1  # along it, across it
    if side > 1:
        begin, end, low, high = low, high, begin, end
    if deep + gap > high - low or along > end - begin:
        return False
    choice = numpy_integer(source, as_int(4))
    if len(neighbour) > 0:
        first, last = neighbour[0].x0, neighbour[0].x1
        if side > 1:
            first, last = neighbour[0].y0, neighbour[0].y1
        x = last if choice % 2 else first - along
        first, last = min(x, first), max(x + along, last)  # of both together
        if first < begin or last > end:
            return False
    else:
        if choice < 2:
            x = begin if choice else end - along
        elif end - begin >= along + 2 * gap:
            x = begin + gap + numpy_integer(source, end - begin - 2 * gap - along + 1)
        else:
            return False
        first, last = x, x + along
    if 0 < first - begin < gap or 0 < end - last < gap:
        return False
    y = low if side % 2 == 0 else high - deep
    if side > 1:
        put(box, as_int(0), y, x, y + deep, x + along)
    else:
        put(box, as_int(0), x, y, x + along, y + deep)
    return True


@kernel
def furnish(
    source: NumpyStream, plan: FloorLayout, home: bool, density: float, passage: float
) -> Furniture:
    """Put furniture into every room; a piece that finds no place is left out.

    A piece stands against a wall or against its neighbour there, without a gap, or at least
    `passage` [m] from everything else: so the rest of the room stays connected and passable at that
    width. The zones of doors are kept clear. `density` is the pieces tried per area [1/m2].
    """
    gap, nil, four = cell_count(passage), as_int(0), as_int(4)
    limit = int(density * plan.width * plan.height * CELL**2) + len(plan.rooms)
    rects, polygons, discs = np.empty(limit, RECT), np.empty((limit, 4, 2)), np.empty((limit, 3))
    n_rects, n_polygons, n_discs = nil, nil, nil
    placed, box, latest = np.empty(limit, RECT), np.empty(1, RECT), np.empty(4, np.int64)
    for r in range(len(plan.rooms)):
        room = plan.rooms[r : r + 1]
        if r == 0 and plan.lobby:
            page = 0 if home else _LOBBY
        elif home:
            page = _HOME_ROOMS + numpy_integer(source, as_int(_HOMES))
        else:
            page = _CLINIC_ROOMS + numpy_integer(source, as_int(_CLINICS))
        count = nil  # placed in this room
        latest[:] = -1  # the last piece on each side
        wide, high = room[0].x1 - room[0].x0, room[0].y1 - room[0].y0
        for _ in range(int(np.rint(density * wide * high * CELL**2))):
            piece = _PIECES[_BEGIN[page] + numpy_integer(source, _BEGIN[page + 1] - _BEGIN[page])]
            along = cell_count(numpy_uniform(source, piece.along_min, piece.along_max))
            deep = cell_count(numpy_uniform(source, piece.deep_min, piece.deep_max))
            for _ in range(4):
                side = numpy_integer(source, four)
                neighbour = latest[side] if piece.stance == WALL else -1
                if piece.stance == WALL:
                    beside = placed[max(neighbour, nil) : neighbour + 1]
                    fits = _place_at_wall(source, room, side, along, deep, gap, beside, box)
                else:
                    across = float(along) if piece.stance == ROUND else math.hypot(along, deep)
                    half = math.ceil(across / 2) + 1
                    fits = _place_free(source, room, half, gap, box)
                for k in range(len(plan.zones)):
                    near = _meet(plan.zones, k, room, nil, nil)
                    fits = fits and not (near and _meet(box, nil, plan.zones, k, nil))
                for k in range(count):
                    fits = fits and (k == neighbour or not _meet(box, nil, placed, k, gap))
                if not fits:
                    continue
                placed[count] = box[0]
                x, y = (box[0].x0 + box[0].x1) / 2 * CELL, (box[0].y0 + box[0].y1) / 2 * CELL
                if piece.stance == WALL:
                    latest[side] = count
                    rects[n_rects] = box[0]
                    n_rects += 1
                elif piece.stance == ROUND:
                    discs[n_discs] = x, y, along / 2 * CELL
                    n_discs += 1
                else:
                    yaw = numpy_uniform(source, 0.0, math.pi)
                    c, s = math.cos(yaw), math.sin(yaw)
                    for k in range(4):  # corners, counter-clockwise
                        forth = along * CELL / 2 * (1.0 if k in (1, 2) else -1.0)
                        left = deep * CELL / 2 * (1.0 if k > 1 else -1.0)
                        dx, dy = body_to_world(c, s, forth, left)
                        polygons[n_polygons, k] = dx + x, dy + y
                    n_polygons += 1
                count += 1
                break
    return Furniture(rects[:n_rects], polygons[:n_polygons], discs[:n_discs])
