"""Motion of people: along their routes, and by their other wishes (`behaviours`).

Those who walk by optimal reciprocal collision avoidance (`orca`) choose a velocity here; who walks
by the social force model (`social_force`) is pushed there.

Someone who avoids all keeps from walls, things, other people and the chair; someone who pays no
attention notices the chair only when it is a step away; someone who avoids nobody goes straight on.
A person who touches the chair stops there. One who does not get on for a while turns back, so
that no doorway stays jammed.
"""

import math
from typing import Any

import numpy as np

from wheelchair_gym.actors.behaviours import face, is_occluded, only_walks, trolley_of, want_of
from wheelchair_gym.actors.bodies import actors_of, extent, offset_from_outline
from wheelchair_gym.actors.orca import HALF_PLANES, avoid_disc, avoid_wall, best_velocity
from wheelchair_gym.actors.records import (
    CUTS_IN,
    DOOR,
    EVERYBODY,
    INATTENTIVE_DISTANCE,
    INDIFFERENT,
    NOBODY,
    PERSON,
    READS_PHONE,
    SOCIAL_FORCE,
)
from wheelchair_gym.actors.separation import ROUNDING
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.compiled.address import on_stack, table_at
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.compiled.random import ACTORS, normal, uniform
from wheelchair_gym.geometry.planar import body_to_world

_HORIZON = 2.0  # s for which people avoid others and the chair: RVO2 (van den Berg et al. 2011)
_WALL_HORIZON = 0.5  # s for which they avoid walls
_NEIGHBOUR_DISTANCE = 4.0  # m: others who are farther away are ignored
_WALLS = 16  # lines of walls and things at most: the others are for who moves
_REACHED = 0.35  # m: a way point counts as reached; about a step
_PASSED = 1.0  # m: and this near when its line has been crossed
_TOUCH = 0.02  # m: a person this near to the chair stops pressing on
_PERSONAL_SPACE = 0.15  # m that people leave between themselves and a chair that they see
_SLOW = 0.25  # of the preferred speed: less than this along the way is no getting on
_HEADING_NOISE = 0.03  # rad: of each choice; breaks the symmetry of two who meet


@borrowing_kernel
def _next_waypoint(world: Any, row: Any, state: Any) -> None:
    """Take up the next way point once the present one is reached, back and forth."""
    route = table_at(world.routes, world.n_routes, 2)
    if row.points < 2:
        return
    for _ in range(row.points):
        at = row.first + state.waypoint
        dx, dy = route[at, 0] - state.pose[0], route[at, 1] - state.pose[1]
        square = dx * dx + dy * dy
        before = state.waypoint - state.direction
        done = square < _REACHED * _REACHED
        after = state.waypoint + state.direction
        last = after < 0 or after >= row.points
        if not done and not last and 0 <= before < row.points and square < _PASSED * _PASSED:
            ex = route[at, 0] - route[row.first + before, 0]
            ey = route[at, 1] - route[row.first + before, 1]
            done = dx * ex + dy * ey < 0.0
        if not done:
            return
        if last:
            state.direction = -state.direction
        state.waypoint += state.direction
        state.blocked_for = 0.0


@borrowing_kernel
def _walls_about(world: Any, k: int, trolley: int, sight: float, near: Array) -> int:
    """Copy the walls and leaves in the sight [m] of person k, and between them and neighbours.

    They are those whose bounding boxes meet one that holds all this, except the person's own
    trolley; returns how many.
    """
    rows, actor_states = actors_of(world)
    x, y = actor_states[k].pose[0], actor_states[k].pose[1]
    left, right, low, high = x - sight, x + sight, y - sight, y + sight
    for j in range(world.n_actors):
        at = actor_states[j].pose
        dx, dy = at[0] - x, at[1] - y
        near_by = dx * dx + dy * dy <= _NEIGHBOUR_DISTANCE * _NEIGHBOUR_DISTANCE
        if rows[j].kind == PERSON and near_by:
            left, right = min(left, at[0]), max(right, at[0])
            low, high = min(low, at[1]), max(high, at[1])
    walls, n = table_at(world.walls, world.n_walls, 4), 0
    own = actor_states[trolley].slot if trolley >= 0 else world.n_walls
    for begin, end in ((0, own), (own + 4, world.n_walls)):
        for i in range(begin, end):
            ax, ay, bx, by = walls[i, 0], walls[i, 1], walls[i, 2], walls[i, 3]
            near[n, 0], near[n, 1], near[n, 2], near[n, 3] = ax, ay, bx, by
            # Without branches, which would often be guessed wrongly.
            along_x = ((ax >= left) | (bx >= left)) & ((ax <= right) | (bx <= right))
            along_y = ((ay >= low) | (by >= low)) & ((ay <= high) | (by <= high))
            n += int(along_x & along_y)
    return n


