"""Scenes in which something moves: people, powered doors, light furniture, sudden obstacles."""

import dataclasses
import math
from typing import ClassVar, Literal

import numpy as np

from wheelchair_gym.actors.records import Actor, combine, door, furniture, obstacle
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import InputError, Range, setting, settings
from wheelchair_gym.geometry.outline import Footprint
from wheelchair_gym.geometry.planar import arc_lengths
from wheelchair_gym.maps import OCCUPIED, OccupancyGrid, geodesic
from wheelchair_gym.scenes import pedestrians
from wheelchair_gym.scenes.arena import (
    CLEARANCE,
    FOOTPRINT,
    Arena,
    draw_pose,
    make_arena,
    passing_radius,
)
from wheelchair_gym.scenes.floor_plan import InBuilding
from wheelchair_gym.scenes.layout import FloorLayout
from wheelchair_gym.scenes.pedestrians import PASSAGES, Passage, PeopleSettings, ReactionShares
from wheelchair_gym.scenes.raster import CELL
from wheelchair_gym.types import Episode

_CLEAR = 1.05  # m round light furniture: the chair passes it on either side
_START_FREE, _GOAL_FREE = 1.5, 1.1  # m about start and goal; the chair is 1.0 m long
_PIECES = (((0.45, 0.45), 5.0), ((0.20, 0.0), 3.0), ((0.60, 0.40), 9.0), ((0.25, 0.0), 8.0))
# chair, stool, serving trolley, waste bin: size [m] (of a round one its radius and 0), mass [kg]

Hall = tuple[Arena, Array, Array]  # with its start and its goal (3,)
Place = Literal["any", "building", "hall", pedestrians.PassageName]
_OPENS_AT = 2.0  # m of somebody from a leaf: EN 16005, sensors of powered doors
_SLIDING_SHARE = 0.5  # of leaves, where the wall has room; the others swing


def sample_doors(
    rng: np.random.Generator, grid: OccupancyGrid, layout: FloorLayout, leaf_share: float
) -> list[Actor]:
    """Powered leaves in some of the doors: one slides where it fits into the wall, or swings.

    A leaf swings into a room: across a corridor it would block everybody nearby.
    """
    found = []
    for k in np.flatnonzero(layout.is_door):
        if rng.random() >= leaf_share:
            continue
        x0, y0, x1, y1 = (CELL * value for value in layout.openings[k].item())
        flip, turn = rng.random() < 0.5, rng.choice((-0.5 * math.pi, 0.5 * math.pi))
        x, y = 0.5 * (x0 + x1), 0.5 * (y0 + y1)
        if layout.along_x[k]:
            hinge, heading = ((x1, y), math.pi) if flip else ((x0, y), 0.0)
        else:
            hinge, heading = ((x, y1), -0.5 * math.pi) if flip else ((x, y0), 0.5 * math.pi)
        width = float(layout.opening_widths[k])
        slides = rng.random() < _SLIDING_SHARE and _in_wall(grid, hinge, heading, width)
        turns = [t for t in (turn, -turn) if _in_room(layout, hinge, heading + t, width)]
        if slides or turns:
            travel = -width if slides else float(turns[0])
            # A person near a leaf that swings must find it open: it starts its length sooner.
            near = _OPENS_AT + (0.0 if slides else width)
            found.append(door(hinge, heading, width, travel, swings=not slides, near=near))
    return found


def leaves_that_let_pass(leaves: list[Actor], episode: Episode, radius: float) -> list[Actor]:
    """The leaves that, while they stand open, leave a way for a disc from start to goal.

    A leaf stands open as long as the chair is near it: the chair would never get past one that
    stands across the only way.
    """
    start, goal = episode.start[:2], episode.goal[:2]

    def passes(some: list[Actor]) -> bool:
        paths = geodesic(pedestrians.with_open_doors(episode.map, some), goal, radius)
        return bool(np.isfinite(paths.at(start)))

    if passes(leaves):
        return leaves
    kept: list[Actor] = []
    for leaf in leaves:
        if not leaf.row["swings"][0] or passes([*kept, leaf]):
            kept.append(leaf)
    return kept


def _in_room(layout: FloorLayout, hinge: tuple[float, float], heading: float, width: float) -> bool:
    """Whether the far end of an open leaf is in a room."""
    col = (hinge[0] + width * math.cos(heading)) / CELL
    row = (hinge[1] + width * math.sin(heading)) / CELL
    rooms = layout.rooms
    beside = (rooms["x0"] <= col) & (col <= rooms["x1"])
    return bool((beside & (rooms["y0"] <= row) & (row <= rooms["y1"])).any())


