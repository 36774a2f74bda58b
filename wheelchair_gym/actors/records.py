"""Actors of a world, besides the chair, as arrays: people, doors, obstacles, furniture.

An actor is a record of ACTOR; the routes of people stand in one table beside it. The simulation
moves them, and sensors see their discs and segments.
"""

import math
from collections.abc import Iterable
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wheelchair_gym.base.arrays import Array, Rows
from wheelchair_gym.base.errors import shorten
from wheelchair_gym.base.settings import FARTHEST, InputError
from wheelchair_gym.compiled.address import as_array, read_record
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.geometry.planar import polygon_edges, to_world

PERSON, DOOR, OBSTACLE, FURNITURE = range(4)
ACTOR_KINDS: Final = ("person", "door", "obstacle", "furniture")

# What a person keeps clear of, beside walls and things.
NOBODY, PEOPLE, EVERYBODY = range(3)

# How a person gets where they want: `orca.py`, `social_force.py`.
ORCA, SOCIAL_FORCE = range(2)
MODELS: Final = ("orca", "social_force")

# What a person does: `behaviours.py`.
WALKS, PAUSES, CUTS_IN, READS_PHONE, WALKS_BESIDE, RUNS = range(6)
BEHAVIOURS: Final = ("walks", "pauses", "cuts_in", "reads_phone", "walks_beside", "runs")

# And how they react to a chair that they see.
REGULAR, CURIOUS, WARY, SURPRISED, INDIFFERENT = range(5)
REACTIONS: Final = ("regular", "curious", "wary", "surprised", "indifferent")

RADIUS: Final = 0.25  # m, of a person: shoulders 0.5 m wide (Fruin 1971: body ellipse 0.6 x 0.45)
MASS: Final = 75.0  # kg, of a person: ISO 7176-11's middle dummy
SPEED: Final = 1.34  # m/s that people prefer (Weidmann 1993; standard deviation 0.26 m/s)
INATTENTIVE_DISTANCE: Final = 1.0  # m at which people who pay no attention see a chair: a step
FLOOR: Final = 0.4  # friction of furniture on the floor: felt or rubber feet on vinyl
LEAF_TURN: Final = 1.0  # rad/s of a swing door: 90 degrees in under 2 s
LEAF_SPEED: Final = 0.5  # m/s of a sliding door
LEAF_WIDTH: Final = 0.04  # m, thickness of a leaf: DIN 68706-1, 39 to 42 mm
FASTEST: Final = 1.5  # m/s of who does more than walk, and of trolleys: as the shield expects
TROLLEY: Final = (0.60, 0.40)  # m: length and width of a serving trolley
TROLLEY_MASS: Final = 20.0  # kg: loaded
FIRST_LOOK: Final = 0.5  # m: at way points nearer than this nobody looks first
GROUP_SIZES: Final = (2, 3, 4)
_HANDLE = 0.10  # m between a trolley and who pushes it
ABREAST: Final = 0.75  # m between neighbours of a group (Moussaid et al. 2010: 0.8 m)
_AHEAD = 0.3  # m that the wings of a V are ahead of its middle
# (ahead, to the left) [m] of those who walk with the first of a group: a V from three on
PLACES_OF_GROUP: Final = ((0.0, ABREAST),), ((_AHEAD, ABREAST), (_AHEAD, -ABREAST)), (
    (_AHEAD, ABREAST), (_AHEAD, -ABREAST), (-0.8, 0.0)
)  # fmt: skip

ACTOR = read_record("ACTOR", globals())[0]


class Actors(NamedTuple):
    """All actors of an episode."""

    rows: Rows  # (k,) of ACTOR
    routes: Array  # (r, 2) m: way points of all people, one after another

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def discs(self) -> int:
        """Number of round ones."""
        return int((self.rows["size"][:, 1] == 0.0).sum())

    @property
    def leaves(self) -> int:
        """Number of doors."""
        return int((self.rows["kind"] == DOOR).sum())

    @property
    def boxes(self) -> int:
        """Number of boxes."""
        return int((self.rows["size"][:, 1] > 0.0).sum()) - self.leaves

    @property
    def segments(self) -> int:
        """Number of segments that they show to the sensors."""
        return 4 * (self.leaves + self.boxes)

    def route(self, number: int) -> Array:
        """The way points (n, 2) [m] of one person."""
        row: Any = self.rows[number]
        return self.routes[row["first"] : row["first"] + row["points"]]


class Actor(NamedTuple):
    """One actor before it is put with others."""

    row: Rows  # (1,) of ACTOR
    route: Array  # (n, 2) m


