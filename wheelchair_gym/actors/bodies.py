"""Actors in a world: their bodies in its Space, what pushes them, and what sensors see of them.

Everything that moves is a body of Munk2D. People and furniture have mass, and a person is driven by
a force no larger than legs give: so walls, doors and others hold them, and they can press nothing
through a wall, as bodies that are moved at will would. A person who walks into the chair stops
there, as people do, and does not shove its 135 kg (`contact.stop_people`); a chair that drives into
somebody pushes them. Doors and obstacles are moved at will, of infinite mass: so a leaf holds
before it would touch anything, and no obstacle appears near the chair.
"""

import math
from typing import Any

import numpy as np

from wheelchair_gym.actors.records import (
    ACTOR,
    DOOR,
    FASTEST,
    FURNITURE,
    MASS,
    NOBODY,
    OBSTACLE,
    PERSON,
    SOCIAL_FORCE,
    first_heading,
)
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.compiled.address import doubles_at, integers_at, read_record, rows_of, table_at
from wheelchair_gym.compiled.kernel import borrowing_kernel, inlined
from wheelchair_gym.engine import (
    GRAVITY,
    body_view,
    change_space,
    place_body,
    set_box,
    set_circle,
    set_friction,
    set_mass,
    set_shape_counter,
    step_space,
    turn_body,
)
from wheelchair_gym.geometry.outline import rectangle_point_gap
from wheelchair_gym.geometry.planar import point_to_world, world_to_body, wrap

ACTOR_STATE = read_record("ACTOR_STATE", globals())[0]

NEVER = -(1 << 40)  # a tick long before any
PARKING = 1e8  # m: beyond all coordinates of an episode (`FARTHEST`)
LEG_FORCE = 200.0  # N at most: 75 kg at 2.7 m/s2, 1.34 m/s in 0.5 s (Helbing and Molnar 1995)
_RELAXATION_TIME = 0.3  # s in which people take up a velocity: below the time of a step
_PARKING_SPACING = 20.0  # m between things that are far away
_PASS_THROUGH_GROUP = 1  # people who avoid nobody pass through each other, as in DynaBARN
_FRICTION_LEVER = 3.0  # the mean lever of floor friction is a third of a radius or a diagonal
_TROLLEY_TURN = 1.0  # rad/s with which a trolley is turned
_TROLLEY_LAG = 0.1  # s in which it comes to where it belongs
_TROLLEY_GRIP = 0.05  # s in which it takes up a speed

_actors_at, _actor_states_at = rows_of(ACTOR), rows_of(ACTOR_STATE)


@inlined
def actors_of(world: Any) -> Any:
    """The actors of a world and their states: records (k,) of ACTOR and of ACTOR_STATE."""
    n = world.n_actors
    return _actors_at(world.actors, n), _actor_states_at(world.actor_states, n)


@inlined
def shapes_of(world: Any) -> Any:
    """Walls (n, 4) and discs (m, 3) [m] of a world, those that show actors behind the others."""
    walls = table_at(world.walls, world.n_walls, 4)
    return walls, table_at(world.discs, world.n_discs, 3)


@borrowing_kernel
def is_box(row: Any) -> bool:
    """Whether an actor has corners: furniture that is not round, and leaves."""
    return bool(row.size[1] > 0.0)


@borrowing_kernel
def offset_from_outline(
    p: Any, c: float, s: float, dx: float, dy: float
) -> tuple[float, float, float, float]:
    """The outline's point nearest to a place, and the offset from there, in the chair's frame.

    The place is (dx, dy) [m] from the chair, whose yaw has cosine c and sine s.
    """
    px, py = world_to_body(c, s, dx, dy)
    qx = min(p.outline[0], max(-p.outline[1], px))
    qy = min(p.outline[2], max(-p.outline[2], py))
    return qx, qy, px - qx, py - qy


@borrowing_kernel
def distance_to_chair(p: Any, pose: Array, x: float, y: float) -> float:
    """Distance [m] from the outline of a chair at a pose (3,) to a point."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    dx, dy = x - pose[0], y - pose[1]
    px, py = world_to_body(c, s, dx, dy)
    return rectangle_point_gap(px, py, p.outline[:])


@borrowing_kernel
def _squared_size(row: Any) -> float:
    """The squared diagonal of a box, or radius of a disc [m2]."""
    return float(row.size[0] * row.size[0] + row.size[1] * row.size[1])


@borrowing_kernel
def extent(row: Any) -> float:
    """Radius [m] of the disc about an actor's place that covers it."""
    if not is_box(row):
        return float(row.size[0])
    length = row.size[0] if row.kind == DOOR else 0.5 * row.size[0]
    return math.sqrt(length * length + 0.25 * row.size[1] * row.size[1])


