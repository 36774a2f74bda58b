"""People in a scene: how many, what kinds of people, and the routes that they walk.

Passages with people are a corridor, a crossing of two corridors, and a lift to go into: walls,
start and goal, and where people walk. A new passage is a name in `PassageName` and a function in
`PASSAGES`.
"""

import math
from collections.abc import Callable
from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.actors import records
from wheelchair_gym.actors.records import RADIUS, Actor, person
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import InputError, Range, setting, settings
from wheelchair_gym.geometry.outline import Footprint
from wheelchair_gym.geometry.planar import to_world
from wheelchair_gym.maps import FREE, OCCUPIED, Geodesic, OccupancyGrid, geodesic
from wheelchair_gym.scenes.arena import WALL, Arena, make_arena, poses_along
from wheelchair_gym.scenes.raster import CELL

Span = tuple[float, float]

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


def _on_raster(rng: np.random.Generator, low_high: Span) -> float:
    return CELL * round(rng.uniform(*low_high) / CELL)


def _draw_lane(rng: np.random.Generator, length: float, width: float) -> tuple[Array, Array]:
    """Place and route along a corridor that begins at (0, 0), in either direction."""
    y = rng.uniform(_GAP, width - _GAP)
    ends = np.array([(length - _TURN_AT, y), (_TURN_AT, y)])
    return np.array([rng.uniform(_TURN_AT, length - _TURN_AT), y]), ends[:: rng.choice((-1, 1))]


def draw_corridor(rng: np.random.Generator, footprint: Footprint, widths: Span) -> Passage:
    """Draw a straight corridor that people walk up and down, each on a lane of their own."""
    length, width = _on_raster(rng, _LENGTH), _on_raster(rng, widths)
    beside = footprint.half_width + 0.25  # m
    ends = rng.uniform(beside, width - beside, 2) if width > 2.0 * beside else [0.5 * width] * 2
    start, goal = poses_along((_END, ends[0]), (length - _END, ends[1]))
    start[2] = goal[2] = 0.0
    arena = make_arena((0.0, 0.0, length, width))
    return Passage(arena, start, goal, lambda r: _draw_lane(r, length, width), length * width)


def draw_crossing(rng: np.random.Generator, footprint: Footprint, widths: Span) -> Passage:
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


def draw_lift(rng: np.random.Generator, footprint: Footprint, widths: Span) -> Passage:
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


WALKING_RADIUS = records.RADIUS + 0.10  # m: people's routes keep this from walls
_PLACES = 8  # where people are going to: each costs one geodesic
_TRIES = 60  # starts drawn for one person before they stay away
_TRIES_TOGETHER = 20  # of groups and trolleys, before somebody walks alone
_MIN_WAY = 3.0  # m: shorter routes are no routes
_PAIR = 0.7  # m between people at the beginning

CHILD: Final = 0.18, 25.0  # m, kg: radius and mass at some eight years
_RUN_TIME = 1.5  # s for which a child runs one way
_PHONE_SHARE = 0.77  # of the speed: 19.3 s instead of 25.0 s (Licence et al. 2015)
_TROLLEY_SPEED = 1.0  # m/s: its far end, turned by 1 rad/s, then moves with 1.45 m/s
_PUSHED_SHARE = 0.7  # of trolleys; the others are pulled
_PAUSE, _BETWEEN_PAUSES = (2.0, 8.0), (5.0, 15.0)  # s
_CUTS_WITHIN, _CUTS, _CUTS_AGAIN, _CUTTING_SPEED = 3.0, (3.0, 6.0), 20.0, 1.2  # m, s, s, m/s
_BESIDE, _BESIDE_SPEED = 0.85, 1.1  # m from the chair's middle, m/s
_ROOM_BESIDE = 0.4  # m: radius of the room for a trolley, and for each of a group


class _Shares:
    """Shares of people, which add up to 1 at most; the others do nothing special."""

    def __post_init__(self) -> None:
        if self.total > 1.0 + 1e-9:
            what = type(self).__name__
            raise InputError(f"{what} add up to {self.total:g}; expected 1 at most")

    @property
    def total(self) -> float:
        """The share of those who do something special."""
        return float(sum(vars(self).values()))

    def spread(self, start: float, count: int) -> list[str]:
        """Return what each of `count` people does: a name of a share, or "".

        The spread is even, shifted by `start` in [0, 1): a share of 1/count always gets a person.
        """
        names, ends = ["", *vars(self)], np.cumsum([1.0 - self.total, *vars(self).values()])
        at = (start + np.arange(count)) / max(count, 1)
        return [names[min(k, len(names) - 1)] for k in np.searchsorted(ends, at, side="right")]


