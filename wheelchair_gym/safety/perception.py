"""What the shield knows of its surroundings, updated by each reading.

A grid holds when each cell was last seen, a list holds the points that the laser hit, and arcs
hold the echoes that only ultrasonics have measured. `update` takes in a reading.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.compiled.address import floats_at
from wheelchair_gym.compiled.kernel import borrowing_kernel, inlined
from wheelchair_gym.kinematics import arc_step
from wheelchair_gym.safety.clearance import signed_clearance
from wheelchair_gym.safety.faults import check_sensors
from wheelchair_gym.safety.state import (
    ARC,
    BINS,
    CELL,
    CELLS,
    CLOSE,
    FAR,
    FRESH,
    KEPT,
    LONE,
    MOVERS,
    NOTHING,
    REACH,
    STANDS,
)
from wheelchair_gym.sensors.echoes import atan2_f32
from wheelchair_gym.sensors.laser import median3

Floats = NDArray[np.float32]
Numbers = NDArray[np.int32]

_F = np.float32
_LOOKED = _F(-0.07)  # m: a ray that came so near a cell's centre has looked at the cell
_BEYOND = _F(0.20)  # m: one that went so far beyond has found it empty
_CLEARED = 1.0  # s: where nothing was so lately, what is there now has moved


@borrowing_kernel
def laser_frame(g: Any, s: Any) -> tuple[float, float, float, float]:
    """Where the laser is (dead-reckoned): x, y, cosine and sine of its yaw."""
    c, sn = math.cos(s.pose[2]), math.sin(s.pose[2])
    x = s.pose[0] + c * g.mount[0] - sn * g.mount[1]
    y = s.pose[1] + sn * g.mount[0] + c * g.mount[1]
    yaw = s.pose[2] + g.mount[2]
    return x, y, math.cos(yaw), math.sin(yaw)


@borrowing_kernel
def recenter_grid(s: Any) -> None:
    """Move the grid with the chair; cells that come in have never been seen."""
    for axis in range(2):
        want = math.floor(s.pose[axis] / CELL) - CELLS // 2
        shift = want - s.corner[axis]
        if shift == 0:
            continue
        s.corner[axis] = want
        step = 1 if shift > 0 else -1
        first = 0 if shift > 0 else CELLS - 1
        for k in range(CELLS):
            to = first + step * k
            source = to + shift
            inside = 0 <= source < CELLS
            for i in range(CELLS):
                if axis == 0:
                    s.seen[to, i] = s.seen[source, i] if inside else _F(-1e9)
                    s.clear[to, i] = s.clear[source, i] if inside else _F(-1e9)
                else:
                    s.seen[i, to] = s.seen[i, source] if inside else _F(-1e9)
                    s.clear[i, to] = s.clear[i, source] if inside else _F(-1e9)


@borrowing_kernel
def _find_beams(
    ex: np.float32, ey: np.float32, step: np.float32, c: np.float32, s: np.float32,
    first: np.float32, per: np.float32, beam: Numbers, far: Floats,
) -> None:  # fmt: skip
    """The beam that covers each cell of a column, and the distance [m] of the cell's centre."""
    for j in range(np.uint64(CELLS)):
        y = ey + _F(np.int32(j)) * step
        beam[j] = np.int32((atan2_f32(c * y - s * ex, c * ex + s * y) - first) * per + _F(1.5)) - 1
        far[j] = np.sqrt(ex * ex + y * y)


