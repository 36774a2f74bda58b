"""What the shield perceives around the chair, updated by each reading.

A grid (`safety.grid`) holds when each cell was last seen, a list holds the points that the laser
hit, and arcs hold the echoes that only ultrasonics have measured. `update` takes in a reading. The
grid is that of the first scanner; a second list holds the points that further scanners hit.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.compiled.address import floats_at
from wheelchair_gym.compiled.kernel import borrowing_kernel, inlined
from wheelchair_gym.geometry import body_to_world, point_to_world, signed_clearance, world_to_body
from wheelchair_gym.kinematics import arc_step
from wheelchair_gym.safety.faults import check_sensors
from wheelchair_gym.safety.grid import Frame, laser_frame, recenter_grid, update_grid, was_empty
from wheelchair_gym.safety.state import (
    ARC,
    BINS,
    CLOSE,
    FAR,
    FRESH,
    HITS,
    KEPT,
    MARKS,
    NOTHING,
    OTHERS,
    OTHERS_KEPT,
    REACH,
    REST_SPEED,
    SECTORS,
    set_motion,
)
from wheelchair_gym.sensors.echoes import atan2_f32
from wheelchair_gym.sensors.laser import LaserArrays, median3
from wheelchair_gym.sensors.scanners import scanner_at
from wheelchair_gym.sensors.settings import SCANNERS

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

_F = np.float32
_BESIDE = 0.20  # m: points so near a moving point may belong to the same object
_FINE = 0.04  # m: length of the arc that becomes one point,
_NEARBY = 1.3  # m: up to this range; twice as long up to twice the range, and again beyond
_SPREAD = _F(0.03)  # m: hits of one arc differ from their mean by less: no more than the margin
_JUMP = _F(0.10)  # m: where ranges jump, the edge is a point of its own
_BODY = 0.35  # m: marks so near each other are of one body
_EDGE = math.radians(15.0)  # of the laser's view: half a body at 2 m
_SAME = 0.10  # m: a ray that ends so near a point, or beyond it, has seen its place again
_AGEING = 0.2  # share of the time that counts at rest
_CLOSE_BY = 1.5  # m from the laser: what was last seen farther away is not in the way
# Hits of two scans are of one thing within these distances along the ray, and beside it beyond the
# width of a beam; an oblique surface is hit farther along it as the chair drives on.
_HIT_ALONG, _HIT_BESIDE = 0.20, 0.02  # m
_HIT_KEPT = 1.0  # s: for which a hit is kept that other beams pass
_PASSED = 2  # readings in which a scanner sees beyond a point before it is dropped
_ALMOST = 1e-9
_ALIKE = 0.015  # m: points so near each other are one
_SPACING = 0.04  # m between the points of an echo's arc
_SLACK = 0.04  # m: points of the laser stand for arcs of this length (`_FINE`)
_ECHO = 2.5  # m: farther echoes do not matter yet
_AGREE = 0.15  # m: laser and ultrasonic together err by less
_ASIDE = math.radians(4.0)  # cones have soft edges
_FIRING = 5e-3  # s: stamps of two firings differ by more


@inlined
def _nearer(edge: np.float32, r: np.float32) -> np.float32:
    """A beam's range where it is slightly nearer than the median, which cuts off edges."""
    return edge if r - _JUMP < edge < r else r


@borrowing_kernel
def _arc_length(r: float) -> float:
    """Length [m] of the arc that one point represents at a range [m]."""
    return _FINE if r < _NEARBY else 2.0 * _FINE if r < 2.0 * _NEARBY else 4.0 * _FINE


@borrowing_kernel
def _beam_towards(g: Any, frame: Frame, dx: float, dy: float) -> int:
    """The beam whose direction is nearest to a vector (dead-reckoned) from the laser."""
    ahead, left = world_to_body(frame.c, frame.s, dx, dy)
    at = (atan2_f32(_F(left), _F(ahead)) - g.first) * g.per_angle
    return int(max(at, 0.0) + 0.5)