@settings
class BehaviourShares(_Shares):
    """Shares of people who do more than walk along their routes."""

    groups: float = setting(default=0.0, low=0.0, high=1.0, source="Moussaid 2010: up to 0.7")
    """Share of people who walk in groups of two to four."""
    pauses: float = setting(default=0.0, low=0.0, high=1.0)
    """Share of people who stop for a while, again and again."""
    cuts_in: float = setting(default=0.0, low=0.0, high=1.0)
    """Share of people who step before the chair and walk there for a while."""
    reads_phone: float = setting(default=0.0, low=0.0, high=1.0)
    """Share of people who look at a phone: slower, and they notice others only a step away."""
    walks_beside: float = setting(default=0.0, low=0.0, high=1.0)
    """Share of people who walk beside the chair; two at most."""
    children: float = setting(default=0.0, low=0.0, high=1.0)
    """Share of people who are children and run."""
    trolleys: float = setting(default=0.0, low=0.0, high=1.0)
    """Share of people who push a trolley, or pull it."""


@settings
class ReactionShares(_Shares):
    """Shares of people who react to the chair otherwise than to another person.

    People who cut in, walk beside the chair or in a group are not counted: they do not react so.
    """

    curious: float = setting(default=0.0, low=0.0, high=1.0, source="HuNavSim's reaction")
    """Share of people who come near and look."""
    wary: float = setting(default=0.0, low=0.0, high=1.0, source="HuNavSim's reaction: scared")
    """Share of people who keep wide of the chair, and slow down."""
    surprised: float = setting(default=0.0, low=0.0, high=1.0, source="HuNavSim's reaction")
    """Share of people who stop and look."""
    indifferent: float = setting(default=0.0, low=0.0, high=1.0, source="HuNavSim: impassive")
    """Share of people who treat the chair as a thing that stands."""


# m/s: deviation of preferred speeds (Weidmann 1993), and the least, with a walking frame
_SPEED_SIGMA, _MIN_SPEED = 0.26, 0.4
_START_DISTANCE = 2.0  # m: smallest distance of people from the chair's start


@settings
class PeopleSettings:
    """Number and behaviour of people."""

    density: Range[float] = setting(default=(0.03, 0.08), unit="1/m2", low=0.0, high=1.0)
    """Range of the number of people per free area; of a lift, per area of its cabin."""
    speed: float = setting(default=records.SPEED, unit="m/s", low=0.1, source="Weidmann 1993")
    """Mean preferred walking speed."""
    inattentive_share: float = setting(default=0.1, low=0.0, high=1.0)
    """Share of people who do not see the chair."""
    crossing_share: float = setting(default=0.0, low=0.0, high=1.0, source="DynaBARN")
    """Share of moving cylinders that avoid nobody."""
    model: Literal["orca", "social_force"] = setting(default="orca")
    """How people avoid others: optimal reciprocal collision avoidance, or the headed social force
    model."""
    behaviours: BehaviourShares = BehaviourShares()
    reactions: ReactionShares = ReactionShares()

    @property
    def only_walk(self) -> bool:
        """Whether all people do nothing but walk along their routes."""
        return self.behaviours.total == 0.0 and self.reactions.total == 0.0


def free_area(grid: OccupancyGrid) -> float:
    """Area [m2] of the map that is free."""
    return float((grid.cells == FREE).sum()) * grid.resolution**2


def draw_place(rng: np.random.Generator, grid: OccupancyGrid, cells: NDArray[np.intp]) -> Array:
    """A place (2,) [m] in one of the cells (n, 2)."""
    cell = cells[rng.integers(len(cells))]
    return grid.to_world(cell) + rng.uniform(-0.4, 0.4, 2) * grid.resolution


def cells_along(grid: OccupancyGrid, a: Array, b: Array, steps: float) -> NDArray[np.int64]:
    """Cells (n, 2) at even steps along the segment a-b, its ends included."""
    shares = np.linspace(0.0, 1.0, 2 + math.ceil(steps))
    return grid.to_cell(a + shares[:, None] * (b - a))


def sample_people(
    rng: np.random.Generator,
    grid: OccupancyGrid,
    start: Array,
    people: PeopleSettings,
    taken: list[Array],
    leaves: list[Actor],
) -> list[Actor]:
    """People on routes between places of a map; none begins where a leaf swings.

    `start` is the chair's pose (3,). Something stands already at the places (x, y, reach) `taken`,
    to which those of people are added. Routes lead round leaves where they stand open.
    """
    count = round(rng.uniform(*people.density) * free_area(grid))
    grid = with_open_doors(grid, leaves)
    cells = np.argwhere(grid.traversable(WALKING_RADIUS))
    for leaf in leaves:
        hinge, length = leaf.row["pose"][0, :2], leaf.row["size"][0, 0]
        far = np.hypot(*(grid.to_world(cells) - hinge).T) > length + WALKING_RADIUS
        cells = cells[far | ~leaf.row["swings"]]
    if not count or not len(cells):
        return []
    goals = [draw_place(rng, grid, cells) for _ in range(min(_PLACES, count))]
    paths = [geodesic(grid, goal, WALKING_RADIUS) for goal in goals]
    found: list[Actor] = []
    for kind in _draw_kinds(rng, people, count):
        speed, avoids = _draw_walker(rng, people)
        near = _too_near(start, taken)
        made: list[Actor] = []
        for _ in range(_TRIES_TOGETHER if kind.behaviour in TOGETHER else 1):
            route = _draw_route(rng, grid, cells, paths, avoids == records.NOBODY, near)
            if route is None:
                break
            who = person(route, speed, avoids=avoids)
            made = _make(rng, people, kind, who)
            if _fits(made, grid, near):
                break
            made = [who]
        if made:
            found += _place(made, kind, start, grid, taken)
    return found


