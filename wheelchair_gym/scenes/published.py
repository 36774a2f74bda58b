"""Worlds of the source documents: exact where they were published, else drawn to their texts.

Two papers on swarm planners published theirs exactly. The five maps of the thesis on RRT*-WOA were
never published: all are 30 m x 20 m with a path of about 35 m from corner to corner: empty; with
unobtrusive obstacles; with narrow passages; with local minima; with clutter.

Laboratories of two sources exist as pictures only. The thesis on limited tree expansion has three
of upright walls, given as rectangles of pixels: one is 10 wide and 500 long. With a centimetre a
pixel that is a room of about 7 m x 5 m, which agrees with its paths of 5.9 m to 12.4 m. The paper
on RRT smoothed by whales has one, an engineering design lab, with two pairs of start and goal and
obstacles inflated by 0.4 m. Verdicts on these maps can be on orders only, never on lengths.
"""

import math
from typing import Any, Final, Literal

import numpy as np

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import setting, settings
from wheelchair_gym.geometry.outline import Footprint
from wheelchair_gym.scenes.arena import FOOTPRINT, make_arena, poses_along, read_table
from wheelchair_gym.scenes.raster import rotated_rectangle
from wheelchair_gym.types import Episode


def _define_maps(scene: type[Any], count: int, doc: str) -> None:
    """Define a class for each map of a scene, such as Lab1, whose number is fixed.

    They are attributes of this module, where the registry and pickles find them.
    """
    for k in range(1, count + 1):
        name = f"{scene.__name__}{k}"
        fields = {
            "__annotations__": {"number": int},
            "__doc__": f"{doc} {k}.",
            "__module__": __name__,
            "number": setting(default=k, low=k, high=k, source="the number of the map"),
        }
        globals()[name] = settings(type(name, (scene,), fields))


Box = tuple[float, float, float, float]  # m: xmin, ymin, xmax, ymax
Disc = tuple[float, float, float]  # m: x, y, radius
Point = tuple[float, float]  # m


_WORLDS: Final = read_table("published")
LAB_SIZE: Final[Point] = _WORLDS["LAB_SIZE"]
LABS: Final[tuple[tuple[tuple[Box, ...], Point, Point], ...]] = _WORLDS["LABS"]
CHAOTIC_PSO_DISCS: Final[tuple[Disc, ...]] = _WORLDS["CHAOTIC_PSO_DISCS"]
GREY_WOLF_DISCS: Final[tuple[Disc, ...]] = _WORLDS["GREY_WOLF_DISCS"]
GREY_WOLF_GOALS: Final[dict[str, Point]] = _WORLDS["GREY_WOLF_GOALS"]


@settings
class Lab:
    """A laboratory of the thesis on limited tree expansion; upright walls, 7 m x 5 m."""

    number: int = setting(default=1, low=1, high=3, source="the first one")
    """Number of the laboratory."""

    def sample(self, rng: np.random.Generator, footprint: Footprint = FOOTPRINT) -> Episode:
        """The one world there is, whatever the footprint."""
        walls, start, goal = LABS[self.number - 1]
        arena = make_arena((0.0, 0.0, *LAB_SIZE), walls)
        return arena.episode(*poses_along(start, goal), f"lab_{self.number}")


@settings
class DesignLab:
    """An engineering design lab with the two ways of the paper on RRT smoothed by whales."""

    path: Literal[1, 2] = setting(default=1, source="the first one")
    """Which of the paper's two pairs of start and goal."""

    def sample(self, rng: np.random.Generator, footprint: Footprint = FOOTPRINT) -> Episode:
        """The one world there is, whatever the footprint."""
        arena = make_arena((0.0, 0.0, *_WORLDS["DESIGN_LAB_SIZE"]), _WORLDS["DESIGN_LAB"])
        path = _WORLDS["DESIGN_LAB_PATHS"][self.path - 1]
        return arena.episode(*poses_along(*path), "design_lab")


_define_maps(Lab, 3, "Laboratory of the thesis on limited tree expansion, no.")


@settings
class ChaoticPso:
    """10 m x 10 m, eight round obstacles, (1, 1) to (9, 9): the paper on chaotic PSO for robots.

    A wall round the ground keeps the chair in; it touches nothing of the paper.
    """

    def sample(self, rng: np.random.Generator, footprint: Footprint = FOOTPRINT) -> Episode:
        """The one world there is, whatever the footprint."""
        arena = make_arena((0.0, 0.0, 10.0, 10.0), discs=CHAOTIC_PSO_DISCS)
        return arena.episode(*poses_along((1.0, 1.0), (9.0, 9.0)), "chaotic_pso")


_MARGIN = 2.0  # m beyond the report's square: room for the chair at the start in its corner


