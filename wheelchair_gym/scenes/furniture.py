"""Furniture: what stands where in a room, so that a chair still gets round everything."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.scenes.raster import CELL, Rect, to_cells, turned_rectangle

Array = NDArray[np.float64]


class Piece(NamedTuple):
    """A kind of furniture: its extent along the wall and away from it [m], and how it stands."""

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


@dataclass
class Furniture:
    """What has been put into one storey so far."""

    rects: list[Rect] = field(default_factory=list)  # upright, on whole cells
    polygons: list[Array] = field(default_factory=list)  # (4, 2) [m], turned
    discs: list[tuple[float, float, float]] = field(default_factory=list)  # x, y, radius [m]


def furnish(
    rng: np.random.Generator,
    room: Rect,
    zones: list[Rect],
    catalogue: Catalogue,
    count: int,
    passage: float,
    out: Furniture,
) -> None:
    """Put up to `count` pieces into a room; one that finds no place is left out.

    A piece stands against a wall or against its neighbour there, without a gap, or at least
    `passage` [m] from everything else: so whatever is left of the room hangs together, and is
    passable at that width.

    Args:
        rng: every draw comes from it.
        room: its floor.
        zones: to keep clear, such as those of doors.
        catalogue: pieces to choose from.
        count: how many.
        passage: clear width round everything [m].
        out: receives the pieces.
    """
    gap = to_cells(passage)
    placed: list[Rect] = []
    against: dict[int, Rect] = {}  # the last piece on each side
    for _ in range(count):
        piece = catalogue[int(rng.integers(len(catalogue)))]
        along, deep = to_cells(rng.uniform(*piece.along)), to_cells(rng.uniform(*piece.deep))
        for _ in range(4):
            side = int(rng.integers(4))
            neighbour = against.get(side) if piece.stance == "wall" else None
            if piece.stance == "wall":
                box = _against(rng, room, side, along, deep, gap, neighbour)
            else:
                half = math.ceil(
                    (along if piece.stance == "round" else math.hypot(along, deep)) / 2
                )
                box = _free(rng, room, half + 1, gap)
            if box is None or any(box.meets(zone) for zone in zones):
                continue
            wide = box.grown(gap)
            if any(wide.meets(other) for other in placed if other is not neighbour):
                continue
            placed.append(box)
            if piece.stance == "wall":
                against[side] = box
                out.rects.append(box)
                break
            x, y = (box.x0 + box.x1) / 2 * CELL, (box.y0 + box.y1) / 2 * CELL
            if piece.stance == "round":
                out.discs.append((x, y, along / 2 * CELL))
            else:
                yaw = rng.uniform(0.0, math.pi)
                out.polygons.append(turned_rectangle(x, y, along * CELL, deep * CELL, yaw))
            break


def _free(rng: np.random.Generator, room: Rect, half: int, gap: int) -> Rect | None:
    """A square of 2 x half cells somewhere in the room, a gap from its walls."""
    inner = room.grown(-gap - half)
    if inner.width < 1 or inner.height < 1:
        return None
    x, y = int(rng.integers(inner.x0, inner.x1)), int(rng.integers(inner.y0, inner.y1))
    return Rect(x - half, y - half, x + half, y + half)


def _against(
    rng: np.random.Generator,
    room: Rect,
    side: int,
    along: int,
    deep: int,
    gap: int,
    neighbour: Rect | None,
) -> Rect | None:
    """A place along one wall (0 and 1 along x, 2 and 3 along y): a corner, a neighbour or free."""
    upright = side > 1
    floor = room.swapped() if upright else room
    if deep + gap > floor.height or along > floor.width:
        return None
    choice = int(rng.integers(4))
    if neighbour is not None:
        other = neighbour.swapped() if upright else neighbour
        x = other.x1 if choice % 2 else other.x0 - along
    elif choice < 2:
        x = floor.x0 if choice else floor.x1 - along
    elif floor.width >= along + 2 * gap:
        x = int(rng.integers(floor.x0 + gap, floor.x1 - gap - along + 1))
    else:
        return None
    if any(0 < rest < gap for rest in (x - floor.x0, floor.x1 - x - along)) and neighbour is None:
        return None
    if neighbour is not None:
        joined = min(x, other.x0), max(x + along, other.x1)
        if joined[0] < floor.x0 or joined[1] > floor.x1:
            return None
        if any(0 < rest < gap for rest in (joined[0] - floor.x0, floor.x1 - joined[1])):
            return None
    y = floor.y0 if side % 2 == 0 else floor.y1 - deep
    box = Rect(x, y, x + along, y + deep)
    return box.swapped() if upright else box