@borrowing_kernel
def last_rows(rows: Any, n: int, most: int) -> int:
    """Keep at most `most` of n rows, the last ones; returns their number."""
    over = max(0, n - most)
    if over > 0:
        for k in range(most):
            rows[k] = rows[k + over]
    return n - over


@borrowing_kernel
def _forget(
    g: Any, s: Any, laser: Floats, rows: Any, n: int, most: int, age: float, edge: int
) -> int:
    """Drop the rows (n,) that are too old, too far, or whose place was seen again.

    At most the last `most` are kept, at the front; returns their number.
    """
    beams, kept, frame = laser.shape[0], 0, laser_frame(g, s.pose)
    for k in range(n):
        dx, dy = rows[k].x - frame.x, rows[k].y - frame.y
        far = math.sqrt(dx * dx + dy * dy)
        if s.stamp - rows[k].stamp > age or far > FAR:
            continue
        b = _beam_towards(g, frame, dx, dy)
        if 1 + edge <= b < beams - 1 - edge:
            near = far - _SAME
            if laser[b] >= near and laser[b - 1] >= near and laser[b + 1] >= near:
                continue
        rows[kept] = rows[k]
        kept += 1
    return last_rows(rows, kept, most)


@borrowing_kernel
def _keep_points(g: Any, s: Any, laser: Floats, dt: float) -> None:
    """Keep the points that the scan does not see again, and merge points that are seen twice.

    At rest, dead reckoning has no error: points age more slowly.
    """
    if abs(s.setpoint.v) + abs(s.setpoint.w) < REST_SPEED:
        for k in range(s.n_points):
            if s.points[k].stamp > s.stamp + g.memory_time:
                s.points[k].stamp += (1.0 - _AGEING) * dt
    old = _forget(g, s, laser, s.points[:], s.n_old, KEPT, 0.0, 0)
    fresh = s.points[s.n_old : s.n_points]
    n = old
    for k in range(_forget(g, s, laser, fresh, s.n_points - s.n_old, FRESH, 0.0, 0)):
        alike = -1
        for j in range(old):
            dx, dy = s.points[j].x - fresh[k].x, s.points[j].y - fresh[k].y
            if dx * dx + dy * dy < _ALIKE * _ALIKE:
                alike = j
                break
        if alike >= 0:
            s.points[alike].stamp = fresh[k].stamp
        else:
            s.points[n] = fresh[k]
            n += 1
    s.n_points = s.n_old = last_rows(s.points[:], n, KEPT)


@borrowing_kernel
def _add_point(g: Any, s: Any, marks: int, frame: Frame, x: float, y: float) -> None:
    """Add a point in the laser's frame; it counts as moving if points beside it moved recently."""
    n = s.n_points
    if n >= FRESH + KEPT:
        return
    px, py = point_to_world(frame.c, frame.s, frame.x, frame.y, x, y)
    point = s.points[n]
    point.x, point.y = px, py
    s.n_points = n + 1
    last = s.stamp if was_empty(s, px, py) else -math.inf
    for k in range(marks):
        dx, dy = s.old_marks[k].x - px, s.old_marks[k].y - py
        if s.old_marks[k].stamp > last and dx * dx + dy * dy < _BESIDE * _BESIDE:
            last = s.old_marks[k].stamp
    moves = s.stamp - last <= g.moving_memory_time
    static = not moves and x * x + y * y < _CLOSE_BY * _CLOSE_BY
    point.stamp = s.stamp + (g.static_memory_time if static else g.memory_time)
    if moves and s.n_marks < MARKS:
        mark = s.marks[s.n_marks]
        mark.x, mark.y, mark.stamp, mark.seen = px, py, last, s.stamp
        s.n_marks += 1


