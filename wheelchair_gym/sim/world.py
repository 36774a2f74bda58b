"""Worlds in pymunk: one Space for each chair, which holds what the chair may touch.

A Space keeps more than its shapes: contact caches, the order of the broad phase. The canonical
entry leaves none of it: the chair goes far away, all shapes are taken out; one step, and the chair
stands at its start. What follows is then the same to the bit as in a Space made for this episode
alone, and costs no Python.

Where nothing moves beside the chair, walls and discs are put in when the chair comes near them, and
taken out when it has left them (`touchable_space`). Where people, doors or furniture move, all
walls and discs are in the Space, and those actors that can touch something in the coming step
(`actors.separation`). Where neither they nor the chair can, nobody needs the Space.
"""

from __future__ import annotations

import math
import weakref
from collections.abc import Callable
from typing import Any, Final

import numpy as np
import pymunk
from numpy.typing import NDArray

from wheelchair_gym.actors.bodies import (  # noqa: F401 for the record
    ACTOR_STATE,
    PARKING,
    add_actors,
    remove_actors,
    reset_actors,
    shapes_of,
    write_actor_shapes,
)
from wheelchair_gym.actors.orca import HALF_PLANES
from wheelchair_gym.actors.records import ACTOR, Actors  # noqa: F401
from wheelchair_gym.actors.separation import FASTEST, STEPS_REMEMBERED
from wheelchair_gym.base.arrays import Array, Floats
from wheelchair_gym.compiled.address import Pointers, integers_at, read_record, table_at
from wheelchair_gym.compiled.kernel import borrowing_kernel, inlined
from wheelchair_gym.engine import (
    UNIT_BOX,
    address_of_struct,
    body_view,
    change_space,
    free_shapes,
    keep_until_exit,
    new_shape,
    place_body,
    set_circle,
    set_mass,
    set_segment,
    set_shape_counter,
    step_space,
)
from wheelchair_gym.geometry.outline import (
    Footprint,
    offsets_from_rectangle,
    outline_segment_gap,
    rectangle_point_gap,
)
from wheelchair_gym.geometry.planar import world_to_body
from wheelchair_gym.sensors.echoes import relative_endpoints
from wheelchair_gym.sensors.settings import RANGERS
from wheelchair_gym.types import Episode

_F = np.float32
_ZERO, _TINY = _F(0.0), _F(1e-3)
_ERROR = _F(4e-6)  # error of float32 about a segment, as a share of its coordinates


@borrowing_kernel
def _rank(n: int, ends: Floats, c: np.float32, s: np.float32, box: Array, out: Floats) -> None:
    """Distances of n segments, for `rank_walls`, in vectors."""
    front, back, half = _F(box[0]), _F(-box[1]), _F(box[2])
    middle, long = _F(0.5 * (box[0] - box[1])), _F(0.5 * (box[0] + box[1]))
    for k in range(np.uint64(n)):
        x0, y0, x1, y1 = ends[4 * k], ends[4 * k + 1], ends[4 * k + 2], ends[4 * k + 3]
        ax, ay, bx, by = c * x0 + s * y0, c * y0 - s * x0, c * x1 + s * y1, c * y1 - s * x1
        low_x, high_x = ax if ax < bx else bx, bx if ax < bx else ax
        low_y, high_y = ay if ay < by else by, by if ay < by else ay
        ahead, behind = low_x - front, back - high_x
        left, right = low_y - half, -half - high_y
        dx = ahead if ahead > behind else behind
        dy = left if left > right else right
        dx, dy = dx if dx > _ZERO else _ZERO, dy if dy > _ZERO else _ZERO
        of_box = np.sqrt(dx * dx + dy * dy)
        ex, ey = bx - ax, by - ay
        length = np.sqrt(ex * ex + ey * ey)
        off = abs((ax - middle) * ey - ay * ex) - long * abs(ey) - half * abs(ex)
        of_line = off / (length if length > _TINY else _TINY)
        size = abs(x0) + abs(y0) + abs(x1) + abs(y1)
        out[k] = (of_box if of_box > of_line else of_line) - _ERROR * size


@inlined
def distances_in(workspace: Floats) -> Floats:
    """The row of a workspace to which `rank_walls` and `rank_discs` write."""
    width = workspace.shape[1]
    return workspace.reshape(workspace.size)[4 * width : 5 * width]