@borrowing_kernel
def inertia(row: Any) -> float:
    """Moment of inertia of light furniture about its centre [kg m2]: a box's, or a disc's."""
    if is_box(row):
        return float(row.mass * _squared_size(row) / 12.0)
    return float(0.5 * row.mass * _squared_size(row))


@borrowing_kernel
def remove_actors(engine: Any, world: Any, dt: float) -> None:
    """Take the actors of the last episode out of a world and its Space."""
    actor_states = _actor_states_at(world.actor_states, world.n_bodies)
    for k in range(world.n_bodies):
        if actor_states[k].in_space:
            change_space(engine.remove, world.space, actor_states[k].shape)
    # What contacts have left in a body lasts for one step.
    step_space(engine.step, world.space, dt)
    for k in range(world.n_bodies):
        if actor_states[k].in_space:
            change_space(engine.remove_body, world.space, actor_states[k].body)
            actor_states[k].in_space = False
    world.n_bodies = 0


@borrowing_kernel
def put_into_space(engine: Any, world: Any, k: int) -> None:
    """Put actor k into the Space, as it is; the order of Munk2D goes by its number."""
    state = actors_of(world)[1][k]
    turn_body(engine, state.body)  # its shape would remember where the Space last saw it
    change_space(engine.add_body, world.space, state.body)
    set_shape_counter(world.space, 1 + world.n_fixed_walls + world.n_fixed_discs + k)
    change_space(engine.add, world.space, state.shape)
    state.in_space = True


@borrowing_kernel
def take_out_of_space(engine: Any, world: Any, state: Any) -> None:
    """Take an actor out of the Space."""
    change_space(engine.remove, world.space, state.shape)
    change_space(engine.remove_body, world.space, state.body)
    state.in_space = False


@borrowing_kernel
def _copy(source: Array, first: int, target: Array, at: int, n: int) -> None:
    """Copy n numbers of a flat array into another."""
    for i in range(n):
        target[at + i] = source[first + i]


@borrowing_kernel
def copy_actor_shapes(world: Any, which: int, saves: bool) -> None:
    """Save what a ranger sees of the actors at the instant when it fires, or restore it."""
    walls = doubles_at(world.walls, 4 * world.n_walls)
    discs = doubles_at(world.discs, 3 * world.n_discs)
    wall, disc = 4 * world.n_fixed_walls, 3 * world.n_fixed_discs
    n, m = 4 * world.n_walls - wall, 3 * world.n_discs - disc
    at = world.snapshot_size * which
    snapshots = doubles_at(world.snapshots, at + world.snapshot_size)
    if saves:
        _copy(walls, wall, snapshots, at, n)
        _copy(discs, disc, snapshots, at + n, m)
    else:
        _copy(snapshots, at, walls, wall, n)
        _copy(snapshots, at + n, discs, disc, m)


@borrowing_kernel
def _take_spare(pairs: np.uint64, k: int, state: Any) -> None:
    """Give an actor the k-th of the spare bodies with their shapes at an address."""
    pair = integers_at(pairs, 2 * (k + 1))
    state.body, state.shape = np.uint64(pair[2 * k]), np.uint64(pair[2 * k + 1])


@borrowing_kernel
def add_actors(engine: Any, world: Any) -> None:
    """Give this episode's actors bodies, far away and at rest; none is in the Space yet.

    From then on the world's walls and discs are its own copy, with those of actors behind them.
    """
    n = world.n_actors
    rows, actor_states = actors_of(world)
    fixed, round_ones = world.n_fixed_walls, world.n_fixed_discs
    n_walls, n_discs = 4 * fixed, 3 * round_ones
    _copy(doubles_at(world.walls, n_walls), 0, doubles_at(world.world_walls, n_walls), 0, n_walls)
    _copy(doubles_at(world.discs, n_discs), 0, doubles_at(world.world_discs, n_discs), 0, n_discs)
    world.walls, world.discs = world.world_walls, world.world_discs
    segment, disc = fixed, round_ones
    balls, boxes, leaves = 0, 0, 0
    for k in range(n):
        row, state = rows[k], actor_states[k]
        moment = math.inf
        friction, group = world.friction, 0
        if row.kind == DOOR:
            _take_spare(world.spare_leaves, leaves, state)
            leaves += 1
            state.slot, segment = segment, segment + 4
            set_box(state.shape, 0.0, row.size[0], 0.5 * row.size[1])
        elif is_box(row):
            _take_spare(world.spare_boxes, boxes, state)
            boxes += 1
            state.slot, segment = segment, segment + 4
            set_box(state.shape, -0.5 * row.size[0], 0.5 * row.size[0], 0.5 * row.size[1])
            moment = inertia(row)
        else:
            _take_spare(world.spare_discs, balls, state)
            balls += 1
            state.slot, disc = disc, disc + 1
            set_circle(state.shape, 0.0, 0.0, row.size[0])
            if row.kind == FURNITURE:
                moment = inertia(row)
            elif row.kind == PERSON:
                # Nobody is turned by rubbing along a wall.
                friction = 0.0
                group = _PASS_THROUGH_GROUP if row.avoids == NOBODY else 0
        set_friction(state.shape, friction, group)
        set_mass(state.body, row.mass, moment)
        place_body(engine, world.space, state.body, -PARKING, PARKING + _PARKING_SPACING * k, 0.0)
        state.in_space = False
    world.n_walls, world.n_discs = segment, disc
    world.n_bodies = n


