"""Scenes in which something moves: people, powered doors, light furniture, sudden obstacles."""

from __future__ import annotations

import dataclasses
import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.config import InputError, setting, settings
from wheelchair_gym.geometry import Footprint
from wheelchair_gym.maps import FREE, OCCUPIED, Geodesic, OccupancyGrid, geodesic
from wheelchair_gym.physics.actors.records import (
    EVERYBODY,
    NOBODY,
    PEOPLE,
    RADIUS,
    SPEED,
    Actor,
    combine,
    door,
    furniture,
    leaf_line,
    obstacle,
    person,
)
from wheelchair_gym.scenes.arena import make_arena
from wheelchair_gym.scenes.floor_plan import FloorPlan
from wheelchair_gym.scenes.layout import Building
from wheelchair_gym.scenes.poses import FOOTPRINT, is_free_pose, passing_radius
from wheelchair_gym.scenes.raster import CELL
from wheelchair_gym.types import Episode

Array = NDArray[np.float64]

WALKING_RADIUS = RADIUS + 0.10  # m: people's routes keep this from walls
_PLACES = 8  # where people are going to: each costs one geodesic
_TRIES = 60  # starts drawn for one person before they stay away
_LEAST_WAY = 3.0  # m: shorter routes are no routes
_CLEAR = 1.05  # m round light furniture: the chair passes it on either side
_PAIR = 0.7  # m between people at the beginning
_PIECES = (((0.45, 0.45), 5.0), ((0.20, 0.0), 3.0), ((0.60, 0.40), 9.0), ((0.25, 0.0), 8.0))
# chair, stool, serving trolley, waste bin: size [m], mass [kg]


@settings
class PeopleSettings:
    """Number and behaviour of people."""

    density: tuple[float, float] = setting(
        default=(0.03, 0.08), unit="1/m2", low=0.0, high=1.0, source="design choice"
    )
    """Least and greatest number of people per free area."""
    speed: float = setting(default=SPEED, unit="m/s", low=0.1, source="Weidmann 1993")
    """Mean preferred walking speed."""
    speed_sigma: float = setting(default=0.26, unit="m/s", low=0.0, source="Weidmann 1993")
    """Standard deviation of the preferred walking speed."""
    min_speed: float = setting(
        default=0.4, unit="m/s", low=0.05, source="a person with a walking frame"
    )
    """Least preferred walking speed."""
    inattentive_share: float = setting(default=0.1, low=0.0, high=1.0, source="design choice")
    """Share of people who do not see the chair."""
    crossing_share: float = setting(default=0.0, low=0.0, high=1.0, source="DynaBARN")
    """Share of moving cylinders that avoid nobody."""
    patience: float = setting(default=4.0, unit="s", low=0.5, source="design choice")
    """Time without progress after which a person turns back."""
    start_distance: float = setting(default=2.0, unit="m", low=0.8, source="design choice")
    """Least distance of people from the chair's start."""

    def __post_init__(self) -> None:
        if self.density[0] > self.density[1]:
            raise InputError(f"PeopleSettings.density is {self.density}; expected from, to")


@settings
class DoorSettings:
    """Powered leaves of doors."""

    leaf_share: float = setting(default=0.4, low=0.0, high=1.0, source="design choice")
    """Share of doors that have a powered leaf."""
    sliding_share: float = setting(default=0.5, low=0.0, high=1.0, source="design choice")
    """Share of leaves that slide where the wall has room; the others swing."""
    trigger_distance: float = setting(
        default=2.0, unit="m", low=0.5, source="EN 16005, sensors of powered doors"
    )
    """Distance at which a leaf opens for somebody."""


def free_area(grid: OccupancyGrid) -> float:
    """Area [m2] of the map that is free."""
    return float((grid.cells == FREE).sum()) * grid.resolution**2


def _draw_place(rng: np.random.Generator, grid: OccupancyGrid, places: NDArray[np.intp]) -> Array:
    """A free place (2,) [m], somewhere in a cell of (n, 2)."""
    cell = places[rng.integers(len(places))]
    drawn: Array = grid.to_world(cell) + rng.uniform(-0.4, 0.4, 2) * grid.resolution
    return drawn


