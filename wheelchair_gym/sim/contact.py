"""Contacts: what the chair touched, and who is at fault.

The chair is at fault if some point of its outline approaches the other thing at more than 0.05 m/s,
and faster than the other thing approaches it. Speeds are those before the physics step that found
the contact, along the normal of the surfaces that meet. Of the chair's speed only the part counts
that its own driving explains: a chair that was shoved is not at fault. Driving explains the set
point, and from a higher one as much as tyres and motors could not yet brake; a quarter more than
that is an error of control, which counts.

A contact with an actor is judged when it begins and again after each second that it lasts: by then
a chair that was bumped into has long been able to stop.
"""

import math
from typing import Any, Final

from wheelchair_gym.actors.bodies import NEVER, actors_of, is_box, offset_from_outline, shapes_of
from wheelchair_gym.actors.records import PERSON
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.compiled.address import table_at
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.engine import body_view
from wheelchair_gym.geometry.outline import rectangle_point_gap, rectangle_segment_gap
from wheelchair_gym.geometry.planar import (
    body_to_world,
    point_segment_distance,
    point_to_world,
    world_to_body,
)

Motion = tuple[float, float, float, float, float]  # x, y [m], vx, vy [m/s], w [rad/s]

AT_FAULT_SPEED: Final = 0.05  # m/s: slower is no collision of the chair's making
_TOUCHING = 1e-6  # m: Munk2D finds contacts where shapes overlap; beyond rounding
_CONTROL, _CONTROL_MIN = 1.25, 0.005  # times, m/s: an error of control is no more than that
_REJUDGE_AFTER = 1.0  # s for which a contact, once judged, stays what it was: a stop takes 0.73 s
_CONTACT_OVER = 0.02  # m beyond which a contact is over
_NEAR = 0.10  # m: farther people do not come in one physics step
_STAND_OFF = 1e-4  # m that people leave who stop at the chair, so that they press on nothing
_DEEPEST = 0.03  # m: deeper than any contact comes in one physics step


@borrowing_kernel
def _speed(motion: Motion, px: float, py: float, nx: float, ny: float) -> float:
    """Speed [m/s] along (nx, ny) of the point (px, py) of something in motion."""
    vx = motion[2] - motion[4] * (py - motion[1])
    vy = motion[3] + motion[4] * (px - motion[0])
    return vx * nx + vy * ny


@borrowing_kernel
def _explained_speed(state: Any, speed: float, px: float, py: float, nx: float, ny: float) -> float:
    """Part [m/s] of the closing speed of a point of the outline that its own driving explains."""
    ahead = math.cos(state.pose[2]) * nx + math.sin(state.pose[2]) * ny
    around = (px - state.pose[0]) * ny - (py - state.pose[1]) * nx
    v = state.explained[1] if ahead > 0.0 else state.explained[0]
    w = state.explained[3] if around > 0.0 else state.explained[2]
    driven = max(0.0, ahead * v + around * w)
    return speed if speed <= _CONTROL * driven + _CONTROL_MIN else driven


@borrowing_kernel
def _record_contact(
    world: Any, state: Any, p: Any, number: int, chair: Motion, other: Motion, px: float,
    py: float, nx: float, ny: float,
) -> None:  # fmt: skip
    """Record one touching point, whose normal (nx, ny) looks away from the chair."""
    ours, theirs = _speed(chair, px, py, nx, ny), -_speed(other, px, py, nx, ny)
    driven = _explained_speed(state, ours, px, py, nx, ny)
    at_fault = driven > AT_FAULT_SPEED and driven > theirs
    if number >= 0:
        actor = actors_of(world)[1][number]
        if actor.judged_at < state.tick < actor.judged_at + _REJUDGE_AFTER / p.dt:
            if not state.contact_recorded:
                state.contact_with = number
            return
        actor.judged_at = state.tick
    if not state.contact_recorded or (at_fault and not state.at_fault):
        better = True
    else:
        faster = ours + theirs > state.approach_speed[0] + state.approach_speed[1]
        better = faster and at_fault == state.at_fault
    if better:
        state.contact_recorded, state.contact_with = True, number
        state.approach_speed[0], state.approach_speed[1] = ours, theirs
    state.at_fault |= at_fault