@borrowing_kernel
def _read_pose(state: Any) -> None:
    fields = body_view(state.body)
    state.pose[0], state.pose[1], state.pose[2] = fields.x, fields.y, fields.angle


@borrowing_kernel
def read_actor_poses(world: Any) -> None:
    """Read where the actors are from their bodies."""
    actor_states = actors_of(world)[1]
    for k in range(world.n_actors):
        _read_pose(actor_states[k])


@borrowing_kernel
def reset_actors(engine: Any, world: Any) -> None:
    """Put the actors where they begin; obstacles stay away."""
    rows, actor_states = actors_of(world)
    world.n_headed = 0
    for k in range(world.n_actors):
        row, state = rows[k], actor_states[k]
        world.n_headed += int(row.kind == PERSON and row.model == SOCIAL_FORCE)
        state.preferred_velocity[0], state.preferred_velocity[1] = 0.0, 0.0
        state.twist[0], state.twist[1], state.twist[2] = 0.0, 0.0, 0.0
        state.waypoint, state.direction, state.blocked_for = 0, 1, 0.0
        state.opening, state.opening_target, state.present_until = 0.0, 0.0, 0.0
        state.is_present, state.is_gone = row.kind != OBSTACLE, False
        state.relocate, state.judged_at = 0, NEVER
        state.clear, state.free, state.moved = 0.0, 0.0, 0.0
        state.measured_at = state.touchable_at = NEVER
        route = table_at(world.routes, world.n_routes, 2)[row.first : row.first + row.points]
        state.heading = state.facing = first_heading(route, row.pose[0], row.pose[1])
        state.turn_rate = state.lasts_until = state.begins_again = 0.0
        if state.is_present:
            place_body(engine, world.space, state.body, row.pose[0], row.pose[1], row.pose[2])
    read_actor_poses(world)


@borrowing_kernel
def relocate_obstacles(engine: Any, world: Any) -> None:
    """Put obstacles that are to appear where they belong, and those that are to go away."""
    rows, actor_states = actors_of(world)
    for k in range(world.n_actors):
        row, state = rows[k], actor_states[k]
        if state.relocate == 0:
            continue
        if state.relocate == 1:
            place_body(engine, world.space, state.body, row.pose[0], row.pose[1], row.pose[2])
        else:
            place_body(
                engine, world.space, state.body, -PARKING, PARKING + _PARKING_SPACING * k, 0.0
            )
        state.relocate, state.clear, state.free = 0, 0.0, 0.0
        _read_pose(state)


@borrowing_kernel
def leg_force(row: Any, ax: float, ay: float) -> tuple[float, float]:
    """The force [N] of legs for an acceleration [m/s2]: never more than they give.

    A person lighter than an adult has less force: children start no faster.
    """
    size = math.sqrt(ax * ax + ay * ay)
    maximum = LEG_FORCE * (row.mass / MASS) if row.mass < MASS else LEG_FORCE
    share = row.mass if size > 0.0 else 0.0
    if row.mass * size > maximum:  # seldom, so that most steps need no division
        share = row.mass * (maximum / (row.mass * size))
    return share * ax, share * ay


