"""What a policy sees: pure functions of a reading, a goal and a path."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.compiled.kernel import borrowing_kernel, kernel
from wheelchair_gym.maps.cost_to_go import poses_ahead, to_local

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

GOAL_REACH = 100.0  # m: farther goals are seen at this distance
_NOTHING = np.float32(0.0)
STRAIGHT = 0.8  # m/s: the pace of a way that is not known
PATH_REACH = 10.0  # m: look-ahead points farther off than this on an axis are clipped


@kernel
def see(value: float, reach: float) -> float:
    """A range as it is observed: no echo is the reach, too near and invalid are 0 (REP-117)."""
    if not value > 0.0:  # NaN too
        return 0.0
    return reach if value > reach else value


@borrowing_kernel
def pool(scan: Floats, reach: float, out: Floats) -> int:
    """Nearest range of each of out's equal groups of beams; returns how many beams are finite."""
    beams, groups = np.uint64(scan.shape[0]), np.uint64(out.shape[0])
    far, none = np.float32(reach), np.float32(np.inf)
    valid = np.uint32(0)  # 32 bits at every step, as wide as a range, so that the loops vectorise
    if groups == beams:
        for i in range(beams):
            value = scan[i]
            valid = np.uint32(valid + np.uint32(abs(value) < none))
            value = value if value > _NOTHING else _NOTHING  # as `see`, but without a branch
            out[i] = value if value < far else far
        return int(valid)
    for i in range(beams):
        valid = np.uint32(valid + np.uint32(abs(scan[i]) < none))
    # Group j ends before floor((j + 1) beams / groups), counted on without a division each.
    size, rest, over, start = beams // groups, beams % groups, np.uint64(0), np.uint64(0)
    for j in range(groups):
        over += rest
        more = np.uint64(over >= groups)
        over -= more * groups
        stop = start + size + more
        # The last beam, then `size` from the first on: one loop length, whatever the group's size.
        last = scan[stop - np.uint64(1)]
        nearest = last if last > _NOTHING else _NOTHING
        nearest = nearest if nearest < far else far
        for i in range(start, start + size):
            value = scan[i] if scan[i] > _NOTHING else _NOTHING
            nearest = value if value < nearest else nearest
        out[j], start = nearest, stop
    return int(valid)


@kernel
def bearing_to(pose: Array, goal: Array, out: Floats) -> None:
    """The goal (3,) in the chair's frame: distance [m], cosine and sine of its bearing.

    If `out` has five places, cosine and sine of the goal's heading follow.
    """
    dx, dy = goal[0] - pose[0], goal[1] - pose[1]
    distance = math.hypot(dx, dy)
    bearing = math.atan2(dy, dx) - pose[2] if distance > 0.0 else 0.0
    out[0] = np.float32(min(distance, GOAL_REACH))
    out[1], out[2] = np.float32(math.cos(bearing)), np.float32(math.sin(bearing))
    if out.shape[0] == 5:
        turn = goal[2] - pose[2]
        out[3], out[4] = np.float32(math.cos(turn)), np.float32(math.sin(turn))


@kernel
def project(path: Array, x: float, y: float) -> tuple[int, float, float]:
    """The point of a path (n, 2) [m] nearest to (x, y): segment, share of it, and distance [m]."""
    best, where, share = math.inf, 0, 0.0
    for k in range(path.shape[0] - 1):
        ex, ey = path[k + 1, 0] - path[k, 0], path[k + 1, 1] - path[k, 1]
        square = ex * ex + ey * ey
        t = 0.0
        if square > 0.0:
            t = ((x - path[k, 0]) * ex + (y - path[k, 1]) * ey) / square
            t = min(1.0, max(0.0, t))
        gap = math.hypot(x - path[k, 0] - t * ex, y - path[k, 1] - t * ey)
        if gap < best:
            best, where, share = gap, k, t
    return where, share, best


@kernel
def tell_place(c: float, s: float, dx: float, dy: float, out: Floats) -> None:
    """A place (dx, dy) off [m], in the frame of a chair with that cosine and sine of its yaw."""
    out[0] = np.float32(min(PATH_REACH, max(-PATH_REACH, c * dx + s * dy)))
    out[1] = np.float32(min(PATH_REACH, max(-PATH_REACH, c * dy - s * dx)))


@kernel
def look_ahead(path: Array, pose: Array, distances: Array, out: Floats) -> None:
    """Points of a path (n, 2) at distances (k,) [m] beyond the nearest one, in the chair's frame.

    Args:
        path: what to follow; beyond its end the end itself is seen.
        pose: of the chair (3,) [m, m, rad].
        distances: rising [m].
        out: (2 k,) x and y of each [m].
    """
    c, s = math.cos(pose[2]), math.sin(pose[2])
    segment, share, _ = project(path, pose[0], pose[1])
    last = path.shape[0] - 2
    walked = 0.0  # m from the nearest point to the end of the segments passed
    for j in range(distances.shape[0]):
        while True:
            ex = path[segment + 1, 0] - path[segment, 0]
            ey = path[segment + 1, 1] - path[segment, 1]
            length = math.hypot(ex, ey)
            rest = (1.0 - share) * length
            if walked + rest >= distances[j] or segment == last:
                break
            walked, segment, share = walked + rest, segment + 1, 0.0
        t = min(1.0, share + (distances[j] - walked) / length) if length > 0.0 else 1.0
        dx = path[segment, 0] + t * ex - pose[0]
        dy = path[segment, 1] + t * ey - pose[1]
        tell_place(c, s, dx, dy, out[2 * j : 2 * j + 2])


@borrowing_kernel
def look_ahead_poses(
    states: NDArray[np.uint32],
    moves: NDArray[np.int32],
    cell: float,
    origin: Array,
    pose: Array,
    goal: Array,
    times: Array,
    out: Floats,
) -> None:
    """Poses at plan times (k,) [s] on the outline's way from a pose, in the chair's frame.

    Where no way is known they lie straight ahead to the goal, as if driven at `STRAIGHT`.

    Args:
        states: of the ways.
        moves: of the ways.
        cell: of the ways [m].
        origin: of the ways (3,) [m, m, rad].
        pose: of the chair (3,) [m, m, rad].
        goal: (3,) [m, m, rad].
        times: rising [s].
        out: (4 k,) x and y [m], cosine and sine of the heading, of each.
    """
    x, y, yaw = to_local(origin, pose[0], pose[1], pose[2])
    c, s = math.cos(yaw), math.sin(yaw)
    left = poses_ahead(states, moves, cell, x, y, yaw, times, out)
    if math.isnan(left):
        c, s = math.cos(pose[2]), math.sin(pose[2])
        dx, dy = goal[0] - pose[0], goal[1] - pose[1]
        far = max(math.hypot(dx, dy), 1e-9)
    for j in range(times.shape[0] - 1, -1, -1):
        heading = out[4 * j + 2] - yaw
        ex, ey = out[4 * j] - x, out[4 * j + 1] - y
        if math.isnan(left):
            share = min(1.0, STRAIGHT * times[j] / far)
            ex, ey = share * dx, share * dy
            heading = math.atan2(dy, dx) - pose[2]
        tell_place(c, s, ex, ey, out[4 * j : 4 * j + 2])
        out[4 * j + 2], out[4 * j + 3] = (
            np.float32(math.cos(heading)),
            np.float32(math.sin(heading)),
        )
