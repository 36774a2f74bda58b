"""Wishes of people beyond their routes: groups, pauses, phones, reactions, trolleys.

Each function gives where a person wants to go and how fast; a motion model (`orca`,
`social_force`) then gets them there without bumping into anything. Nobody wants to go faster than
their own speed. `docs/concepts/people.md` has a table of all that people do, with sources.
"""

import math
from typing import Any

import numpy as np

from wheelchair_gym.actors.bodies import actors_of, extent, offset_from_outline
from wheelchair_gym.actors.records import (
    CURIOUS,
    CUTS_IN,
    FURNITURE,
    ORCA,
    PAUSES,
    REGULAR,
    RUNS,
    SURPRISED,
    WALKS,
    WALKS_BESIDE,
    WARY,
)
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.compiled.address import table_at
from wheelchair_gym.compiled.kernel import borrowing_kernel, inlined
from wheelchair_gym.compiled.random import ACTORS, uniform
from wheelchair_gym.geometry.planar import body_to_world, point_to_world, segments_cross, wrap

Want = tuple[float, float, float, bool]  # offset [m] of a goal, speed [m/s], is it of the route

# HuNavSim (Perez-Higueras et al. 2023), its behaviour trees and agent manager.
_SURPRISED_WITHIN = 4.0  # m
_CURIOUS_WITHIN, _CURIOUS_STOP = 10.0, 1.5  # m
_CURIOUS_RATE = 0.18  # 1/s: speed per distance
_WARY_WITHIN, _WARY_SPEED = 3.0, 0.6  # m, m/s
_REACTS = (5.0, 15.0)  # s: how long a reaction lasts
_REACTS_AGAIN = 30.0  # s after its end

_CUT_AHEAD = 0.9  # m before the chair's outline: HuNavSim blocks a robot from 1.1 m
_CUT_REACHED, _CUT_TRIES = 0.4, 10.0  # m, s: when they are there, and when they give up
_CATCH_UP = 0.6  # s in which who keeps company makes up for a distance
_LOOKS_AHEAD = 1.5  # m
_SINGLE_FILE = 0.8  # m between people of a group where walls leave no other place
_WAITS_FROM, _WAITS_PER_METRE, _MIN_SHARE = 0.5, 0.4, 0.2  # of a leader whose group falls behind
_TURN_RATE = 1.5  # rad/s with which people turn who walk by `orca`
_RUN_TURN, _RUN_STANDS = math.radians(60.0), 0.2  # of a child: turns aside, share of standing
_NOWHERE = 0.05  # m, m/s: who wants no more than this keeps their heading
_SWING, _SWING_ROOM = 0.1, 0.4  # rad, m: a turn of a trolley, and the room that it needs
_SLACK = 0.2  # m: a trolley that is so far off stops who pushes it


@borrowing_kernel
def is_occluded(walls: Array, x: float, y: float, ex: float, ey: float) -> bool:
    """Whether one of the walls and leaves (n, 4) stands between two points."""
    left, right, low, high = min(x, ex), max(x, ex), min(y, ey), max(y, ey)
    for k in range(walls.shape[0]):
        ax, ay, bx, by = walls[k, 0], walls[k, 1], walls[k, 2], walls[k, 3]
        # Most walls lie on one side, which is quick to see.
        if (ax < left and bx < left) or (ax > right and bx > right):
            continue
        if (ay < low and by < low) or (ay > high and by > high):
            continue
        if segments_cross(x, y, ex, ey, ax, ay, bx, by):
            return True
    return False


@inlined
def leads(world: Any, k: int) -> bool:
    """Whether the actor behind person k in the rows goes with them: a group, or a trolley."""
    return bool(k + 1 < world.n_actors and actors_of(world)[0][k + 1].leader == 1)


@borrowing_kernel
def trolley_of(world: Any, k: int) -> int:
    """Return the trolley of person k; -1: none."""
    return k + 1 if leads(world, k) and actors_of(world)[0][k + 1].kind == FURNITURE else -1


