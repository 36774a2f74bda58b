"""When doors open and obstacles appear, and what holds a leaf."""

import math
from typing import Any

from wheelchair_gym.actors.bodies import actors_of, distance_to_chair, extent
from wheelchair_gym.actors.records import DOOR, OBSTACLE, PERSON
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.compiled.address import doubles_at
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.geometry.outline import rectangle_segment_gap
from wheelchair_gym.geometry.planar import point_segment_distance

_SPACING = 0.30  # m that an obstacle keeps from other actors when it appears


@borrowing_kernel
def _leaf_ends(row: Any, share: float) -> tuple[float, float, float, float]:
    """Both ends [m] of the middle line of a door's leaf that is opened by a share."""
    x, y, angle, way = row.pose[0], row.pose[1], row.pose[2], share * row.travel
    if row.swings:
        angle += way
    else:
        x, y = x + math.cos(angle) * way, y + math.sin(angle) * way
    return x, y, x + math.cos(angle) * row.size[0], y + math.sin(angle) * row.size[0]


@borrowing_kernel
def _leaf_gap(
    world: Any, p: Any, pose: Array, j: int, x: float, y: float, ex: float, ey: float
) -> float:
    """Distance [m] from a leaf's middle line to actor j; to the chair at a pose where j is -1."""
    if j < 0:
        return rectangle_segment_gap(pose[0], pose[1], pose[2], p.outline[:], x, y, ex, ey)
    rows, actor_states = actors_of(world)
    other, at = rows[j], actor_states[j].pose
    if other.size[1] > 0.0:
        box = doubles_at(world.half_planes, 3)  # its outline, as of a chair
        box[0] = box[1] = 0.5 * other.size[0]
        box[2] = 0.5 * other.size[1]
        return rectangle_segment_gap(at[0], at[1], at[2], box, x, y, ex, ey)
    return float(point_segment_distance(at[0], at[1], x, y, ex, ey) - other.size[0])


@borrowing_kernel
def _is_blocked(world: Any, p: Any, pose: Array, k: int, share: float) -> bool:
    """Whether opening door k to a share brings its leaf nearer to anything that is near."""
    rows, actor_states = actors_of(world)
    row = rows[k]
    minimum = row.minimum + 0.5 * row.size[1]
    x, y, ex, ey = _leaf_ends(row, share)
    ax, ay, bx, by = _leaf_ends(row, actor_states[k].opening)
    outer = max(p.outline[0], p.outline[1]) + p.outline[2]
    for j in range(-1, world.n_actors):
        if j >= 0 and (rows[j].kind == DOOR or not actor_states[j].is_present):
            continue
        at = pose if j < 0 else actor_states[j].pose
        # No nearer to the leaf than to its hinge, less its length: most are far from both.
        far = minimum + row.size[0] + (outer if j < 0 else extent(rows[j]))
        if (at[0] - x) * (at[0] - x) + (at[1] - y) * (at[1] - y) > far * far:
            continue
        after = _leaf_gap(world, p, pose, j, x, y, ex, ey)
        if after < minimum and after <= _leaf_gap(world, p, pose, j, ax, ay, bx, by):
            return True
    return False


@borrowing_kernel
def move_leaves(world: Any, p: Any, pose: Array) -> None:
    """Doors move on by a physics step, unless that brings them nearer to something near."""
    rows, actor_states = actors_of(world)
    for k in range(world.n_actors):
        row, state = rows[k], actor_states[k]
        if row.kind != DOOR or state.opening == state.opening_target:
            continue
        step = row.speed * p.dt / abs(row.travel)
        opened = min(state.opening_target, state.opening + step)
        closed = max(state.opening_target, state.opening - step)
        aim = opened if state.opening_target > state.opening else closed
        if not _is_blocked(world, p, pose, k, aim):
            state.opening = aim


@borrowing_kernel
def _should_open(world: Any, p: Any, pose: Array, k: int, time: float) -> bool:
    rows, actor_states = actors_of(world)
    row = rows[k]
    if row.stay > 0.0 and time >= row.since:
        late = time - row.since
        if (late % row.every if row.every < math.inf else late) < row.stay:
            return True
    if row.near <= 0.0:
        return False
    half = 0.5 * row.size[0]
    x = row.pose[0] + math.cos(row.pose[2]) * half
    y = row.pose[1] + math.sin(row.pose[2]) * half
    if distance_to_chair(p, pose, x, y) < row.near:
        return True
    for j in range(world.n_actors):
        if rows[j].kind == PERSON:
            at = actor_states[j].pose
            if math.hypot(at[0] - x, at[1] - y) < row.near:
                return True
    return False


@borrowing_kernel
def _has_space(world: Any, k: int) -> bool:
    """Whether obstacle k can appear beside the other actors."""
    rows, actor_states = actors_of(world)
    row = rows[k]
    for j in range(world.n_actors):
        other, at = rows[j], actor_states[j].pose
        if j == k or other.kind == DOOR or not actor_states[j].is_present:
            continue
        reach = math.hypot(0.5 * other.size[0], 0.5 * other.size[1])
        reach = reach if other.size[1] > 0.0 else other.size[0]
        gap = math.hypot(at[0] - row.pose[0], at[1] - row.pose[1]) - reach - row.size[0]
        if gap < _SPACING:
            return False
    return True


@borrowing_kernel
def schedule_actors(world: Any, p: Any, pose: Array, time: float) -> None:
    """Decide which doors are to open, which obstacles to appear and which to go."""
    rows, actor_states = actors_of(world)
    for k in range(world.n_actors):
        row, state = rows[k], actor_states[k]
        if row.kind == DOOR:
            state.opening_target = 1.0 if _should_open(world, p, pose, k, time) else 0.0
        elif row.kind == OBSTACLE and state.is_present:
            if time >= state.present_until:
                state.is_present, state.is_gone, state.relocate = False, True, 2
        elif row.kind == OBSTACLE and not state.is_gone and time >= row.since:
            gap = distance_to_chair(p, pose, row.pose[0], row.pose[1]) - row.size[0]
            if row.minimum <= gap <= row.near and _has_space(world, k):
                state.is_present, state.relocate, state.present_until = True, 1, time + row.stay