def no_actors() -> Actors:
    """Return the actors of a world where nothing else moves."""
    return Actors(np.zeros(0, ACTOR), np.empty((0, 2)))


def check_actors(actors: Actors) -> Actors:
    """The actors, once every number is one that kernels can take.

    Raises:
        InputError: an array has a wrong shape or type, or a value is out of bounds.
    """
    rows = as_array(actors.rows, ACTOR, (None,), "Actors.rows")
    routes = as_array(actors.routes, np.float64, (None, 2), "Actors.routes", FARTHEST)
    for key in ("pose", "size", "friction", "speed", "travel", "minimum", "offset"):
        as_array(rows[key], np.float64, (None, *ACTOR[key].shape), f"Actors.rows.{key}", FARTHEST)
    walks, is_door, size = rows["kind"] == PERSON, rows["kind"] == DOOR, rows["size"]
    first, points = rows["first"], rows["points"]
    leader, numbers = rows["leader"], np.arange(len(rows))
    led = (leader >= 0) & (leader <= numbers)
    moved = walks | ((rows["kind"] == FURNITURE) & (size[:, 1] > 0.0))
    moved &= walks[numbers - np.where(led, leader, 0)]
    led &= (leader == 0) | moved
    right = {
        "kind": (rows["kind"] >= 0) & (rows["kind"] < len(ACTOR_KINDS)),
        "size": (size[:, 0] > 0.0) & ((size[:, 1] > 0.0) | (size[:, 1] == 0.0) & ~is_door),
        "mass": (rows["mass"] > 0.0) & (np.isfinite(rows["mass"]) | ~walks & (leader == 0)),
        "friction": rows["friction"] >= 0.0,
        "speed": rows["speed"] >= 0.0,
        "avoids": (rows["avoids"] >= NOBODY) & (rows["avoids"] <= EVERYBODY),
        "first": (first >= 0) & (first <= len(routes)),
        "points": (points >= walks) & (points <= len(routes) - first),
        "model": (rows["model"] >= 0) & (rows["model"] < len(MODELS)),
        "behaviour": (rows["behaviour"] >= 0) & (rows["behaviour"] < len(BEHAVIOURS)),
        "reaction": (rows["reaction"] >= 0) & (rows["reaction"] < len(REACTIONS)),
        "leader": led,
        "every": (rows["every"] > 0.0) | ((rows["every"] == 0.0) & (rows["behaviour"] == WALKS)),
    } | {name: rows[name] >= 0.0 for name in ("patience", "near", "since", "stay")}
    for name, fits in right.items():
        if not fits.all():
            k = int(np.flatnonzero(~fits)[0])
            raise InputError(f"actor {k}: {name} is {rows[name][k]}, which is out of bounds")
    return Actors(rows, routes)


def combine(actors: Iterable[Actor]) -> Actors:
    """Actors as the arrays of one episode."""
    rows, routes, begin = [], [np.empty((0, 2))], 0
    for row, route in actors:
        kept = row.copy()
        kept["first"], kept["points"] = begin, len(route)
        begin += len(route)
        rows.append(kept)
        routes.append(route)
    if not rows:
        return no_actors()
    return Actors(np.concatenate(rows), np.ascontiguousarray(np.concatenate(routes)))


def _actor(kind: int, route: ArrayLike = (), **fields: Any) -> Actor:
    row = np.zeros(1, ACTOR)
    row["kind"], row["mass"] = kind, math.inf
    for name in ("near", "stay", "every"):
        row[name] = math.inf
    for name, value in fields.items():
        field, where = ACTOR[name], f"{ACTOR_KINDS[kind]}: {name}"
        row[name] = as_array(value, field.base, field.shape, where)
        if np.isnan(row[name]).any():
            raise InputError(f"{where} is NaN; expected a number")
    size = row["size"][0]
    if not (size[0] > 0.0 and size[1] >= 0.0 and row["mass"][0] > 0.0 and row["speed"][0] >= 0.0):
        raise InputError(
            f"{ACTOR_KINDS[kind]}: size {size.tolist()}, mass {row['mass'][0]:g}, "
            f"speed {row['speed'][0]:g}; expected positive numbers"
        )
    return Actor(row, np.asarray(route, np.float64).reshape(-1, 2))


def _place(value: ArrayLike, where: str) -> Array:
    """Check a place (2,) [m]."""
    return as_array(value, np.float64, (2,), where, FARTHEST)


