"""Worlds in pymunk: one Space for each chair, furnished at each reset.

A Space keeps more than its shapes: contact caches, the order of the broad phase. The canonical
entry leaves none of it: the chair goes far away, all walls and discs are taken out and the next
ones put in, in order; one step, and the chair stands at its start. What follows is then the same
to the bit as in a Space made for this episode alone, and costs no Python.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

import numpy as np
import pymunk
from numpy.typing import NDArray

from wheelchair_gym.compiled.address import Pointers, Target, integers_at, pointer_record
from wheelchair_gym.compiled.kernel import borrowing_kernel, inlined
from wheelchair_gym.geometry import Footprint
from wheelchair_gym.physics.actors.bodies import (
    ACTOR_STATE,
    PARKING,
    add_actors,
    remove_actors,
    reset_actors,
    shapes_of,
    write_actor_shapes,
)
from wheelchair_gym.physics.actors.orca import HALF_PLANES
from wheelchair_gym.physics.actors.records import ACTOR, Actors
from wheelchair_gym.physics.engine import (
    UNIT_BOX,
    add_shape,
    address_of_struct,
    place_body,
    remove_shape,
    set_circle,
    set_mass,
    set_segment,
    set_shape_counter,
    step_space,
)
from wheelchair_gym.sensors.settings import RANGERS
from wheelchair_gym.types import Episode

Array = NDArray[np.float64]

_PAIRS = Target("u8", None, 2)  # addresses of a cpBody and its cpShape
WORLD, TARGETS = pointer_record(
    ("space", "u8"),  # address of the cpSpace
    ("body", "u8"),  # address of the chair's cpBody
    ("segments", Target("u8", None)),  # addresses of spare cpSegmentShapes
    ("circles", Target("u8", None)),  # addresses of spare cpCircleShapes
    ("walls_in_space", "i8"),
    ("discs_in_space", "i8"),
    ("walls", Target("f8", None, 4)),  # m: walls and discs of this episode
    ("discs", Target("f8", None, 3)),
    ("n_walls", "i8"),
    ("n_discs", "i8"),
    ("n_fixed_walls", "i8"),  # how many of them stay; the others are what actors show
    ("n_fixed_discs", "i8"),
    ("actors", Target(ACTOR, None)),
    ("routes", Target("f8", None, 2)),  # m: of all people
    ("n_actors", "i8"),
    ("n_routes", "i8"),
    ("actor_states", Target(ACTOR_STATE, None)),
    ("actors_in_space", "i8"),
    ("spare_discs", _PAIRS),
    ("spare_boxes", _PAIRS),
    ("spare_leaves", _PAIRS),
    ("world_walls", Target("f8", None)),  # this world's own walls and discs, actors among them
    ("world_discs", Target("f8", None)),
    ("snapshots", Target("f8", RANGERS, None)),  # what each ranger saw of the actors
    ("snapshot_size", "i8"),
    ("half_planes", Target("f8", 2 * HALF_PLANES, 4)),  # workspace
    ("drives", Target("f8", None, 3)),  # v, w, protective of each drive of this episode
    ("drives_capacity", "i8"),
    ("frozen_scan", Target("f4", None)),  # (beams,) what a frozen laser repeats; 0: none ever is
    ("friction", "f8"),  # of the outline on walls and things
)

# A leaf slides inside its wall, and its hinge is in one: nothing has to look for that contact.
FIXED: Final = pymunk.ShapeFilter(categories=1)
LEAF: Final = pymunk.ShapeFilter(mask=pymunk.ShapeFilter.ALL_MASKS() ^ 1)
NO_POSES: Array = np.empty((0, 3))  # poses of no actors
_SLOP = 1e-4  # m: overlap that contacts leave
_BIAS = 1e-4  # share of a remaining overlap after one second: pushed out within a few steps
_GROWTH = 1.25  # of shapes made at once: the next world may be a little larger


@inlined
def enter_episode(world: Any, ground: Any) -> None:
    """The next episode's walls, discs and actors: those of a record that has the same fields."""
    world.walls, world.discs = ground.walls, ground.discs
    world.n_walls = world.n_fixed_walls = ground.n_walls
    world.n_discs = world.n_fixed_discs = ground.n_discs
    world.actors, world.n_actors = ground.actors, ground.n_actors
    world.routes, world.n_routes = ground.routes, ground.n_routes