def _in_wall(grid: OccupancyGrid, hinge: tuple[float, float], heading: float, width: float) -> bool:
    """Whether a leaf that slides back behind its hinge is inside the wall."""
    back = np.arange(0.5 * CELL, width, 0.5 * CELL)[:, None]
    points = np.array(hinge) - back * (math.cos(heading), math.sin(heading))
    if not grid.inside(points).all():
        return False
    cells = grid.to_cell(points)
    return bool((grid.cells[cells[:, 0], cells[:, 1]] == OCCUPIED).all())


def sample_furniture(
    rng: np.random.Generator,
    grid: OccupancyGrid,
    density: float,
    ends: tuple[Array, Array],
    taken: list[Array],
) -> list[Actor]:
    """Movable furniture, none on the chair's start and goal; `taken` as in `sample_people`."""
    places = np.argwhere(grid.traversable(_CLEAR))
    found: list[Actor] = []
    for _ in range(round(density * pedestrians.free_area(grid)) if len(places) else 0):
        size, mass = _PIECES[rng.integers(len(_PIECES))]
        x, y = pedestrians.draw_place(rng, grid, places)
        yaw = rng.uniform(-math.pi, math.pi)
        reach = math.hypot(*size) / (2.0 if size[1] else 1.0)
        gaps = [math.dist((x, y), end[:2]) for end in ends]
        if gaps[0] < _START_FREE or gaps[1] < _GOAL_FREE:
            continue
        if all(math.dist((x, y), at[:2]) > reach + at[2] + 0.1 for at in taken):
            taken.append(np.array([x, y, reach]))
            found.append(furniture((float(x), float(y), float(yaw)), size, mass))
    return found


_CROWD_TRIES = 200  # halls drawn before the settings are called impossible
_COLUMN_DENSITY = 0.02  # 1/m2 of a hall


@settings
class Crowd(InBuilding):
    """People who walk through a building, a hall, a corridor, a crossing or out of a lift.

    Buildings have powered doors; light furniture stands about where there is room for it.
    """

    name: ClassVar[str] = "crowd"  # of its episodes

    place: Place = setting(default="any")
    """Place where people walk; any draws a building or a hall."""
    people: PeopleSettings = PeopleSettings()
    leaf_share: float = setting(default=0.4, low=0.0, high=1.0)
    """Share of doors that have a powered leaf."""
    furniture_density: float = setting(default=0.01, unit="1/m2", low=0.0, high=1.0)
    """Movable pieces of furniture per free area."""
    hall_size: Range[float] = setting(default=(9.0, 14.0), unit="m", low=5.0, high=60.0)
    """Minimum and maximum side of a hall."""
    corridor_width: Range[float] = setting(default=(2.0, 3.0), unit="m", low=1.2, high=10.0)
    """Range of widths of a corridor, a crossing's corridors and the landing of a lift."""

    def sample_building(
        self, rng: np.random.Generator, footprint: Footprint = FOOTPRINT
    ) -> tuple[FloorLayout | None, Episode]:
        """Draw a place, with its rooms, corridors and doors if it has any, and what moves in it."""
        layout: FloorLayout | None = None
        ground: Passage | Hall | None = None
        if self.place == "building" or (self.place == "any" and rng.random() < 0.5):
            layout, episode = self.building.sample_building(rng, footprint)
        else:
            ground = self._draw_ground(rng, footprint)
            episode = ground[0].episode(ground[1], ground[2], "crowd")
        taken: list[Array] = []
        start, grid = episode.start, episode.map
        pieces = sample_furniture(rng, grid, self.furniture_density, (start, episode.goal), taken)
        leaves = [] if layout is None else sample_doors(rng, grid, layout, self.leaf_share)
        leaves = leaves_that_let_pass(leaves, episode, passing_radius(footprint))
        if isinstance(ground, Passage):
            people = pedestrians.sample_passage_people(rng, ground, self.people, taken)
        else:
            people = pedestrians.sample_people(rng, grid, start, self.people, taken, leaves)
        actors = combine([*pieces, *leaves, *people])
        return layout, dataclasses.replace(episode, actors=actors, name=self.name)

    def _draw_ground(self, rng: np.random.Generator, footprint: Footprint) -> Passage | Hall:
        """Draw a passage or a hall in which the footprint gets from start to goal."""
        is_passage = self.place in PASSAGES
        minimum = 0.0 if is_passage else 0.6 * self.hall_size[0]  # m: length of the path
        for _ in range(_CROWD_TRIES):
            if is_passage:
                ground: Passage | Hall = PASSAGES[self.place](rng, footprint, self.corridor_width)
            else:
                ground = self._draw_hall(rng)
            arena, start, goal = ground[0], ground[1], ground[2]
            if all(arena.is_free(pose, footprint, CLEARANCE) for pose in (start, goal)):
                paths = geodesic(arena.map, goal[:2], passing_radius(footprint))
                if minimum <= float(paths.at(start[:2])) < np.inf:
                    return ground
        raise InputError(
            f"Crowd: {_CROWD_TRIES} draws had no start and goal for {footprint} in {self}"
        )

    def _draw_hall(self, rng: np.random.Generator) -> Hall:
        """Draw an open hall with a few columns, a start and a goal."""
        width, height = rng.uniform(*self.hall_size, 2)
        count = round(_COLUMN_DENSITY * width * height)
        low, high = (1.0, 1.0, 0.15), (width - 1.0, height - 1.0, 0.30)  # m: x, y, radius
        draws = [rng.uniform(a, b, count) for a, b in zip(low, high, strict=True)]
        arena = make_arena((0.0, 0.0, width, height), discs=np.column_stack(draws))
        start, goal = (np.array(draw_pose(rng, 0.8, width, height)) for _ in range(2))
        return arena, start, goal