def person(
    route: ArrayLike,
    speed: float = SPEED,
    *,
    avoids: int = EVERYBODY,
    radius: float = RADIUS,
    mass: float = MASS,
    patience: float = 4.0,
    at: ArrayLike | None = None,
    model: int = ORCA,
    behaviour: int = WALKS,
    reaction: int = REGULAR,
    near: float = math.inf,
    since: float = 0.0,
    stay: float = math.inf,
    every: float = math.inf,
    leader: int = 0,
    offset: tuple[float, float] = (0.0, 0.0),
) -> Actor:
    """Someone who walks a route there and back, again and again.

    Args:
        route: way points (n, 2) [m], one at least.
        speed: preferred [m/s].
        avoids: EVERYBODY, PEOPLE (pays no attention: notices the chair when it is a step away) or
            NOBODY (a crossing cylinder, as in DynaBARN).
        radius: [m].
        mass: [kg].
        patience: without getting on, after which they turn back [s].
        at: where they stand first (2,) [m]; the first way point if left out.
        model: how they get where they want: ORCA or SOCIAL_FORCE.
        behaviour: WALKS; PAUSES (stands from `since` on for `stay`, and again after `every`);
            CUTS_IN (goes to stand before a chair that is `near`, for `stay`, 10 s at most with the
            way there, and not again for `every`); READS_PHONE (notices chair and people when they
            are a step away); WALKS_BESIDE (keeps an `offset` from the chair) or RUNS (turns aside
            or stands, anew after `every`).
        reaction: to a chair that they see: REGULAR, CURIOUS, WARY, SURPRISED or INDIFFERENT.
        near: of what starts a behaviour [m].
        since: of a behaviour [s].
        stay: of a behaviour [s].
        every: of a behaviour [s].
        leader: of their group, as the number of actors before this one; 0: nobody.
        offset: ahead of the leader or the chair, and to the left (2,) [m].

    Raises:
        InputError: a value is out of bounds.
    """
    for name, number, known in (
        ("model", model, MODELS), ("behaviour", behaviour, BEHAVIOURS),
        ("reaction", reaction, REACTIONS),
    ):  # fmt: skip
        if number not in range(len(known)):
            raise InputError(
                f"person: {name} is {shorten(number)}; expected 0 to {len(known) - 1}: "
                + ", ".join(known)
            )
    if behaviour == READS_PHONE:
        avoids = min(avoids, PEOPLE)
    if behaviour != WALKS and not every > 0.0:
        raise InputError(f"person: every is {every:g} s; expected a positive number")
    points = as_array(route, np.float64, (None, 2), "person: route", FARTHEST)
    if not len(points):
        raise InputError("person: the route has no way points; expected one at least")
    x, y = _place(points[0] if at is None else at, "person: at")
    return _actor(
        PERSON, points, pose=(x, y, 0.0), size=(radius, 0.0), mass=mass, speed=speed, avoids=avoids,
        patience=patience, model=model, behaviour=behaviour, reaction=reaction, near=near,
        since=since, stay=stay, every=every, leader=leader, offset=offset,
    )  # fmt: skip


@borrowing_kernel
def first_heading(route: Array, x: float, y: float) -> float:
    """Initial heading of a person at (x, y) [rad]: towards the first way point elsewhere."""
    for k in range(route.shape[0]):
        dx, dy = route[k, 0] - x, route[k, 1] - y
        if math.sqrt(dx * dx + dy * dy) > FIRST_LOOK:
            return math.atan2(dy, dx)
    return 0.0


def group(first: Actor, size: int, speed: float) -> list[Actor]:
    """People who walk together: the first one, and others at places beside them.

    Args:
        first: a person, who leads.
        size: how many they are, 2 to 4.
        speed: with which those who fall behind catch up [m/s].

    Raises:
        InputError: the size is out of bounds.
    """
    if size not in GROUP_SIZES:
        raise InputError(f"group: size is {shorten(size)}; expected 2, 3 or 4")
    x, y, _ = first.row["pose"][0]
    found, pose = [first], (x, y, first_heading(first.route, x, y))
    for number, offset in enumerate(PLACES_OF_GROUP[size - 2], start=1):
        row = first.row.copy()
        row["leader"], row["offset"], row["speed"] = number, offset, speed
        row["pose"][0, :2] = to_world(np.array(offset), pose)
        found.append(Actor(row, first.route))
    return found


