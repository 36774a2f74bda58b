"""Roll-out of commands (v, w, t) within the chair's limits, and the clearance there.

A command is a target twist for t seconds. The chair approaches it within its limits of acceleration
and jerk.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.compiled.kernel import borrowing_kernel, kernel
from wheelchair_gym.geometry.kinematics import approach, approach_twist, odometric_step
from wheelchair_gym.geometry.outline import footprint_clearance

MAX_CLEARANCE = 0.5  # m: larger clearances are not told apart
FINEST = 0.02  # m: near obstacles no point of the outline moves farther between two tests
STEP = 0.05  # s: as a control loop of 20 Hz
FREE_TURNS = 0.4  # m/s: from here on the chair's sides sweep floor that was ahead before
REST = 1e-5  # m/s, rad/s: slower is at rest; the last of a jerk-limited approach is rounding

MOTION = np.dtype(
    [
        ("x", np.float64),  # m
        ("y", np.float64),
        ("yaw", np.float64),  # rad
        ("v", np.float64),  # m/s
        ("w", np.float64),  # rad/s
        ("v_rate", np.float64),  # m/s2
        ("w_rate", np.float64),  # rad/s2
        ("time", np.float64),  # s since the roll-out began
        ("moved", np.float64),  # m: bound of the outline's motion since the last test
        ("gap", np.float64),  # m: clearance at the last test
        ("minimum", np.float64),  # m: minimum of the tested clearances
        ("marked", np.float64),  # m: minimum distance from the marked point so far
        ("free", np.bool_),  # false once the clearance fell below the margin, or the box was left
    ]
)
Motion = NDArray[Any]  # (1,) MOTION


class World(NamedTuple):
    """The chair and the obstacles around it."""

    walls: Array  # (n, 4) m
    discs: Array  # (m, 3) m: x, y, radius
    box: Array  # (4,) m: xmin, ymin, xmax, ymax of the axle's positions; walls are known there
    footprint: Array  # (3,) m: front, rear, half width
    limits: Any  # record, `Limits.record`
    margin: float  # m: a clearance below this is a collision
    pivot: float  # rad/s: turn limit of a chair at rest
    mark_x: float  # m: the marked point
    mark_y: float


@borrowing_kernel
def turn_limit(v: float, limits: Any, pivot: float) -> float:
    """Return the turn limit [rad/s] at a speed; it is `pivot` for a chair at rest."""
    limit: float = min(limits.turn, pivot + limits.turn * abs(v) / FREE_TURNS)
    return limit


@borrowing_kernel
def advance(
    motion: Any, v: float, w: float, dt: float, limits: Any, pivot: float
) -> tuple[float, float]:
    """Move on for one step [s] towards a twist; return the distance [m] and the turn [rad].

    The turn limit is `pivot` [rad/s] for a chair at rest, and rises with its speed.
    """
    fastest = turn_limit(motion.v, limits, pivot)
    w = min(max(w, -fastest), fastest)
    v, v_rate, w, w_rate = approach_twist(
        motion.v, motion.v_rate, motion.w, motion.w_rate, v, w, limits, dt
    )
    way, turn = 0.5 * (motion.v + v) * dt, 0.5 * (motion.w + w) * dt
    x, y, yaw = odometric_step(motion.x, motion.y, motion.yaw, way, turn)
    motion.x, motion.y, motion.yaw = x, y, yaw
    motion.v, motion.v_rate, motion.w, motion.w_rate = v, v_rate, w, w_rate
    motion.time += dt
    return way, turn


@borrowing_kernel
def measure_clearance(motion: Any, x: float, y: float, yaw: float, world: World) -> None:
    """Measure the clearance at a pose of the motion, and decide whether it is free."""
    box = world.box
    gap = footprint_clearance(x, y, yaw, world.footprint, world.walls, world.discs, MAX_CLEARANCE)
    inside = box[0] <= x <= box[2] and box[1] <= y <= box[3]
    motion.gap = gap
    motion.moved = 0.0
    motion.minimum = min(motion.minimum, gap)
    motion.free = inside and gap > 0.0 and gap >= world.margin


@borrowing_kernel
def drive(motion: Any, v: float, w: float, t: float, world: World) -> None:
    """Drive towards a twist for t seconds, or until the motion is no longer free.

    The clearance is tested again before it can have fallen below the margin, but not more often
    than every `FINEST` metres.
    """
    footprint = world.footprint
    reach = math.hypot(max(footprint[0], footprint[1]), footprint[2])
    while t > 1e-9 and motion.free:
        step = min(STEP, t)
        t -= step
        x, y, yaw = motion.x, motion.y, motion.yaw
        way, turn = advance(motion, v, w, step, world.limits, world.pivot)
        motion.marked = min(
            motion.marked, math.hypot(world.mark_x - motion.x, world.mark_y - motion.y)
        )
        moved = abs(way) + abs(turn) * reach
        if motion.moved + moved <= motion.gap - world.margin:
            motion.moved += moved
            continue
        parts = math.ceil(moved / FINEST)
        for k in range(1, parts + 1):
            motion.moved += moved / parts
            if motion.free and motion.moved + moved / parts > motion.gap - world.margin:
                part = k / parts
                px, py, pyaw = odometric_step(x, y, yaw, part * way, part * turn)
                measure_clearance(motion, px, py, pyaw, world)


@borrowing_kernel
def brake(motion: Any, world: World) -> float:
    """Brake until the chair rests, or is no longer free; return the duration [s]."""
    steps = 0
    while motion.free and max(abs(motion.v), abs(motion.w)) > REST:
        drive(motion, 0.0, 0.0, STEP, world)
        steps += 1
    motion.v, motion.w, motion.v_rate, motion.w_rate = 0.0, 0.0, 0.0, 0.0
    return steps * STEP


@borrowing_kernel
def time_to_cover(
    amount: float, speed: float, up: float, down: float, jerk: float, rest: bool, begun: float
) -> float:
    """Return the duration [s] of a target speed that covers an amount [m or rad].

    The motion begins at the speed `begun`, without acceleration. `up`, `down` and `jerk` limit
    acceleration and deceleration. With `rest` the amount includes the motion while coming to rest.
    """
    t, low, high = amount / speed, 0.0, np.inf
    for _ in range(16):  # Newton's method between bounds that are too short and too long
        covered, now, rate, left = 0.0, begun, 0.0, t
        while left > 1e-9 or (rest and abs(now) > REST):
            step = min(STEP, left) if left > 1e-9 else STEP
            before = now
            now, rate = approach(now, rate, speed if left > 1e-9 else 0.0, up, down, jerk, step)
            covered += 0.5 * (before + now) * step
            left -= step
        error = amount - covered
        if abs(error) < 1e-3:
            break
        if error > 0.0:
            low = t
        else:
            high = t
        t += error / speed
        if t <= low or t >= high:
            t = 0.5 * (low + high) if high < np.inf else 2.0 * low
    return t


@borrowing_kernel
def stopping_time(speed: float, rate: float, jerk: float) -> float:
    """Return the time [s] to come to rest from a speed, within a deceleration and a jerk."""
    speed = abs(speed)
    if speed == 0.0:
        return 0.0
    if speed > rate * rate / jerk:
        return speed / rate + rate / jerk + STEP
    return 2.0 * math.sqrt(speed / jerk) + STEP


@kernel
def rollout(
    commands: Array, pose: Array, twist: Array, limits: Any, pivot: float
) -> tuple[Array, Array, Array]:
    """Return the roll-out of commands (k, 3) (thesis, (2.15)-(2.17), under limits).

    `pivot` [rad/s] limits the turn rate of a chair at rest.

    Returns:
        Poses (n, 3), twists (n, 2) and times (n,) [s], those of the start first.
    """
    n = 1
    for k in range(commands.shape[0]):
        n += math.ceil(max(0.0, commands[k, 2] - 1e-9) / STEP) + 1
    poses, twists, times = np.empty((n, 3)), np.empty((n, 2)), np.empty(n)
    motion = np.zeros(1, MOTION)[0]
    motion.x, motion.y, motion.yaw = pose[0], pose[1], pose[2]
    motion.v, motion.w = twist[0], twist[1]
    k, n, left = -1, 0, 0.0
    while True:
        poses[n] = motion.x, motion.y, motion.yaw
        twists[n] = motion.v, motion.w
        times[n] = motion.time
        n += 1
        while left <= 1e-9 and k + 1 < commands.shape[0]:
            k += 1
            left = commands[k, 2]
        if left <= 1e-9:
            return poses[:n], twists[:n], times[:n]
        step = min(STEP, left)
        advance(motion, commands[k, 0], commands[k, 1], step, limits, pivot)
        left -= step
