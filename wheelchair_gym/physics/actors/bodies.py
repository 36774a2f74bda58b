"""Movers in a world: their bodies in its Space, what pushes them, and what sensors see of them.

Everything that moves is a body of Munk2D. People and furniture have mass, and a person is driven by
a force no larger than legs give: so walls, doors and others hold them, and they can press nothing
through a wall, as bodies that are moved at will would. Whoever walks into the chair stops there,
as people do, and does not shove its 135 kg (`contact.stop_people`); a chair that drives into
somebody pushes them. Doors and obstacles are moved at will, of infinite mass: so a leaf holds
before it would touch anything, and no obstacle appears near the chair.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.compiled.address import integers_at, rows_of, table_at
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.physics.actors.records import DOOR, FURNITURE, MOVER, NOBODY, OBSTACLE, PERSON
from wheelchair_gym.physics.engine import (
    ANGLE,
    FX,
    FY,
    TORQUE,
    VX,
    VY,
    W,
    X,
    Y,
    add_shape,
    body_view,
    place,
    remove_shape,
    set_box,
    set_circle,
    set_touch,
    weigh,
)
from wheelchair_gym.physics.settings import GRAVITY

Array = NDArray[np.float64]

MOVING = np.dtype(
    [
        ("body", "u8"),  # addresses of the cpBody and of its cpShape
        ("shape", "u8"),
        ("slot", "i8"),  # row of its disc, or of its first segment, behind those that stay
        ("pose", "f8", (3,)),  # m, m, rad: after the last physics step
        ("twist", "f8", (3,)),  # m/s, m/s, rad/s: before it
        ("want", "f8", (2,)),  # m/s: the velocity that a person has chosen
        ("toward", "i8"),  # way point
        ("ahead", "i8"),  # 1, or -1: back along the route
        ("waited", "f8"),  # s without getting on
        ("open", "f8"),  # share of a door's travel
        ("wanted", "f8"),  # the same, to be reached
        ("there", "b1"),  # an obstacle that has appeared and is not gone
        ("gone", "b1"),
        ("until", "f8"),  # s: when it goes
        ("judged", "i8"),  # tick at which its contact with the chair was judged; NEVER: no contact
        ("carry", "i8"),  # an obstacle is to be put: 1 where it belongs, 2 away
    ],
    align=True,
)

NEVER = -(1 << 40)  # a tick long before any
FAR = 1e4  # m: where no wall is
_APART = 20.0  # m between things that are far away
_GHOSTS = 1  # the group of those who heed nobody: they pass through each other, as in DynaBARN
_WRAP = 3.0  # of a disc's radius and a box's length: their floor friction's mean lever is a third

rows_at = rows_of(MOVER)
moving_at = rows_of(MOVING)


@borrowing_kernel
def is_box(row: Any) -> bool:
    """Whether a mover has corners: furniture that is not round, and leaves."""
    return bool(row.size[1] > 0.0)


@borrowing_kernel
def _square(row: Any) -> float:
    """The squared diagonal of a box, or radius of a disc [m2]."""
    return float(row.size[0] * row.size[0] + row.size[1] * row.size[1])


@borrowing_kernel
def inertia(row: Any) -> float:
    """Moment of inertia of light furniture about its centre [kg m2]: a box's, or a disc's."""
    if is_box(row):
        return float(row.mass * _square(row) / 12.0)
    return float(0.5 * row.mass * _square(row))


@borrowing_kernel
def clear_movers(engine: Any, world: Any) -> None:
    """Take the movers of the last episode out of a world's Space."""
    moving = moving_at(world.moving, world.movers_in)
    for k in range(world.movers_in):
        remove_shape(engine.remove, world.space, moving[k].shape)
        remove_shape(engine.remove_body, world.space, moving[k].body)
    world.movers_in = 0


@borrowing_kernel
def bring_movers(engine: Any, world: Any) -> None:
    """Put this episode's movers into a world's Space, in order, far away and at rest.

    From then on the world's walls and discs are its own copy, with those of movers behind them.
    """
    n = world.n_movers
    rows, moving = rows_at(world.movers, n), moving_at(world.moving, n)
    walls, fixed = table_at(world.own_walls, world.n_fixed_walls, 4), world.n_fixed_walls
    given = table_at(world.walls, fixed, 4)
    for k in range(fixed):
        for i in range(4):
            walls[k, i] = given[k, i]
    discs, round_ones = table_at(world.own_discs, world.n_fixed_discs, 3), world.n_fixed_discs
    stand = table_at(world.discs, round_ones, 3)
    for k in range(round_ones):
        for i in range(3):
            discs[k, i] = stand[k, i]
    world.walls, world.discs = world.own_walls, world.own_discs
    segment, disc = fixed, round_ones
    balls, boxes, leaves = 0, 0, 0
    for k in range(n):
        row, own = rows[k], moving[k]
        moment = math.inf
        friction, group = world.friction, 0
        if row.kind == DOOR:
            pair = integers_at(world.leaves, 2 * (leaves + 1))[2 * leaves :]
            leaves += 1
            own.slot, segment = segment, segment + 4
            own.body, own.shape = np.uint64(pair[0]), np.uint64(pair[1])
            set_box(own.shape, 0.0, row.size[0], 0.5 * row.size[1])
        elif is_box(row):
            pair = integers_at(world.boxes, 2 * (boxes + 1))[2 * boxes :]
            boxes += 1
            own.slot, segment = segment, segment + 4
            own.body, own.shape = np.uint64(pair[0]), np.uint64(pair[1])
            set_box(own.shape, -0.5 * row.size[0], 0.5 * row.size[0], 0.5 * row.size[1])
            moment = inertia(row)
        else:
            pair = integers_at(world.balls, 2 * (balls + 1))[2 * balls :]
            balls += 1
            own.slot, disc = disc, disc + 1
            own.body, own.shape = np.uint64(pair[0]), np.uint64(pair[1])
            set_circle(own.shape, 0.0, 0.0, row.size[0])
            if row.kind == FURNITURE:
                moment = inertia(row)
            elif row.kind == PERSON:
                # Nobody is turned by rubbing along a wall; those who heed nobody pass each other.
                friction = 0.0
                group = _GHOSTS if row.heeds == NOBODY else 0
        set_touch(own.shape, friction, group)
        weigh(own.body, row.mass, moment)
        add_shape(engine.add_body, world.space, own.body)
        # Placed before its shape is added, which would remember where the body was last used.
        place(engine, world.space, own.body, -FAR, FAR + _APART * k, 0.0)
        add_shape(engine.add, world.space, own.shape)
    world.n_walls, world.n_discs = segment, disc
    world.movers_in = n


