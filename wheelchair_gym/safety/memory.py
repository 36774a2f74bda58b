"""What the shield remembers: points that the laser saw."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.compiled.address import floats_at
from wheelchair_gym.compiled.kernel import borrowing_kernel, inlined
from wheelchair_gym.safety.cells import laser_frame, was_empty
from wheelchair_gym.safety.state import FAR, FRESH, KEPT, LONE, MOVERS, STANDS
from wheelchair_gym.sensors.echoes import bearing
from wheelchair_gym.sensors.laser import middle

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

_F = np.float32
_BESIDE = 0.20  # m: points so near one that moves may be of the same thing
_FINE = 0.04  # m: an arc as long as this is one point,
_NEARBY = 1.3  # m: up to this range; twice as long up to twice of it, and again beyond
_SPREAD = _F(0.03)  # m: hits of one arc differ from their mean by less: no more than the margin
_JUMP = _F(0.10)  # m: where ranges jump, the edge is a point of its own
_BODY = 0.35  # m: marks so near each other are of one body
_EDGE = math.radians(15.0)  # of the laser's view: half a body at 2 m
_SAME = 0.10  # m: a ray that ends so near a point has looked at it anew
_AGEING = 0.2  # of the time counts at rest
_CLOSE_BY = 1.5  # m from the laser: what was seen last farther off is not in the way
# Hits of two scans are of one thing within so much, and a beam's width beside; what is seen aslant
# is hit farther along it as the chair drives on.
_LONE_ALONG, _LONE_BESIDE = 0.20, 0.02  # m
_LONE_KEPT = 1.0  # s: what one beam hit, and others look past
_ALIKE = 0.015  # m: points so near each other are one


@inlined
def _nearer(own: np.float32, r: np.float32) -> np.float32:
    """A beam's own range where it is a little nearer than the median: that cuts edges off."""
    return own if r - _JUMP < own < r else r


@borrowing_kernel
def _arc_of(r: float) -> float:
    """How long an arc [m] is one point, at a range [m]."""
    return _FINE if r < _NEARBY else 2.0 * _FINE if r < 2.0 * _NEARBY else 4.0 * _FINE


@borrowing_kernel
def _forget(
    g: Any, s: Any, laser: Floats, rows: Array, n: int, most: int, age: float, edge: int
) -> int:
    """Drop rows (n, 3 or more) x, y, stamp that are too old, far off, or were looked at anew.

    If more than `most` are left, the last ones are.

    Args:
        g: record of GUARD.
        s: record of SHIELD.
        laser: the scan [m].
        rows: is written to.
        n: how many there are.
        most: how many may be left.
        age: older ones are dropped [s].
        edge: so many beams at each end do not tell: who was there may have left their view.

    Returns:
        How many are left, at the front.
    """
    beams, kept = laser.shape[0], 0
    lx, ly, cl, sl = laser_frame(g, s)
    for k in range(n):
        dx, dy = rows[k, 0] - lx, rows[k, 1] - ly
        far = math.sqrt(dx * dx + dy * dy)
        if s.stamp - rows[k, 2] > age or far > FAR:
            continue
        at = (bearing(_F(cl * dy - sl * dx), _F(cl * dx + sl * dy)) - g.first) * g.per_angle
        b = int(max(at, 0.0) + 0.5)
        if 1 + edge <= b < beams - 1 - edge:
            near = far - _SAME
            if laser[b] >= near and laser[b - 1] >= near and laser[b + 1] >= near:
                continue
        for i in range(rows.shape[1]):
            rows[kept, i] = rows[k, i]
        kept += 1
    return last_rows(rows, kept, most)


@borrowing_kernel
def last_rows(rows: Array, n: int, most: int) -> int:
    """Keep the last rows of n, at most so many; returns how many."""
    over = max(0, n - most)
    if over > 0:
        for k in range(most):
            for i in range(rows.shape[1]):
                rows[k, i] = rows[k + over, i]
    return n - over