def sample_people(
    rng: np.random.Generator,
    grid: OccupancyGrid,
    start: Array,
    who: PeopleSettings,
    taken: list[Array],
    leaves: list[Actor],
) -> list[Actor]:
    """People on ways between places of a map; ways lead round open leaves, none begins behind one.

    Args:
        rng: every draw comes from it.
        grid: where they walk.
        start: of the chair.
        who: they are.
        taken: places (x, y, reach) where something stands already; theirs are added.
        leaves: doors.
    """
    count = round(rng.uniform(*who.density) * free_area(grid))
    own = _barred(grid, leaves)
    places = np.argwhere(own.traversable(WALKING_RADIUS))
    for leaf in leaves:
        hinge, length = leaf.row["pose"][0, :2], leaf.row["size"][0, 0]
        far = np.hypot(*(own.to_world(places) - hinge).T) > length + WALKING_RADIUS
        places = places[far | ~leaf.row["swings"]]
    if not count or not len(places):
        return []
    goals = [_draw_place(rng, own, places) for _ in range(min(_PLACES, count))]
    ways = [geodesic(own, goal, WALKING_RADIUS) for goal in goals]
    found = []
    for _ in range(count):
        speed = max(who.min_speed, rng.normal(who.speed, who.speed_sigma))
        avoids = EVERYBODY
        if rng.random() < who.crossing_share:
            avoids = NOBODY
        elif rng.random() < who.inattentive_share:
            avoids = PEOPLE
        route = _draw_route(rng, own, places, ways, avoids, start, who.start_distance, taken)
        if route is not None:
            taken.append(np.array([*route[0], RADIUS]))
            found.append(person(route, speed, avoids=avoids, patience=who.patience))
    return found


def _barred(grid: OccupancyGrid, leaves: list[Actor]) -> OccupancyGrid:
    """A map of its own on which leaves that swing stand open."""
    cells = grid.cells.copy()
    for leaf in leaves:
        row = leaf.row[0]
        if row["swings"]:
            x, y, heading = row["pose"]
            ends = leaf_line(row, x, y, heading + row["travel"])
            steps = np.linspace(0.0, 1.0, 2 + math.ceil(4.0 * row["size"][0] / grid.resolution))
            on = grid.to_cell(ends[0] + steps[:, None] * (ends[1] - ends[0]))
            inside = ((on >= 0) & (on < grid.shape)).all(axis=1)
            cells[tuple(on[inside].T)] = OCCUPIED
    return OccupancyGrid(cells, grid.resolution, grid.origin)


def _draw_route(
    rng: np.random.Generator,
    grid: OccupancyGrid,
    places: NDArray[np.intp],
    ways: list[Geodesic],
    avoids: int,
    start: Array,
    apart: float,
    taken: list[Array],
) -> Array | None:
    """A route (n, 2) [m] from a free place, or None where the draws were unlucky."""
    for _ in range(_TRIES):
        here = _draw_place(rng, grid, places)
        way = ways[rng.integers(len(ways))]
        if math.dist(here, start[:2]) < apart + RADIUS:
            continue
        if any(math.dist(here, at[:2]) < _PAIR - RADIUS + at[2] for at in taken):
            continue
        if avoids == NOBODY:
            there = _draw_place(rng, grid, places)
            route = np.array([here, there])
            if math.dist(here, there) < _LEAST_WAY or not _clear(grid, here, there):
                continue
            return route
        length = float(way.at(here))
        if _LEAST_WAY <= length < math.inf:
            route = way.path(here)
            if len(route) >= 2:
                return route
    return None


def _clear(grid: OccupancyGrid, here: Array, there: Array) -> bool:
    """Whether a straight way keeps off everything on the map."""
    steps = np.linspace(0.0, 1.0, 2 + math.ceil(math.dist(here, there) / grid.resolution))
    cells = grid.to_cell(here + steps[:, None] * (there - here))
    return bool(grid.traversable(WALKING_RADIUS)[cells[:, 0], cells[:, 1]].all())


def sample_doors(
    rng: np.random.Generator, grid: OccupancyGrid, layout: Building, what: DoorSettings
) -> list[Actor]:
    """Powered leaves in some of the doors: one slides where it vanishes in the wall, or swings.

    A leaf swings into a room: across a corridor it would stand in the way of all who are near.
    """
    found = []
    for opening in layout.doors:
        if not opening.leaf or rng.random() >= what.leaf_share:
            continue
        x0, y0, x1, y1 = (CELL * value for value in opening.opening)
        flip, way = rng.random() < 0.5, rng.choice((-0.5 * math.pi, 0.5 * math.pi))
        x, y = 0.5 * (x0 + x1), 0.5 * (y0 + y1)
        if opening.along_x:
            hinge, heading = ((x1, y), math.pi) if flip else ((x0, y), 0.0)
        else:
            hinge, heading = ((x, y1), -0.5 * math.pi) if flip else ((x, y0), 0.5 * math.pi)
        width = opening.width
        slides = rng.random() < what.sliding_share and _in_wall(grid, hinge, heading, width)
        ways = [turn for turn in (way, -way) if _in_room(layout, hinge, heading + turn, width)]
        if slides or ways:
            travel = -width if slides else float(ways[0])
            # Whom a leaf swings at has to find it open: it begins its own length sooner.
            near = what.trigger_distance if slides else what.trigger_distance + width
            found.append(door(hinge, heading, width, travel, swings=not slides, near=near))
    return found


