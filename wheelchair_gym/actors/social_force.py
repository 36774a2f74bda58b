"""The headed social force model: forces of people, walls and the chair, and a body with a heading.

Farina, Fontanelli, Garulli, Giannitrapani and Prattichizzo 2017 (Walking Ahead: The Headed Social
Force Model), without their force between members of a group; repulsion is that of Helbing, Farkas
and Vicsek 2000 without the contact forces, which are Munk2D's. No force is greater than legs give,
and nobody is faster than their own speed.
"""

import math
from typing import Any

from wheelchair_gym.actors.behaviours import is_occluded, trolley_of
from wheelchair_gym.actors.bodies import actors_of, extent, leg_force, offset_from_outline
from wheelchair_gym.actors.records import (
    DOOR,
    EVERYBODY,
    INATTENTIVE_DISTANCE,
    NOBODY,
    PERSON,
    READS_PHONE,
    SOCIAL_FORCE,
    WALKS_BESIDE,
)
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.compiled.address import table_at
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.engine import body_view
from wheelchair_gym.geometry.planar import body_to_world, world_to_body, wrap

# Farina et al. 2017 and their code (`HeadedSocialForceModel`).
_DRIVE_TIME = 0.5  # s in which a person comes to the wanted velocity
_SIDEWAYS_GAIN = 1.0  # share of the forces of others and walls that moves a person sideways
_SIDEWAYS_DAMPING = 500.0  # kg/s, against walking sideways
_TURN_GAIN = 0.3  # 1/(kg m): turn acceleration per angle and driving force
_TURN_RATIO = 3.0  # of the two rates with which a turn decays
_STRENGTH = 2000.0  # N at contact with a person, the chair, a wall, a thing (Helbing et al. 2000)
_WALL_RANGE = 0.08  # m in which a force falls to 1/e, of a group's, too (Helbing et al. 2000)
# The same of other people and the chair, from the range of walls in Helbing and Molnar 1995: with
# 0.08 m, 200 N stop nobody in time.
_SOCIAL_RANGE = 0.2
_REACH = 10.0  # ranges: beyond, a force is below a twenty-thousandth
_TURNS = 20.0  # N: who stands turns to what they look at as if this force drove them


@borrowing_kernel
def _repulsion(strength: float, scale: float, gap: float, dx: float, dy: float) -> Any:
    """The force [N] along (dx, dy) away from what is a gap [m] off."""
    d = math.sqrt(dx * dx + dy * dy)
    if gap > _REACH * scale or d == 0.0:
        return 0.0, 0.0
    force = strength * math.exp(-gap / scale) / d
    return force * dx, force * dy


@borrowing_kernel
def _force_of_walls(world: Any, k: int) -> tuple[float, float]:
    """Return the force of walls, leaves, boxes and round things, except one's own trolley."""
    rows, actor_states = actors_of(world)
    x, y, radius = actor_states[k].pose[0], actor_states[k].pose[1], rows[k].size[0]
    trolley = trolley_of(world, k)
    own = actor_states[trolley].slot if trolley >= 0 else -4
    reach = radius + _REACH * _WALL_RANGE
    walls, fx, fy = table_at(world.walls, world.n_walls, 4), 0.0, 0.0
    for i in range(world.n_walls):
        ax, ay, bx, by = walls[i, 0], walls[i, 1], walls[i, 2], walls[i, 3]
        if (ax < x - reach and bx < x - reach) or (ax > x + reach and bx > x + reach):
            continue
        if own <= i < own + 4:
            continue
        ex, ey = bx - ax, by - ay
        along, square = (x - ax) * ex + (y - ay) * ey, ex * ex + ey * ey
        t = 0.0 if along <= 0.0 else (along / square if along < square else 1.0)
        dx, dy = x - ax - t * ex, y - ay - t * ey
        gap = math.sqrt(dx * dx + dy * dy) - radius
        gx, gy = _repulsion(_STRENGTH, _WALL_RANGE, gap, dx, dy)
        fx, fy = fx + gx, fy + gy
    discs = table_at(world.discs, world.n_fixed_discs, 3)
    for i in range(world.n_fixed_discs):
        dx, dy = x - discs[i, 0], y - discs[i, 1]
        gap = math.sqrt(dx * dx + dy * dy) - discs[i, 2] - radius
        gx, gy = _repulsion(_STRENGTH, _WALL_RANGE, gap, dx, dy)
        fx, fy = fx + gx, fy + gy
    for j in range(world.n_actors):
        other, at = rows[j], actor_states[j].pose
        if other.kind == PERSON or other.kind == DOOR or other.size[1] > 0.0:
            continue
        if actor_states[j].is_present:
            dx, dy = x - at[0], y - at[1]
            gap = math.sqrt(dx * dx + dy * dy) - other.size[0] - radius
            gx, gy = _repulsion(_STRENGTH, _WALL_RANGE, gap, dx, dy)
            fx, fy = fx + gx, fy + gy
    return fx, fy