@borrowing_kernel
def _add_hit(g: Any, s: Any, frame: Frame, x: float, y: float) -> None:
    """Store a hit of a single beam, in the laser's frame, or match it to one of an earlier scan.

    Ghost echoes do not repeat at one place; thin objects do, though not in every scan.
    """
    px, py = point_to_world(frame.c, frame.s, frame.x, frame.y, x, y)
    far = math.sqrt(x * x + y * y)
    ux, uy = (px - frame.x) / far, (py - frame.y) / far
    beside = _HIT_BESIDE + far / g.per_angle
    for k in range(s.n_hits):
        hit = s.hits[k]
        dx, dy = hit.x - px, hit.y - py
        if abs(ux * dx + uy * dy) < _HIT_ALONG and abs(ux * dy - uy * dx) < beside:
            hit.scans += 1.0 if hit.stamp < s.stamp else 0.0
            hit.x, hit.y, hit.stamp = px, py, s.stamp
            return
    n = last_rows(s.hits[:], s.n_hits, HITS - 1)
    hit = s.hits[n]
    hit.x, hit.y, hit.stamp, hit.scans = px, py, s.stamp, 1.0
    s.n_hits = n + 1


@borrowing_kernel
def _keep_hits(g: Any, s: Any, laser: Floats) -> None:
    """Drop old hits of single beams; a hit that repeats in a second scan is an obstacle.

    A hit that beams pass is dropped sooner.
    """
    n, kept, beams = s.n_points, 0, laser.shape[0]
    frame = laser_frame(g, s.pose)
    for k in range(s.n_hits):
        hit = s.hits[k]
        dx, dy = hit.x - frame.x, hit.y - frame.y
        far = math.sqrt(dx * dx + dy * dy)
        b = _beam_towards(g, frame, dx, dy)
        passed = 1 <= b < beams - 1 and laser[b] >= far - _SAME
        if s.stamp - hit.stamp > (_HIT_KEPT if passed else g.memory_time) or far > FAR:
            continue
        s.hits[kept] = hit
        kept += 1
        if hit.scans > 1.0 and n < FRESH + KEPT:
            s.points[n].x, s.points[n].y = hit.x, hit.y
            s.points[n].stamp = -math.inf  # of this scan alone: it is added again after each scan
            n += 1
    s.n_hits, s.n_points = kept, n


@borrowing_kernel
def _drop_passed(g: Any, s: Any, first: int) -> None:
    """Drop moving points not seen again near one that was: they are a body's earlier position.

    A mark at the edge of the view is no evidence: its body may reach beyond.
    """
    kept, frame = 0, laser_frame(g, s.pose)
    for k in range(first, s.n_marks):
        ahead, left = world_to_body(
            frame.c, frame.s, s.marks[k].x - frame.x, s.marks[k].y - frame.y
        )
        s.in_view[k] = abs(atan2_f32(_F(left), _F(ahead))) < abs(g.first) - _EDGE
    for k in range(s.n_marks):
        passed = False
        for i in range(first if k < first else s.n_marks, s.n_marks):
            if not s.in_view[i]:
                continue
            dx, dy = s.marks[i].x - s.marks[k].x, s.marks[i].y - s.marks[k].y
            passed = passed or dx * dx + dy * dy < _BODY * _BODY
        if not passed:
            s.marks[kept] = s.marks[k]
            kept += 1
    s.n_marks = kept


