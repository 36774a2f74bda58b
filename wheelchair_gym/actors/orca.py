"""Optimal reciprocal collision avoidance: half-planes of velocities, and the best one they allow.

Equations: van den Berg et al. 2011 (Reciprocal n-Body Collision Avoidance); incremental linear
programs: de Berg et al. 2008, chapter 4. A line (x, y, dx, dy) allows the velocities on its left.
`pace`: maximum speed; `far`: seek the velocity farthest along (ox, oy), not the nearest to it.
"""

import math

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.compiled.kernel import borrowing_kernel

HALF_PLANES = 40  # at most for one person; the rows of `lines` from here on are scratch memory
_PARALLEL = 1e-9


@borrowing_kernel
def add_half_plane(lines: Array, n: int, x: float, y: float, dx: float, dy: float) -> int:
    """Add the line through (x, y) in direction (dx, dy), up to HALF_PLANES; return their number."""
    if n == HALF_PLANES:
        return n
    lines[n, 0], lines[n, 1], lines[n, 2], lines[n, 3] = x, y, dx, dy
    return n + 1


@borrowing_kernel
def avoid_wall(lines: Array, n: int, nx: float, ny: float, gap: float, horizon: float) -> int:
    """Limit the speed towards a wall to gap / horizon; (nx, ny) points from it to the person."""
    speed = -gap / horizon
    return add_half_plane(lines, n, nx * speed, ny * speed, ny, -nx)


@borrowing_kernel
def avoid_disc(
    lines: Array,
    n: int,
    dx: float,  # m, from the person to the disc
    dy: float,
    radius: float,  # m, of person and disc together
    vx: float,  # m/s, of the person
    vy: float,
    ux: float,  # m/s, of the disc
    uy: float,
    share: float,  # of the avoidance that this person does; the other one does the rest
    horizon: float,  # s
    overlap_time: float,  # s, to end an overlap
) -> int:
    """Add the line that keeps a person clear of a moving disc for a horizon."""
    rx, ry = vx - ux, vy - uy
    square = dx * dx + dy * dy
    apart = square > radius * radius
    per = 1.0 / horizon if apart else 1.0 / overlap_time
    wx, wy = rx - per * dx, ry - per * dy
    length = math.sqrt(wx * wx + wy * wy)
    along = wx * dx + wy * dy
    if not apart or (along < 0.0 and along * along > radius * radius * length * length):
        if length < _PARALLEL:
            wx, wy, length = 1.0, 0.0, 1.0
        wx, wy = wx / length, wy / length
        ex, ey = wy, -wx
        push = radius * per - length
        gx, gy = push * wx, push * wy
    else:
        leg = math.sqrt(square - radius * radius)
        if dx * wy - dy * wx > 0.0:
            ex, ey = (dx * leg - dy * radius) / square, (dx * radius + dy * leg) / square
        else:
            ex, ey = -(dx * leg + dy * radius) / square, -(dy * leg - dx * radius) / square
        dot = rx * ex + ry * ey
        gx, gy = dot * ex - rx, dot * ey - ry
    return add_half_plane(lines, n, vx + share * gx, vy + share * gy, ex, ey)


@borrowing_kernel
def _optimize_on_line(
    lines: Array, k: int, low: int, pace: float, ox: float, oy: float, far: bool
) -> tuple[bool, float, float]:
    """Return whether lines low to k - 1 and `pace` allow a velocity on line k, and the best one."""
    x, y, dx, dy = lines[k, 0], lines[k, 1], lines[k, 2], lines[k, 3]
    dot = x * dx + y * dy
    inside = dot * dot + pace * pace - x * x - y * y
    if inside < 0.0:
        return False, 0.0, 0.0
    root = math.sqrt(inside)
    t0, t1 = -dot - root, -dot + root
    for i in range(low, k):
        across = dx * lines[i, 3] - dy * lines[i, 2]
        behind = lines[i, 2] * (y - lines[i, 1]) - lines[i, 3] * (x - lines[i, 0])
        if abs(across) <= _PARALLEL:
            if behind < 0.0:
                return False, 0.0, 0.0
            continue
        t = behind / across
        if across >= 0.0:
            t1 = min(t1, t)
        else:
            t0 = max(t0, t)
        if t0 > t1:
            return False, 0.0, 0.0
    if far:
        t = t1 if ox * dx + oy * dy > 0.0 else t0
    else:
        t = min(t1, max(t0, dx * (ox - x) + dy * (oy - y)))
    return True, x + t * dx, y + t * dy


@borrowing_kernel
def _linear_program(
    lines: Array, low: int, high: int, pace: float, ox: float, oy: float, far: bool
) -> tuple[int, float, float]:
    """Return the first line that could not be met (`high` if none), and the best velocity."""
    x, y = ox, oy
    speed = math.sqrt(ox * ox + oy * oy)
    if far:
        x, y = pace * ox, pace * oy
    elif speed > pace:
        x, y = ox * pace / speed, oy * pace / speed
    for k in range(low, high):
        if lines[k, 2] * (lines[k, 1] - y) - lines[k, 3] * (lines[k, 0] - x) > 0.0:
            found, nx, ny = _optimize_on_line(lines, k, low, pace, ox, oy, far)
            if not found:
                return k, x, y
            x, y = nx, ny
    return high, x, y


@borrowing_kernel
def best_velocity(
    lines: Array, hard: int, n: int, pace: float, ox: float, oy: float
) -> tuple[float, float]:
    """Return the velocity nearest to a preferred one (ox, oy) that n lines allow.

    If there is none, the first `hard` lines (static things) hold; the others are overstepped least.
    """
    first, x, y = _linear_program(lines, 0, n, pace, ox, oy, False)
    worst = 0.0
    for k in range(first, n):
        over = lines[k, 2] * (lines[k, 1] - y) - lines[k, 3] * (lines[k, 0] - x)
        if over <= worst:
            continue
        # Lines on which this one and an earlier one are overstepped alike.
        m = HALF_PLANES
        for i in range(hard):
            for c in range(4):
                lines[m, c] = lines[i, c]
            m += 1
        for i in range(hard, k):
            across = lines[k, 2] * lines[i, 3] - lines[k, 3] * lines[i, 2]
            if abs(across) <= _PARALLEL:
                if lines[k, 2] * lines[i, 2] + lines[k, 3] * lines[i, 3] > 0.0:
                    continue
                px, py = 0.5 * (lines[k, 0] + lines[i, 0]), 0.5 * (lines[k, 1] + lines[i, 1])
            else:
                t = (
                    lines[i, 2] * (lines[k, 1] - lines[i, 1])
                    - lines[i, 3] * (lines[k, 0] - lines[i, 0])
                ) / across
                px, py = lines[k, 0] + t * lines[k, 2], lines[k, 1] + t * lines[k, 3]
            dx, dy = lines[i, 2] - lines[k, 2], lines[i, 3] - lines[k, 3]
            length = math.sqrt(dx * dx + dy * dy)
            if length <= _PARALLEL:
                continue
            lines[m, 0], lines[m, 1] = px, py
            lines[m, 2], lines[m, 3] = dx / length, dy / length
            m += 1
        last, nx, ny = _linear_program(lines, HALF_PLANES, m, pace, -lines[k, 3], lines[k, 2], True)
        if last == m:
            x, y = nx, ny
        worst = lines[k, 2] * (lines[k, 1] - y) - lines[k, 3] * (lines[k, 0] - x)
    return x, y