@borrowing_kernel
def _force_of_people(world: Any, k: int) -> tuple[float, float]:
    """Of other people not hidden by a wall; of those of one's group, and to a phone, only close."""
    rows, actor_states = actors_of(world)
    row, x, y = rows[k], actor_states[k].pose[0], actor_states[k].pose[1]
    walls = table_at(world.walls, world.n_fixed_walls, 4)
    fx, fy = 0.0, 0.0
    for j in range(world.n_actors):
        other, at = rows[j], actor_states[j].pose
        if j == k or other.kind != PERSON:
            continue
        dx, dy = x - at[0], y - at[1]
        gap = math.sqrt(dx * dx + dy * dy) - row.size[0] - other.size[0]
        if gap > _REACH * _SOCIAL_RANGE or is_occluded(walls, x, y, at[0], at[1]):
            continue
        close = row.behaviour == READS_PHONE or j - other.leader == k - row.leader
        scale = _WALL_RANGE if close else _SOCIAL_RANGE
        gx, gy = _repulsion(_STRENGTH, scale, gap, dx, dy)
        fx, fy = fx + gx, fy + gy
    return fx, fy


@borrowing_kernel
def _force_of_chair(
    p: Any, row: Any, state: Any, radius: float, pose: Array
) -> tuple[float, float]:
    """Of the chair's outline on a disc, of a person or a trolley.

    Of a chair that somebody wants to be beside, or overlooks, only close.
    """
    c, s = math.cos(pose[2]), math.sin(pose[2])
    _, _, ex, ey = offset_from_outline(p, c, s, state.pose[0] - pose[0], state.pose[1] - pose[1])
    gap = math.sqrt(ex * ex + ey * ey) - radius
    if row.avoids != EVERYBODY and gap > INATTENTIVE_DISTANCE:
        return 0.0, 0.0
    dx, dy = body_to_world(c, s, ex, ey)
    close = row.behaviour == WALKS_BESIDE or row.behaviour == READS_PHONE
    gx, gy = _repulsion(_STRENGTH, _WALL_RANGE if close else _SOCIAL_RANGE, gap, dx, dy)
    return gx, gy


@borrowing_kernel
def _turn(state: Any, force: float, dt: float) -> None:
    """Turn towards where a person wants to go, the faster the more force [N] drives them."""
    stiffness = _TURN_GAIN * max(force, _TURNS)
    damping = (1.0 + _TURN_RATIO) * math.sqrt(stiffness / _TURN_RATIO)
    off = wrap(state.heading - state.facing)
    state.turn_rate -= (stiffness * off + damping * state.turn_rate) * dt
    state.heading = wrap(state.heading + state.turn_rate * dt)


@borrowing_kernel
def _headed_step(p: Any, row: Any, state: Any, fields: Any, ex: float, ey: float) -> None:
    """The force on a body for a physics step, of a force (ex, ey) [N] of what is around."""
    vx, vy, dt, mass = fields.vx, fields.vy, p.dt, row.mass
    # What drives them along: equation 4 of Farina et al., with a velocity for a speed's direction.
    dx = mass * (state.preferred_velocity[0] - vx) / _DRIVE_TIME
    dy = mass * (state.preferred_velocity[1] - vy) / _DRIVE_TIME
    c, s = math.cos(state.heading), math.sin(state.heading)
    ahead, aside = world_to_body(c, s, vx, vy)
    ahead += (c * (dx + ex) + s * (dy + ey)) / mass * dt
    push = _SIDEWAYS_GAIN * (c * ey - s * ex) - _SIDEWAYS_DAMPING * aside
    aside += push / mass * dt
    _turn(state, math.sqrt(dx * dx + dy * dy), dt)
    c, s = math.cos(state.heading), math.sin(state.heading)
    wx, wy = body_to_world(c, s, ahead, aside)
    fast = math.sqrt(wx * wx + wy * wy)
    if fast > row.speed:
        wx, wy = wx * row.speed / fast, wy * row.speed / fast
    fields.fx, fields.fy = leg_force(row, (wx - vx) / dt, (wy - vy) / dt)


@borrowing_kernel
def apply_social_forces(world: Any, p: Any, pose: Array) -> None:
    """Push everybody who walks by this model, for the coming step, about a chair at a pose (3,)."""
    rows, actor_states = actors_of(world)
    for k in range(world.n_actors):
        row, state = rows[k], actor_states[k]
        if row.kind != PERSON or row.model != SOCIAL_FORCE:
            continue
        fx = fy = 0.0
        if row.avoids != NOBODY:
            for gx, gy in (
                _force_of_walls(world, k), _force_of_people(world, k),
                _force_of_chair(p, row, state, row.size[0], pose),
            ):  # fmt: skip
                fx, fy = fx + gx, fy + gy
            trolley = trolley_of(world, k)
            if trolley >= 0:
                cart = actor_states[trolley]
                gx, gy = _force_of_chair(p, row, cart, extent(rows[trolley]), pose)
                fx, fy = fx + gx, fy + gy
        _headed_step(p, row, state, body_view(state.body), fx, fy)