@borrowing_kernel
def update_points(g: Any, s: Any, laser: Floats, dt: float) -> None:
    """Add a scan, dt [s] after the last one: neighbouring beams on one surface become one point.

    A point is the mean of its arc's ranges, which averages noise. Where the arc ends in the open it
    is not: an oblique edge is nearer than the mean. The median of three beams rejects lost echoes
    and what a single beam hits, which is an obstacle once another scan hits it. Too near (-inf)
    counts as the laser's minimum range.
    """
    beams = laser.shape[0]
    cosine, sine = floats_at(g.cosine, beams), floats_at(g.sine, beams)
    marks = s.n_marks
    for k in range(marks):
        s.old_marks[k] = s.marks[k]
    view_edge = int(_EDGE * g.per_angle)
    _keep_points(g, s, laser, dt)
    first = s.n_marks = _forget(
        g, s, laser, s.marks[:], s.n_marks, MARKS // 2, g.moving_memory_time, view_edge
    )
    frame, far = laser_frame(g, s.pose), _F(FAR)
    nearest, none = _F(g.nearest), _F(np.inf)
    begin, count, limit, edge = 0, 0, 0, False
    total, before, mean, head, tail = _F(0.0), none, _F(0.0), _F(0.0), _F(0.0)
    for b in range(beams + 1):
        r = none
        if b < beams:
            r = laser[b]
            if 0 < b < beams - 1:
                r = median3(laser[b - 1], r, laser[b + 1])
                single = max(laser[b], nearest)
                if single < r - _JUMP and single <= far:
                    _add_hit(g, s, frame, single * cosine[b], single * sine[b])
            r = nearest if r == -none else r
        if count > 0:
            off = total - r * _F(count)
            if not (abs(off) <= _SPREAD * _F(count) and b - begin <= limit):
                mean = total / _F(count)
                i, last = begin + count // 2, begin + count - 1
                if edge and i > begin:
                    r0 = min(mean, head)
                    _add_point(g, s, marks, frame, r0 * cosine[begin], r0 * sine[begin])
                _add_point(g, s, marks, frame, mean * cosine[i], mean * sine[i])
                if not abs(r - mean) <= _JUMP and last > i:
                    r0 = min(mean, tail)
                    _add_point(g, s, marks, frame, r0 * cosine[last], r0 * sine[last])
                before, count, total = mean, 0, _F(0.0)
        if r <= far:
            if count == 0:
                begin, head, edge = b, _nearer(laser[b], r), bool(abs(r - before) > _JUMP)
                limit = int(_arc_length(float(r)) * g.per_angle / r)
            count += 1
            total += r
            tail = _nearer(laser[b], r)
        elif count == 0:
            before = none
    _keep_hits(g, s, laser)
    _drop_passed(g, s, first)


@borrowing_kernel
def _is_explained(g: Any, s: Any, k: int, x: float, y: float, yaw: float, r: float) -> bool:
    """Whether a laser point inside ranger k's cone explains its echo."""
    c, sn, slope = math.cos(yaw), math.sin(yaw), math.tan(g.ranger_half[k] + _ASIDE)
    for i in range(s.n_points):
        dx, dy = s.points[i].x - x, s.points[i].y - y
        ahead, left = world_to_body(c, sn, dx, dy)
        inside = ahead > 0.0 and abs(left) <= slope * ahead + _SLACK
        if inside and dx * dx + dy * dy <= (r + _AGREE) * (r + _AGREE):
            return True
    for i in range(s.n_others):
        dx, dy = s.others[i].x - x, s.others[i].y - y
        ahead, left = world_to_body(c, sn, dx, dy)
        inside = ahead > 0.0 and abs(left) <= slope * ahead + _SLACK
        if inside and dx * dx + dy * dy <= (r + _AGREE) * (r + _AGREE):
            return True
    return False


@borrowing_kernel
def _frame_of(s: Any, mount: Array) -> Frame:
    """The frame of a scanner with a mount (3,), where the chair is (dead-reckoned)."""
    c, sn = math.cos(s.pose[2]), math.sin(s.pose[2])
    x, y = point_to_world(c, sn, s.pose[0], s.pose[1], mount[0], mount[1])
    yaw = s.pose[2] + mount[2]
    return Frame(x, y, math.cos(yaw), math.sin(yaw))


