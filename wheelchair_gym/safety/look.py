"""What the shield takes in: a reading, and where all that it knows is about the chair now."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.kinematics import arc_step
from wheelchair_gym.safety.cells import recenter_grid, update_grid
from wheelchair_gym.safety.clearance import signed_clearance
from wheelchair_gym.safety.echoes import update_echoes
from wheelchair_gym.safety.faults import check_sensors
from wheelchair_gym.safety.memory import update_points
from wheelchair_gym.safety.state import BINS, CLOSE, FAR, NOTHING, REACH

Array = NDArray[np.float64]
Floats = NDArray[np.float32]


@borrowing_kernel
def reset(s: Any) -> None:
    """Begin anew: nothing was seen, the chair stands."""
    s.begun, s.rearmed = False, False
    s.stamp, s.latched, s.reason = 0.0, 0, NOTHING
    s.laser_hash, s.sonar_hash = np.uint64(0), np.uint64(0)
    s.laser_silent, s.laser_frozen, s.sonar_frozen = 0.0, 0.0, 0.0
    s.laser_blind, s.laser_denied = 0.0, 0.0
    s.odometry_silent, s.odometry_frozen, s.astray = 0.0, 0.0, 0.0
    for k in range(s.echo.shape[0]):
        s.echo[k] = math.inf
    for k in range(3):
        s.pose[k], s.echo_pose[k] = 0.0, 0.0
    for k in range(5):
        s.told[k] = 0.0
    for k in range(4):
        s.set[k] = 0.0
    s.late[0], s.late[1] = 0.0, 0.0
    for k in range(s.sonar_silent.shape[0]):
        s.sonar_silent[k], s.fired[k] = 0.0, -math.inf
        s.doubtful[k], s.n_arc[k] = math.nan, 0
    s.corner[0], s.corner[1] = 1 << 40, 1 << 40  # far off: the whole grid comes in anew
    s.n_points, s.n_old, s.n_marks, s.n_near, s.n_moving, s.n_close = 0, 0, 0, 0, 0, 0
    s.n_lone = 0
    s.gap, s.columns, s.hidden = FAR, 0, 0.0
    for k in range(2):
        s.asked[k], s.given[k] = 0.0, 0.0
    s.protective = False


@borrowing_kernel
def _near(s: Any, outline: Array, margin: float, px: float, py: float, n: int) -> int:
    """Note a point in the chair's frame among those inside the margin, or those near."""
    far = math.sqrt(px * px + py * py)
    if far >= REACH:
        return n
    gap = signed_clearance(px, py, outline)
    s.gap = min(s.gap, max(0.0, gap))
    if gap < margin and s.n_close < CLOSE:
        s.close[s.n_close, 0], s.close[s.n_close, 1], s.close[s.n_close, 2] = px, py, gap
        s.n_close += 1
        return n
    s.local[n, 0], s.local[n, 1], s.local[n, 2] = px, py, far
    s.bins[int(far * BINS / REACH) + 1] += 1
    return n + 1


@borrowing_kernel
def gather(g: Any, s: Any) -> None:
    """Bring points and echoes into the chair's frame, in the order of bins of distance."""
    for b in range(BINS + 1):
        s.bins[b] = 0
    s.gap, s.n_close, n = FAR, 0, 0
    outline, margin = g.outline[:], g.stop_margin
    c, sn = math.cos(s.pose[2]), math.sin(s.pose[2])
    x, y = s.pose[0], s.pose[1]
    for k in range(s.n_points):
        dx, dy = s.points[k, 0] - x, s.points[k, 1] - y
        n = _near(s, outline, margin, c * dx + sn * dy, c * dy - sn * dx, n)
    for k in range(s.n_arc.shape[0]):
        for i in range(s.n_arc[k]):
            dx, dy = s.arc[k, i, 0] - x, s.arc[k, i, 1] - y
            n = _near(s, outline, margin, c * dx + sn * dy, c * dy - sn * dx, n)
    for b in range(BINS):
        s.bins[b + 1] += s.bins[b]
    s.n_near = n
    for k in range(n):
        b = int(s.local[k, 2] * BINS / REACH)
        at = s.bins[b]
        s.bins[b] = at + 1
        s.near[at, 0], s.near[at, 1] = s.local[k, 0], s.local[k, 1]
        s.near[at, 2] = b * REACH / BINS
    s.hidden = 0.0
    for k in range(s.n_marks):
        dx, dy = s.marks[k, 0] - x, s.marks[k, 1] - y
        s.moving[k, 0], s.moving[k, 1] = c * dx + sn * dy, c * dy - sn * dx
        s.moving[k, 2], s.moving[k, 3] = 0.0, s.stamp - s.marks[k, 2]
        s.moving[k, 4] = s.stamp - s.marks[k, 3]
        s.hidden = max(s.hidden, s.moving[k, 4])
    s.n_moving = s.n_marks


@borrowing_kernel
def update(
    g: Any, s: Any, pose: Array, twist: Array, laser: Floats, ultrasonic: Floats, age: Floats,
    bumped: bool, halted: bool, stamp: float,
) -> None:  # fmt: skip
    """Take in a reading; the same one again only counts as time without any.

    Args:
        g: record of GUARD.
        s: record of SHIELD.
        pose: of the reading (3,); only whether it changes matters.
        twist: (2,) [m/s, rad/s].
        laser: (beams,) [m].
        ultrasonic: (rangers,) [m].
        age: (rangers,) [s].
        bumped: a bumper strip is pressed.
        halted: the chair stands whatever it is told.
        stamp: [s].
    """
    dt = stamp - s.stamp if s.begun else 0.0
    if s.begun and dt <= 0.0:
        dt = g.period
        stamp = s.stamp
    # What the wheels say is believed; where they say nothing, what they were told.
    v, w = twist[0], twist[1]
    if not math.isfinite(v + w):
        v, w = s.set[0], s.set[2]
    if s.begun and stamp > s.stamp:
        x, y, yaw = arc_step(s.pose[0], s.pose[1], s.pose[2], v, w, dt)
        s.pose[0], s.pose[1], s.pose[2] = x, y, yaw
    s.stamp = stamp
    fresh = check_sensors(g, s, pose, twist, laser, ultrasonic, age, bumped, halted, dt)
    if halted:
        s.set[0], s.set[1], s.set[2], s.set[3] = v, 0.0, w, 0.0
        s.late[0], s.late[1] = v, w
    recenter_grid(s)
    if fresh:
        update_points(g, s, laser, dt)
        update_grid(g, s, laser)
        if not s.begun:  # the other half of the columns, too
            update_grid(g, s, laser)
    update_echoes(g, s, ultrasonic, age)
    gather(g, s)
    s.begun = True