def _in_room(layout: Building, hinge: tuple[float, float], heading: float, width: float) -> bool:
    """Whether the far end of an open leaf is in a room."""
    col = (hinge[0] + width * math.cos(heading)) / CELL
    row = (hinge[1] + width * math.sin(heading)) / CELL
    return any(r.x0 <= col <= r.x1 and r.y0 <= row <= r.y1 for r in layout.rooms)


def _in_wall(grid: OccupancyGrid, hinge: tuple[float, float], heading: float, width: float) -> bool:
    """Whether a leaf that slides back behind its hinge is inside the wall."""
    back = np.arange(0.5 * CELL, width, 0.5 * CELL)[:, None]
    points = np.array(hinge) - back * (math.cos(heading), math.sin(heading))
    if not grid.inside(points).all():
        return False
    cells = grid.to_cell(points)
    return bool((grid.cells[cells[:, 0], cells[:, 1]] == OCCUPIED).all())


def sample_furniture(
    rng: np.random.Generator, grid: OccupancyGrid, density: float, start: Array, taken: list[Array]
) -> list[Actor]:
    """Movable furniture; `taken` as in `sample_people`."""
    places = np.argwhere(grid.traversable(_CLEAR))
    found: list[Actor] = []
    for _ in range(round(density * free_area(grid)) if len(places) else 0):
        size, mass = _PIECES[rng.integers(len(_PIECES))]
        x, y = _draw_place(rng, grid, places)
        yaw = rng.uniform(-math.pi, math.pi)
        reach = math.hypot(*size) / (2.0 if size[1] else 1.0)
        if math.dist((x, y), start[:2]) < 1.5:
            continue
        if all(math.dist((x, y), at[:2]) > reach + at[2] + 0.1 for at in taken):
            taken.append(np.array([x, y, reach]))
            found.append(furniture((float(x), float(y), float(yaw)), size, mass))
    return found


_CROWD_TRIES = 200  # halls drawn before the settings are called impossible
_CLEARANCE = 0.15  # m round the footprint at start and goal, as in the other scenes
_COLUMNS = 0.02  # 1/m2 of a hall


@settings
class Crowd:
    """People who walk through a building or a hall, with powered doors and light furniture."""

    place: Literal["any", "building", "hall"] = setting(default="any", source="design choice")
    """Where people walk; any draws one of the two."""
    people: PeopleSettings = PeopleSettings()
    doors: DoorSettings = DoorSettings()
    furniture_density: float = setting(
        default=0.01, unit="1/m2", low=0.0, high=1.0, source="design choice"
    )
    """Movable pieces of furniture per free area."""
    building: FloorPlan = FloorPlan()
    hall_size: tuple[float, float] = setting(
        default=(9.0, 14.0), unit="m", low=5.0, high=60.0, source="design choice"
    )
    """Least and greatest side of a hall."""

    def __post_init__(self) -> None:
        if self.hall_size[0] > self.hall_size[1]:
            raise InputError(f"Crowd.hall_size is {self.hall_size}; expected from, to")

    def sample(self, rng: np.random.Generator, footprint: Footprint = FOOTPRINT) -> Episode:
        """Draw a building or hall that the footprint fits, then everything that moves in it.

        Raises:
            InputError: the settings leave no start and goal.
        """
        return self.sample_building(rng, footprint)[1]

    def sample_building(
        self, rng: np.random.Generator, footprint: Footprint = FOOTPRINT
    ) -> tuple[Building | None, Episode]:
        """The same, with the rooms, corridors and doors where it is a building."""
        layout: Building | None = None
        if self.place == "building" or (self.place == "any" and rng.random() < 0.5):
            layout, episode = self.building.sample_building(rng, footprint)
        else:
            episode = self._hall(rng, footprint)
        taken: list[Array] = []
        start, grid = episode.start, episode.map
        things = sample_furniture(rng, grid, self.furniture_density, start, taken)
        leaves = [] if layout is None else sample_doors(rng, grid, layout, self.doors)
        people = sample_people(rng, grid, start, self.people, taken, leaves)
        actors = combine([*things, *leaves, *people])
        return layout, dataclasses.replace(episode, actors=actors, name="crowd")

    def _hall(self, rng: np.random.Generator, footprint: Footprint) -> Episode:
        """An open hall with a few columns; start and goal far apart."""
        for _ in range(_CROWD_TRIES):
            width, height = rng.uniform(*self.hall_size, 2)
            count = round(_COLUMNS * width * height)
            discs = np.column_stack(
                [
                    rng.uniform(1.0, width - 1.0, count),
                    rng.uniform(1.0, height - 1.0, count),
                    rng.uniform(0.15, 0.30, count),
                ]
            )
            ground = make_arena((0.0, 0.0, width, height), discs=discs)
            drawn = [
                np.array([*rng.uniform(0.8, (width - 0.8, height - 0.8)), rng.uniform(-3, 3)])
                for _ in range(2)
            ]
            start, goal = drawn
            if not all(
                is_free_pose(pose, ground.walls, discs, footprint, _CLEARANCE) for pose in drawn
            ):
                continue
            far = float(geodesic(ground.map, goal[:2], passing_radius(footprint)).at(start[:2]))
            if 0.6 * self.hall_size[0] <= far < np.inf:
                return Episode(ground.map, start, goal, ground.walls, discs)
        raise InputError(
            f"Crowd: {_CROWD_TRIES} halls had no start and goal for {footprint} in {self}"
        )