TOGETHER: Final = ("groups", "trolleys")  # behaviours of more than one actor


class Kind(NamedTuple):
    """Behaviour and reaction of a walker: names of shares, and the size of their group."""

    behaviour: str = ""
    reaction: str = ""
    size: int = 1


def _draw_kinds(rng: np.random.Generator, people: PeopleSettings, count: int) -> list[Kind]:
    """Draw what `count` people do; a group is one entry."""
    if people.only_walk:
        return [Kind()] * count
    behaviours = people.behaviours.spread(rng.random(), count)
    in_groups = behaviours.count("groups")
    kinds = []
    while in_groups > 1:
        # Nobody is left over who would be a group of one.
        sizes = [n for n in records.GROUP_SIZES if n == in_groups or n + 1 < in_groups]
        kinds.append(Kind("groups", size=int(rng.choice(sizes))))
        in_groups -= kinds[-1].size
    others = [name for name in behaviours if name != "groups"] + [""] * in_groups
    react = [k for k, name in enumerate(others) if name not in ("cuts_in", "walks_beside")]
    reactions = dict(
        zip(rng.permutation(react), people.reactions.spread(rng.random(), len(react)), strict=True)
    )
    kinds += [Kind(name, reactions.get(k, "")) for k, name in enumerate(others)]
    return [kinds[k] for k in rng.permutation(len(kinds))]


def _make(
    rng: np.random.Generator, people: PeopleSettings, kind: Kind, walker: Actor
) -> list[Actor]:
    """A walker as a kind says, and who or what goes with them."""
    row = walker.row
    row["model"] = records.MODELS.index(people.model)
    if people.model != "orca" or not people.only_walk:
        row["speed"] = min(row["speed"][0], records.FASTEST)
    if kind.reaction:
        row["reaction"] = records.REACTIONS.index(kind.reaction)
    match kind.behaviour:
        case "groups":  # their mean speed: Moussaid et al. 2010
            row["speed"] = min(row["speed"][0], 1.24 - 0.08 * kind.size)
            return records.group(walker, kind.size, records.FASTEST)
        case "pauses":
            row["behaviour"], row["stay"] = records.PAUSES, rng.uniform(*_PAUSE)
            row["every"] = row["stay"] + rng.uniform(*_BETWEEN_PAUSES)
            row["since"] = rng.uniform(0.0, row["every"][0])
        case "cuts_in":
            row["behaviour"], row["stay"] = records.CUTS_IN, rng.uniform(*_CUTS)
            row["near"] = _CUTS_WITHIN
            row["every"], row["speed"] = _CUTS_AGAIN, max(row["speed"][0], _CUTTING_SPEED)
        case "reads_phone":
            row["behaviour"], row["speed"] = records.READS_PHONE, _PHONE_SHARE * row["speed"]
            row["avoids"] = min(row["avoids"][0], records.PEOPLE)
        case "children":
            row["behaviour"], row["every"], row["speed"] = records.RUNS, _RUN_TIME, records.FASTEST
            row["size"][0, 0], row["mass"] = CHILD
        case "trolleys":
            row["speed"] = min(row["speed"][0], _TROLLEY_SPEED)
            return records.with_trolley(walker, bool(rng.random() < _PUSHED_SHARE))
    return [walker]


def _fits(made: list[Actor], grid: OccupancyGrid, near: list[tuple[float, float, float]]) -> bool:
    """Whether there is room for those who go with the first of them."""
    free = grid.traversable(_ROOM_BESIDE)
    places = [each.row["pose"][0, :2] for each in made[1:]]
    return all(
        _is_free(grid, free, place) and all(math.dist(place, (x, y)) >= r for x, y, r in near)
        for place in places
    )


def _place(
    made: list[Actor], kind: Kind, start: Array, grid: OccupancyGrid, taken: list[Array]
) -> list[Actor]:
    """The same people, once their places are taken: beside the chair, if their kind walks there."""
    if kind.behaviour == "walks_beside":
        _put_beside_chair(made[0], start, grid, taken)
    room = [records.RADIUS] + [_ROOM_BESIDE] * (len(made) - 1)
    taken += [np.array([*each.row["pose"][0, :2], r]) for each, r in zip(made, room, strict=True)]
    return made