@borrowing_kernel
def update_grid(g: Any, s: Any, laser: Floats) -> None:
    """Store which cells the scan has seen, and which it has found empty.

    Each call updates every other column, since this is half of a reading's work.
    """
    beams, now, step = laser.shape[0], _F(s.stamp), _F(CELL)
    lx, ly, cl, sl = laser_frame(g, s)
    c, sn = _F(math.cos(s.pose[2])), _F(math.sin(s.pose[2]))
    vacated = _F(s.stamp - max(0.0, g.memory_time - g.vacated_time))
    front, rear = _F(g.outline[0]) + _LOOKED, _F(-g.outline[1]) - _LOOKED
    half = _F(g.outline[2]) - _F(0.02)
    ey, by = (s.corner[1] + 0.5) * CELL - ly, (s.corner[1] + 0.5) * CELL - s.pose[1]
    first, per = _F(g.first), _F(g.per_angle)
    beam, far = s.beam[:], s.range[:]
    reach = math.hypot(max(g.outline[0], g.outline[1]), g.outline[2])
    s.columns = 1 - s.columns
    for i in range((s.corner[0] + s.columns) % 2, CELLS, 2):
        ex = (s.corner[0] + i + 0.5) * CELL - lx
        _find_beams(_F(ex), _F(ey), step, _F(cl), _F(sl), first, per, beam, far)
        for j in range(CELLS):
            b = beam[j]
            if b < 1 or b > beams - 2:
                continue
            d = far[j] + _LOOKED
            if laser[b] >= d and laser[b - 1] >= d and laser[b + 1] >= d:
                s.seen[i, j] = now
                d = far[j] + _BEYOND
                if laser[b] >= d and laser[b - 1] >= d and laser[b + 1] >= d:
                    s.clear[i, j] = now
        # What is wholly under the chair is as good as seen, and for a while after.
        bx = (s.corner[0] + i + 0.5) * CELL - s.pose[0]
        if abs(bx) > reach:
            continue
        low, high = int((-reach - by) / CELL), int((reach - by) / CELL) + 2
        for j in range(max(low, 0), min(high, CELLS)):
            y = _F(by + j * CELL)
            px, py = c * _F(bx) + sn * y, c * y - sn * _F(bx)
            if rear <= px <= front and abs(py) <= half:
                s.seen[i, j] = max(s.seen[i, j], vacated)


@borrowing_kernel
def was_empty(s: Any, x: float, y: float) -> bool:
    """Whether all cells about a point (dead-reckoned) were empty a moment ago."""
    i, j = math.floor(x / CELL) - s.corner[0], math.floor(y / CELL) - s.corner[1]
    if i < 1 or j < 1 or i >= CELLS - 1 or j >= CELLS - 1:
        return False
    since = s.stamp - _CLEARED
    for a in range(-1, 2):
        for b in range(-1, 2):
            if s.clear[i + a, j + b] < since:
                return False
    return True


@borrowing_kernel
def was_seen(s: Any, x: float, y: float, since: float) -> bool:
    """Whether the cell of a point (dead-reckoned) has been seen since a stamp [s]."""
    i, j = math.floor(x / CELL) - s.corner[0], math.floor(y / CELL) - s.corner[1]
    if i < 0 or j < 0 or i >= CELLS or j >= CELLS:
        return False
    return bool(s.seen[i, j] >= since)


Array = NDArray[np.float64]

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
    """A beam's range where it is slightly nearer than the median, which cuts off edges."""
    return own if r - _JUMP < own < r else r


@borrowing_kernel
def _arc_of(r: float) -> float:
    """Length [m] of the arc that one point represents at a range [m]."""
    return _FINE if r < _NEARBY else 2.0 * _FINE if r < 2.0 * _NEARBY else 4.0 * _FINE


@borrowing_kernel
def _forget(
    g: Any, s: Any, laser: Floats, rows: Array, n: int, most: int, age: float, edge: int
) -> int:
    """Drop rows (n, 3 or more) x, y, stamp that are too old, too far, or seen again.

    If more than `most` are left, the last ones are.

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
        at = (atan2_f32(_F(cl * dy - sl * dx), _F(cl * dx + sl * dy)) - g.first) * g.per_angle
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
    """Keep at most `most` of n rows, the last ones; returns their number."""
    over = max(0, n - most)
    if over > 0:
        for k in range(most):
            for i in range(rows.shape[1]):
                rows[k, i] = rows[k + over, i]
    return n - over


@borrowing_kernel
def _keep(g: Any, s: Any, laser: Floats, dt: float) -> None:
    """Keep the points that the scan does not see again, and merge points that are seen twice.

    At rest, dead reckoning has no error: points age more slowly.
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
    """Add a point in the laser's frame; it counts as moving if points beside it moved recently."""
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
    """Store what a single beam hit, in the laser's frame, or match it to a hit of an earlier scan.

    Ghost echoes do not repeat at one place; thin objects do, though not in every scan.
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
    """Drop old hits of single beams; a hit that repeats in a second scan is an obstacle.

    A hit that beams pass is dropped sooner.
    """
    n, kept, beams = s.n_points, 0, laser.shape[0]
    lx, ly, cl, sl = laser_frame(g, s)
    for k in range(s.n_lone):
        dx, dy = s.lone[k, 0] - lx, s.lone[k, 1] - ly
        far = math.sqrt(dx * dx + dy * dy)
        at = (atan2_f32(_F(cl * dy - sl * dx), _F(cl * dx + sl * dy)) - g.first) * g.per_angle
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
    """Drop moving points not seen again near one that was: they are a body's earlier position.

    One at the edge of the view does not tell: its body may reach beyond.
    """
    kept = 0
    lx, ly, cl, sl = laser_frame(g, s)
    for k in range(first, s.n_marks):
        dx, dy = s.marks[k, 0] - lx, s.marks[k, 1] - ly
        at = atan2_f32(_F(cl * dy - sl * dx), _F(cl * dx + sl * dy))
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
    """Add a scan, dt [s] after the last one: neighbouring beams on one surface become one point.

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
                r = median3(laser[b - 1], r, laser[b + 1])
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