@borrowing_kernel
def rank_walls(
    x: float, y: float, yaw: float, outline: Array, walls: Array, workspace: Floats
) -> None:
    """Write of each wall a distance [m] that it has at least from an outline (3,) at a pose.

    It is that of its bounding box in the outline's frame, or of its line. `workspace` has at least
    five rows, and a column for each wall and disc.
    """
    ends = workspace.reshape(workspace.size)[: 4 * workspace.shape[1]]
    relative_endpoints(walls, x, y, ends)
    near = distances_in(workspace)
    _rank(walls.shape[0], ends, _F(math.cos(yaw)), _F(math.sin(yaw)), outline, near)


@borrowing_kernel
def rank_discs(
    x: float, y: float, yaw: float, outline: Array, discs: Array, workspace: Floats
) -> None:
    """`rank_walls`, of discs (n, 3) [m]: x, y, radius."""
    near = distances_in(workspace)
    front, back, half = outline[0], -outline[1], outline[2]
    c, s = math.cos(yaw), math.sin(yaw)
    for k in range(np.uint64(discs.shape[0])):
        dx, dy = discs[k, 0] - x, discs[k, 1] - y
        px, py = world_to_body(c, s, dx, dy)
        ex, ey = offsets_from_rectangle(px, py, front, back, half)
        size = abs(dx) + abs(dy) + discs[k, 2]
        near[k] = _F(math.sqrt(ex * ex + ey * ey) - discs[k, 2]) - _ERROR * _F(size)


@borrowing_kernel
def outline_clearance(
    pose: Array, outline: Array, walls: Array, discs: Array, reach: float, workspace: Floats
) -> float:
    """`outline.footprint_clearance` of a pose (3,) [m, m, rad], to the bit, and faster.

    `workspace` is that of `rank_walls`.
    """
    n, x, y = walls.shape[0], pose[0], pose[1]
    c, s = math.cos(pose[2]), math.sin(pose[2])
    rank_walls(x, y, pose[2], outline, walls, workspace)
    near = distances_in(workspace)
    gap, first, minimum = reach, 0, _F(reach)
    for k in range(n):
        if near[k] < minimum:
            minimum, first = near[k], k
    for j in range(-1 if n > 0 else 0, n):  # the most promising one first
        k = first if j < 0 else j
        if near[k] > gap:
            continue
        px, py = world_to_body(c, s, walls[k, 0] - x, walls[k, 1] - y)
        qx, qy = world_to_body(c, s, walls[k, 2] - x, walls[k, 3] - y)
        gap = min(gap, outline_segment_gap(outline, px, py, qx, qy))
    rank_discs(x, y, pose[2], outline, discs, workspace)
    for k in range(discs.shape[0]):
        if near[k] > gap:
            continue
        px, py = world_to_body(c, s, discs[k, 0] - x, discs[k, 1] - y)
        gap = min(gap, max(0.0, rectangle_point_gap(px, py, outline) - discs[k, 2]))
    return gap


Integers = NDArray[np.int64]

HALF_PLANE_ROWS = 2 * HALF_PLANES  # of the workspace
WORLD, TARGETS = read_record("WORLD", globals())

# A leaf slides inside its wall, and its hinge is in one: nothing has to look for that contact.
FIXED: Final = pymunk.ShapeFilter(categories=1)
LEAF: Final = pymunk.ShapeFilter(mask=pymunk.ShapeFilter.ALL_MASKS() ^ 1)
NO_POSES: Array = np.empty((0, 3))  # poses of no actors
CLEARANCE_REACH: Final = 2.0  # m: clearances beyond this are reported as this
_ROUNDING: Final = 1e-6  # m
_REACH: Final = 0.5  # m: walls within are put into the Space at once
WALL_FRICTION = 0.3  # coefficient of friction between the outline and what it touches
_SLOP = 1e-4  # m: overlap that contacts leave
_BIAS = 1e-4  # share of a remaining overlap after one second: pushed out within a few steps
_CAPACITY = 100  # shapes: from 98 to 192 have the same table
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
def _empty(engine: Any, world: Any, dt: float) -> None:
    """Take all but the chair out of a Space."""
    remove_actors(engine, world, dt)
    for table, n in ((world.segments, world.walls_in_space), (world.circles, world.discs_in_space)):
        shapes = integers_at(table, n)
        for k in range(n):
            change_space(engine.remove, world.space, np.uint64(shapes[k]))
    world.walls_in_space = world.discs_in_space = 0


