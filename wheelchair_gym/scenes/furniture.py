"""Places furniture in rooms so that the chair can still pass."""

from __future__ import annotations

import math
from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.compiled.kernel import as_int, borrowing_kernel
from wheelchair_gym.random import NumpyStream, numpy_integer, numpy_uniform
from wheelchair_gym.scenes.layout import FloorLayout, put
from wheelchair_gym.scenes.raster import CELL, cell_count

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class Piece(NamedTuple):
    """A kind of furniture: its extent along the wall and away from it [m], and its stance."""

    name: str
    along: tuple[float, float]  # m, from, to; of a round piece its diameter
    deep: tuple[float, float]
    stance: Literal["wall", "free", "round"] = "wall"


Catalogue = tuple[Piece, ...]

BED = Piece("bed", (0.9, 1.6), (2.0, 2.1))
TABLE = Piece("table", (1.2, 1.8), (0.75, 0.9), "free")
ROUND_TABLE = Piece("round table", (0.8, 1.2), (0.0, 0.0), "round")
COLUMN = Piece("column", (0.3, 0.5), (0.0, 0.0), "round")
DESK = Piece("desk", (1.2, 1.6), (0.6, 0.8))
SHELF = Piece("shelf", (0.8, 1.8), (0.3, 0.45))
WARDROBE = Piece("wardrobe", (1.0, 2.0), (0.55, 0.65))

LIVING_ROOM: Catalogue = (
    Piece("sofa", (1.6, 2.3), (0.85, 0.95)),
    Piece("armchair", (0.8, 0.9), (0.8, 0.9), "free"),
    SHELF,
    TABLE,
    ROUND_TABLE,
    Piece("kitchen unit", (1.8, 3.0), (0.6, 0.65)),
)
HOME_ROOMS: tuple[Catalogue, ...] = (
    (BED, WARDROBE, Piece("bedside table", (0.45, 0.5), (0.4, 0.45)), DESK),
    (Piece("kitchen unit", (1.8, 3.0), (0.6, 0.65)), SHELF, ROUND_TABLE, TABLE),
    (Piece("bath", (1.6, 1.7), (0.7, 0.8)), Piece("basin", (0.6, 0.9), (0.5, 0.5)), SHELF),
    (DESK, SHELF, Piece("armchair", (0.8, 0.9), (0.8, 0.9), "free"), SHELF),
)
LOBBY: Catalogue = (
    Piece("row of chairs", (1.65, 2.75), (0.55, 0.6)),
    Piece("counter", (2.0, 3.0), (0.7, 0.9)),
    COLUMN,
    ROUND_TABLE,
    Piece("bench", (1.2, 1.6), (0.45, 0.5), "free"),
)
CLINIC_ROOMS: tuple[Catalogue, ...] = (
    (BED, BED, Piece("cabinet", (0.5, 0.6), (0.45, 0.5)), WARDROBE),
    (
        DESK,
        Piece("couch", (0.65, 0.75), (1.85, 1.95)),
        Piece("sink", (0.6, 0.8), (0.5, 0.55)),
        SHELF,
    ),
    (TABLE, SHELF, DESK, Piece("row of chairs", (1.1, 2.2), (0.55, 0.6))),
)


_BOOK: Final = (LIVING_ROOM, *HOME_ROOMS, LOBBY, *CLINIC_ROOMS)
_PIECES: Final = [piece for catalogue in _BOOK for piece in catalogue]
# For kernels: where each catalogue of the book begins, and the pieces of all, one after another.
_BEGIN: Final = np.cumsum([0, *map(len, _BOOK)])
_EXTENT: Final = np.array([(*piece.along, *piece.deep) for piece in _PIECES])
_STANCE: Final = np.array([("wall", "free", "round").index(piece.stance) for piece in _PIECES])
_HOME_ROOMS, _LOBBY = 1, 1 + len(HOME_ROOMS)  # places in the book
_CLINIC_ROOMS = _LOBBY + 1
_HOMES, _CLINICS = len(HOME_ROOMS), len(CLINIC_ROOMS)


