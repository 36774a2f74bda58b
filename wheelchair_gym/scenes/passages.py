"""Passages with people: a corridor, a crossing of two corridors, and a lift to go into.

This module draws walls, start and goal, and where people walk. `Crowd` draws the people. A new
passage is a name in `PassageName` and a function in `PASSAGES`; both are at the end of this file.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, Literal, NamedTuple

import numpy as np

from wheelchair_gym.actors.records import RADIUS
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.geometry.outline import Footprint
from wheelchair_gym.scenes.arena import WALL, Arena, make_arena, poses_along
from wheelchair_gym.scenes.raster import CELL

Range = tuple[float, float]

_LENGTH = 14.0, 18.0  # m, min and max: length of a corridor, from end to end
_DOOR = 0.9, 1.1  # m, min and max: width of a lift's door, which stands open
_END = 2.5  # m from the ends of a corridor to the chair's start and goal
_TURN_AT = 0.6  # m from the ends of a corridor, where people turn back
_GAP = RADIUS + 0.10  # m from walls to people's routes
_CABIN: Final = ((1.6, 2.0), (2.2, 2.6))  # m: width and depth of a cabin for beds
_START_OFFSET: Final = (1.5, 2.5)  # m along the landing, from the door to the chair's start
_EXIT_DISTANCE = 0.9  # m before the door, where people who have come out turn aside
_LAPS = 20  # number of times that they then walk up and down, away from the door


class Passage(NamedTuple):
    """Walls, start and goal, and where people begin and walk."""

    arena: Arena
    start: Array  # (3,)
    goal: Array  # (3,)
    draw_walk: Callable[[np.random.Generator], tuple[Array, Array]]  # place (2,), route (n, 2)
    area: float  # m2 of the ground where people begin


def _on_raster(rng: np.random.Generator, low_high: Range) -> float:
    return CELL * round(rng.uniform(*low_high) / CELL)


def _draw_lane(rng: np.random.Generator, length: float, width: float) -> tuple[Array, Array]:
    """Place and route along a corridor that begins at (0, 0), in either direction."""
    y = rng.uniform(_GAP, width - _GAP)
    ends = np.array([(length - _TURN_AT, y), (_TURN_AT, y)])
    return np.array([rng.uniform(_TURN_AT, length - _TURN_AT), y]), ends[:: rng.choice((-1, 1))]


def draw_corridor(rng: np.random.Generator, footprint: Footprint, widths: Range) -> Passage:
    """Draw a straight corridor that people walk up and down, each on a lane of their own."""
    length, width = _on_raster(rng, _LENGTH), _on_raster(rng, widths)
    beside = footprint.half_width + 0.25  # m
    ends = rng.uniform(beside, width - beside, 2) if width > 2.0 * beside else [0.5 * width] * 2
    start, goal = poses_along((_END, ends[0]), (length - _END, ends[1]))
    start[2] = goal[2] = 0.0
    arena = make_arena((0.0, 0.0, length, width))
    return Passage(arena, start, goal, lambda r: _draw_lane(r, length, width), length * width)


def draw_crossing(rng: np.random.Generator, footprint: Footprint, widths: Range) -> Passage:
    """Two corridors that cross in their middles; the chair comes from one arm and takes another."""
    size, along, across = (_on_raster(rng, each) for each in (_LENGTH, widths, widths))
    x, y = (CELL * round(0.5 * (size - width) / CELL) for width in (across, along))
    blocks = [
        (left, low, right, high)
        for left, right in ((0.0, x), (x + across, size))
        for low, high in ((0.0, y), (y + along, size))
    ]
    arena = make_arena((0.0, 0.0, size, size), blocks)
    middle = np.array([x + 0.5 * across, y + 0.5 * along])
    headings = 0.5 * math.pi * rng.permutation(4)[:2]  # of the arms, seen from the middle
    a, b = (
        middle + (0.5 * size - _END) * np.array([math.cos(yaw), math.sin(yaw)]) for yaw in headings
    )
    start, goal = np.array([*a, headings[0] + math.pi]), np.array([*b, headings[1]])

    def draw_walk(r: np.random.Generator) -> tuple[Array, Array]:
        if r.random() < 0.5:
            place, route = _draw_lane(r, size, along)
            corner = np.array([0.0, y])
        else:
            place, route = (each[..., ::-1] for each in _draw_lane(r, size, across))
            corner = np.array([x, 0.0])
        return place + corner, route + corner

    return Passage(arena, start, goal, draw_walk, size * (along + across) - along * across)


def draw_lift(rng: np.random.Generator, footprint: Footprint, widths: Range) -> Passage:
    """Draw a landing with an open lift in its side: people come out, and the chair is to go in.

    A person who has come out walks off to one side, and from then on up and down there.
    """
    length, width, door = (_on_raster(rng, each) for each in (_LENGTH, widths, _DOOR))
    cabin, depth = (_on_raster(rng, each) for each in _CABIN)
    left = CELL * round((rng.uniform(0.4, 0.6) * length - 0.5 * door) / CELL)
    middle, low = left + 0.5 * door, width + WALL
    side = CELL * round((middle - 0.5 * cabin) / CELL)
    blocks = [
        (0.0, width, left, low), (left + door, width, length, low),
        (0.0, low, side, low + depth), (side + cabin, low, length, low + depth),
    ]  # fmt: skip
    arena = make_arena((0.0, 0.0, length, low + depth), blocks)
    side_sign = rng.choice((-1.0, 1.0))
    heading = 0.0 if side_sign > 0.0 else math.pi
    start = np.array([middle - side_sign * rng.uniform(*_START_OFFSET), 0.5 * width, heading])
    goal = np.array([middle, low + depth - footprint.front - 0.25, 0.5 * math.pi])

    def draw_walk(r: np.random.Generator) -> tuple[Array, Array]:
        place = r.uniform((side + _GAP, low + _GAP), (side + cabin - _GAP, low + depth - _GAP))
        y, to_right = r.uniform(_GAP, width - _GAP), r.random() < 0.5
        far, near = (length - _TURN_AT, middle + 2.5) if to_right else (_TURN_AT, middle - 2.5)
        strolls = np.tile([(far, y), (near, y)], (_LAPS, 1))
        return place, np.vstack([(middle, max(_GAP, width - _EXIT_DISTANCE)), strolls])

    return Passage(arena, start, goal, draw_walk, cabin * depth)


PassageName = Literal["corridor", "crossing", "lift"]
PASSAGES: Final = {"corridor": draw_corridor, "crossing": draw_crossing, "lift": draw_lift}