@borrowing_kernel
def _is_kept(g: Any, s: Any, ranges: Floats, k: int) -> bool:
    """Whether point k of a further scanner is remembered after a reading.

    It goes where its scanner hits its place again, which gives a new point, or sees beyond it in
    two readings: a lost echo alone is no evidence.
    """
    point = s.others[k]
    dx, dy = point.x - s.pose[0], point.y - s.pose[1]
    if s.stamp > point.stamp or dx * dx + dy * dy > FAR * FAR:
        return False
    one = scanner_at(g.scanners, g.n_scanners, point.scanner)
    frame = _frame_of(s, one.mount)
    dx, dy = point.x - frame.x, point.y - frame.y
    ahead, left = world_to_body(frame.c, frame.s, dx, dy)
    b = math.floor((math.atan2(left, ahead) - one.first) * one.per_angle)
    if b < 0 or b + 1 >= one.cosine.shape[0]:
        return True
    far = math.sqrt(dx * dx + dy * dy)
    least = min(ranges[one.start + b], ranges[one.start + b + 1])
    if far > one.reach or not least >= far - _SAME:
        return True
    point.passed += 1
    return bool(least > far + _SAME and point.passed < _PASSED)


@borrowing_kernel
def _add_other(g: Any, s: Any, one: LaserArrays, frame: Frame, r: np.float32, b: int) -> None:
    """Add the hit of beam b of a further scanner at a range [m]."""
    x, y = r * one.cosine[b], r * one.sine[b]
    point = s.others[s.n_others]
    px, py = point_to_world(frame.c, frame.s, frame.x, frame.y, x, y)
    static = x * x + y * y < _CLOSE_BY * _CLOSE_BY and not was_empty(s, px, py)
    point.x, point.y, point.scanner, point.passed = px, py, one.number, 0
    point.stamp = s.stamp + (g.static_memory_time if static else g.memory_time)
    s.n_others += 1


@borrowing_kernel
def _range_of_edge(g: Any, one: LaserArrays, b: int) -> float:
    """How far beam b of a scanner runs within the outline [m], at most its least range."""
    c, sn = math.cos(one.mount[2]), math.sin(one.mount[2])
    dx, dy = body_to_world(c, sn, one.cosine[b], one.sine[b])
    ahead = g.outline[0] - one.mount[0] if dx > 0.0 else g.outline[1] + one.mount[0]
    aside = g.outline[2] - one.mount[1] if dy > 0.0 else g.outline[2] + one.mount[1]
    r = min(ahead / max(abs(dx), _ALMOST), aside / max(abs(dy), _ALMOST))
    return float(min(max(r, 0.0), one.nearest))


@borrowing_kernel
def update_others(g: Any, s: Any, ranges: Floats) -> None:
    """Add the hits of all scanners but the first: each is an obstacle, whatever the others see.

    Neighbouring beams whose ranges differ little become one point, the nearest of them: each of at
    most `SECTORS` groups of beams has one at least, and more where ranges jump within the group.
    What is too near to be measured (-inf) counts as at the outline: it may be anywhere up to there.
    """
    kept = 0
    for k in range(s.n_others):
        if kept < OTHERS_KEPT and _is_kept(g, s, ranges, k):
            s.others[kept] = s.others[k]
            kept += 1
    for k in range(kept):  # new points come first, so that the oldest are lost
        s.others[OTHERS - kept + k] = s.others[k]
    s.n_others, far = 0, _F(FAR)
    spare = (SCANNERS - g.n_scanners) * SECTORS
    for k in range(1, g.n_scanners):
        one = scanner_at(g.scanners, g.n_scanners, k)
        beams, frame = one.cosine.shape[0], _frame_of(s, one.mount)
        size = (beams + SECTORS - 1) // SECTORS
        best, at = far, -1
        for b in range(beams):
            if b % size == 0 and at >= 0:
                _add_other(g, s, one, frame, best, at)
                at = -1
            r = ranges[one.start + b]
            r = _F(_range_of_edge(g, one, b)) if r == -_F(np.inf) else r
            if not r <= far:  # NaN, too
                continue
            if at >= 0 and abs(r - best) > _JUMP and spare > 0:
                _add_other(g, s, one, frame, best, at)
                spare -= 1
                at = -1
            if at < 0 or r < best:
                best, at = r, b
        if at >= 0:
            _add_other(g, s, one, frame, best, at)
    for k in range(kept):
        s.others[s.n_others] = s.others[OTHERS - kept + k]
        s.n_others += 1