@borrowing_kernel
def rebuild_space(engine: Any, world: Any) -> None:
    """Take everything out of a world's Space and put this episode's in, in order."""
    remove_actors(engine, world)
    segments = integers_at(world.segments, max(world.walls_in_space, world.n_walls))
    circles = integers_at(world.circles, max(world.discs_in_space, world.n_discs))
    for k in range(world.walls_in_space):
        remove_shape(engine.remove, world.space, np.uint64(segments[k]))
    for k in range(world.discs_in_space):
        remove_shape(engine.remove, world.space, np.uint64(circles[k]))
    set_shape_counter(world.space, 1)  # 0 is the chair
    walls, discs = shapes_of(world)
    for k in range(world.n_walls):
        shape = np.uint64(segments[k])
        set_segment(shape, walls[k, 0], walls[k, 1], walls[k, 2], walls[k, 3])
        add_shape(engine.add, world.space, shape)
    for k in range(world.n_discs):
        shape = np.uint64(circles[k])
        set_circle(shape, discs[k, 0], discs[k, 1], discs[k, 2])
        add_shape(engine.add, world.space, shape)
    world.walls_in_space, world.discs_in_space = world.n_walls, world.n_discs
    if world.n_actors > 0:
        add_actors(engine, world)


@borrowing_kernel
def enter_world(engine: Any, world: Any, p: Any, x: float, y: float, yaw: float) -> None:
    """Canonical entry: a furnished world whose chair stands at a pose [m, m, rad], at rest."""
    set_mass(world.body, p.mass, p.moment)
    place_body(engine, world.space, world.body, PARKING, PARKING, 0.0)
    rebuild_space(engine, world)
    step_space(engine.step, world.space, p.dt)
    c, s = math.cos(yaw), math.sin(yaw)
    place_body(
        engine, world.space, world.body, x + p.centre_of_mass * c, y + p.centre_of_mass * s, yaw
    )
    if world.n_actors > 0:
        reset_actors(engine, world)
        write_actor_shapes(world)


def _leaf(body: pymunk.Body) -> pymunk.Shape:
    """A shape for a door."""
    shape = pymunk.Poly(body, UNIT_BOX)
    shape.filter = LEAF
    return shape