@settings
class GreyWolf:
    """25 x 25, three round obstacles, (0, 0) to one of six goals: the report on PSO with GWO.

    A margin beyond its ground lets the chair stand at the start in its corner.
    """

    goal: Literal["5,20", "15,5", "12,12", "15,22", "20,20", "10,2.5"] = setting(
        default="20,20", source="beyond all obstacles"
    )
    """Which of the report's six goals."""

    def sample(self, rng: np.random.Generator, footprint: Footprint = FOOTPRINT) -> Episode:
        """The one world there is, whatever the footprint."""
        low, high = -_MARGIN, 25.0 + _MARGIN
        arena = make_arena((low, low, high, high), discs=GREY_WOLF_DISCS)
        return arena.episode(*poses_along((0.0, 0.0), GREY_WOLF_GOALS[self.goal]), "grey_wolf")


WIDTH: Final = 30.0  # m
HEIGHT: Final = 20.0
START: Final = (1.5, 1.5)
GOAL: Final = (28.5, 18.5)
_CLUTTER_SEED = 5  # of map 5
_WALL = 0.3  # m: thickness of walls drawn by hand
_GAP = 1.2  # m: width of the narrow passages, enough for the chair


def _barrier(x: float, gap_at: float) -> list[Box]:
    """A wall across the map at x with one gap centred at a height."""
    right = x + _WALL
    return [(x, 0.0, right, gap_at - _GAP / 2), (x, gap_at + _GAP / 2, right, HEIGHT)]


def _pocket(x: float, low: float, high: float, deep: float) -> list[Box]:
    """A pocket that opens towards the start's side; its back stands at x."""
    return [
        (x, low, x + _WALL, high),
        (x - deep, low, x, low + _WALL),
        (x - deep, high - _WALL, x, high),
    ]


def _clutter() -> tuple[list[Disc], list[Array]]:
    """Discs and rotated rectangles at random, apart from each other and from the barriers."""
    rng = np.random.default_rng(_CLUTTER_SEED)
    taken = [(*START, 1.2), (*GOAL, 1.2), (10.15, 12.5, 1.3), (20.15, 6.0, 1.3)]  # x, y, keep-out
    discs: list[Disc] = []
    rotated: list[Array] = []
    for _ in range(2000):
        length, deep = rng.uniform(0.5, 2.2), rng.uniform(0.4, 1.2)
        disc = rng.random() < 0.4
        reach = deep / 2 if disc else math.hypot(length, deep) / 2
        x, y = rng.uniform(reach, WIDTH - reach), rng.uniform(reach, HEIGHT - reach)
        across = min(abs(x - 10.15), abs(x - 20.15)) - _WALL / 2  # to the barriers
        edge = min(x, WIDTH - x, y, HEIGHT - y)
        clear = all(math.dist((x, y), t[:2]) >= t[2] + reach + _GAP for t in taken)
        if not clear or min(across, edge) < reach + _GAP:
            continue
        taken.append((x, y, reach))
        if disc:
            discs.append((x, y, reach))
        else:
            rotated.append(rotated_rectangle(x, y, length, deep, rng.uniform(0.0, math.pi)))
    return discs, rotated


@settings
class ThesisMap:
    """One of the five maps of the thesis on RRT*-WOA; the same world for every generator."""

    number: int = setting(default=1, low=1, high=5, source="the first one")
    """Which of the five maps."""
    scale: float = setting(
        default=1.0, low=0.5, high=2.0, source="RRT* paths of the thesis are 35.27 m: 0.872"
    )
    """Factor of all lengths of the map, its passages included."""

    def sample(self, rng: np.random.Generator, footprint: Footprint = FOOTPRINT) -> Episode:
        """The one world there is, whatever the footprint."""
        shapes, scale = _WORLDS["THESIS_MAPS"][self.number - 1], self.scale
        discs, rotated = _clutter() if self.number == 5 else (shapes.get("discs", []), [])
        rotated += [rotated_rectangle(*one) for one in shapes.get("rotated", [])]
        boxes = [*shapes.get("boxes", [])]
        boxes += [box for one in shapes.get("barriers", []) for box in _barrier(*one)]
        boxes += [box for one in shapes.get("pockets", []) for box in _pocket(*one)]
        arena = make_arena(
            (0.0, 0.0, scale * WIDTH, scale * HEIGHT),
            (scale * np.array(boxes).reshape(-1, 4)).tolist(),
            [scale * outline for outline in rotated],
            scale * np.array(discs).reshape(-1, 3),
        )
        start, goal = ((scale * x, scale * y) for x, y in (START, GOAL))
        return arena.episode(*poses_along(start, goal), f"thesis_{self.number}")


_define_maps(ThesisMap, 5, "Map of the thesis, no.")