@borrowing_kernel
def update_echoes(g: Any, s: Any, ultrasonic: Floats, age: Floats) -> None:
    """Add echoes: one that no laser point explains and that repeats is an obstacle.

    It may stand anywhere on its arc. It has to repeat, since ghost echoes do not.
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
        # Where the chair was when the ranger fired: it has moved since as its wheels report.
        v, w = s.read_twist[0], s.read_twist[1]
        way, turn = v * old, w * old
        if not math.isfinite(way + turn):
            way, turn = 0.0, 0.0
        bx, by, yaw = arc_step(s.pose[0], s.pose[1], s.pose[2], -way, -turn, 1.0)
        mount = g.ranger_mount[k]
        x, y = point_to_world(math.cos(yaw), math.sin(yaw), bx, by, mount[0], mount[1])
        yaw += mount[2]
        if _is_explained(g, s, k, x, y, yaw, r):
            s.n_arc[k], s.doubtful[k] = 0, math.nan
            continue
        moved = abs(v) * since if math.isfinite(v) else 0.0
        again = abs(s.doubtful[k] - r) <= _AGREE + moved
        s.doubtful[k] = r
        s.n_arc[k] = 0
        if again:
            half = g.ranger_half[k]
            n = min(ARC, 2 + int(2.0 * half * r / _SPACING))
            for i in range(n):
                angle = yaw - half + 2.0 * half * i / (n - 1)
                s.arc[k, i].x, s.arc[k, i].y = x + r * math.cos(angle), y + r * math.sin(angle)
            s.n_arc[k] = n


@borrowing_kernel
def reset(s: Any) -> None:
    """Reset the state: nothing has been seen, the chair stands."""
    decision = s.decision
    s.begun, s.rearmed, decision.protective = False, False, False
    s.stamp, s.latched, decision.reason = 0.0, 0, NOTHING
    s.laser_hash, s.sonar_hash = np.uint64(0), np.uint64(0)
    s.laser_silent, s.laser_frozen, s.sonar_frozen = 0.0, 0.0, 0.0
    s.laser_blind, s.laser_denied = 0.0, 0.0
    s.odometry_silent, s.odometry_frozen, s.astray = 0.0, 0.0, 0.0
    s.echo[:] = _F(np.inf)
    s.pose[:] = s.echo_pose[:] = s.read_pose[:] = 0.0
    s.read_twist[:] = decision.asked[:] = decision.given[:] = 0.0
    set_motion(s, 0.0, 0.0, 0.0, 0.0)
    s.sonar_silent[:], s.fired[:] = 0.0, -math.inf
    s.doubtful[:], s.n_arc[:] = math.nan, 0
    s.corner[:] = 1 << 40  # far away: all cells of the grid come in as never seen
    s.n_points, s.n_old, s.n_marks, s.n_near, s.n_moving, s.n_close = 0, 0, 0, 0, 0, 0
    s.n_hits, s.n_others, s.columns, s.gap, s.hidden = 0, 0, 0, FAR, 0.0
    s.other_silent[:] = s.other_frozen[:] = 0.0
    s.other_hash[:] = np.uint64(0)


@borrowing_kernel
def _store_near(s: Any, outline: Array, margin: float, px: float, py: float, n: int) -> int:
    """Store a point in the chair's frame, either as inside the stop zone or as near."""
    far = math.sqrt(px * px + py * py)
    if far >= REACH:
        return n
    gap = signed_clearance(px, py, outline)
    s.gap = min(s.gap, max(0.0, gap))
    if gap < margin and s.n_close < CLOSE:
        point = s.close[s.n_close]
        point.x, point.y, point.distance = px, py, gap
        s.n_close += 1
        return n
    point = s.unsorted[n]
    point.x, point.y, point.distance = px, py, far
    s.bins[int(far * BINS / REACH) + 1] += 1
    return n + 1