@borrowing_kernel
def _furnish_with(
    engine: Any, world: Any, things: Array, first: int, shapes: Integers, held: Integers,
    inside: int, near: Floats, reach: float,
) -> int:  # fmt: skip
    """Put walls (n, 4), or discs (n, 3), nearer than a reach into a Space; take out the others.

    No thing is closer to the outline than its `near` [m]. `held` names the thing of each shape in
    the Space, `inside` of them before; return their number now. Shapes are made when they
    are first needed. The order in which Munk2D solves goes by numbers, so each thing has its own,
    from `first` on, whenever it is put in.
    """
    kept = 0
    for k in range(inside):
        shape, number = shapes[k], held[k]
        if near[number] < reach:
            shapes[k], held[k] = shapes[kept], held[kept]
            shapes[kept], held[kept] = shape, number
            kept += 1
        else:
            change_space(engine.remove, world.space, np.uint64(shape))
    stayed, is_wall = kept, things.shape[1] == 4
    for k in range(things.shape[0]):
        if near[k] >= reach or k in held[:stayed]:
            continue
        if shapes[kept] == 0:
            make = engine.new_segment if is_wall else engine.new_circle
            shapes[kept] = np.int64(new_shape(make, world.static_body, world.surface))
        shape = np.uint64(shapes[kept])
        if is_wall:
            set_segment(shape, things[k, 0], things[k, 1], things[k, 2], things[k, 3])
        else:
            set_circle(shape, things[k, 0], things[k, 1], things[k, 2])
        set_shape_counter(world.space, first + k)
        change_space(engine.add, world.space, shape)
        held[kept] = k
        kept += 1
    return kept


@borrowing_kernel
def _furnish(engine: Any, world: Any, p: Any, reach: float, workspace: Floats) -> None:
    """Put exactly the walls and discs within a reach [m] of the chair's outline into a Space."""
    fields = body_view(world.body)
    yaw = fields.angle
    x = fields.x - math.cos(yaw) * p.body.centre_of_mass
    y = fields.y - math.sin(yaw) * p.body.centre_of_mass
    n, m, outline = world.n_fixed_walls, world.n_fixed_discs, p.outline[:]
    walls, discs = table_at(world.walls, n, 4), table_at(world.discs, m, 3)
    near = distances_in(workspace)
    rank_walls(x, y, yaw, outline, walls, workspace)
    world.walls_in_space = _furnish_with(
        engine, world, walls, 1, integers_at(world.segments, n), integers_at(world.walls_held, n),
        world.walls_in_space, near, reach,
    )  # fmt: skip
    rank_discs(x, y, yaw, outline, discs, workspace)
    world.discs_in_space = _furnish_with(
        engine, world, discs, 1 + n, integers_at(world.circles, m),
        integers_at(world.discs_held, m), world.discs_in_space, near, reach,
    )  # fmt: skip


@borrowing_kernel
def touchable_space(engine: Any, world: Any, p: Any, workspace: Floats) -> np.uint64:
    """The Space of the coming physics step, which holds all that the chair may touch in it.

    0: that is nothing, so that the chair needs no Space.
    """
    fields, arm = body_view(world.body), p.body.centre_of_mass
    far = max(p.outline[0] - arm, p.outline[1] + arm)
    corner = math.sqrt(far * far + p.outline[2] * p.outline[2])
    speed = math.sqrt(fields.vx * fields.vx + fields.vy * fields.vy)
    moved = (speed + corner * abs(fields.w)) * p.dt  # no point of the outline moves farther
    world.free -= moved
    world.furnished -= moved
    if world.free > 0.0:
        return np.uint64(0)
    if world.furnished <= 0.0:
        _furnish(engine, world, p, _REACH + moved, workspace)
        world.furnished = _REACH
    return np.uint64(world.space)


@borrowing_kernel
def measure_clearance(state: Any, p: Any, world: Any, workspace: Floats) -> None:
    """Measure how far the outline is from all that its world shows, and so how far it may move.

    Where a contact may be so recent that Munk2D remembers it, the Space goes on step by step.
    """
    walls, discs = shapes_of(world)
    world.clearance = clearance = outline_clearance(
        state.pose, p.outline[:], walls, discs, CLEARANCE_REACH, workspace
    )
    is_away = clearance > STEPS_REMEMBERED * p.dt * FASTEST
    world.free = clearance - _ROUNDING if is_away else 0.0


@borrowing_kernel
def enter_world(
    engine: Any, world: Any, p: Any, x: float, y: float, yaw: float, workspace: Floats
) -> None:
    """Canonical entry: an episode's world, whose chair stands at a pose [m, m, rad], at rest."""
    set_mass(world.body, p.mass, p.moment)
    place_body(engine, world.space, world.body, PARKING, PARKING, 0.0)
    _empty(engine, world, p.dt)
    world.free = world.furnished = 0.0
    if world.n_actors > 0:
        _furnish(engine, world, p, math.inf, workspace)
        world.furnished = math.inf
        add_actors(engine, world)
    step_space(engine.step, world.space, p.dt)
    c, s = math.cos(yaw), math.sin(yaw)
    ahead = p.body.centre_of_mass
    place_body(engine, world.space, world.body, x + ahead * c, y + ahead * s, yaw)
    if world.n_actors > 0:
        reset_actors(engine, world)
        write_actor_shapes(world)


