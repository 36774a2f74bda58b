"""The actors that can touch something in the coming physics step: only these are in the Space.

Each actor has a distance that it may move before it can touch a wall (`clear`), and one before it
can touch another actor (`free`): of the gap between two of them each has half. An actor that
has used up one is measured anew. An actor that can touch something is put into the Space; it leaves
once it has touched nothing for longer than Munk2D remembers a contact. All others move by the same
arithmetic without the Space.
"""

import math
from typing import Any, Final

from wheelchair_gym.actors.bodies import (
    actors_of,
    distance_to_chair,
    extent,
    is_box,
    put_into_space,
    read_actor_poses,
    take_out_of_space,
)
from wheelchair_gym.actors.records import DOOR
from wheelchair_gym.compiled.address import table_at
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.engine import body_view, move_freely
from wheelchair_gym.geometry.planar import point_segment_distance

STEPS_REMEMBERED: Final = 4  # Munk2D keeps what it knows of a contact for three steps after it
FASTEST: Final = 3.0  # m/s: the outline is never faster
ROUNDING: Final = 1e-6  # m
_FAR = 0.5  # m: farther things are not looked at
_PUSHED = 0.5  # m/s: contacts push nothing faster out of what it overlaps after one step


@borrowing_kernel
def _gap(row: Any, state: Any, other: Any, other_state: Any) -> float:
    """A distance [m] that two actors have at least: that of a disc from a box's middle line."""
    if is_box(row) and not is_box(other):
        row, state, other, other_state = other, other_state, row, state
    x, y = state.pose[0], state.pose[1]
    at = other_state.pose
    if not is_box(other):
        dx, dy = at[0] - x, at[1] - y
        return float(math.sqrt(dx * dx + dy * dy) - extent(row) - other.size[0])
    c, s = math.cos(at[2]), math.sin(at[2])
    front = other.size[0] if other.kind == DOOR else 0.5 * other.size[0]
    rear = front - other.size[0]
    away = point_segment_distance(
        x, y, at[0] + c * rear, at[1] + s * rear, at[0] + c * front, at[1] + s * front
    )
    return float(away - extent(row) - 0.5 * other.size[1])


@borrowing_kernel
def _measure_to_what_stays(world: Any, k: int) -> None:
    """Distance that an actor may move before it can touch a wall or a disc; leaves touch none."""
    rows, actor_states = actors_of(world)
    row, state = rows[k], actor_states[k]
    free, size, x, y = _FAR, extent(row), state.pose[0], state.pose[1]
    if row.kind != DOOR:
        walls = table_at(world.walls, world.n_fixed_walls, 4)
        for i in range(world.n_fixed_walls):
            reach = size + free
            ax, ay, bx, by = walls[i, 0], walls[i, 1], walls[i, 2], walls[i, 3]
            if (ax < x - reach and bx < x - reach) or (ax > x + reach and bx > x + reach):
                continue
            if (ay < y - reach and by < y - reach) or (ay > y + reach and by > y + reach):
                continue
            free = min(free, point_segment_distance(x, y, ax, ay, bx, by) - size)
        discs = table_at(world.discs, world.n_fixed_discs, 3)
        for i in range(world.n_fixed_discs):
            dx, dy = discs[i, 0] - x, discs[i, 1] - y
            free = min(free, math.sqrt(dx * dx + dy * dy) - discs[i, 2] - size)
    state.clear = free - ROUNDING


@borrowing_kernel
def _share_gaps(world: Any, k: int) -> None:
    """Half of the gap to each other actor is what either may move."""
    rows, actor_states = actors_of(world)
    row, state = rows[k], actor_states[k]
    size, state.free = extent(row), _FAR
    for j in range(world.n_actors):
        other = actor_states[j]
        dx, dy = other.pose[0] - state.pose[0], other.pose[1] - state.pose[1]
        reach = size + extent(rows[j]) + 2.0 * max(state.free, other.free, state.moved)
        reach += 2.0 * other.moved
        if j == k or dx * dx + dy * dy > reach * reach:
            continue
        half = 0.5 * _gap(row, state, rows[j], other) - ROUNDING
        if half <= max(state.moved, other.moved):
            half = 0.0
        state.free, other.free = min(state.free, half), min(other.free, half)


@borrowing_kernel
def _is_beside_chair(row: Any, actor: Any, state: Any, p: Any) -> bool:
    """Whether an actor and the chair can touch each other in the coming step."""
    front, rear, half = p.outline[0], p.outline[1], p.outline[2]
    reach = extent(row) + actor.moved + FASTEST * p.dt + ROUNDING
    dx, dy = actor.pose[0] - state.pose[0], actor.pose[1] - state.pose[1]
    far = reach + max(front, rear) + half
    if dx * dx + dy * dy > far * far:
        return False
    return bool(distance_to_chair(p, state.pose, actor.pose[0], actor.pose[1]) <= reach)


@borrowing_kernel
def choose_who_may_touch(engine: Any, world: Any, state: Any, p: Any) -> bool:
    """Put actors that can touch something in the coming step into the Space.

    Returns:
        Whether any is in the Space.
    """
    rows, actor_states = actors_of(world)
    for k in range(world.n_actors):
        actor = actor_states[k]
        fields = body_view(actor.body)
        speed = math.sqrt(fields.vx * fields.vx + fields.vy * fields.vy)
        if fields.w != 0.0:
            speed += extent(rows[k]) * abs(fields.w)
        actor.moved = (speed + (_PUSHED if actor.in_space else 0.0)) * p.dt
    for k in range(world.n_actors):
        actor = actor_states[k]
        is_due = not actor.in_space or state.tick > actor.measured_at + STEPS_REMEMBERED
        if actor.clear <= actor.moved and is_due:
            _measure_to_what_stays(world, k)
            actor.measured_at = state.tick
        if actor.free <= actor.moved:
            _share_gaps(world, k)
    found = False
    for k in range(world.n_actors):
        actor = actor_states[k]
        beside = _is_beside_chair(rows[k], actor, state, p)
        if beside or min(actor.clear, actor.free) <= actor.moved:
            actor.touchable_at = state.tick
            if not actor.in_space:
                put_into_space(engine, world, k)
        elif actor.in_space and state.tick > actor.touchable_at + STEPS_REMEMBERED:
            take_out_of_space(engine, world, actor)
        actor.clear -= actor.moved
        actor.free -= actor.moved
        found |= actor.in_space
    return found


@borrowing_kernel
def move_the_others(world: Any, dt: float) -> None:
    """Move the actors that are not in the Space by a physics step, and read where all are."""
    actor_states = actors_of(world)[1]
    for k in range(world.n_actors):
        if not actor_states[k].in_space:
            move_freely(actor_states[k].body, dt)
    read_actor_poses(world)