class Furniture(NamedTuple):
    """The furniture of one floor."""

    rects: Index  # (k, 4) upright, whole cells: x0, y0, x1, y1
    polygons: Array  # (k, 4, 2) [m]: turned rectangles, counter-clockwise
    discs: Array  # (k, 3) [m]: x, y, radius


@borrowing_kernel
def _meet(a: Index, i: int, b: Index, j: int, apart: int) -> bool:
    """Whether two rectangles are less than `apart` cells from each other, in both directions."""
    return bool(
        a[i, 0] - apart < b[j, 2]
        and b[j, 0] < a[i, 2] + apart
        and a[i, 1] - apart < b[j, 3]
        and b[j, 1] < a[i, 3] + apart
    )


@borrowing_kernel
def _free(source: NumpyStream, room: Index, half: int, gap: int, box: Index) -> bool:
    """A square of 2 x half cells somewhere in the room, a gap from its walls; if there is room."""
    apart = gap + half
    wide, high = room[0, 2] - room[0, 0] - 2 * apart, room[0, 3] - room[0, 1] - 2 * apart
    if wide < 1 or high < 1:
        return False
    x = room[0, 0] + apart + numpy_integer(source, wide)
    y = room[0, 1] + apart + numpy_integer(source, high)
    put(box, as_int(0), x - half, y - half, x + half, y + half)
    return True


@borrowing_kernel
def _against(
    source: NumpyStream,
    room: Index,
    side: int,
    along: int,
    deep: int,
    gap: int,
    placed: Index,
    neighbour: int,
    box: Index,
) -> bool:
    """A place along one wall (0 and 1 along x, 2 and 3 along y): a corner, a neighbour or free."""
    a = 1 if side > 1 else 0  # the axis along the wall
    floor_0, floor_1 = room[0, a], room[0, 2 + a]
    deep_0, deep_1 = room[0, 1 - a], room[0, 3 - a]
    if deep + gap > deep_1 - deep_0 or along > floor_1 - floor_0:
        return False
    choice = numpy_integer(source, as_int(4))
    if neighbour >= 0:
        x = placed[neighbour, 2 + a] if choice % 2 else placed[neighbour, a] - along
    elif choice < 2:
        x = floor_0 if choice else floor_1 - along
    elif floor_1 - floor_0 >= along + 2 * gap:
        x = floor_0 + gap + numpy_integer(source, floor_1 - floor_0 - 2 * gap - along + 1)
    else:
        return False
    first, last = x, x + along  # with its neighbour
    if neighbour >= 0:
        first = min(x, placed[neighbour, a])
        last = max(x + along, placed[neighbour, 2 + a])
        if first < floor_0 or last > floor_1:
            return False
    if 0 < first - floor_0 < gap or 0 < floor_1 - last < gap:
        return False
    y = deep_0 if side % 2 == 0 else deep_1 - deep
    if a:
        put(box, as_int(0), y, x, y + deep, x + along)
    else:
        put(box, as_int(0), x, y, x + along, y + deep)
    return True


def furnish(
    source: NumpyStream, plan: FloorLayout, home: bool, density: float, passage: float
) -> Furniture:
    """Put furniture into every room; a piece that finds no place is left out.

    A piece stands against a wall or against its neighbour there, without a gap, or at least
    `passage` [m] from everything else: so whatever is left of the room hangs together, and is
    passable at that width.

    Args:
        source: every draw comes from it.
        plan: its rooms are furnished; the zones of its doors are kept clear.
        home: whose rooms are a home's; else a clinic's.
        density: pieces tried per area of room [1/m2].
        passage: clear width round everything [m].
    """
    most = int(density * plan.width * plan.height * CELL**2) + len(plan.rooms)
    rects, polygons = np.empty((most, 4), np.int64), np.empty((most, 4, 2))
    discs, placed = np.empty((most, 3)), np.empty((most, 4), np.int64)
    box, against = np.empty((1, 4), np.int64), np.empty(4, np.int64)
    tally = _place(
        source, plan, home, density, passage, placed, box, against, rects, polygons, discs
    )
    return Furniture(rects[: tally[0]], polygons[: tally[1]], discs[: tally[2]])


