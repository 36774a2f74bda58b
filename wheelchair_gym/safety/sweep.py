"""What the outline would sweep: distances to points, and roll-outs that end at rest."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.kernel import borrowing_kernel, kernel
from wheelchair_gym.kinematics import approach, arc_step
from wheelchair_gym.safety.state import CELL, CELLS, MOVING, NOTHING, OBSTACLE, UNSEEN

Array = NDArray[np.float64]

STEP = 0.05  # s between two poses of a roll-out
_LONGEST = 100  # poses
_REST = 0.01  # m/s: slower is at rest
_TURN_REST = 0.02  # rad/s
_WORSE = 1e-6  # m: what is inside the stop zone may not come nearer, beyond rounding


@kernel
def outline_gap(
    x: float, y: float, yaw: float, footprint: Array, points: Array, interest: float
) -> float:
    """Distance [m] from the outline at a pose to the nearest point, at most `interest`; 0 inside.

    Args:
        x: the pose's x [m]; then y [m] and yaw [rad].
        y: see x.
        yaw: see x.
        footprint: `Footprint.array`.
        points: (k, 3) x, y and no more than the distance from the origin [m], which rises.
        interest: farther points are not looked for [m].
    """
    c, s = math.cos(yaw), math.sin(yaw)
    middle = 0.5 * (footprint[0] - footprint[1])
    half_length, half_width = 0.5 * (footprint[0] + footprint[1]), footprint[2]
    mx, my = x + c * middle, y + s * middle
    reach = math.hypot(x, y) + interest
    reach += math.hypot(max(footprint[0], footprint[1]), half_width)
    best = interest * interest
    for k in range(points.shape[0]):
        if points[k, 2] > reach:
            break
        px, py = points[k, 0] - mx, points[k, 1] - my
        dx = max(abs(c * px + s * py) - half_length, 0.0)
        dy = max(abs(c * py - s * px) - half_width, 0.0)
        best = min(best, dx * dx + dy * dy)
    return math.sqrt(best)


@borrowing_kernel
def signed_gap(px: float, py: float, outline: Array) -> float:
    """Distance [m] of a point in the chair's frame to the outline; below 0 inside of it."""
    dx = max(px - outline[0], -outline[1] - px)
    dy = abs(py) - outline[2]
    if dx > 0.0 and dy > 0.0:
        return math.sqrt(dx * dx + dy * dy)
    return max(dx, dy)


@borrowing_kernel
def was_seen(s: Any, x: float, y: float, since: float) -> bool:
    """Whether the cell of a point (dead-reckoned) was looked at since a stamp [s]."""
    i, j = int(math.floor(x / CELL)) - s.corner[0], int(math.floor(y / CELL)) - s.corner[1]
    if i < 0 or j < 0 or i >= CELLS or j >= CELLS:
        return False
    return s.seen[i, j] >= since


@borrowing_kernel
def enters_unseen(
    g: Any, s: Any, x: float, y: float, yaw: float, v: float, w: float, t: float
) -> bool:
    """Whether a point of the outline enters what nobody has seen, faster than it may.

    How fast it enters is how fast it moves along its side's normal. The rear corners count as fast
    as they move, but for what the whole chair moves ahead: there they follow their own side.
    """
    lever = math.hypot(max(g.outline[0], g.outline[1]), g.outline[2])
    if abs(v) + abs(w) * lever <= g.unseen:
        return False
    c, sn = math.cos(yaw), math.sin(yaw)
    px, py, pyaw = s.pose[0], s.pose[1], s.pose[2]
    cw, sw = math.cos(pyaw), math.sin(pyaw)
    since = s.stamp + t - g.memory
    for k in range(g.samples.shape[0]):
        ax, ay = g.samples[k, 0], g.samples[k, 1]
        nx, ny = g.samples[k, 2], g.samples[k, 3]
        vx, vy = v - w * ay, w * ax
        if nx == 0.0 and ny == 0.0:
            ex = vx - max(v, 0.0)
            speed = math.sqrt(ex * ex + vy * vy)
        else:
            speed = vx * nx + vy * ny
        if speed <= g.unseen:
            continue
        lx, ly = x + c * ax - sn * ay, y + sn * ax + c * ay
        if not was_seen(s, px + cw * lx - sw * ly, py + sw * lx + cw * ly, since):
            return True
    return False


@borrowing_kernel
def sweep(g: Any, s: Any, v: float, w: float) -> int:
    """Why a twist may not be driven for a period and then braked to rest; NOTHING if it may.

    Args:
        g: record of GUARD.
        s: record of SHIELD, which has taken in the latest reading.
        v: [m/s].
        w: [rad/s].
    """
    limits, outline = g.limits[:], g.outline[:]
    near, moving = s.near[: s.n_near], s.moving[: s.n_moving]
    sv, av, sw, aw = s.set[0], s.set[1], s.set[2], s.set[3]
    x, y, yaw, t = 0.0, 0.0, 0.0, 0.0
    lever = math.hypot(max(outline[0], outline[1]), outline[2])
    hold = round((g.period + g.reaction) / STEP)
    # Along something inside the stop zone the chair may go on; others may come half as near.
    least = 0.5 * g.margin if s.n_close > 0 else g.margin
    bound = 0.0  # of the gap, from below: looked for anew only where it might matter
    mbound = 0.0
    for k in range(_LONGEST):
        if k == hold:
            v, w = 0.0, 0.0
        sv, av = approach(sv, av, v, limits[3], limits[4], limits[7], STEP)
        sw, aw = approach(sw, aw, w, limits[6], limits[6], limits[8], STEP)
        x, y, yaw = arc_step(x, y, yaw, sv, sw, STEP)
        t += STEP
        speed, turn = abs(sv), abs(sw)
        moved = (speed + lever * turn) * STEP
        bound -= moved
        mbound -= moved
        need = least + g.headway * max(0.0, speed + 0.5 * lever * turn - g.crawl)
        if bound < need:
            bound = outline_gap(x, y, yaw, outline, near, need + 0.1)
            if bound < need:
                return OBSTACLE
        if s.n_close > 0 and speed + 0.5 * lever * turn > g.crawl and k >= hold:
            return OBSTACLE
        for i in range(s.n_close):
            ex, ey = s.close[i, 0] - x, s.close[i, 1] - y
            c, sn = math.cos(yaw), math.sin(yaw)
            now = signed_gap(c * ex + sn * ey, c * ey - sn * ex, outline)
            if now < s.close[i, 2] - _WORSE:
                return OBSTACLE
        if s.n_moving > 0 and speed + lever * turn > g.crawl:
            need = g.margin + g.pace * t
            if mbound < need:
                mbound = outline_gap(x, y, yaw, outline, moving, need + 0.2)
                if mbound < need:
                    return MOVING
        if enters_unseen(g, s, x, y, yaw, sv, sw, t):
            return UNSEEN
        if k >= hold and speed < _REST and turn < _TURN_REST:
            break
    return NOTHING