@borrowing_kernel
def _keep(g: Any, s: Any, laser: Floats, dt: float) -> None:
    """Keep of all points those that the scan does not look at anew; seen twice, they are one.

    A chair that stands sees the edges of what is hidden anew with each scan, and its dead reckoning
    does not err: what stood is forgotten later for it.
    """
    if abs(s.set[0]) + abs(s.set[2]) < STANDS:
        for k in range(s.n_points):
            if s.points[k, 2] > s.stamp + g.memory_time:
                s.points[k, 2] += (1.0 - _AGEING) * dt
    old = _forget(g, s, laser, s.points[:], s.n_old, KEPT, 0.0, 0)
    fresh = s.points[s.n_old : s.n_points]
    n = old
    for k in range(_forget(g, s, laser, fresh, s.n_points - s.n_old, FRESH, 0.0, 0)):
        alike = -1
        for j in range(old):
            dx, dy = s.points[j, 0] - fresh[k, 0], s.points[j, 1] - fresh[k, 1]
            if dx * dx + dy * dy < _ALIKE * _ALIKE:
                alike = j
                break
        if alike >= 0:
            s.points[alike, 2] = fresh[k, 2]
            continue
        for i in range(3):
            s.points[n, i] = fresh[k, i]
        n += 1
    s.n_old = last_rows(s.points[:], n, KEPT)
    s.n_points = s.n_old


@borrowing_kernel
def _add(
    g: Any, s: Any, marks: int, frame: tuple[float, float, float, float], x: float, y: float
) -> None:
    """Add a point in the laser's frame; it may move if others beside it did lately."""
    n = s.n_points
    if n >= FRESH + KEPT:
        return
    lx, ly, c, sn = frame
    px, py = lx + c * x - sn * y, ly + sn * x + c * y
    s.points[n, 0], s.points[n, 1] = px, py
    s.n_points = n + 1
    last = s.stamp if was_empty(s, px, py) else -math.inf
    for k in range(marks):
        dx, dy = s.marked[k, 0] - px, s.marked[k, 1] - py
        if s.marked[k, 2] > last and dx * dx + dy * dy < _BESIDE * _BESIDE:
            last = s.marked[k, 2]
    moves = s.stamp - last <= g.moving_memory_time
    lasts = not moves and x * x + y * y < _CLOSE_BY * _CLOSE_BY
    s.points[n, 2] = s.stamp + (g.static_memory_time if lasts else g.memory_time)
    if moves and s.n_marks < MOVERS:
        m = s.n_marks
        s.marks[m, 0], s.marks[m, 1], s.marks[m, 2] = px, py, last
        s.marks[m, 3] = s.stamp
        s.n_marks += 1


@borrowing_kernel
def _add_lone(g: Any, s: Any, frame: tuple[float, float, float, float], x: float, y: float) -> None:
    """Take in what one beam alone hit, in the laser's frame: the same as in a scan before, or new.

    A ghost is nowhere twice. What is thin is: beams meet it again, if not in every scan.
    """
    lx, ly, c, sn = frame
    px, py = lx + c * x - sn * y, ly + sn * x + c * y
    far = math.sqrt(x * x + y * y)
    ux, uy = (px - lx) / far, (py - ly) / far
    beside = _LONE_BESIDE + far / g.per_angle
    for k in range(s.n_lone):
        dx, dy = s.lone[k, 0] - px, s.lone[k, 1] - py
        if abs(ux * dx + uy * dy) < _LONE_ALONG and abs(ux * dy - uy * dx) < beside:
            s.lone[k, 3] += 1.0 if s.lone[k, 2] < s.stamp else 0.0
            s.lone[k, 0], s.lone[k, 1], s.lone[k, 2] = px, py, s.stamp
            return
    n = last_rows(s.lone[:], s.n_lone, LONE - 1)
    s.lone[n, 0], s.lone[n, 1], s.lone[n, 2], s.lone[n, 3] = px, py, s.stamp, 1.0
    s.n_lone = n + 1


@borrowing_kernel
def _keep_lone(g: Any, s: Any, laser: Floats) -> None:
    """Drop what one beam hit once it is too old; what was hit in two scans is an obstacle.

    Where beams look past it, it is too old sooner than where none does.
    """
    n, kept, beams = s.n_points, 0, laser.shape[0]
    lx, ly, cl, sl = laser_frame(g, s)
    for k in range(s.n_lone):
        dx, dy = s.lone[k, 0] - lx, s.lone[k, 1] - ly
        far = math.sqrt(dx * dx + dy * dy)
        at = (bearing(_F(cl * dy - sl * dx), _F(cl * dx + sl * dy)) - g.first) * g.per_angle
        b = int(max(at, 0.0) + 0.5)
        passed = 1 <= b < beams - 1 and laser[b] >= far - _SAME
        if s.stamp - s.lone[k, 2] > (_LONE_KEPT if passed else g.memory_time) or far > FAR:
            continue
        for i in range(s.lone.shape[1]):
            s.lone[kept, i] = s.lone[k, i]
        kept += 1
        if s.lone[k, 3] > 1.0 and n < FRESH + KEPT:
            s.points[n, 0], s.points[n, 1] = s.lone[k, 0], s.lone[k, 1]
            s.points[n, 2] = -math.inf  # of this scan alone: put there anew after each
            n += 1
    s.n_lone, s.n_points = kept, n