@borrowing_kernel
def _place(
    source: NumpyStream,
    plan: FloorLayout,
    home: bool,
    density: float,
    passage: float,
    placed: Index,
    box: Index,
    against: Index,
    rects: Index,
    polygons: Array,
    discs: Array,
) -> tuple[int, int, int]:
    """Write the pieces that find a place; how many there are of each shape."""
    gap, nil, four = cell_count(passage), as_int(0), as_int(4)
    n_rects, n_polygons, n_discs = nil, nil, nil
    for r in range(len(plan.rooms)):
        room = plan.rooms[r : r + 1]
        if r == 0 and plan.lobby:
            page = 0 if home else _LOBBY
        elif home:
            page = _HOME_ROOMS + numpy_integer(source, as_int(_HOMES))
        else:
            page = _CLINIC_ROOMS + numpy_integer(source, as_int(_CLINICS))
        count = nil  # placed in this room
        for k in range(4):
            against[k] = -1  # the last piece on each side
        wide, high = room[0, 2] - room[0, 0], room[0, 3] - room[0, 1]
        for _ in range(int(np.rint(density * wide * high * CELL**2))):
            piece = _BEGIN[page] + numpy_integer(source, _BEGIN[page + 1] - _BEGIN[page])
            along = cell_count(numpy_uniform(source, _EXTENT[piece, 0], _EXTENT[piece, 1]))
            deep = cell_count(numpy_uniform(source, _EXTENT[piece, 2], _EXTENT[piece, 3]))
            at_wall, is_round = _STANCE[piece] == 0, _STANCE[piece] == 2
            for _ in range(4):
                side = numpy_integer(source, four)
                neighbour = against[side] if at_wall else -1
                if at_wall:
                    fits = _against(source, room, side, along, deep, gap, placed, neighbour, box)
                else:
                    across = float(along) if is_round else math.hypot(along, deep)
                    half = math.ceil(across / 2) + 1
                    fits = _free(source, room, half, gap, box)
                for k in range(len(plan.zones)):
                    near = _meet(plan.zones, k, room, nil, nil)
                    fits = fits and not (near and _meet(box, nil, plan.zones, k, nil))
                for k in range(count):
                    fits = fits and (k == neighbour or not _meet(box, nil, placed, k, gap))
                if not fits:
                    continue
                x0, y0, x1, y1 = box[0, 0], box[0, 1], box[0, 2], box[0, 3]
                put(placed, count, x0, y0, x1, y1)
                x, y = (x0 + x1) / 2 * CELL, (y0 + y1) / 2 * CELL
                if at_wall:
                    against[side] = count
                    n_rects = put(rects, n_rects, x0, y0, x1, y1)
                elif is_round:
                    discs[n_discs, 0], discs[n_discs, 1] = x, y
                    discs[n_discs, 2] = along / 2 * CELL
                    n_discs += 1
                else:
                    yaw = numpy_uniform(source, 0.0, math.pi)
                    c, s = math.cos(yaw), math.sin(yaw)
                    for k in range(4):  # corners, counter-clockwise
                        forth = along * CELL / 2 * (1.0 if k in (1, 2) else -1.0)
                        left = deep * CELL / 2 * (1.0 if k > 1 else -1.0)
                        polygons[n_polygons, k, 0] = c * forth - s * left + x
                        polygons[n_polygons, k, 1] = s * forth + c * left + y
                    n_polygons += 1
                count += 1
                break
    return n_rects, n_polygons, n_discs