def _is_free(grid: OccupancyGrid, free: NDArray[np.bool_], place: Array) -> bool:
    """Whether a place (2,) [m] lies in one of the free cells of a map."""
    return bool(grid.inside(place)) and bool(free[tuple(grid.to_cell(place))])


def _put_beside_chair(walker: Actor, start: Array, grid: OccupancyGrid, taken: list[Array]) -> None:
    """Start a walker beside the chair, left or right, where it stays, if there is room."""
    free = grid.traversable(records.RADIUS)
    for offset in ((0.0, _BESIDE), (0.0, -_BESIDE)):
        place = to_world(np.array(offset), start)
        gap = min((math.dist(at[:2], place) for at in taken), default=math.inf)
        if _is_free(grid, free, place) and gap >= 2.0 * records.RADIUS:
            row = walker.row
            row["behaviour"], row["offset"] = records.WALKS_BESIDE, offset
            row["speed"] = max(row["speed"][0], _BESIDE_SPEED)
            row["pose"][0, :2] = place
            return


def _draw_walker(rng: np.random.Generator, people: PeopleSettings) -> tuple[float, int]:
    """Preferred speed [m/s] of somebody, and what they keep clear of."""
    speed = max(_MIN_SPEED, rng.normal(people.speed, _SPEED_SIGMA))
    if rng.random() < people.crossing_share:
        return speed, records.NOBODY
    return speed, records.PEOPLE if rng.random() < people.inattentive_share else records.EVERYBODY


def _too_near(start: Array, taken: list[Array]) -> list[tuple[float, float, float]]:
    """Discs (x, y, radius) [m] in which nobody begins."""
    near = [(*start[:2], _START_DISTANCE + records.RADIUS)]
    return near + [(*at[:2], _PAIR - records.RADIUS + at[2]) for at in taken]


def sample_passage_people(
    rng: np.random.Generator, passage: Passage, people: PeopleSettings, taken: list[Array]
) -> list[Actor]:
    """People of a passage; `taken` as in `sample_people`. In a lift there is one at least."""
    found: list[Actor] = []
    grid = passage.arena.map
    count = max(people.density[1] > 0.0, round(rng.uniform(*people.density) * passage.area))
    for kind in _draw_kinds(rng, people, count):
        speed, avoids = _draw_walker(rng, people)
        near = _too_near(passage.start, taken)
        for tried in range(_TRIES):
            place, route = passage.draw_walk(rng)
            if all(math.dist(place, (x, y)) >= radius for x, y, radius in near):
                who = person(route, speed, avoids=avoids, at=place)
                made = _make(rng, people, kind, who)
                if not _fits(made, grid, near):
                    if tried < _TRIES_TOGETHER:
                        continue
                    made = [who]
                found += _place(made, kind, passage.start, grid, taken)
                break
    return found


def with_open_doors(grid: OccupancyGrid, leaves: list[Actor]) -> OccupancyGrid:
    """A copy of the map on which leaves that swing stand open."""
    cells = grid.cells.copy()
    for leaf in leaves:
        row = leaf.row[0]
        if row["swings"]:
            x, y, heading = row["pose"]
            a, b = records.leaf_line(row, x, y, heading + row["travel"])
            on = cells_along(grid, a, b, 4.0 * row["size"][0] / grid.resolution)
            inside = ((on >= 0) & (on < grid.shape)).all(axis=1)
            cells[tuple(on[inside].T)] = OCCUPIED
    return OccupancyGrid(cells, grid.resolution, grid.origin)


def _draw_route(
    rng: np.random.Generator,
    grid: OccupancyGrid,
    cells: NDArray[np.intp],
    paths: list[Geodesic],
    straight: bool,
    near: list[tuple[float, float, float]],
) -> Array | None:
    """A route (n, 2) [m] that begins in one of the cells, or None where the draws were unlucky.

    It begins outside of the discs `near`, and leads to the goal of a geodesic or `straight` to
    another cell.
    """
    for _ in range(_TRIES):
        here = draw_place(rng, grid, cells)
        path = paths[rng.integers(len(paths))]
        if any(math.dist(here, (x, y)) < radius for x, y, radius in near):
            continue
        if straight:
            there = draw_place(rng, grid, cells)
            length = math.dist(here, there)
            on = cells_along(grid, here, there, length / grid.resolution)
            if length >= _MIN_WAY and grid.traversable(WALKING_RADIUS)[tuple(on.T)].all():
                return np.array([here, there])
        elif _MIN_WAY <= float(path.at(here)) < math.inf:
            route = path.path(here)
            if len(route) >= 2:
                return route
    return None
