"""When doors open and obstacles appear, and what holds a leaf."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.compiled.address import doubles_at
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.geometry import (
    point_segment_distance,
    rectangle_point_gap,
    rectangle_segment_gap,
)
from wheelchair_gym.physics.actors.bodies import moving_at, rows_at
from wheelchair_gym.physics.actors.records import DOOR, OBSTACLE, PERSON

Array = NDArray[np.float64]

_BESIDE = 0.30  # m that an obstacle keeps from other movers when it appears


@borrowing_kernel
def chair_gap(p: Any, pose: Array, x: float, y: float) -> float:
    """Distance [m] from the outline of a chair at a pose (3,) to a point."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    dx, dy = x - pose[0], y - pose[1]
    return rectangle_point_gap(c * dx + s * dy, c * dy - s * dx, p.outline[:])


@borrowing_kernel
def _leaf_at(row: Any, share: float) -> tuple[float, float, float, float]:
    """Both ends [m] of the middle line of a door's leaf that is opened by a share."""
    x, y, angle, way = row.pose[0], row.pose[1], row.pose[2], share * row.travel
    if row.swings:
        angle += way
    else:
        x, y = x + math.cos(angle) * way, y + math.sin(angle) * way
    return x, y, x + math.cos(angle) * row.size[0], y + math.sin(angle) * row.size[0]


@borrowing_kernel
def _thing_gap(
    world: Any, p: Any, pose: Array, j: int, x: float, y: float, ex: float, ey: float
) -> float:
    """Distance [m] from a leaf's middle line to mover j; to the chair at a pose where j is -1."""
    if j < 0:
        return rectangle_segment_gap(pose[0], pose[1], pose[2], p.outline[:], x, y, ex, ey)
    other = rows_at(world.movers, world.n_movers)[j]
    at = moving_at(world.moving, world.n_movers)[j].pose
    if other.size[1] > 0.0:
        box = doubles_at(world.lines, 3)  # its outline, as of a chair
        box[0] = box[1] = 0.5 * other.size[0]
        box[2] = 0.5 * other.size[1]
        return rectangle_segment_gap(at[0], at[1], at[2], box, x, y, ex, ey)
    return float(point_segment_distance(at[0], at[1], x, y, ex, ey) - other.size[0])


@borrowing_kernel
def _held(world: Any, p: Any, pose: Array, k: int, share: float) -> bool:
    """Whether opening door k to a share brings its leaf nearer to anything that is near."""
    n = world.n_movers
    rows, moving = rows_at(world.movers, n), moving_at(world.moving, n)
    row = rows[k]
    least = row.least + 0.5 * row.size[1]
    x, y, ex, ey = _leaf_at(row, share)
    ax, ay, bx, by = _leaf_at(row, moving[k].open)
    for j in range(-1, n):
        if j >= 0 and (rows[j].kind == DOOR or not moving[j].there):
            continue
        after = _thing_gap(world, p, pose, j, x, y, ex, ey)
        if after < least and after <= _thing_gap(world, p, pose, j, ax, ay, bx, by):
            return True
    return False


@borrowing_kernel
def turn_leaves(world: Any, p: Any, pose: Array) -> None:
    """Doors move on by a physics step, unless that brings them nearer to something near."""
    n = world.n_movers
    rows, moving = rows_at(world.movers, n), moving_at(world.moving, n)
    for k in range(n):
        row, own = rows[k], moving[k]
        if row.kind != DOOR or own.open == own.wanted:
            continue
        step = row.speed * p.dt / abs(row.travel)
        aim = min(own.wanted, own.open + step) if own.wanted > own.open else own.open - step
        aim = max(aim, own.wanted) if own.wanted < own.open else aim
        if not _held(world, p, pose, k, aim):
            own.open = aim


@borrowing_kernel
def _wants_open(world: Any, p: Any, pose: Array, k: int, time: float) -> bool:
    n = world.n_movers
    rows, moving = rows_at(world.movers, n), moving_at(world.moving, n)
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
    if chair_gap(p, pose, x, y) < row.near:
        return True
    for j in range(n):
        if rows[j].kind == PERSON:
            at = moving[j].pose
            if math.hypot(at[0] - x, at[1] - y) < row.near:
                return True
    return False


@borrowing_kernel
def _free(world: Any, k: int) -> bool:
    """Whether other movers leave room for obstacle k to appear."""
    n = world.n_movers
    rows, moving = rows_at(world.movers, n), moving_at(world.moving, n)
    row = rows[k]
    for j in range(n):
        other, at = rows[j], moving[j].pose
        if j == k or other.kind == DOOR or not moving[j].there:
            continue
        reach = math.hypot(0.5 * other.size[0], 0.5 * other.size[1])
        reach = reach if other.size[1] > 0.0 else other.size[0]
        gap = math.hypot(at[0] - row.pose[0], at[1] - row.pose[1]) - reach - row.size[0]
        if gap < _BESIDE:
            return False
    return True


@borrowing_kernel
def keep_times(world: Any, p: Any, pose: Array, time: float) -> None:
    """Decide which doors are to open, which obstacles to appear and which to go.

    Args:
        world: record of WORLD.
        p: the chair's parameters.
        pose: of the chair (3,) [m, m, rad].
        time: since reset [s].
    """
    n = world.n_movers
    rows, moving = rows_at(world.movers, n), moving_at(world.moving, n)
    for k in range(n):
        row, own = rows[k], moving[k]
        if row.kind == DOOR:
            own.wanted = 1.0 if _wants_open(world, p, pose, k, time) else 0.0
        elif row.kind == OBSTACLE and own.there:
            if time >= own.until:
                own.there, own.gone, own.carry = False, True, 2
        elif row.kind == OBSTACLE and not own.gone and time >= row.since:
            gap = chair_gap(p, pose, row.pose[0], row.pose[1]) - row.size[0]
            if row.least <= gap <= row.near and _free(world, k):
                own.there, own.carry, own.until = True, 1, time + row.stay