def with_trolley(walker: Actor, ahead: bool = True) -> list[Actor]:
    """A person who pushes a trolley, or pulls it if it is not `ahead`, and that trolley.

    Args:
        walker: who walks with it.
        ahead: before the person; else behind.
    """
    row = walker.row.copy()
    row["mass"] += TROLLEY_MASS  # legs move both
    far = float(walker.row["size"][0, 0]) + _HANDLE + 0.5 * TROLLEY[0]
    offset = (far if ahead else -far, 0.0)
    x, y, _ = walker.row["pose"][0]
    yaw = first_heading(walker.route, x, y)
    x, y = to_world(np.array(offset), (x, y, yaw))
    trolley = _actor(
        FURNITURE, pose=(x, y, yaw), size=TROLLEY, mass=TROLLEY_MASS, leader=1, offset=offset
    )
    return [Actor(row, walker.route), trolley]


def door(
    hinge: tuple[float, float],
    heading: float,
    length: float,
    travel: float,
    *,
    swings: bool = True,
    near: float = 0.0,
    since: float = 0.0,
    stay: float = 0.0,
    every: float = math.inf,
    minimum: float = 0.10,
) -> Actor:
    """A leaf that opens on a timetable, or for anyone near its doorway's middle.

    It never moves towards anything nearer than `minimum`: what it meets holds it, as EN 16005 asks
    of powered doors.

    Args:
        hinge: one end of the leaf when shut (2,) [m].
        heading: from there to the other end [rad].
        length: of the leaf [m].
        travel: to stand open: turned by this [rad], or moved along itself by this [m]; signed.
        swings: about the hinge; else it slides.
        near: opens when the chair or a person is so near [m]; 0: for nobody.
        since: first opens by itself [s].
        stay: how long it then stays open [s]; 0: it has no timetable.
        every: after which it does so again [s].
        minimum: kept from everything while it moves [m].
    """
    speed = LEAF_TURN if swings else LEAF_SPEED
    pose = (*_place(hinge, "door: hinge"), heading)
    return _actor(
        DOOR, pose=pose, size=(length, LEAF_WIDTH), speed=speed, travel=travel,
        swings=int(bool(swings)), near=near, since=since, stay=stay, every=every, minimum=minimum,
    )  # fmt: skip


def obstacle(
    place: tuple[float, float],
    radius: float = 0.25,
    *,
    since: float = 0.0,
    stay: float = 10.0,
    near: float = math.inf,
    minimum: float = 1.2,
) -> Actor:
    """Something round that appears once, stays for a while and is gone again.

    Args:
        place: its centre (2,) [m].
        radius: [m].
        since: not before [s].
        stay: [s].
        near: appears once the chair's outline is so near [m].
        minimum: never nearer to the chair's outline than this [m]; more than its stopping distance.
    """
    pose = (*_place(place, "obstacle: place"), 0.0)
    return _actor(
        OBSTACLE, pose=pose, size=(radius, 0.0), since=since, stay=stay, near=near, minimum=minimum
    )


def furniture(
    pose: tuple[float, float, float],
    size: tuple[float, float],
    mass: float,
    friction: float = FLOOR,
) -> Actor:
    """Something light that can be pushed: a box, or a disc where the width is 0.

    Args:
        pose: of its centre (3,) [m, m, rad].
        size: length and width, or radius and 0 [m].
        mass: [kg].
        friction: on the floor.
    """
    return _actor(FURNITURE, pose=pose, size=size, mass=mass, friction=friction)


def actor_shapes(actors: Actors, poses: Array) -> tuple[Array, Array]:
    """Discs (m, 3) and segments (s, 4) [m] that actors show at poses (k, 3) [m, m, rad].

    What is not there (its pose is NaN) shows nothing.
    """
    discs, segments = [np.empty((0, 3))], [np.empty((0, 4))]
    for row, (x, y, yaw) in zip(actors.rows, poses, strict=True):
        if not math.isfinite(x):
            continue
        outline = actor_outline(row, x, y, yaw)
        if len(outline) == 1:
            discs.append(np.array([(x, y, row["size"][0])]))
        else:
            segments.append(polygon_edges(outline))
    return np.concatenate(discs), np.concatenate(segments)


def actor_outline(row: Any, x: float, y: float, yaw: float) -> Array:
    """Points of an actor at a pose: its centre (1, 2) if round, else its corners (4, 2) [m]."""
    length, width = row["size"]
    if width == 0.0:
        return np.array([(x, y)])
    front, b = length if row["kind"] == DOOR else 0.5 * length, 0.5 * width
    rear = front - length
    corners = np.array([(rear, -b), (front, -b), (front, b), (rear, b)])
    return to_world(corners, (x, y, yaw))


def leaf_line(row: Any, x: float, y: float, yaw: float) -> Array:
    """The middle line (2, 2) [m] of a leaf at a pose, from its hinge to its other end."""
    length = row["size"][0]
    return np.array([(x, y), (x + math.cos(yaw) * length, y + math.sin(yaw) * length)])