@borrowing_kernel
def _static_half_planes(world: Any, state: Any, radius: float, sight: float, walls: Array) -> int:
    """Lines of near walls (n, 4), leaves among them, and of static things; returns how many.

    It also measures how far the person is from walls and discs that stay (`separation`).
    """
    lines = table_at(world.half_planes, 2 * HALF_PLANES, 4)
    discs = table_at(world.discs, world.n_fixed_discs, 3)
    x, y, n = state.pose[0], state.pose[1], 0
    n, nearest = _avoid_walls(x, y, radius, sight, walls, lines, n)
    state.clear = math.sqrt(nearest) - radius - ROUNDING
    rows, actor_states = actors_of(world)
    for k in range(world.n_fixed_discs):
        ex, ey, r = x - discs[k, 0], y - discs[k, 1], discs[k, 2]
        state.clear = min(state.clear, math.sqrt(ex * ex + ey * ey) - r - radius - ROUNDING)
        n = _avoid_static_disc(lines, n, ex, ey, radius, sight, r)
    for k in range(world.n_actors):
        row, at = rows[k], actor_states[k].pose
        things = row.kind != PERSON and row.kind != DOOR and row.size[1] == 0.0
        if things and actor_states[k].is_present:
            ex, ey, r = x - at[0], y - at[1], row.size[0]
            n = _avoid_static_disc(lines, n, ex, ey, radius, sight, r)
    return n


@borrowing_kernel
def _avoid_static_disc(
    lines: Array, n: int, ex: float, ey: float, radius: float, sight: float, r: float
) -> int:
    """The line of one static disc, from which a person is (ex, ey) away."""
    d = math.sqrt(ex * ex + ey * ey)
    if d - r < sight and d > 0.0 and n < _WALLS:
        return avoid_wall(lines, n, ex / d, ey / d, d - r - radius, _WALL_HORIZON)
    return n


@borrowing_kernel
def _avoid_walls(
    x: float, y: float, radius: float, sight: float, walls: Array, lines: Array, n: int
) -> tuple[int, float]:
    """Lines of near walls (m, 4) behind n others; how many there are, and the least square [m2]."""
    nearest = sight * sight
    for k in range(walls.shape[0]):
        ax, ay, bx, by = walls[k, 0], walls[k, 1], walls[k, 2], walls[k, 3]
        if (ax < x - sight and bx < x - sight) or (ax > x + sight and bx > x + sight):
            continue
        ex, ey = bx - ax, by - ay
        along, square = (x - ax) * ex + (y - ay) * ey, ex * ex + ey * ey
        t = 0.0 if along <= 0.0 else (along / square if along < square else 1.0)
        dx, dy = x - ax - t * ex, y - ay - t * ey
        far = dx * dx + dy * dy
        nearest = min(nearest, far)
        if far < sight * sight and far > 0.0 and n < _WALLS:
            d = math.sqrt(far)
            n = avoid_wall(lines, n, dx / d, dy / d, d - radius, _WALL_HORIZON)
    return n, nearest