@borrowing_kernel
def nearest_point(
    state: Any, p: Any, x: float, y: float
) -> tuple[float, float, float, float, float]:
    """The outline's point nearest to (x, y): where, its normal that way, and how far off [m]."""
    c, s = math.cos(state.pose[2]), math.sin(state.pose[2])
    qx, qy, ex, ey = offset_from_outline(p, c, s, x - state.pose[0], y - state.pose[1])
    far = d = math.sqrt(ex * ex + ey * ey)
    if d == 0.0:  # it lies inside: away from the middle of the outline
        ex, ey = qx - 0.5 * (p.outline[0] - p.outline[1]), qy
        d = max(math.sqrt(ex * ex + ey * ey), _TOUCHING)
    ex, ey = ex / d, ey / d
    at_x, at_y = point_to_world(c, s, state.pose[0], state.pose[1], qx, qy)
    nx, ny = body_to_world(c, s, ex, ey)
    return at_x, at_y, nx, ny, far


@borrowing_kernel
def stop_people(world: Any, state: Any, p: Any, chair: Motion) -> float:
    """Stop people at the chair who would walk into it in the coming step; they press on nothing.

    Returns:
        The impulse [N s] that the hardest of them loses, which the strips feel.
    """
    rows, actor_states = actors_of(world)
    hardest = 0.0
    reach = math.hypot(max(p.outline[0], p.outline[1]), p.outline[2]) + _NEAR + _TOUCHING
    for k in range(world.n_actors):
        row, actor_state = rows[k], actor_states[k]
        if row.kind != PERSON:
            continue
        dx, dy = actor_state.pose[0] - state.pose[0], actor_state.pose[1] - state.pose[1]
        far = reach + row.size[0]
        if dx * dx + dy * dy > far * far:
            continue
        px, py, nx, ny, far = nearest_point(state, p, actor_state.pose[0], actor_state.pose[1])
        gap = far - row.size[0]
        if gap > _NEAR:
            continue
        fields = body_view(actor_state.body)
        toward = -(fields.vx * nx + fields.vy * ny)
        maximum = max(0.0, gap - _STAND_OFF) / p.dt
        if toward > maximum:
            other = (actor_state.pose[0], actor_state.pose[1], fields.vx, fields.vy, 0.0)
            _record_contact(world, state, p, k, chair, other, px, py, nx, ny)
            hardest = max(hardest, row.mass * (toward - maximum))
            fields.vx += (toward - maximum) * nx
            fields.vy += (toward - maximum) * ny
            actor_state.twist[0], actor_state.twist[1] = fields.vx, fields.vy
        force = -(fields.fx * nx + fields.fy * ny)
        if force > 0.0 and gap < _CONTACT_OVER:
            fields.fx += force * nx
            fields.fy += force * ny
    return hardest


@borrowing_kernel
def _touch_disc(
    world: Any, state: Any, p: Any, number: int, chair: Motion, other: Motion, disc: Array
) -> None:
    """Record a disc if it touches the outline."""
    px, py, nx, ny, far = nearest_point(state, p, disc[0], disc[1])
    if far <= disc[2] + _TOUCHING:
        _record_contact(world, state, p, number, chair, other, px, py, nx, ny)