@borrowing_kernel
def only_walks(world: Any, k: int) -> bool:
    """Whether a person does nothing but walk along a route."""
    row = actors_of(world)[0][k]
    plain = row.behaviour == WALKS and row.reaction == REGULAR and row.leader == 0
    return plain and not leads(world, k)


@borrowing_kernel
def _sees_chair(world: Any, state: Any, pose: Array, within: float) -> bool:
    """Whether a chair is in front of a person, within a distance [m], and no wall between."""
    x, y = state.pose[0], state.pose[1]
    dx, dy = pose[0] - x, pose[1] - y
    if dx * dx + dy * dy > within * within:
        return False
    if dx * math.cos(state.heading) + dy * math.sin(state.heading) < 0.0:
        return False
    walls = table_at(world.walls, world.n_fixed_walls, 4)
    return not is_occluded(walls, x, y, pose[0], pose[1])


@borrowing_kernel
def _is_at_it(state: Any, now: float, begins: bool, lasts: float, pause: float) -> bool:
    """Whether a person does what begins now, or has begun and lasts; again only after a pause."""
    if begins and now >= state.begins_again:
        state.lasts_until = now + lasts
        state.begins_again = state.lasts_until + pause
    return bool(now < state.lasts_until)


@borrowing_kernel
def _keep_up(row: Any, state: Any, x: float, y: float, ux: float, uy: float) -> Want:
    """Reach a place [m] that moves with a velocity (ux, uy) [m/s], and stay there."""
    vx = ux + (x - state.pose[0]) / _CATCH_UP
    vy = uy + (y - state.pose[1]) / _CATCH_UP
    return vx, vy, min(row.speed, math.sqrt(vx * vx + vy * vy)), False


@borrowing_kernel
def _place_beside(
    world: Any, x: float, y: float, yaw: float, offset: Array, behind: float, room: float
) -> tuple[float, float]:
    """A place at an offset (2,) from a pose; behind it where a wall is there, or soon will be."""
    c, s = math.cos(yaw), math.sin(yaw)
    px, py = point_to_world(c, s, x, y, offset[0], offset[1])
    far = math.sqrt((px - x) * (px - x) + (py - y) * (py - y))
    share = 1.0 + room / max(far, 1e-9)
    walls = table_at(world.walls, world.n_fixed_walls, 4)
    blocked = is_occluded(walls, x, y, x + share * (px - x), y + share * (py - y))
    if blocked or is_occluded(walls, px, py, px + _LOOKS_AHEAD * c, py + _LOOKS_AHEAD * s):
        px, py = point_to_world(c, s, x, y, -behind, 0.0)
    return px, py


@borrowing_kernel
def _walk_in_group(world: Any, k: int, dx: float, dy: float) -> Want:
    """Keep the place beside the first of a group; along the route (dx, dy) to who is hidden."""
    rows, actor_states = actors_of(world)
    row, state, first = rows[k], actor_states[k], actor_states[k - rows[k].leader]
    x, y = _place_beside(
        world, first.pose[0], first.pose[1], first.heading, row.offset, _SINGLE_FILE * row.leader,
        row.size[0],
    )  # fmt: skip
    walls = table_at(world.walls, world.n_fixed_walls, 4)
    if is_occluded(walls, state.pose[0], state.pose[1], x, y):
        return dx, dy, row.speed, False
    if row.points == rows[k - row.leader].points:  # the same route
        state.waypoint, state.direction = first.waypoint, first.direction
    return _keep_up(row, state, x, y, first.twist[0], first.twist[1])