@settings
class People(Crowd):
    """A hall with everything that people do, and every reaction to the chair."""

    name: ClassVar[str] = "people"

    place: Place = setting(default="hall")
    people: PeopleSettings = PeopleSettings(
        density=(0.12, 0.14),
        behaviours=pedestrians.BehaviourShares(
            groups=0.25, pauses=0.1, cuts_in=0.1, reads_phone=0.1, walks_beside=0.1, children=0.1,
            trolleys=0.1,
        ),
        reactions=ReactionShares(curious=0.2, wary=0.2, surprised=0.2, indifferent=0.2),
    )  # fmt: skip
    furniture_density: float = setting(default=0.0, unit="1/m2", low=0.0, high=1.0)
    hall_size: Range[float] = setting(default=(10.0, 12.0), unit="m", low=5.0, high=60.0)


_RADIUS = 0.15, 0.35  # m, min and max: radius of an obstacle, from a bag to a trolley
_TRIGGER_DISTANCE = 1.5, 3.0  # m, min and max: distance of the chair at which an obstacle appears
_MIN_DISTANCE = 1.2  # m: no obstacle appears nearer to the chair; 0.8 m/s stops in 0.88 m
_DURATION = 5.0, 20.0  # s, min and max: time for which an obstacle stays
_LATERAL_OFFSET = 0.15  # m: largest of an obstacle from the path, along x and y
_ENDS = 2.0  # m of the way at start and goal where nothing appears


@settings
class Temporary(InBuilding):
    """A floor plan in which discs appear for a while on the shortest path ahead of the chair.

    The chair plans a new path round them or waits until they are gone (Belalia 2023).
    """

    count: Range[int] = setting(default=(1, 3), low=0, high=20)
    """Minimum and maximum number of obstacles."""

    def sample_building(
        self, rng: np.random.Generator, footprint: Footprint = FOOTPRINT
    ) -> tuple[FloorLayout, Episode]:
        """Draw a floor plan with its layout, and obstacles that appear on the shortest path."""
        layout, episode = self.building.sample_building(rng, footprint)
        radius = passing_radius(footprint)
        path = geodesic(episode.map, episode.goal[:2], radius).path(episode.start[:2])
        lengths = arc_lengths(path)
        obstacles: list[Actor] = []
        count = int(rng.integers(self.count[0], self.count[1] + 1))
        if lengths[-1] > 2.0 * _ENDS:
            for at in np.sort(rng.uniform(_ENDS, lengths[-1] - _ENDS, count)):
                x, y = (
                    float(np.interp(at, lengths, path[:, k]))
                    + rng.uniform(-_LATERAL_OFFSET, _LATERAL_OFFSET)
                    for k in range(2)
                )
                radius = float(rng.uniform(*_RADIUS))
                near = float(rng.uniform(*_TRIGGER_DISTANCE))
                stay = float(rng.uniform(*_DURATION))
                obstacles.append(
                    obstacle((x, y), radius, near=near, minimum=_MIN_DISTANCE, stay=stay)
                )
        return layout, dataclasses.replace(episode, actors=combine(obstacles), name="temporary")