@borrowing_kernel
def _touch_segment(
    world: Any, state: Any, p: Any, number: int, chair: Motion, other: Motion, segment: Array
) -> None:
    """Record a segment if it touches the outline: its ends on the sides, and corners on it."""
    ax, ay, bx, by = segment[0], segment[1], segment[2], segment[3]
    x, y, yaw = state.pose[0], state.pose[1], state.pose[2]
    front, rear, half = p.outline[0], p.outline[1], p.outline[2]
    reach = math.sqrt(max(front, rear) ** 2 + half * half) + _TOUCHING
    if point_segment_distance(x, y, ax, ay, bx, by) > reach:
        return
    if rectangle_segment_gap(x, y, yaw, p.outline[:], ax, ay, bx, by) > _TOUCHING:
        return
    c, s = math.cos(yaw), math.sin(yaw)
    for end in range(2):
        wx, wy = (ax, ay) if end == 0 else (bx, by)
        px, py = world_to_body(c, s, wx - x, wy - y)
        if rectangle_point_gap(px, py, p.outline[:]) > _TOUCHING:
            continue
        depth, nx, ny = front - px, 1.0, 0.0
        if px + rear < depth:
            depth, nx, ny = px + rear, -1.0, 0.0
        if half - abs(py) < depth:
            nx, ny = 0.0, math.copysign(1.0, py)
        nx, ny = body_to_world(c, s, nx, ny)
        _record_contact(world, state, p, number, chair, other, wx, wy, nx, ny)
    ex, ey = bx - ax, by - ay
    length = math.sqrt(ex * ex + ey * ey)
    if length == 0.0:
        return
    nx, ny = ey / length, -ex / length
    middle = 0.5 * (front - rear)
    if (ax - x - c * middle) * nx + (ay - y - s * middle) * ny < 0.0:
        nx, ny = -nx, -ny
    for k in range(4):
        px, py = front if k < 2 else -rear, half if k % 2 == 0 else -half
        wx, wy = point_to_world(c, s, x, y, px, py)
        beyond = (wx - ax) * nx + (wy - ay) * ny
        along = (wx - ax) * ex + (wy - ay) * ey
        if -_TOUCHING <= beyond <= _DEEPEST and 0.0 <= along <= length * length:
            _record_contact(world, state, p, number, chair, other, wx, wy, nx, ny)


@borrowing_kernel
def record_contacts(world: Any, state: Any, p: Any, chair: Motion) -> None:
    """Record everything that the chair touches, before the contact at a motion about its centre."""
    walls, discs = shapes_of(world)
    rest = (0.0, 0.0, 0.0, 0.0, 0.0)
    for k in range(world.n_fixed_walls):
        _touch_segment(world, state, p, -1, chair, rest, walls[k])
    for k in range(world.n_fixed_discs):
        _touch_disc(world, state, p, -1, chair, rest, discs[k])
    rows, actor_states = actors_of(world)
    for k in range(world.n_actors):
        row, actor_state, at = rows[k], actor_states[k], actor_states[k].slot
        pose, twist = actor_state.pose, actor_state.twist
        other = (pose[0], pose[1], twist[0], twist[1], twist[2])
        if is_box(row):
            for i in range(4):
                _touch_segment(world, state, p, k, chair, other, walls[at + i])
        else:
            _touch_disc(world, state, p, k, chair, other, discs[at])


@borrowing_kernel
def end_contacts(world: Any, state: Any, p: Any) -> None:
    """Actors that are clear of the chair may begin a new contact."""
    walls = table_at(world.walls, world.n_walls, 4)
    rows, actor_states = actors_of(world)
    x, y, yaw = state.pose[0], state.pose[1], state.pose[2]
    for k in range(world.n_actors):
        row, actor_state = rows[k], actor_states[k]
        if actor_state.judged_at == NEVER:
            continue
        gap = math.inf
        if is_box(row):
            for i in range(actor_state.slot, actor_state.slot + 4):
                w = walls[i]
                near = rectangle_segment_gap(x, y, yaw, p.outline[:], w[0], w[1], w[2], w[3])
                gap = min(gap, near)
        else:
            gap = nearest_point(state, p, actor_state.pose[0], actor_state.pose[1])[4] - row.size[0]
        if gap > _CONTACT_OVER:
            actor_state.judged_at = NEVER
