"""Laboratories of two sources that published pictures only: drawn to what their texts say.

The thesis on limited tree expansion has three of upright walls, given as rectangles of pixels: one
is 10 wide and 500 long. With a centimetre a pixel that is a room of about 7 m x 5 m, which agrees
with its paths of 5.9 m to 12.4 m. The paper on RRT smoothed by whales has one, an engineering
design lab, with two pairs of start and goal and obstacles inflated by 0.4 m. Verdicts on these maps
can be on orders only, never on lengths.
"""

from __future__ import annotations

from typing import Final, Literal, NamedTuple

import numpy as np

from wheelchair_gym.config import setting, settings
from wheelchair_gym.geometry import Footprint
from wheelchair_gym.scenes.arena import arena, facing
from wheelchair_gym.scenes.numbered import numbered
from wheelchair_gym.scenes.poses import FOOTPRINT
from wheelchair_gym.types import Episode

Box = tuple[float, float, float, float]
Point = tuple[float, float]

LAB_SIZE: Final = (7.0, 5.0)  # m


class _Plan(NamedTuple):
    walls: tuple[Box, ...]  # m: xmin, ymin, xmax, ymax
    start: Point  # m
    goal: Point


# Few walls; a screen and a bench; three screens one behind the other: more clutter from 1 to 3.
LABS: Final = (
    _Plan(((2.3, 0.0, 2.4, 2.2), (4.4, 2.6, 4.5, 5.0)), (0.9, 1.2), (6.0, 3.8)),
    _Plan(
        ((3.2, 1.5, 3.3, 5.0), (4.3, 2.4, 5.4, 2.5), (0.8, 4.2, 2.0, 4.3)), (1.2, 3.2), (5.6, 3.4)
    ),
    _Plan(
        ((1.9, 1.4, 2.0, 5.0), (3.6, 0.0, 3.7, 3.5), (5.3, 1.5, 5.4, 5.0), (0.0, 2.9, 0.7, 3.0)),
        (0.9, 1.6),
        (6.2, 2.4),
    ),
)

DESIGN_LAB_SIZE: Final = (12.0, 14.0)  # m
DESIGN_LAB: Final[tuple[Box, ...]] = (
    # The wall between hall and lab, with a door of 1.6 m.
    (0.0, 7.0, 6.6, 7.2),
    (8.2, 7.0, 12.0, 7.2),
    # The lab: a bench across the straight way of path 1, and benches along the walls.
    (6.5, 10.4, 7.8, 11.1),
    (2.6, 9.4, 3.4, 12.6),
    (9.8, 8.4, 10.6, 11.0),
    (4.4, 12.8, 7.0, 13.6),
    # The hall: a table across the straight way of path 2, a screen, cupboards.
    (4.8, 3.6, 6.9, 4.8),
    (3.4, 0.0, 3.5, 3.0),
    (8.8, 2.2, 10.4, 3.2),
    (1.2, 3.8, 2.4, 5.6),
)
DESIGN_LAB_PATHS: Final = {
    1: ((5.3, 9.0), (8.5, 12.0)),
    2: ((6.0, 2.0), (6.3, 9.5)),
}
DESIGN_LAB_INFLATION: Final = 0.4  # m: the paper's


@settings
class Lab:
    """A laboratory of the thesis on limited tree expansion; upright walls, 7 m x 5 m."""

    number: int = setting(default=1, source="which of the three", low=1, high=3)

    def sample(self, rng: np.random.Generator, footprint: Footprint = FOOTPRINT) -> Episode:
        """The one world there is, whatever the footprint."""
        plan = LABS[self.number - 1]
        ground = arena((0.0, 0.0, *LAB_SIZE), plan.walls)
        start, goal = facing(plan.start, plan.goal)
        name = f"lab_{self.number}"
        return Episode(ground.map, start, goal, ground.walls, ground.discs, name=name)


@settings
class DesignLab:
    """An engineering design lab with the two ways of the paper on RRT smoothed by whales."""

    path: Literal[1, 2] = setting(default=1, source="the paper's start and goal")

    def sample(self, rng: np.random.Generator, footprint: Footprint = FOOTPRINT) -> Episode:
        """The one world there is, whatever the footprint."""
        ground = arena((0.0, 0.0, *DESIGN_LAB_SIZE), DESIGN_LAB)
        start, goal = facing(*DESIGN_LAB_PATHS[self.path])
        return Episode(ground.map, start, goal, ground.walls, ground.discs, name="design_lab")


LAB_MAPS: Final = numbered(Lab, "lab", 3, "Laboratory of the thesis on limited tree expansion, no.")
