"""A hall of things that a laser sees end-on: leaves of doors, slabs, posts, and a corner.

They stand about the chair, each in its own direction, turned so that its narrow side faces it.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from wheelchair_gym.actors.records import Actor, combine, door
from wheelchair_gym.geometry.outline import Footprint
from wheelchair_gym.geometry.planar import polygon_edges, to_world
from wheelchair_gym.scenes.arena import FOOTPRINT, make_arena
from wheelchair_gym.types import Episode

SIDE: Final = 9.0  # m
SLABS: Final = 2  # of four walls each; then the screen, of four walls, too
POSTS: Final = 2  # discs; then the one behind the screen
SCREEN: Final = 0.6  # m: half of its length


@dataclass(frozen=True)
class Edges:
    """Two leaves, two slabs, two posts, and a post behind the end of a screen.

    Attributes:
        narrowest: slabs and posts are as wide [m],
        widest: or as this.
    """

    narrowest: float
    widest: float

    def sample(self, rng: np.random.Generator, footprint: Footprint = FOOTPRINT) -> Episode:
        """Draw where the things stand, how wide they are, and which leaves swing when."""
        x, y = rng.uniform(0.5 * SIDE - 0.3, 0.5 * SIDE + 0.3, 2)
        start = np.array([x, y, rng.uniform(-math.pi, math.pi)])
        turn = rng.uniform(-math.pi, math.pi)
        ways = turn + np.arange(8) * math.pi / 4 + rng.uniform(-0.12, 0.12, 8)
        leaves = [self._leaf(rng, x, y, ways[k]) for k in (0, 1)]
        walls, discs = [], []
        for k in (2, 3):
            near = (x, y, ways[k])
            length, half = rng.uniform(0.4, 1.0), 0.5 * self._width(rng)
            corners = np.array([(0, -half), (length, -half), (length, half), (0, half)])
            askew = rng.normal(0.0, 0.01) if rng.random() < 0.7 else rng.uniform(-1.2, 1.2)
            at = to_world((rng.uniform(1.5, 2.5), 0.0), near)
            walls.append(polygon_edges(to_world(corners, (*at, ways[k] + askew))))
        for k in (4, 5):
            at = to_world((rng.uniform(1.5, 2.5), 0.0), (x, y, ways[k]))
            discs.append((*at, 0.5 * self._width(rng)))
        screen = (x, y, ways[6] + 0.4)
        far, side = rng.uniform(1.3, 1.6), rng.choice((-1.0, 1.0))
        box = [(far, -SCREEN), (far + 0.1, -SCREEN), (far + 0.1, SCREEN), (far, SCREEN)]
        walls.append(polygon_edges(to_world(np.array(box), screen)))
        behind = far + 0.1 + rng.uniform(0.06, 0.4), side * (SCREEN - rng.uniform(0.0, 0.2))
        discs.append((*to_world(behind, screen), 0.5 * self._width(rng)))
        ground = make_arena((0.0, 0.0, SIDE, SIDE))
        goal = np.array([0.7, 0.7, 0.0])
        walls = np.vstack([ground.walls, *walls])
        return Episode(
            ground.map, start, goal, walls, np.array(discs), actors=combine(leaves), name="edges"
        )

    def _width(self, rng: np.random.Generator) -> float:
        return float(rng.uniform(self.narrowest, self.widest))

    def _leaf(self, rng: np.random.Generator, x: float, y: float, way: float) -> Actor:
        """A leaf whose hinge or other end looks at (x, y); half of them swing on a timetable."""
        length, near = rng.uniform(0.8, 1.1), rng.uniform(1.5, 2.5)
        hinge = rng.random() < 0.5
        at = to_world((near if hinge else near + length, 0.0), (x, y, way))
        heading = (way if hinge else way + math.pi) + rng.normal(0.0, 0.01)
        stay = 2.0 if rng.random() < 0.5 else 0.0
        return door(
            (float(at[0]), float(at[1])), float(heading), length, rng.choice((-1.5, 1.5)),
            since=rng.uniform(0.0, 4.0), stay=stay,
        )  # fmt: skip
