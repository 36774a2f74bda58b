"""Rooms, corridors and doors of one storey, as rectangles of cells.

Corridors run side by side through the building, rooms lie in rows between them, and a lobby (a
home's living room) may close one end: in a home of one corridor, in a clinic of up to two joined
by a cross corridor. Everything is laid out with corridors along x, then perhaps mirrored.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from wheelchair_gym.scenes.raster import CELL, Rect, to_cells

OUTER = to_cells(0.20)  # thickness of outer walls
INNER = to_cells(0.10)
JAMB = to_cells(0.15)  # between a door and the corner of its room
ZONE = to_cells(1.30)  # kept clear on both sides of a door
_SECOND_CORRIDOR = to_cells(13.5)  # from this depth of the building on
_ROOM_LEAST = to_cells(2.6)


class Door(NamedTuple):
    """An opening through a wall; leaf: a real door, and not the open end of a corridor."""

    opening: Rect
    along_x: bool  # the wall runs along x
    leaf: bool = True

    @property
    def width(self) -> float:
        """Clear width [m]."""
        return (self.opening.width if self.along_x else self.opening.height) * CELL

    @property
    def zone(self) -> Rect:
        """What furniture keeps clear of, on both sides."""
        x0, y0, x1, y1 = self.opening
        wide = max(0, ZONE - (x1 - x0 if self.along_x else y1 - y0) + 1) // 2
        if self.along_x:
            return Rect(x0 - wide, y0 - ZONE, x1 + wide, y1 + ZONE)
        return Rect(x0 - ZONE, y0 - wide, x1 + ZONE, y1 + wide)


@dataclass(frozen=True)
class Layout:
    """One storey before it is furnished."""

    width: int  # cells
    height: int
    rooms: tuple[Rect, ...]  # the lobby, if there is one, is the first
    lobby: bool
    corridors: tuple[Rect, ...]
    doors: tuple[Door, ...]

    @property
    def corridor_widths(self) -> list[float]:
        """Of each corridor [m]."""
        return [min(rect.width, rect.height) * CELL for rect in self.corridors]

    def solid(self) -> np.ndarray[tuple[int, int], np.dtype[np.int8]]:
        """Walls (rows, cols): 1, and 0 where rooms, corridors and doors are."""
        cells = np.ones((self.height, self.width), dtype=np.int8)
        for rect in (*self.rooms, *self.corridors, *(door.opening for door in self.doors)):
            rect.paint(cells, 0)
        return cells

    def mirrored(self, swap: bool, flip_x: bool, flip_y: bool) -> Layout:
        """The same storey flipped, then with x and y swapped."""

        def move(rect: Rect) -> Rect:
            x0, y0, x1, y1 = rect
            if flip_x:
                x0, x1 = self.width - x1, self.width - x0
            if flip_y:
                y0, y1 = self.height - y1, self.height - y0
            return Rect(y0, x0, y1, x1) if swap else Rect(x0, y0, x1, y1)

        return Layout(
            self.height if swap else self.width,
            self.width if swap else self.height,
            tuple(map(move, self.rooms)),
            self.lobby,
            tuple(map(move, self.corridors)),
            tuple(Door(move(d.opening), d.along_x != swap, d.leaf) for d in self.doors),
        )


def _split(length: int, parts: int, least: int, rng: np.random.Generator) -> list[int]:
    """Whole numbers that sum to length, uneven by up to a quarter, none below least if possible."""
    share = rng.uniform(0.75, 1.25, parts)
    sizes = np.maximum(np.floor(share / share.sum() * length).astype(int), least)
    sizes[int(sizes.argmax())] += length - int(sizes.sum())
    return [int(size) for size in sizes]


def lay_out(
    rng: np.random.Generator,
    home: bool,
    width: float,
    height: float,
    doors: tuple[float, float],
    corridors: tuple[float, float],
) -> Layout:
    """Draw rooms, corridors and doors.

    Args:
        rng: every draw comes from it.
        home: a living room and one corridor; else a clinic.
        width: of the building along its corridors [m].
        height: across them [m].
        doors: clear width from, to [m].
        corridors: clear width from, to [m].
    """

    def door_width() -> int:
        return to_cells(rng.uniform(*doors))

    def corridor_width() -> int:
        return to_cells(rng.uniform(*corridors))

    w, h = to_cells(width), to_cells(height)
    left, right = OUTER, w - OUTER
    rooms: list[Rect] = []
    openings: list[Door] = []
    lobby = home or rng.random() < 0.6
    if lobby:
        end = left + to_cells(rng.uniform(4.0, 5.5) if home else rng.uniform(3.0, 4.5))
        rooms.append(Rect(left, OUTER, end, h - OUTER))
        left = end + INNER
    spines = 1 if home or h < _SECOND_CORRIDOR else 2
    widths = [corridor_width() for _ in range(spines)]
    depth = h - 2 * OUTER - sum(widths) - 2 * spines * INNER
    rows: list[tuple[int, int]] = []
    halls: list[Rect] = []
    y = OUTER
    for k, size in enumerate(_split(depth, spines + 1, _ROOM_LEAST, rng)):
        rows.append((y, y + size))
        if k < spines:
            halls.append(Rect(left, y + size + INNER, right, y + size + INNER + widths[k]))
            y += size + 2 * INNER + widths[k]
    if lobby:
        openings += [Door(Rect(left - INNER, s.y0, left, s.y1), False, False) for s in halls]
    ends = [right] * (spines + 1)
    crossing: list[Rect] = []
    if spines == 2 and (not lobby or rng.random() < 0.5):
        across = Rect(right - corridor_width(), halls[0].y1, right, halls[1].y0)
        crossing.append(across)
        ends[1] = across.x0 - INNER
    for k, (y0, y1) in enumerate(rows):
        parts = max(1, round((ends[k] - left) / to_cells(rng.uniform(3.0, 4.8))))
        x = left
        for number, size in enumerate(
            _split(ends[k] - left - (parts - 1) * INNER, parts, _ROOM_LEAST, rng)
        ):
            room = Rect(x, y0, x + size, y1)
            rooms.append(room)
            beside = [Rect(0, y0 - INNER, 0, y0)] * (k > 0) + [Rect(0, y1, 0, y1 + INNER)] * (
                k < spines
            )
            both = len(beside) > 1 and rng.random() < 0.3
            for wall in beside if both else [beside[int(rng.integers(len(beside)))]]:
                wide = door_width()
                nook = not home and rng.random() < 0.1
                if nook:  # a waiting nook stands open
                    wide = max(wide, min(size - 2 * JAMB, to_cells(2.5)))
                at = room.x0 + JAMB + int(rng.integers(max(1, size - 2 * JAMB - wide + 1)))
                openings.append(Door(Rect(at, wall.y0, at + wide, wall.y1), True, not nook))
            to_left = number > 0 or lobby
            if to_left and rng.random() < (0.25 if home else 0.08):  # from room to room
                wide = door_width()
                at = y0 + JAMB + int(rng.integers(max(1, y1 - y0 - 2 * JAMB - wide + 1)))
                openings.append(Door(Rect(x - INNER, at, x, at + wide), False))
            x += size + INNER
    layout = Layout(w, h, tuple(rooms), lobby, (*halls, *crossing), tuple(openings))
    swap, flip_x, flip_y = (bool(flag) for flag in rng.integers(2, size=3))
    return layout.mirrored(swap, flip_x, flip_y)
