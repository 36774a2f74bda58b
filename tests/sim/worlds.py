"""Worlds and chairs that several tests drive in."""

import math
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
import shapely

from wheelchair_gym.actors import records
from wheelchair_gym.geometry.planar import polygon_edges, to_world
from wheelchair_gym.safety import Shield
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.sim.chair import SimulatedChair
from wheelchair_gym.sim.settings import ChairSettings, PhysicsSettings
from wheelchair_gym.types import Episode, Reading


def box(
    half: float = 5.0, start: Any = (0.0, 0.0, 0.0), walls: Any = (), discs: Any = (),
    actors: Iterable[records.Actor] = (),
) -> Episode:  # fmt: skip
    """A square room of 2 x half, without a map, with further walls, discs and actors in it."""
    h = half
    around = np.array([(-h, -h, h, -h), (h, -h, h, h), (h, h, -h, h), (-h, h, -h, -h)])
    walls = np.vstack([around, np.reshape(walls, (-1, 4))])
    discs, nowhere = np.reshape(np.array(discs, float), (-1, 3)), np.zeros(3)
    return Episode(None, np.array(start), nowhere, walls, discs, actors=records.combine(actors))  # type: ignore[arg-type]


def wall_gaps(points: Any, walls: Any) -> Any:
    """Distances (n,) [m] from points (n, 2) to the nearest of walls (m, 4)."""
    sides = shapely.multilinestrings(np.reshape(walls, (-1, 2, 2)))
    return shapely.distance(shapely.points(points), sides)


def step(chair: SimulatedChair, shield: Shield, twist: Any, reading: Reading) -> Reading:
    """Drive for a period what the shield lets through of a twist; the next reading."""
    given = shield.filter(np.asarray(twist, float), reading)
    return chair.drive(given, shield.decision.protective)


def cluttered(seed: int, start: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Episode:
    """A room with rotated boxes and round posts about a free middle."""
    rng = np.random.default_rng(seed)
    walls: list[Any] = []
    while len(walls) < 11:
        x, y = rng.uniform(-5, 5, 2)
        if np.hypot(x, y) < 1.7:
            continue
        t, a, b = rng.uniform(0, np.pi), *rng.uniform(0.1, 0.5, 2)
        corners = np.array([(-a, -b), (a, -b), (a, b), (-a, b)])
        walls.append(polygon_edges(to_world(corners, (x, y, t))))
    angles = rng.uniform(-np.pi, np.pi, 5)
    radii = rng.uniform(0.05, 0.3, 5)
    discs = np.column_stack([3 * np.cos(angles), 3 * np.sin(angles), radii])
    return box(6.0, start, np.vstack(walls), discs)


def exact_chair(step: float = 0.01, **chair: Any) -> SimulatedChair:
    """A chair whose sensors and wheels do not err."""
    sensors = SensorSettings(noise=False)
    return SimulatedChair(ChairSettings(**chair), sensors, PhysicsSettings(step=step))


def placed(chair: SimulatedChair, episode: Episode, key: int = 0) -> SimulatedChair:
    """The chair, at the start of an episode."""
    chair.reset(episode, key)
    return chair


def drives(chair: Any, twist: Any, periods: int) -> Iterator[Reading]:
    """Drive with one twist for some periods; yield each reading."""
    for _ in range(periods):
        yield chair.drive(np.asarray(twist, float))


def drive_for(chair: Any, twist: Any, periods: int) -> Reading:
    """Drive with one twist for some periods; return the last reading."""
    *_, reading = drives(chair, twist, periods)
    return reading


def busy(seed: int, start: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Episode:
    """A room with everything that moves: people of each kind, doors, obstacles, furniture."""
    rng = np.random.default_rng(seed)
    things: list[records.Actor] = []
    spots = [(x, y) for x in (-3, -2, 2, 3) for y in (-3, -1.9, 1.9, 3)]
    rng.shuffle(spots)
    for avoids in (records.EVERYBODY, records.PEOPLE, records.NOBODY):
        for _ in range(2):
            way = np.array([spots.pop(), rng.uniform(-1, 1, 2), rng.uniform(-3, 3, 2)])
            things.append(records.person(way, rng.uniform(0.6, 1.6), avoids=avoids, patience=2.0))
    for size, mass in (((0.5, 0.4), 8.0), ((0.2, 0.0), 4.0), ((0.3, 0.3), 6.0)):
        things.append(records.furniture((*spots.pop(), rng.uniform(-3, 3)), size, mass))
    for near in (0.5, 2.5):
        place = rng.uniform(-2.5, 2.5, 2)
        things.append(records.obstacle(tuple(place), 0.2, since=near, stay=3.0, minimum=0.9))
    things.append(records.door((-3.9, 0.0), 0.0, 1.0, 1.5, near=2.0))
    things.append(
        records.door((3.9, 0.5), math.pi, 1.2, -1.2, swings=False, since=0.5, stay=1.5, every=4.0)
    )
    rng.shuffle(things)
    return box(4.0, start, discs=(0.0, 3.2, 0.2), actors=things)