_SPACING = 0.04  # m between the points of an echo's arc
_SLACK = 0.04  # m: points of the laser stand for arcs as long (`memory`)
_ECHO = 2.5  # m: echoes from farther off do not matter yet
_AGREE = 0.15  # m: laser and ultrasonic err together by less
_ASIDE = math.radians(4.0)  # cones have soft edges
_FIRING = 5e-3  # s: stamps of two firings differ by more


@borrowing_kernel
def _explained(g: Any, s: Any, k: int, x: float, y: float, yaw: float, r: float) -> bool:
    """Whether a laser point inside ranger k's cone explains its echo."""
    half = g.ranger_half[k] + _ASIDE
    c, sn = math.cos(yaw), math.sin(yaw)
    slope = math.tan(half)
    for i in range(s.n_points):
        dx, dy = s.points[i, 0] - x, s.points[i, 1] - y
        ahead, left = c * dx + sn * dy, c * dy - sn * dx
        inside = ahead > 0.0 and abs(left) <= slope * ahead + _SLACK
        if inside and dx * dx + dy * dy <= (r + _AGREE) * (r + _AGREE):
            return True
    return False


@borrowing_kernel
def update_echoes(g: Any, s: Any, ultrasonic: Floats, age: Floats) -> None:
    """Add echoes: one that no laser point explains and that repeats is an obstacle.

    It may stand anywhere on its arc. Twice, since a ghost is heard once.
    """
    for k in range(age.shape[0]):
        old = float(age[k])
        if not old <= g.stale_ultrasonic:
            s.n_arc[k], s.doubtful[k] = 0, math.nan
            continue
        fired = s.stamp - old
        if abs(fired - s.fired[k]) < _FIRING:
            continue
        since, s.fired[k] = fired - s.fired[k], fired
        r = float(ultrasonic[k])
        if not (0.0 <= r <= min(g.ranger_reach[k], _ECHO)):
            s.n_arc[k], s.doubtful[k] = 0, math.nan
            continue
        # Where the chair was when it fired: it has driven on as its wheels say.
        way, turn = s.told[3] * old, s.told[4] * old
        if not math.isfinite(way + turn):
            way, turn = 0.0, 0.0
        bx, by, byaw = arc_step(s.pose[0], s.pose[1], s.pose[2], -way, -turn, 1.0)
        c, sn = math.cos(byaw), math.sin(byaw)
        mx, my = g.ranger_mount[k, 0], g.ranger_mount[k, 1]
        x, y = bx + c * mx - sn * my, by + sn * mx + c * my
        yaw = byaw + g.ranger_mount[k, 2]
        if _explained(g, s, k, x, y, yaw, r):
            s.n_arc[k], s.doubtful[k] = 0, math.nan
            continue
        moved = abs(s.told[3]) * since if math.isfinite(s.told[3]) else 0.0
        again = abs(s.doubtful[k] - r) <= _AGREE + moved
        s.doubtful[k] = r
        s.n_arc[k] = 0
        if again:
            half = g.ranger_half[k]
            n = min(ARC, 2 + int(2.0 * half * r / _SPACING))
            for i in range(n):
                angle = yaw - half + 2.0 * half * i / (n - 1)
                s.arc[k, i, 0], s.arc[k, i, 1] = x + r * math.cos(angle), y + r * math.sin(angle)
            s.n_arc[k] = n


@borrowing_kernel
def reset(s: Any) -> None:
    """Reset the state: nothing has been seen, the chair stands."""
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
    """Store a point in the chair's frame, either as inside the stop zone or as near."""
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
    """Transform points and echoes into the chair's frame, sorted by bins of distance."""
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
    """Update the state by a reading; a repeated reading counts as time without one."""
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