@borrowing_kernel
def _walk_beside(world: Any, p: Any, row: Any, state: Any, pose: Array, twist: Array) -> Want:
    """Keep a place beside the chair."""
    behind = p.outline[1] + row.size[0] + _SINGLE_FILE
    x, y = _place_beside(world, pose[0], pose[1], pose[2], row.offset, behind, row.size[0])
    ux = twist[0] * math.cos(pose[2]) - twist[1] * (y - pose[1])
    uy = twist[0] * math.sin(pose[2]) + twist[1] * (x - pose[0])
    return _keep_up(row, state, x, y, ux, uy)


@borrowing_kernel
def _cut_in(p: Any, row: Any, state: Any, now: float, pose: Array, twist: Array) -> Want:
    """Get to a place right before the chair, and walk there for a while."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    ahead = p.outline[0] + _CUT_AHEAD
    x, y = pose[0] + c * ahead, pose[1] + s * ahead
    if math.hypot(x - state.pose[0], y - state.pose[1]) < _CUT_REACHED:
        state.lasts_until = min(state.lasts_until, now + row.stay)
    return _keep_up(row, state, x, y, twist[0] * c, twist[0] * s)


@borrowing_kernel
def _stay_away(dx: float, dy: float, ax: float, ay: float) -> tuple[float, float]:
    """A direction (dx, dy) of length 1, turned away from a chair that is (ax, ay) [m] off."""
    d = max(math.sqrt(ax * ax + ay * ay), 1e-9)
    ax, ay = -ax / d, -ay / d
    weight = _WARY_WITHIN / d - 1.0
    approach = dx * ax + dy * ay
    if approach < 0.0:  # go round it
        less = min(1.0, 2.0 * weight) * approach
        dx, dy = dx - less * ax, dy - less * ay
    return dx + weight * ax, dy + weight * ay


@borrowing_kernel
def _react(
    world: Any, row: Any, state: Any, key: np.uint64, tick: int, k: int, now: float, pose: Array,
    want: Want,
) -> Want:  # fmt: skip
    """Return the motion that a person who sees the chair wants."""
    ax, ay = pose[0] - state.pose[0], pose[1] - state.pose[1]
    d = math.sqrt(ax * ax + ay * ay)
    if row.reaction == WARY:
        if not _sees_chair(world, state, pose, _WARY_WITHIN):
            return want
        length = max(math.sqrt(want[0] * want[0] + want[1] * want[1]), 1e-9)
        dx, dy = _stay_away(want[0] / length, want[1] / length, ax, ay)
        return dx, dy, min(row.speed, _WARY_SPEED), False
    within = _CURIOUS_WITHIN if row.reaction == CURIOUS else _SURPRISED_WITHIN
    begins = now >= state.begins_again and _sees_chair(world, state, pose, within)
    index = 3 * world.n_actors + k
    lasts = _REACTS[0] + (_REACTS[1] - _REACTS[0]) * uniform(key, tick, ACTORS, index)
    if not _is_at_it(state, now, begins, lasts, _REACTS_AGAIN):
        return want
    speed = 0.0
    if row.reaction == CURIOUS and d > _CURIOUS_STOP:
        speed = min(row.speed, _CURIOUS_RATE * d)
    return ax, ay, speed, False


@borrowing_kernel
def _with_trolley(world: Any, p: Any, k: int, trolley: int, chair: Array, want: Want) -> Want:
    """Slower while a trolley has to be turned or is held; it is not turned towards a near chair."""
    rows, actor_states = actors_of(world)
    state, row, cart = actor_states[k], rows[trolley], actor_states[trolley].pose
    c, s = math.cos(cart[2]), math.sin(cart[2])
    x, y = point_to_world(c, s, state.pose[0], state.pose[1], row.offset[0], row.offset[1])
    held = math.hypot(cart[0] - x, cart[1] - y) / _SLACK
    turn = wrap(math.atan2(want[1], want[0]) - cart[2])
    a, b = math.cos(chair[2]), math.sin(chair[2])
    _, _, ex, ey = offset_from_outline(p, a, b, cart[0] - chair[0], cart[1] - chair[1])
    ex, ey = body_to_world(a, b, ex, ey)
    swings_away = turn * row.offset[0] * (c * ey - s * ex) >= 0.0
    if math.hypot(ex, ey) < extent(row) + _SWING_ROOM and abs(turn) > _SWING and not swings_away:
        state.blocked_for += 2.0 * p.decide_every * p.dt  # they turn back when this lasts
        return c, s, 0.0, want[3]
    speed = want[2] * max(0.0, math.cos(turn)) * max(0.0, 1.0 - held)
    return want[0], want[1], speed, want[3]


@borrowing_kernel
def _with_group(world: Any, k: int, want: Want) -> Want:
    """Slower where a group falls behind."""
    rows, actor_states = actors_of(world)
    row, state, speed = rows[k], actor_states[k], want[2]
    behind, j = 0.0, k + 1
    while j < world.n_actors and rows[j].leader == j - k:
        at, offset = actor_states[j].pose, rows[j].offset
        dx, dy = at[0] - state.pose[0], at[1] - state.pose[1]
        place = math.sqrt(offset[0] * offset[0] + offset[1] * offset[1])
        behind = max(behind, math.sqrt(dx * dx + dy * dy) - place)
        j += 1
    share = 1.0 - _WAITS_PER_METRE * max(0.0, behind - _WAITS_FROM)
    return want[0], want[1], min(speed, row.speed * max(_MIN_SHARE, share)), want[3]


@borrowing_kernel
def want_of(
    world: Any, p: Any, key: np.uint64, tick: int, k: int, pose: Array, twist: Array, dx: float,
    dy: float,
) -> Want:  # fmt: skip
    """Return the motion that person k wants near a chair at a pose (3,); by route: (dx, dy) [m]."""
    rows, actor_states = actors_of(world)
    row, state, now = rows[k], actor_states[k], tick * p.dt
    if row.leader > 0:
        return _walk_in_group(world, k, dx, dy)
    if row.behaviour == WALKS_BESIDE:
        return _walk_beside(world, p, row, state, pose, twist)
    speed = min(row.speed, math.sqrt(dx * dx + dy * dy) / (p.decide_every * p.dt))
    want = (dx, dy, speed, True)
    since = now - row.since
    if row.behaviour == PAUSES and since >= 0.0 and since % row.every < row.stay:
        want = (dx, dy, 0.0, False)
    elif row.behaviour == RUNS:
        draw = uniform(key, int(now / row.every), ACTORS, 2 * world.n_actors + k)
        stands = draw < _RUN_STANDS
        turn = _RUN_TURN * (2.0 * (draw - _RUN_STANDS) / (1.0 - _RUN_STANDS) - 1.0)
        c, s = math.cos(turn), math.sin(turn)
        want = (c * dx - s * dy, s * dx + c * dy, 0.0 if stands else speed, not stands)
    if row.behaviour == CUTS_IN:
        begins = now >= state.begins_again and _sees_chair(world, state, pose, row.near)
        if _is_at_it(state, now, begins, _CUT_TRIES, row.every):
            want = _cut_in(p, row, state, now, pose, twist)
    elif row.reaction == CURIOUS or row.reaction == WARY or row.reaction == SURPRISED:
        want = _react(world, row, state, key, tick, k, now, pose, want)
    if not leads(world, k):
        return want
    trolley = trolley_of(world, k)
    if trolley >= 0:
        return _with_trolley(world, p, k, trolley, pose, want)
    return _with_group(world, k, want)


@borrowing_kernel
def face(row: Any, state: Any, dx: float, dy: float, period: float) -> None:
    """Turn a person to where they want to go, or to what they look at, (dx, dy) [m] off."""
    if dx * dx + dy * dy > _NOWHERE * _NOWHERE:
        state.facing = math.atan2(dy, dx)
    if row.model == ORCA:
        turn, maximum = wrap(state.facing - state.heading), _TURN_RATE * period
        state.heading = wrap(state.heading + max(-maximum, min(maximum, turn)))