def _release(of: weakref.ref[World], pointers: Pointers, row: int) -> None:
    """Free the shapes that kernels made for a world that is gone; its Space is not yet.

    A world that is still there when the process ends keeps everything: the destructors of pymunk
    are Python functions, which may run after the modules that they call are gone.
    """
    world = of()
    if world is None:
        free_shapes(pointers.array("segments", row), pointers.array("circles", row))
    else:
        world.keep_until_exit()


def _leaf(body: pymunk.Body) -> pymunk.Shape:
    """A shape for a door."""
    shape = pymunk.Poly(body, UNIT_BOX)
    shape.filter = LEAF
    return shape


def _widen(space: pymunk.Space) -> None:
    """Give a Space the table that it has once it held `_CAPACITY` shapes, which never shrinks.

    Where bodies touch bodies, the order in which Munk2D solves goes by the size of that table: by
    the largest episode so far, of all worlds alike up to this number of actors.
    """
    body = pymunk.Body(1.0, 1.0)
    shapes = [pymunk.Circle(body, 1.0) for _ in range(_CAPACITY)]
    space.add(body, *shapes)
    space.remove(body, *shapes)


class World:
    """A pymunk Space with the chair's body, and bodies and shapes in store for any episode.

    The body's position is its centre of mass, `centre` metres ahead of the drive axle.

    Args:
        footprint: the chair's outline.
        centre: of mass, ahead of the axle [m].
        pointers: records of WORLD, with `TARGETS`.
        row: which of them points here.
    """

    def __init__(self, footprint: Footprint, centre: float, pointers: Pointers, row: int) -> None:
        self.space = pymunk.Space()
        self.space.collision_slop = _SLOP
        self.space.collision_bias = _BIAS
        self.body = pymunk.Body(1.0, 1.0)
        outline = pymunk.Poly(self.body, [(x - centre, y) for x, y in footprint.corners])
        outline.friction = WALL_FRICTION
        self.space.add(self.body, outline)
        self._surface = pymunk.Circle(self.space.static_body, 1.0)  # of walls; in no Space
        self._surface.friction, self._surface.filter = WALL_FRICTION, FIXED
        self._actor_shapes: list[pymunk.Shape] = []
        self._bodies: list[pymunk.Body] = []  # of actors
        self._pointers, self._row = pointers, row
        self._rows = rows = pointers.record[row : row + 1]
        rows["friction"] = WALL_FRICTION
        self._point("half_planes", np.zeros((2 * HALF_PLANES, 4)))
        for name, thing in {
            "space": self.space._space,
            "body": self.body._body,
            "static_body": self.space.static_body._body,
            "surface": self._surface._shape,
        }.items():
            rows[name] = address_of_struct(thing)
        weakref.finalize(self, _release, weakref.ref(self), pointers, row)

    def keep_until_exit(self) -> None:
        """Leave the memory of the engine to the end of the process; the world stays usable."""
        bodies = self.body, self.space.static_body, *self._bodies
        shapes = *self.space.shapes, self._surface, *self._actor_shapes
        keep_until_exit(
            self.space._space, *(body._body for body in bodies), *(s._shape for s in shapes)
        )

    def reserve_shapes(self, episode: Episode) -> None:
        """Reserve spare shapes for an episode's walls, discs and actors before it is entered.

        What the present episode uses stays as it is.
        """
        walls, discs = len(episode.walls), len(episode.discs)
        for count, *names in (walls, "segments", "walls_held"), (discs, "circles", "discs_held"):
            for name in names:
                self._reserve(name, count)
        if len(episode.actors):
            self._reserve_actors(walls, discs, episode.actors)

    def actor_poses(self) -> Array:
        """Poses of the actors (k, 3) [m, m, rad]; NaN: not there."""
        count = int(self._rows["n_bodies"][0])
        actor_states: Any = self._array("actor_states")[:count]
        there = actor_states["is_present"][:, None]
        return np.where(there, actor_states["pose"], np.nan)

    def _reserve_actors(self, walls: int, discs: int, actors: Actors) -> None:
        """Reserve spare bodies for actors, and memory for what is seen of them."""
        if not self._bodies:
            _widen(self.space)
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
        """Reserve memory for `capacity` drives of an episode; what was driven stays recorded."""
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