@borrowing_kernel
def _avoid_outline(
    p: Any, state: Any, row: Any, radius: float, n: int, lines: Array, pose: Array
) -> int:
    """The line of the chair's outline as a wall, for people who see or touch it."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    dx, dy = state.pose[0] - pose[0], state.pose[1] - pose[1]
    _, _, ex, ey = offset_from_outline(p, c, s, dx, dy)
    d = math.sqrt(ex * ex + ey * ey)
    gap = d - radius
    nx, ny = body_to_world(c, s, ex, ey)
    nx, ny = nx / max(d, 1e-9), ny / max(d, 1e-9)
    sight = (_NEIGHBOUR_DISTANCE, INATTENTIVE_DISTANCE, 0.0)[EVERYBODY - row.avoids]
    if d > 0.0 and gap < sight:
        space = 0.0 if row.reaction == INDIFFERENT else _PERSONAL_SPACE
        return avoid_wall(lines, n, nx, ny, gap - space, 2.0 * _WALL_HORIZON)
    if d > 0.0 and gap < _TOUCH:
        return avoid_wall(lines, n, nx, ny, 0.0, _WALL_HORIZON)
    return n


@borrowing_kernel
def _avoid_chair(
    p: Any, state: Any, own_radius: float, vx: float, vy: float, n: int, lines: Array, pose: Array,
    twist: Array,
) -> int:  # fmt: skip
    """Lines of the chair as two discs that cover its outline; it is not relied on to give way."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    quarter = 0.25 * (p.outline[0] + p.outline[1])
    radius = math.sqrt(quarter * quarter + p.outline[2] * p.outline[2]) + own_radius
    for part in range(2):
        ahead = (3.0 if part == 0 else 1.0) * quarter - p.outline[1]
        dx = pose[0] + c * ahead - state.pose[0]
        dy = pose[1] + s * ahead - state.pose[1]
        if dx * dx + dy * dy < (_NEIGHBOUR_DISTANCE + radius) * (_NEIGHBOUR_DISTANCE + radius):
            ux, uy = twist[0] * c - twist[1] * s * ahead, twist[0] * s + twist[1] * c * ahead
            n = avoid_disc(
                lines, n, dx, dy, radius, vx, vy, ux, uy, 1.0, _HORIZON, p.decide_every * p.dt
            )
    return n


@borrowing_kernel
def _moving_half_planes(
    world: Any, p: Any, k: int, state: Any, radius: float, walls: Array, n: int, lines: Array,
    pose: Array, twist: Array,
) -> int:  # fmt: skip
    """Lines of the chair and of other people for person k, or their trolley: a disc at a state."""
    rows, actor_states = actors_of(world)
    row, velocity = rows[k], actor_states[k].twist
    vx, vy = velocity[0], velocity[1]
    keeps_from_chair = row.reaction != INDIFFERENT and row.behaviour != CUTS_IN
    if row.avoids == EVERYBODY and keeps_from_chair:
        n = _avoid_chair(p, state, radius, vx, vy, n, lines, pose, twist)
    if row.avoids == NOBODY:
        return n
    near = INATTENTIVE_DISTANCE if row.behaviour == READS_PHONE else _NEIGHBOUR_DISTANCE
    for j in range(world.n_actors):
        other, at = rows[j], actor_states[j].pose
        dx, dy = at[0] - state.pose[0], at[1] - state.pose[1]
        if j == k or other.kind != PERSON or dx * dx + dy * dy > near * near:
            continue
        if is_occluded(walls, state.pose[0], state.pose[1], at[0], at[1]):
            continue
        ux, uy = actor_states[j].twist[0], actor_states[j].twist[1]
        share = 1.0 if other.avoids == NOBODY else 0.5
        both, overlap_time = radius + other.size[0], p.decide_every * p.dt
        n = avoid_disc(lines, n, dx, dy, both, vx, vy, ux, uy, share, _HORIZON, overlap_time)
    return n