class World:
    """A pymunk Space with the chair's body, and bodies and shapes in store for any episode.

    The body's position is its centre of mass, `centre` metres ahead of the drive axle.

    Args:
        footprint: the chair's outline.
        centre: of mass, ahead of the axle [m].
        friction: of the outline on walls.
        pointers: records of WORLD, with `TARGETS`.
        row: which of them points here.
    """

    def __init__(
        self, footprint: Footprint, centre: float, friction: float, pointers: Pointers, row: int
    ) -> None:
        self.space = pymunk.Space()
        self.space.collision_slop = _SLOP
        self.space.collision_bias = _BIAS
        self.body = pymunk.Body(1.0, 1.0)
        outline = pymunk.Poly(self.body, [(x - centre, y) for x, y in footprint.corners])
        outline.friction = self._friction = friction
        self.space.add(self.body, outline)
        self._segments: list[pymunk.Shape] = []
        self._circles: list[pymunk.Shape] = []
        self._actor_shapes: list[pymunk.Shape] = []
        self._bodies: list[pymunk.Body] = []  # of actors
        self._pointers, self._row = pointers, row
        self._rows = rows = pointers.record[row : row + 1]
        rows["friction"] = friction
        self._point("half_planes", np.zeros((2 * HALF_PLANES, 4)))
        rows["space"], rows["body"] = (
            address_of_struct(self.space._space),
            address_of_struct(self.body._body),
        )

    def reserve_shapes(self, episode: Episode) -> None:
        """Have spare shapes for an episode's walls, discs and actors before it is entered.

        What the present episode uses stays as it is.
        """
        walls, discs = len(episode.walls), len(episode.discs)
        self._reserve_static("segments", self._segments, walls)
        self._reserve_static("circles", self._circles, discs)
        if len(episode.actors):
            self._reserve_actors(walls, discs, episode.actors)

    def _reserve_static(self, name: str, spare: list[pymunk.Shape], wanted: int) -> None:
        """Have so many spare segments or circles."""
        if wanted <= len(spare):
            return
        static = self.space.static_body
        fresh: list[pymunk.Shape] = []
        for _ in range(round(_GROWTH * wanted) - len(spare)):
            segment = name == "segments"
            shape: pymunk.Shape = (
                pymunk.Segment(static, (0, 0), (1, 0), 0.0)
                if segment
                else pymunk.Circle(static, 1.0)
            )
            shape.friction, shape.filter = self._friction, FIXED
            fresh.append(shape)
        spare += fresh
        addresses = np.array([address_of_struct(shape._shape) for shape in fresh], np.uint64)
        self._point(name, np.concatenate([self._array(name), addresses]))

    def actor_poses(self) -> Array:
        """Where the actors are (k, 3) [m, m, rad]; NaN: not there."""
        count = int(self._rows["actors_in_space"][0])
        actor_states: Any = self._array("actor_states")[:count]
        there = actor_states["is_present"][:, None]
        return np.where(there, actor_states["pose"], np.nan)

    def _reserve_actors(self, walls: int, discs: int, actors: Actors) -> None:
        """Have spare bodies for actors, and memory for what is seen of them."""
        makers: dict[str, tuple[int, Callable[[pymunk.Body], pymunk.Shape]]] = {
            "spare_discs": (actors.discs, lambda body: pymunk.Circle(body, 1.0)),
            "spare_boxes": (actors.boxes, lambda body: pymunk.Poly(body, UNIT_BOX)),
            "spare_leaves": (actors.leaves, _leaf),
        }
        for name, (wanted, make) in makers.items():
            pairs = self._array(name)
            fresh = []
            for _ in range(round(_GROWTH * wanted) - len(pairs) if wanted > len(pairs) else 0):
                body = pymunk.Body(1.0, 1.0)
                shape = make(body)
                self._bodies.append(body)
                self._actor_shapes.append(shape)
                fresh.append((address_of_struct(body._body), address_of_struct(shape._shape)))
            if fresh:
                self._point(name, np.concatenate([pairs, np.array(fresh, np.uint64)]))
        self._reserve("actor_states", len(actors))
        seen = {"world_walls": walls + actors.segments, "world_discs": discs + actors.discs}
        for (name, count), columns in zip(seen.items(), (4, 3), strict=True):
            before = int(self._rows[name][0])
            self._reserve(name, columns * count)
            now = name.removeprefix("world_")
            if before and int(self._rows[now][0]) == before:
                self._rows[now] = self._rows[name]
        shot = max(int(self._rows["snapshot_size"][0]), 4 * actors.segments + 3 * actors.discs)
        if shot > self._rows["snapshot_size"][0]:
            self._point("snapshots", np.zeros((RANGERS, shot)))
            self._rows["snapshot_size"] = shot

    def reserve_drives(self, capacity: int) -> None:
        """Have memory for so many drives of an episode; what was driven stays recorded."""
        old = self._array("drives")
        new = np.zeros((capacity, 3))
        new[: len(old)] = old
        self._point("drives", new)
        self._rows["drives_capacity"] = capacity

    def _reserve(self, name: str, count: int) -> None:
        """Make an array of the world at least so long; what it holds stays."""
        old = self._array(name)
        if count > len(old):
            new = np.zeros(round(_GROWTH * count), old.dtype)
            new[: len(old)] = old
            self._point(name, new)

    def _array(self, name: str) -> NDArray[Any]:
        return self._pointers.array(name, self._row)

    def _point(self, name: str, array: NDArray[Any]) -> None:
        self._pointers.point(name, array, self._row)