@borrowing_kernel
def _move_trolley(row: Any, state: Any, walker: Any, fields: Any) -> None:
    """The force of arms that keeps a trolley before or behind a person, no more than legs give.

    It turns about that person, and no corner of it wants to be faster than FASTEST.
    """
    c, s = math.cos(state.pose[2]), math.sin(state.pose[2])
    ox, oy = c * row.offset[0] - s * row.offset[1], s * row.offset[0] + c * row.offset[1]
    turn = wrap(walker.facing - state.pose[2]) / _RELAXATION_TIME
    turn = max(-_TROLLEY_TURN, min(_TROLLEY_TURN, turn))
    walks = body_view(walker.body)
    vx = walks.vx - turn * oy + (walker.pose[0] + ox - state.pose[0]) / _TROLLEY_LAG
    vy = walks.vy + turn * ox + (walker.pose[1] + oy - state.pose[1]) / _TROLLEY_LAG
    share = min(1.0, (FASTEST - abs(turn) * extent(row)) / max(math.sqrt(vx * vx + vy * vy), 1e-9))
    vx, vy = share * vx, share * vy
    ax, ay = (vx - fields.vx) / _TROLLEY_GRIP, (vy - fields.vy) / _TROLLEY_GRIP
    fields.fx, fields.fy = leg_force(row, ax, ay)
    maximum = row.mass * LEG_FORCE / MASS * abs(row.offset[0])
    torque = inertia(row) * (turn - fields.w) / _TROLLEY_GRIP
    fields.torque = max(-maximum, min(maximum, torque))


@borrowing_kernel
def _apply_floor_friction(row: Any, fields: Any, dt: float) -> None:
    """Friction on the floor: slows what slides and turns, and never turns it round."""
    speed = math.sqrt(fields.vx * fields.vx + fields.vy * fields.vy)
    bound = row.friction * row.mass * GRAVITY
    if speed > 0.0:
        share = min(bound, row.mass * speed / dt) / speed
        fields.fx, fields.fy = -share * fields.vx, -share * fields.vy
    if fields.w != 0.0:
        maximum = bound * math.sqrt(_squared_size(row)) / _FRICTION_LEVER
        fields.torque = -math.copysign(min(maximum, inertia(row) * abs(fields.w) / dt), fields.w)


@borrowing_kernel
def _set_leaf_velocity(row: Any, state: Any, fields: Any, dt: float) -> None:
    """The velocity of a leaf that takes it where `hold_leaves` has allowed it to go."""
    c, s = math.cos(row.pose[2]), math.sin(row.pose[2])
    way = state.opening * row.travel
    if row.swings:
        fields.w = (row.pose[2] + way - fields.angle) / dt
    else:
        fields.vx = (row.pose[0] + c * way - fields.x) / dt
        fields.vy = (row.pose[1] + s * way - fields.y) / dt


@borrowing_kernel
def apply_forces(world: Any, p: Any) -> None:
    """Apply what moves the actors in the coming physics step: forces, and velocities of doors."""
    rows, actor_states = actors_of(world)
    for k in range(world.n_actors):
        row, state = rows[k], actor_states[k]
        fields = body_view(state.body)
        if row.kind == PERSON:
            ax = (state.preferred_velocity[0] - fields.vx) / _RELAXATION_TIME
            ay = (state.preferred_velocity[1] - fields.vy) / _RELAXATION_TIME
            fields.fx, fields.fy = leg_force(row, ax, ay)
        elif row.kind == FURNITURE:
            if row.leader > 0:
                _move_trolley(row, state, actor_states[k - row.leader], fields)
            else:
                _apply_floor_friction(row, fields, p.dt)
        elif row.kind == DOOR:
            _set_leaf_velocity(row, state, fields, p.dt)
        state.twist[0], state.twist[1], state.twist[2] = fields.vx, fields.vy, fields.w


@borrowing_kernel
def write_actor_shapes(world: Any) -> None:
    """Write what sensors see of the actors behind the walls and discs that stay."""
    rows, actor_states = actors_of(world)
    walls, discs = shapes_of(world)
    for k in range(world.n_actors):
        row, state = rows[k], actor_states[k]
        x, y = state.pose[0], state.pose[1]
        at = state.slot
        if not is_box(row):
            discs[at, 0], discs[at, 1], discs[at, 2] = x, y, row.size[0]
            continue
        c, s = math.cos(state.pose[2]), math.sin(state.pose[2])
        front, b = row.size[0] if row.kind == DOOR else 0.5 * row.size[0], 0.5 * row.size[1]
        rear = front - row.size[0]
        px, py = point_to_world(c, s, x, y, rear, b)
        for i in range(4):
            ex, ey = front if i == 1 or i == 2 else rear, b if i > 1 else -b
            qx, qy = point_to_world(c, s, x, y, ex, ey)
            walls[at + i, 0], walls[at + i, 1] = px, py
            walls[at + i, 2], walls[at + i, 3] = qx, qy
            px, py = qx, qy
