"""Five maps after those of the thesis on RRT*-WOA: their pictures were never published.

All are 30 m x 20 m with a way of about 35 m from corner to corner: empty; with unobtrusive
obstacles; with narrow passages; with local minima; with clutter.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.config import setting, settings
from wheelchair_gym.geometry import Footprint
from wheelchair_gym.scenes.arena import Arena, arena, facing
from wheelchair_gym.scenes.numbered import numbered
from wheelchair_gym.scenes.poses import FOOTPRINT
from wheelchair_gym.scenes.raster import turned_rectangle
from wheelchair_gym.types import Episode

Array = NDArray[np.float64]
Box = tuple[float, float, float, float]

WIDTH: Final = 30.0  # m
HEIGHT: Final = 20.0
START: Final = (1.5, 1.5)
GOAL: Final = (28.5, 18.5)
_WALL = 0.3  # m: thickness of walls drawn by hand


def _barrier(x: float, gap_at: float, gap: float) -> list[Box]:
    """A wall across the map at x with one gap centred at a height."""
    right = x + _WALL
    return [(x, 0.0, right, gap_at - gap / 2), (x, gap_at + gap / 2, right, HEIGHT)]


def _pocket(x: float, low: float, high: float, deep: float) -> list[Box]:
    """A pocket that opens towards the start's side; its back stands at x."""
    return [
        (x, low, x + _WALL, high),
        (x - deep, low, x, low + _WALL),
        (x - deep, high - _WALL, x, high),
    ]


def _empty(gap: float, seed: int) -> Arena:
    return arena((0.0, 0.0, WIDTH, HEIGHT))


def _unobtrusive(gap: float, seed: int) -> Arena:
    rects = [(5.0, 9.0, 7.5, 11.0), (13.5, 14.0, 15.0, 16.5), (21.0, 4.0, 24.0, 6.0)]
    turned = [
        turned_rectangle(11.0, 3.0, 2.0, 1.2, 0.5),
        turned_rectangle(8.0, 16.0, 2.5, 1.0, 2.4),
    ]
    discs = [(17.0, 5.0, 0.8), (21.0, 17.0, 0.7), (3.0, 14.5, 0.6), (26.5, 9.0, 0.7)]
    return arena((0.0, 0.0, WIDTH, HEIGHT), rects, turned, discs)


def _narrow(gap: float, seed: int) -> Arena:
    rects = _barrier(7.0, 6.0, gap) + _barrier(12.5, 11.0, gap)
    rects += _barrier(18.0, 6.5, gap) + _barrier(23.5, 14.0, gap)
    return arena((0.0, 0.0, WIDTH, HEIGHT), rects)


def _local_minima(gap: float, seed: int) -> Arena:
    rects = _pocket(9.0, 2.0, 9.5, 4.0) + _pocket(16.0, 8.0, 17.0, 5.0)
    rects += _pocket(24.0, 9.5, 17.5, 4.5) + _pocket(20.5, 1.5, 6.5, 3.0)
    return arena((0.0, 0.0, WIDTH, HEIGHT), rects)


def _clutter(gap: float, seed: int) -> Arena:
    rects = _barrier(10.0, 12.5, gap) + _barrier(20.0, 6.0, gap)
    rng = np.random.default_rng(seed)
    taken = [(*START, 1.2), (*GOAL, 1.2), (10.15, 12.5, 1.3), (20.15, 6.0, 1.3)]  # x, y, keep-out
    discs: list[tuple[float, float, float]] = []
    turned: list[Array] = []
    for _ in range(2000):
        length, deep = rng.uniform(0.5, 2.2), rng.uniform(0.4, 1.2)
        disc = rng.random() < 0.4
        reach = deep / 2 if disc else math.hypot(length, deep) / 2
        x, y = rng.uniform(reach, WIDTH - reach), rng.uniform(reach, HEIGHT - reach)
        across = min(abs(x - 10.15), abs(x - 20.15)) - _WALL / 2  # to the barriers
        edge = min(x, WIDTH - x, y, HEIGHT - y)
        clear = all(math.dist((x, y), t[:2]) >= t[2] + reach + gap for t in taken)
        if not clear or min(across, edge) < reach + gap:
            continue
        taken.append((x, y, reach))
        if disc:
            discs.append((x, y, reach))
        else:
            turned.append(turned_rectangle(x, y, length, deep, rng.uniform(0.0, math.pi)))
    return arena((0.0, 0.0, WIDTH, HEIGHT), rects, turned, discs)


_MAPS: Final[tuple[Callable[[float, int], Arena], ...]] = (
    _empty,
    _unobtrusive,
    _narrow,
    _local_minima,
    _clutter,
)


@settings
class ThesisMap:
    """One of the five maps; the same world for every generator."""

    number: int = setting(default=1, source="which map of the five", low=1, high=5)
    gap: float = setting(
        default=1.2,
        unit="m",
        source="narrow passages, wide enough for the chair",
        low=0.7,
        high=3.0,
    )
    seed: int = setting(default=5, source="of the clutter in map 5", low=0)

    def sample(self, rng: np.random.Generator, footprint: Footprint = FOOTPRINT) -> Episode:
        """The one world there is, whatever the footprint."""
        ground = _MAPS[self.number - 1](self.gap, self.seed)
        start, goal = facing(START, GOAL)
        name = f"thesis_{self.number}"
        return Episode(ground.map, start, goal, ground.walls, ground.discs, name=name)


THESIS_MAPS: Final = numbered(ThesisMap, "thesis", 5, "Map of the thesis, no.")