@borrowing_kernel
def _choose_velocity(
    world: Any, p: Any, k: int, trolley: int, wx: float, wy: float, pose: Array, twist: Array,
    near: Array,
) -> tuple[float, float]:  # fmt: skip
    """The velocity that person k, who may have a trolley, chooses for a preferred one [m/s]."""
    rows, actor_states = actors_of(world)
    row, state = rows[k], actor_states[k]
    lines = table_at(world.half_planes, 2 * HALF_PLANES, 4)
    radius = row.size[0]
    hard, walls, beyond = 0, near[:0], 0.0
    if trolley >= 0:
        beyond = abs(rows[trolley].offset[0]) + extent(rows[trolley])
    if row.avoids != NOBODY:
        sight = radius + row.speed * _WALL_HORIZON
        walls = near[: _walls_about(world, k, trolley, sight + beyond, near)]
        hard = _static_half_planes(world, state, radius, sight, walls)
    hard = _avoid_outline(p, state, row, radius, hard, lines, pose)
    if trolley >= 0:
        cart, cart_radius = actor_states[trolley], extent(rows[trolley])
        sight = cart_radius + row.speed * _WALL_HORIZON
        x, y = cart.pose[0], cart.pose[1]
        hard, _ = _avoid_walls(x, y, cart_radius, sight, walls, lines, hard)
        hard = _avoid_outline(p, cart, row, cart_radius, hard, lines, pose)
    n = _moving_half_planes(world, p, k, state, radius, walls, hard, lines, pose, twist)
    if trolley >= 0:
        cart, cart_radius = actor_states[trolley], extent(rows[trolley])
        n = _moving_half_planes(world, p, k, cart, cart_radius, walls, n, lines, pose, twist)
    return best_velocity(lines, hard, n, row.speed, wx, wy)


@borrowing_kernel
def choose_velocities(
    world: Any, p: Any, key: np.uint64, tick: int, pose: Array, twist: Array
) -> None:
    """Choose a velocity for every person, all from the same instant of a chair at a pose (3,)."""
    rows, actor_states = actors_of(world)
    route = table_at(world.routes, world.n_routes, 2)
    period = p.decide_every * p.dt
    near = table_at(on_stack(32 * world.n_walls), world.n_walls, 4)  # walls about one person
    for k in range(world.n_actors):
        row, state = rows[k], actor_states[k]
        if row.kind != PERSON:
            continue
        _next_waypoint(world, row, state)
        at = row.first + state.waypoint
        dx, dy = route[at, 0] - state.pose[0], route[at, 1] - state.pose[1]
        far, is_on_way, plain = math.sqrt(dx * dx + dy * dy), True, only_walks(world, k)
        if far < _REACHED and row.points < 2 and plain:
            state.preferred_velocity[0], state.preferred_velocity[1] = 0.0, 0.0
            continue
        speed = min(row.speed, far / period)
        if not plain:
            dx, dy, speed, is_on_way = want_of(world, p, key, tick, k, pose, twist, dx, dy)
            far = math.sqrt(dx * dx + dy * dy)
        if not plain or row.model == SOCIAL_FORCE:
            face(row, state, dx, dy, period)
        sway = 0.0 if row.avoids == NOBODY else _HEADING_NOISE * normal(key, tick, ACTORS, k)
        turn = math.atan2(dy, dx) + sway
        wx, wy = speed * math.cos(turn), speed * math.sin(turn)
        if row.model != SOCIAL_FORCE:
            trolley = -1 if plain else trolley_of(world, k)
            wx, wy = _choose_velocity(world, p, k, trolley, wx, wy, pose, twist, near)
        state.preferred_velocity[0], state.preferred_velocity[1] = wx, wy
        if not is_on_way:
            state.blocked_for = 0.0
            continue
        got = (state.twist[0] * dx + state.twist[1] * dy) / max(far, 1e-9)
        change = period if got < _SLOW * speed else -period
        state.blocked_for = max(0.0, state.blocked_for + change)
        limit = row.patience * (0.5 + uniform(key, tick, ACTORS, world.n_actors + k))
        if state.blocked_for > limit and row.points > 1:
            state.direction, state.blocked_for = -state.direction, 0.0
            state.waypoint = min(row.points - 1, max(0, state.waypoint + state.direction))