_ENDS = 2.0  # m of the way at start and goal where nothing appears


@settings
class Temporary:
    """A floor plan in which discs appear for a while on the shortest path ahead of the chair.

    The chair plans a new path round them or waits until they are gone (docs/sources.md, T1).
    """

    count: tuple[int, int] = setting(default=(1, 3), low=0, high=20, source="design choice")
    """Least and greatest number of obstacles."""
    radius: tuple[float, float] = setting(
        default=(0.15, 0.35), unit="m", low=0.05, high=1.0, source="from a bag to a trolley"
    )
    """Least and greatest radius of an obstacle."""
    trigger_distance: tuple[float, float] = setting(
        default=(1.5, 3.0), unit="m", low=0.1, source="design choice"
    )
    """Least and greatest distance of the chair at which an obstacle appears."""
    min_distance: float = setting(
        default=1.2, unit="m", low=0.9, source="a stop from 0.8 m/s takes 0.88 m"
    )
    """Distance of the chair below which no obstacle appears."""
    duration: tuple[float, float] = setting(
        default=(5.0, 20.0), unit="s", low=0.1, high=600.0, source="design choice"
    )
    """Shortest and longest time for which an obstacle stays."""
    lateral_offset: float = setting(
        default=0.15, unit="m", low=0.0, high=1.0, source="design choice"
    )
    """Largest offset of an obstacle from the path, along x and y."""
    building: FloorPlan = FloorPlan()

    def __post_init__(self) -> None:
        for name in ("count", "radius", "trigger_distance", "duration"):
            low, high = getattr(self, name)
            if low > high:
                raise InputError(f"Temporary.{name} is {low}, {high}; expected from, to")
        if self.trigger_distance[0] <= self.min_distance:
            raise InputError(
                f"Temporary.trigger_distance is {self.trigger_distance}; expected more than "
                f"min_distance, {self.min_distance} m"
            )

    def sample(self, rng: np.random.Generator, footprint: Footprint = FOOTPRINT) -> Episode:
        """Draw a floor plan, and obstacles that appear on the shortest path.

        Raises:
            InputError: the plan's settings leave no start and goal.
        """
        return self.sample_building(rng, footprint)[1]

    def sample_building(
        self, rng: np.random.Generator, footprint: Footprint = FOOTPRINT
    ) -> tuple[Building, Episode]:
        """The same, with the rooms, corridors and doors of the building."""
        layout, episode = self.building.sample_building(rng, footprint)
        radius = passing_radius(footprint)
        path = geodesic(episode.map, episode.goal[:2], radius).path(episode.start[:2])
        way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
        things: list[Actor] = []
        count = int(rng.integers(self.count[0], self.count[1] + 1))
        if way[-1] > 2.0 * _ENDS:
            spots = np.sort(rng.uniform(_ENDS, way[-1] - _ENDS, count))
            for at in spots:
                x, y = (float(np.interp(at, way, path[:, k])) for k in range(2))
                things.append(
                    obstacle(
                        (
                            x + rng.uniform(-self.lateral_offset, self.lateral_offset),
                            y + rng.uniform(-self.lateral_offset, self.lateral_offset),
                        ),
                        float(rng.uniform(*self.radius)),
                        near=float(rng.uniform(*self.trigger_distance)),
                        least=self.min_distance,
                        stay=float(rng.uniform(*self.duration)),
                    )
                )
        return layout, dataclasses.replace(episode, actors=combine(things), name="temporary")
