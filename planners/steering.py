"""Steering in (x, y, yaw): from pose to pose, in pieces that the footprint drives freely.

A connection is at most three stretches: pivot, straight and pivot, or two arcs that meet in one
direction (Bolton 1975, Biarc curves), each ahead or back. It is driven in short pieces, each at a
constant curvature; a piece costs its duration at the chair's limits, and more near obstacles.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from planners.collision.footprint import Pose, Surroundings, surroundings, sweep, swept_gap
from planners.collision.nearby import Nearby
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.compiled.kernel import borrowing_kernel, kernel
from wheelchair_gym.geometry.kinematics import arc_step
from wheelchair_gym.geometry.planar import wrap
from wheelchair_gym.maps.driving_cost import STILL, MotionCost, duration, kind_of, stretch_cost

CONNECTIONS = 4  # number of kinds: arcs ahead and back, pivots and a straight ahead and back
# The stretches of a connection, each a distance [m] and a turn [rad].
Parts = tuple[tuple[float, float], tuple[float, float], tuple[float, float]]
NO_PARTS = ((0.0, 0.0), (0.0, 0.0), (0.0, 0.0))


@borrowing_kernel
def connection(kind: int, pose: Pose, target: Pose) -> tuple[bool, Parts]:
    """Return whether there is a connection of a kind to a target pose, and its three stretches.

    Kinds 0 and 2 lead ahead, 1 and 3 back; 0 and 1 are arcs, 2 and 3 turn in place. A target
    heading of NaN is free. The third stretch is a turn in place.
    """
    (x, y, yaw), tyaw = pose, target[2]
    dx, dy = target[0] - x, target[1] - y
    far, towards = math.hypot(dx, dy), wrap(math.atan2(dy, dx) - yaw)
    back = kind % 2 == 1
    sign = -1.0 if back else 1.0
    none = (False, NO_PARTS)
    aim = wrap(towards + math.pi) if back else towards
    if kind >= 2:  # pivot, straight, pivot
        s, b = (aim, sign * far) if far > STILL else (0.0, 0.0)
        u = 0.0 if math.isnan(tyaw) else wrap(tyaw - yaw - s)
        return True, ((0.0, s), (b, 0.0), (0.0, u))
    if far <= STILL:
        return none
    if math.isnan(tyaw):  # one arc
        if abs(aim) > 0.5 * math.pi:
            return none
        a = sign * far * (aim / math.sin(aim) if abs(aim) > STILL else 1.0)
        return True, ((a, 2.0 * aim), (0.0, 0.0), (0.0, 0.0))
    # two arcs
    c0, s0 = math.cos(yaw), math.sin(yaw)
    c1, s1 = math.cos(tyaw), math.sin(tyaw)
    vt = dx * (c0 + c1) + dy * (s0 + s1)
    less = 2.0 - 2.0 * (c0 * c1 + s0 * s1)  # 4 - |t0 + t1|^2
    square = dx * dx + dy * dy
    if less > 1e-9:
        root = math.sqrt(vt * vt + less * square)
        d = (-vt + sign * root) / less
    elif sign * vt > 1e-9:
        d = 0.5 * square / vt
    else:
        return none
    if sign * d < STILL:
        return none
    mx, my = 0.5 * (dx + d * (c0 - c1)), 0.5 * (dy + d * (s0 - s1))
    first = math.hypot(mx, my)
    half = wrap(math.atan2(my, mx) - yaw + (math.pi if back else 0.0))
    middle = yaw + 2.0 * half
    last = math.hypot(dx - mx, dy - my)
    other = wrap(math.atan2(dy - my, dx - mx) - middle + (math.pi if back else 0.0))
    if abs(half) > 0.5 * math.pi or abs(other) > 0.5 * math.pi:
        return none
    a = sign * first * (half / math.sin(half) if abs(half) > STILL else 1.0)
    b = sign * last * (other / math.sin(other) if abs(other) > STILL else 1.0)
    return True, ((a, 2.0 * half), (b, 2.0 * other), (0.0, 0.0))


@borrowing_kernel
def switch(motion: MotionCost, before: int, after: int) -> float:
    """Return the time [s] that a change of the kind of motion takes."""
    return motion.switch_time if before != 0 and after != 0 and before != after else 0.0


@borrowing_kernel
def parts_time(
    motion: MotionCost, sharpest: float, parts: Parts, before: int, after: int, sign: float
) -> float:
    """Return the minimum time [s] of a connection between two kinds of motion.

    It is infinite where an arc's curvature is greater than `sharpest` [1/m]. With a sign of -1 the
    connection is driven from the target.
    """
    time = 0.0
    for distance, turn in parts:
        way = sign * distance
        now = kind_of(way, turn)
        if abs(now) == 1 and abs(turn) > sharpest * abs(way) + STILL:
            return math.inf
        if now != 0:
            time += duration(motion, way, turn)
            time += switch(motion, before, now)
            before = now
    return time + switch(motion, before, after)


LONGEST_PIECE = 0.2  # m: as the lattice's moves, so that costs are comparable
WIDEST_PIECE = 0.4  # rad
CAPACITY = 8192  # pieces of a path: 1.6 km

PIECE = np.dtype(
    [
        ("x", np.float64),  # m: the beginning
        ("y", np.float64),
        ("yaw", np.float64),  # rad
        ("way", np.float64),  # m
        ("turn", np.float64),  # rad
        ("cost", np.float64),  # s
        ("kind", np.int64),  # ahead, back or a pivot; see `kind_of`
    ]
)


class SteeringContext(NamedTuple):
    """Limits and cost of driving a footprint on a map, and workspace."""

    around: Surroundings
    trial: NDArray[Any]  # (CAPACITY,) PIECE: of one connection
    candidate: NDArray[Any]  # (CAPACITY,) PIECE: of several
    times: Array  # (CONNECTIONS,) s
    sharpest: float  # 1/m: greatest curvature of arcs


def new_context(near: Nearby, motion: MotionCost, sharpest: float) -> SteeringContext:
    """Return a context on a map.

    `near` reaches `LONGEST_PIECE` beyond the footprint's reach and the desired clearance.
    """
    trial, candidate = np.zeros(CAPACITY, PIECE), np.zeros(CAPACITY, PIECE)
    times = np.zeros(CONNECTIONS)
    return SteeringContext(surroundings(near, motion), trial, candidate, times, sharpest)


@borrowing_kernel
def piece_count(way: float, turn: float) -> int:
    """Return the number of pieces of a stretch."""
    if kind_of(way, turn) == 0:
        return 0
    return int(max(1, math.ceil(max(abs(way) / LONGEST_PIECE, abs(turn) / WIDEST_PIECE) - 1e-9)))


@borrowing_kernel
def shortened(way: float, turn: float, left: int) -> tuple[float, float, int]:
    """Return a stretch of at most `left` pieces, and the number of pieces left."""
    count = piece_count(way, turn)
    if count == 0:
        return way, turn, left
    made = min(count, left)
    return way * made / count, turn * made / count, left - made


@borrowing_kernel
def first_pieces(parts: Parts, count: int) -> Parts:
    """Return the stretches of a connection up to its first pieces."""
    a, s, count = shortened(parts[0][0], parts[0][1], count)
    b, t, count = shortened(parts[1][0], parts[1][1], count)
    _, u, _ = shortened(0.0, parts[2][1], count)
    return (a, s), (b, t), (0.0, u)


@borrowing_kernel
def drive_stretch(
    around: Surroundings, pose: Pose, way: float, turn: float, pieces: NDArray[Any], first: int,
    budget: float,
) -> tuple[int, float]:  # fmt: skip
    """Write a stretch's pieces from index `first` on while they are free and within a budget [s].

    Returns the number of pieces written, and their cost [s].
    """
    motion, (x, y, yaw) = around.motion, pose
    count = piece_count(way, turn)
    if count == 0 or first + count >= pieces.shape[0]:
        return 0, 0.0
    part, bend, kind = way / count, turn / count, kind_of(way, turn)
    minimum = duration(motion, part, bend)
    sweep(around.sweeps, 0, part, bend, motion.outline)
    cost = 0.0
    for k in range(count):
        if cost + (count - k) * minimum >= budget:
            return k, cost
        at = arc_step(x, y, yaw, way, turn, k / count)
        gap = swept_gap(around, at, motion.desired_clearance)
        if gap < motion.margin:
            return k, cost
        piece = pieces[first + k]
        piece.x, piece.y, piece.yaw = at
        piece.way, piece.turn, piece.kind = part, bend, kind
        piece.cost = stretch_cost(motion, part, bend, gap)
        cost += piece.cost
    return count, cost


@borrowing_kernel
def drive_parts(
    around: Surroundings, pose: Pose, before: int, parts: Parts, pieces: NDArray[Any], first: int,
    budget: float,
) -> tuple[int, float, bool, Pose]:  # fmt: skip
    """Write the pieces of a connection from index `first` on, as far as it can be driven.

    Returns the number of pieces written, their cost [s] with the changes of kind, whether the
    connection is complete and within the budget [s], and the pose reached.
    """
    made, cost = 0, 0.0
    for way, turn in parts:
        count, kind = piece_count(way, turn), kind_of(way, turn)
        if count == 0:
            continue
        cost += switch(around.motion, before, kind)
        new, more = drive_stretch(around, pose, way, turn, pieces, first + made, budget - cost)
        made, cost, before = made + new, cost + more, kind
        pose = arc_step(pose[0], pose[1], pose[2], way, turn, new / count)
        if new < count or cost >= budget:
            return made, cost, False, pose
    return made, cost, True, pose


@borrowing_kernel
def write_times(
    context: SteeringContext, pose: Pose, before: int, target: Pose, after: int, sign: float
) -> float:
    """Write the time of each connection to `context.times`, and return the minimum."""
    minimum = math.inf
    for kind in range(CONNECTIONS):
        possible, parts = connection(kind, pose, target)
        time = parts_time(context.around.motion, context.sharpest, parts, before, after, sign)
        context.times[kind] = time if possible else math.inf
        minimum = min(minimum, context.times[kind])
    return minimum


@borrowing_kernel
def quickest(times: Array) -> int:
    """Return the quickest connection, or -1 if no time is finite."""
    kind = int(np.argmin(times))
    return kind if times[kind] < math.inf else -1


@borrowing_kernel
def connect(
    context: SteeringContext, pose: Pose, before: int, target: Pose, after: int, budget: float,
    first: int = 0,
) -> tuple[int, int, float]:  # fmt: skip
    """Write the cheapest free connection below a budget [s] to `context.candidate` from `first` on.

    A NaN heading of the target is free. Returns the kind of connection, -1 if there is none, the
    number of its pieces, and its cost [s] with the changes from and to other kinds of motion.
    """
    around, trial, pieces, times = context.around, context.trial, context.candidate, context.times
    write_times(context, pose, before, target, after, 1.0)
    best, found, length = budget, -1, 0
    while True:
        kind = quickest(times)
        if kind < 0 or times[kind] >= best:
            return found, length, best if found >= 0 else math.inf
        times[kind] = math.inf
        _, parts = connection(kind, pose, target)
        count, cost, free, _ = drive_parts(around, pose, before, parts, trial, 0, best)
        cost += switch(around.motion, trial[count - 1].kind if count > 0 else before, after)
        if free and cost < best and first + count < pieces.shape[0]:
            best, found, length = cost, kind, count
            for k in range(count):
                pieces[first + k] = trial[k]


POSE_SPACING = 0.05  # m, and rad of a pivot times 2: between poses of the path


@kernel
def poses_along(pieces: NDArray[Any], slack: float = 1e-9) -> Array:
    """Return the poses (n, 3) along pieces, the last of which has no length.

    Their distance may exceed `POSE_SPACING` by the share `slack`, for rounding.
    """
    count = pieces.shape[0]
    parts = np.ones(count, np.int64)
    for k in range(count):
        longest = max(abs(pieces[k].way), 0.5 * abs(pieces[k].turn))
        parts[k] = max(1, math.ceil(longest / POSE_SPACING - slack))
    poses, m = np.empty((parts.sum(), 3)), 0
    for k in range(count):
        piece = pieces[k]
        for part in range(parts[k]):
            poses[m, 0], poses[m, 1], poses[m, 2] = arc_step(
                piece.x, piece.y, piece.yaw, piece.way, piece.turn, part / parts[k]
            )
            m += 1
    for k in range(1, m):
        poses[k, 2] = poses[k - 1, 2] + wrap(poses[k, 2] - poses[k - 1, 2])
    return poses