@borrowing_kernel
def _drop_passed(g: Any, s: Any, first: int) -> None:
    """Drop marks that were not seen anew beside one that was: there that body was before.

    One at the edge of the view does not tell: its body may reach beyond.

    Args:
        g: record of GUARD.
        s: record of SHIELD.
        first: mark of this scan; those before it were not seen anew.
    """
    kept = 0
    lx, ly, cl, sl = laser_frame(g, s)
    for k in range(first, s.n_marks):
        dx, dy = s.marks[k, 0] - lx, s.marks[k, 1] - ly
        at = bearing(_F(cl * dy - sl * dx), _F(cl * dx + sl * dy))
        s.marked[k, 0] = 1.0 if abs(at) < abs(g.first) - _EDGE else 0.0  # 1: seen whole
    for k in range(s.n_marks):
        passed = False
        for i in range(first if k < first else s.n_marks, s.n_marks):
            if s.marked[i, 0] == 0.0:
                continue
            dx, dy = s.marks[i, 0] - s.marks[k, 0], s.marks[i, 1] - s.marks[k, 1]
            passed = passed or dx * dx + dy * dy < _BODY * _BODY
        if not passed:
            for i in range(s.marks.shape[1]):
                s.marks[kept, i] = s.marks[k, i]
            kept += 1
    s.n_marks = kept


@borrowing_kernel
def update_points(g: Any, s: Any, laser: Floats, dt: float) -> None:
    """Take in a scan, dt [s] after the last: arcs of beams that meet the same become a point each.

    A point is the mean of its arc's ranges, which averages noise, but where the arc ends in the
    open: an edge seen aslant is nearer. The median of three beams keeps lost echoes out, and what
    one beam alone hits: that is an obstacle once another scan hits it, too. Too near (-inf) is as
    near as the laser sees.
    """
    beams = laser.shape[0]
    cosine, sine = floats_at(g.cosine, beams), floats_at(g.sine, beams)
    marks = s.n_marks
    for k in range(marks):
        for i in range(s.marks.shape[1]):
            s.marked[k, i] = s.marks[k, i]
    edge = int(_EDGE * g.per_angle)
    _keep(g, s, laser, dt)
    s.n_marks = _forget(g, s, laser, s.marks[:], s.n_marks, MOVERS // 2, g.moving_memory_time, edge)
    first = s.n_marks
    frame, far = laser_frame(g, s), _F(FAR)
    nearest, none = _F(g.nearest), _F(np.inf)
    begin, count, limit, edge = 0, 0, 0, False
    total, before, mean, head, tail = _F(0.0), none, _F(0.0), _F(0.0), _F(0.0)
    for b in range(beams + 1):
        r = none
        if b < beams:
            r = laser[b]
            if 0 < b < beams - 1:
                r = middle(laser[b - 1], r, laser[b + 1])
                own = max(laser[b], nearest)
                if own < r - _JUMP and own <= far:
                    _add_lone(g, s, frame, own * cosine[b], own * sine[b])
            r = nearest if r == -none else r
        if count > 0:
            span = total - r * _F(count)
            if not (abs(span) <= _SPREAD * _F(count) and b - begin <= limit):
                mean = total / _F(count)
                i, last = begin + count // 2, begin + count - 1
                if edge and i > begin:
                    r0 = min(mean, head)
                    _add(g, s, marks, frame, r0 * cosine[begin], r0 * sine[begin])
                _add(g, s, marks, frame, mean * cosine[i], mean * sine[i])
                if not abs(r - mean) <= _JUMP and last > i:
                    r0 = min(mean, tail)
                    _add(g, s, marks, frame, r0 * cosine[last], r0 * sine[last])
                before, count, total = mean, 0, _F(0.0)
        if r <= far:
            if count == 0:
                begin, head, edge = b, _nearer(laser[b], r), bool(abs(r - before) > _JUMP)
                limit = int(_arc_of(float(r)) * g.per_angle / r)
            count += 1
            total += r
            tail = _nearer(laser[b], r)
        elif count == 0:
            before = none
    _keep_lone(g, s, laser)
    _drop_passed(g, s, first)