@borrowing_kernel
def follow(world: Any) -> None:
    """Read where the movers are from their bodies."""
    moving = moving_at(world.moving, world.n_movers)
    for k in range(world.n_movers):
        own = moving[k]
        fields = body_view(own.body)
        own.pose[0], own.pose[1], own.pose[2] = fields[X], fields[Y], fields[ANGLE]


@borrowing_kernel
def begin_movers(engine: Any, world: Any) -> None:
    """Put the movers where they begin; obstacles stay away."""
    n = world.n_movers
    rows, moving = rows_at(world.movers, n), moving_at(world.moving, n)
    for k in range(n):
        row, own = rows[k], moving[k]
        own.want[0], own.want[1] = 0.0, 0.0
        own.twist[0], own.twist[1], own.twist[2] = 0.0, 0.0, 0.0
        own.toward, own.ahead, own.waited = 0, 1, 0.0
        own.open, own.wanted, own.until = 0.0, 0.0, 0.0
        own.there, own.gone = row.kind != OBSTACLE, False
        own.carry, own.judged = 0, NEVER
        if own.there:
            place(engine, world.space, own.body, row.pose[0], row.pose[1], row.pose[2])
    follow(world)


@borrowing_kernel
def carry(engine: Any, world: Any) -> None:
    """Put obstacles that are to appear where they belong, and those that are to go away."""
    n = world.n_movers
    rows, moving = rows_at(world.movers, n), moving_at(world.moving, n)
    for k in range(n):
        row, own = rows[k], moving[k]
        if own.carry == 1:
            place(engine, world.space, own.body, row.pose[0], row.pose[1], row.pose[2])
        elif own.carry == 2:
            place(engine, world.space, own.body, -FAR, FAR + _APART * k, 0.0)
        own.carry = 0


@borrowing_kernel
def _push_person(row: Any, own: Any, fields: Array, p: Any) -> None:
    """The force of legs: towards the wanted velocity, never more than they give."""
    ax = (own.want[0] - fields[VX]) / p.relax
    ay = (own.want[1] - fields[VY]) / p.relax
    size = math.sqrt(ax * ax + ay * ay)
    share = row.mass * min(1.0, p.legs / (row.mass * size)) if size > 0.0 else 0.0
    fields[FX], fields[FY] = share * ax, share * ay


@borrowing_kernel
def _drag(row: Any, fields: Array, dt: float) -> None:
    """Friction on the floor: slows what slides and turns, and never turns it round."""
    speed = math.sqrt(fields[VX] * fields[VX] + fields[VY] * fields[VY])
    bound = row.friction * row.mass * GRAVITY
    if speed > 0.0:
        share = min(bound, row.mass * speed / dt) / speed
        fields[FX], fields[FY] = -share * fields[VX], -share * fields[VY]
    if fields[W] != 0.0:
        most = bound * math.sqrt(_square(row)) / _WRAP
        fields[TORQUE] = -math.copysign(min(most, inertia(row) * abs(fields[W]) / dt), fields[W])


@borrowing_kernel
def _move_leaf(row: Any, own: Any, fields: Array, dt: float) -> None:
    """The velocity of a leaf that takes it where `hold_leaves` has allowed it to go."""
    c, s = math.cos(row.pose[2]), math.sin(row.pose[2])
    way = own.open * row.travel
    if row.swings:
        fields[W] = (row.pose[2] + way - fields[ANGLE]) / dt
    else:
        fields[VX] = (row.pose[0] + c * way - fields[X]) / dt
        fields[VY] = (row.pose[1] + s * way - fields[Y]) / dt


@borrowing_kernel
def push(world: Any, p: Any) -> None:
    """What moves the movers in the coming physics step: forces, and velocities of doors."""
    n = world.n_movers
    rows, moving = rows_at(world.movers, n), moving_at(world.moving, n)
    for k in range(n):
        row, own = rows[k], moving[k]
        fields = body_view(own.body)
        if row.kind == PERSON:
            _push_person(row, own, fields, p)
        elif row.kind == FURNITURE:
            _drag(row, fields, p.dt)
        elif row.kind == DOOR:
            _move_leaf(row, own, fields, p.dt)
        own.twist[0], own.twist[1], own.twist[2] = fields[VX], fields[VY], fields[W]