@borrowing_kernel
def gather(g: Any, s: Any) -> None:
    """Transform points and echoes into the chair's frame, sorted by bins of distance."""
    s.bins[:] = 0
    s.gap, s.n_close, n = FAR, 0, 0
    outline, margin = g.outline[:], g.stop_margin
    c, sn = math.cos(s.pose[2]), math.sin(s.pose[2])
    x, y = s.pose[0], s.pose[1]
    for k in range(s.n_points):
        px, py = world_to_body(c, sn, s.points[k].x - x, s.points[k].y - y)
        n = _store_near(s, outline, margin, px, py, n)
    for k in range(s.n_others):
        px, py = world_to_body(c, sn, s.others[k].x - x, s.others[k].y - y)
        n = _store_near(s, outline, margin, px, py, n)
    for k in range(s.n_arc.shape[0]):
        for i in range(s.n_arc[k]):
            px, py = world_to_body(c, sn, s.arc[k, i].x - x, s.arc[k, i].y - y)
            n = _store_near(s, outline, margin, px, py, n)
    for b in range(BINS):
        s.bins[b + 1] += s.bins[b]
    s.n_near = n
    for k in range(n):
        point = s.unsorted[k]
        b = int(point.distance * BINS / REACH)
        at = s.bins[b]
        s.bins[b] = at + 1
        s.near[at, 0], s.near[at, 1], s.near[at, 2] = point.x, point.y, b * REACH / BINS
    s.hidden = 0.0
    for k in range(s.n_marks):
        mark = s.marks[k]
        s.moving[k, 0], s.moving[k, 1] = world_to_body(c, sn, mark.x - x, mark.y - y)
        s.moving[k, 2] = 0.0
        s.standing_for[k], s.hidden_for[k] = s.stamp - mark.stamp, s.stamp - mark.seen
        s.hidden = max(s.hidden, s.hidden_for[k])
    s.n_moving = s.n_marks


@borrowing_kernel
def update(
    g: Any, s: Any, pose: Array, twist: Array, ranges: Floats, ultrasonic: Floats, age: Floats,
    bumped: bool, halted: bool, stamp: float,
) -> None:  # fmt: skip
    """Update the state by a reading; a repeated reading counts as time without one.

    `ranges` holds the scans of all scanners, one after another.
    """
    dt = stamp - s.stamp if s.begun else 0.0
    if s.begun and dt <= 0.0:
        dt = g.period
        stamp = s.stamp
    # The motion is what the wheels report; the set point where they report nothing.
    v, w = twist[0], twist[1]
    if not math.isfinite(v + w):
        v, w = s.setpoint.v, s.setpoint.w
    if s.begun and stamp > s.stamp:
        x, y, yaw = arc_step(s.pose[0], s.pose[1], s.pose[2], v, w, dt)
        s.pose[0], s.pose[1], s.pose[2] = x, y, yaw
    s.stamp = stamp
    fresh = check_sensors(g, s, pose, twist, ranges, ultrasonic, age, bumped, halted, dt)
    laser = ranges[: g.beams]
    if halted:
        set_motion(s, v, 0.0, w, 0.0)
    recenter_grid(s)
    if fresh:
        update_points(g, s, laser, dt)
        update_grid(g, s, laser)
        if not s.begun:  # the other half of the columns, too
            update_grid(g, s, laser)
    if g.n_scanners > 1:
        update_others(g, s, ranges)
    update_echoes(g, s, ultrasonic, age)
    gather(g, s)
    s.begun = True
