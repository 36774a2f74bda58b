"""Surroundings of the chair as the shield perceives them, updated by each reading.

A grid (`safety.grid`) holds when each cell was last seen, a list holds the points that the laser
hit, and arcs hold the echoes that only ultrasonics have measured. `update` takes in a reading. What
further scanners show is in `safety.faults`.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.base.arrays import Array, Floats
from wheelchair_gym.compiled.address import floats_at, on_stack, rows_of
from wheelchair_gym.compiled.kernel import as_int, borrowing_kernel, inlined
from wheelchair_gym.geometry.kinematics import arc_step
from wheelchair_gym.geometry.planar import point_to_world, world_to_body
from wheelchair_gym.safety.agreement import add_lost, expected_echo, find_lost, is_doubted
from wheelchair_gym.safety.faults import check_sensors, update_others
from wheelchair_gym.safety.grid import (
    Scan,
    beam_towards,
    find_minimum,
    mark_motion,
    recenter_grid,
    scan_of,
    sees_beyond,
    update_grid,
)
from wheelchair_gym.safety.moving import track
from wheelchair_gym.safety.state import (
    ARC,
    BODY,
    CLOSE_BY,
    EDGE,
    FAR,
    FRESH,
    HITS,
    JUMP,
    KEPT,
    MARKS,
    NOTHING,
    REST_SPEED,
    SAME,
    SCANNED,
    UPDATE,
    Frame,
    set_motion,
)
from wheelchair_gym.sensors.echoes import atan2_f32
from wheelchair_gym.sensors.laser import LaserArrays, median3, scanner_at

Bytes = NDArray[np.int8]

_update_at, _SIZE = rows_of(UPDATE), UPDATE.itemsize
_F, _INF, _ONE = np.float32, np.float32(np.inf), np.uint64(1)
_BLOCK = 32  # beams that are compared at once
_FINE = 0.04  # m: length of the arc that becomes one point,
_NEARBY = 1.3  # m: up to this range; twice as long up to twice the range, and again beyond
_SPREAD = _F(0.03)  # m: hits of one arc differ from their mean by less: no more than the margin
_AGEING = 0.2  # share of the time that counts at rest
# Hits of two scans are of one thing within these distances along the ray, and beside it beyond the
# width of a beam; an oblique surface is hit farther along it as the chair drives on.
_HIT_ALONG, _HIT_BESIDE = 0.20, 0.02  # m
_HIT_KEPT = 1.0  # s: for which a hit is kept that other beams pass
_ALIKE = 0.015  # m: points so near each other are one
_SPACING = 0.04  # m between the points of an echo's arc
_SLACK = 0.04  # m: points of the laser stand for arcs of this length (`_FINE`)
_ECHO = 2.5  # m: farther echoes do not matter yet
_AGREE = 0.15  # m: laser and ultrasonic together err by less
_KNOWN_LAG = 0.03  # s: of a scan that comes in time, which the reaction time includes
_LOW = 1.3  # ratio of a scan's greatest age to the estimate: the fit prefers no motion
_ELSEWHERE = 0.3  # m or rad between two places at which a ranger is tried
_FIRING = 5e-3  # s: stamps of two firings differ by more
_MISSED = 0.3  # m: an echo that comes so far behind a surface is not of it
_STEADY, _NEARER, _TURNED = 0.05, 0.3, 0.5  # m, m, rad: a range that stays, motions that change it
_NEARLY = 1e-9


@inlined
def _nearer(edge: np.float32, r: np.float32) -> np.float32:
    """A beam's range where it is slightly nearer than the median, which cuts off edges."""
    return edge if r - JUMP < edge < r else r


@borrowing_kernel
def last_rows(rows: Any, n: int, maximum: int) -> int:
    """Keep at most `maximum` of n rows, the last ones; returns their number."""
    over = max(0, n - maximum)
    if over > 0:
        for k in range(maximum):
            rows[k] = rows[k + over]
    return n - over


@borrowing_kernel
def _compact(points: Any, kept: Bytes, begin: int, end: int, to: int) -> int:
    """Move the kept ones of points begin to end to `to` and on; returns where they end."""
    x, y, stamp = points.x[:], points.y[:], points.stamp[:]
    n = np.uint64(to)
    for k in range(np.uint64(begin), np.uint64(end)):
        x[n], y[n], stamp[n] = x[k], y[k], stamp[k]
        n += np.uint64(kept[k])
    moved: int = as_int(n)
    return moved


@borrowing_kernel
def _find_kept(s: Any, scan: Scan, work: Any) -> None:
    """Store 1 for each point that is neither too old, nor too far, nor its place seen again.

    A scan that may move with the chair shows no place again: it would take obstacles along.
    """
    trusted = not is_doubted(s.keys[0])
    x, y, stamp, now = s.points.x[:], s.points.y[:], s.points.stamp[:], s.stamp
    kept, far, beam = work.kept[:], work.far[:], work.beam[:]
    n, last = s.n_points, scan.minimum.shape[0] - 1
    for k in range(np.uint64(n + -n % _BLOCK)):
        dx, dy = x[k] - scan.x, y[k] - scan.y
        b = beam_towards(scan, dx, dy)
        beam[k] = b if b < last else 0
        far[k] = math.sqrt(dx * dx + dy * dy)
    for k in range(np.uint64(n)):
        again = scan.minimum[np.uint64(beam[k])] >= far[k] - SAME
        kept[k] = (now <= stamp[k]) & (far[k] <= FAR) & (not (again and trusted))


@borrowing_kernel
def _first_alike(points: Any, n: int, px: float, py: float) -> int:
    """The first of n points that is where another is, or n."""
    x, y, first = points.x[:], points.y[:], n
    for k in range(np.uint64(n + -n % _BLOCK)):
        dx, dy = x[k] - px, y[k] - py
        at = as_int(k) if dx * dx + dy * dy < _ALIKE * _ALIKE else n
        first = at if at < first else first
    return first


@borrowing_kernel
def _keep_points(g: Any, s: Any, scan: Scan, work: Any, dt: float) -> None:
    """Keep the points that the scan does not see again, and merge points that are seen twice.

    At rest, dead reckoning has no error: points age more slowly.
    """
    points = s.points
    x, y, stamp = points.x[:], points.y[:], points.stamp[:]
    if abs(s.setpoint.v) + abs(s.setpoint.w) < REST_SPEED:
        latest, younger = s.stamp + g.memory_time, (1.0 - _AGEING) * dt
        for k in range(np.uint64(s.n_points)):
            stamp[k] += younger if stamp[k] > latest else 0.0
    _find_kept(s, scan, work)
    kept = work.kept[:]
    n = old = _compact(points, kept, 0, s.n_old, 0)
    end = _compact(points, kept, s.n_old, s.n_points, old)
    for k in range(max(old, end - FRESH), end):
        alike = _first_alike(points, old, x[k], y[k])
        if alike < old:
            stamp[alike] = stamp[k]
        else:
            x[n], y[n], stamp[n] = x[k], y[k], stamp[k]
            n += 1
    last_rows(x, n, KEPT)
    last_rows(y, n, KEPT)
    s.n_points = s.n_old = last_rows(stamp, n, KEPT)


@borrowing_kernel
def _keep_marks(g: Any, s: Any, scan: Scan) -> None:
    """Keep the marks that are not too old, nor too far, and whose place is not seen again."""
    kept, edge = 0, int(EDGE * scan.per_angle)
    for k in range(s.n_marks):
        mark = s.marks[k]
        dx, dy = mark.x - scan.x, mark.y - scan.y
        far = math.sqrt(dx * dx + dy * dy)
        lasts = s.stamp - mark.stamp <= g.moving_memory_time and far <= FAR
        if lasts and not sees_beyond(scan, dx, dy, far - SAME, edge):
            s.marks[kept] = mark
            kept += 1
    s.n_marks = last_rows(s.marks[:], kept, MARKS // 2)


@borrowing_kernel
def _add_points(g: Any, s: Any, work: Any, scan: Scan, marks: int, end: int) -> None:
    """Add points in the laser's frame; one moves if its cell was empty or marks beside it moved.

    Those of a doubted scan stay for this scan alone.
    """
    x, y, stamp = s.points.x[:], s.points.y[:], s.points.stamp[:]
    near, far, begin = s.stamp + g.static_memory_time, s.stamp + g.memory_time, s.n_points
    if is_doubted(s.keys[0]):
        near = far = -math.inf
    for k in range(np.uint64(begin), np.uint64(end)):
        ahead, left = work.x[k], work.y[k]
        x[k], y[k] = point_to_world(scan.c, scan.s, scan.x, scan.y, ahead, left)
        stamp[k] = near if ahead * ahead + left * left < CLOSE_BY * CLOSE_BY else far
    s.n_points = end
    for k in range(begin, end):
        if mark_motion(g, s, x[k], y[k], work.old_marks[:], marks):
            stamp[k] = far


@borrowing_kernel
def _add_hit(s: Any, scan: Scan, x: float, y: float) -> bool:
    """Store a hit of a single beam, in the laser's frame, or match it to one of an earlier scan.

    Ghost echoes do not repeat at one place; thin objects do, though not in every scan. The oldest
    hit gives way to it. Returns False if there is no room, since all hits are of this scan.
    """
    px, py = point_to_world(scan.c, scan.s, scan.x, scan.y, x, y)
    far = math.sqrt(x * x + y * y)
    ux, uy = (px - scan.x) / far, (py - scan.y) / far
    beside, n = _HIT_BESIDE + far / scan.per_angle, 0
    for k in range(s.n_hits):
        hit = s.hits[k]
        dx, dy = hit.x - px, hit.y - py
        if abs(ux * dx + uy * dy) < _HIT_ALONG and abs(ux * dy - uy * dx) < beside:
            hit.scans += 1.0 if hit.stamp < s.stamp else 0.0
            hit.x, hit.y, hit.stamp = px, py, s.stamp
            return True
        n = k if hit.stamp < s.hits[n].stamp else n
    if s.n_hits < HITS:
        n, s.n_hits = s.n_hits, s.n_hits + 1
    elif s.hits[n].stamp == s.stamp:
        return False
    hit = s.hits[n]
    hit.x, hit.y, hit.stamp, hit.scans = px, py, s.stamp, 1.0
    return True


@borrowing_kernel
def _keep_hits(g: Any, s: Any, scan: Scan, laser: Floats) -> None:
    """Drop old hits of single beams; a hit that repeats in a second scan is an obstacle.

    A hit that beams pass is dropped sooner.
    """
    n, kept, beams, points = s.n_points, 0, laser.shape[0], s.points
    for k in range(s.n_hits):
        hit = s.hits[k]
        dx, dy = hit.x - scan.x, hit.y - scan.y
        far = math.sqrt(dx * dx + dy * dy)
        b = beam_towards(scan, dx, dy)
        passed = 1 <= b < beams - 1 and laser[b] >= far - SAME
        if s.stamp - hit.stamp > (_HIT_KEPT if passed else g.memory_time) or far > FAR:
            continue
        s.hits[kept] = hit
        kept += 1
        if hit.scans > 1.0:
            points.x[n], points.y[n] = hit.x, hit.y
            points.stamp[n] = -math.inf  # of this scan alone: it is added again after each scan
            n += 1
    s.n_hits, s.n_points = kept, n


@borrowing_kernel
def _drop_passed(s: Any, scan: Scan, in_view: Bytes, first: int) -> None:
    """Drop moving points not seen again near one that was: they are a body's earlier position.

    A mark at the edge of the view is no evidence: its body may reach beyond.
    """
    kept = 0
    for k in range(first, s.n_marks):
        ahead, left = world_to_body(scan.c, scan.s, s.marks[k].x - scan.x, s.marks[k].y - scan.y)
        in_view[k] = abs(atan2_f32(_F(left), _F(ahead))) < abs(scan.first) - EDGE
    for k in range(s.n_marks):
        passed = False
        for i in range(first if k < first else s.n_marks, s.n_marks):
            if not in_view[i]:
                continue
            dx, dy = s.marks[i].x - s.marks[k].x, s.marks[i].y - s.marks[k].y
            passed = passed or dx * dx + dy * dy < BODY * BODY
        if not passed:
            s.marks[kept] = s.marks[k]
            kept += 1
    s.n_marks = kept


@borrowing_kernel
def _find_medians(s: Any, one: LaserArrays, scan: Scan, laser: Floats, medians: Floats) -> None:
    """Store the median of each three beams, and add what a single one of them hits.

    It rejects lost echoes. Too near (-inf) counts as the laser's minimum range. Single hits that
    do not fit, since a scan has too many for ghosts, replace the median.
    """
    beams = laser.shape[0]
    nearest, far = _F(one.nearest), _F(FAR)
    medians[beams] = _INF
    for b in (0, beams - 1):
        medians[b] = nearest if laser[b] == -_INF else laser[b]
    for begin in range(1, beams - 1, _BLOCK):
        end, found = min(begin + _BLOCK, beams - 1), 0
        for b in range(np.uint64(begin), np.uint64(end)):
            r = median3(laser[b - _ONE], laser[b], laser[b + _ONE])
            single = max(laser[b], nearest)
            found |= (single < r - JUMP) & (single <= far)
            medians[b] = nearest if r == -_INF else r
        for b in range(begin, end if found else begin):
            r, single = median3(laser[b - 1], laser[b], laser[b + 1]), max(laser[b], nearest)
            x, y = single * one.cosine[b], single * one.sine[b]
            if single < r - JUMP and single <= far and not _add_hit(s, scan, x, y):
                medians[b] = single


@inlined
def _put(work: Any, n: int, x: np.float32, y: np.float32) -> int:
    """Store a point in the laser's frame as the n-th if it fits; returns n + 1."""
    if n < SCANNED:
        work.x[n], work.y[n] = x, y
    return n + 1


@borrowing_kernel
def _find_points(one: LaserArrays, work: Any, laser: Floats, medians: Floats, n: int) -> int:
    """Store points from the n-th on in the laser's frame; returns where they end, if they fit.

    Neighbouring beams on one surface become one point, the mean of their ranges, which averages
    noise. Where the arc ends in the open it is not: an oblique edge is nearer than the mean.
    """
    beams, cosine, sine = laser.shape[0], one.cosine, one.sine
    far, begin, tail, count, limit, edge = _F(FAR), 0, 0, 0, 0, False
    total, before = _F(0.0), _INF
    for b in range(beams + 1):
        r = medians[b]
        if count > 0:
            off = total - r * _F(count)
            if not (abs(off) <= _SPREAD * _F(count) and b - begin <= limit):
                mean = total / _F(count)
                i, last = begin + count // 2, begin + count - 1
                if edge and i > begin:
                    r0 = min(mean, _nearer(laser[begin], medians[begin]))
                    n = _put(work, n, r0 * cosine[begin], r0 * sine[begin])
                n = _put(work, n, mean * cosine[i], mean * sine[i])
                if not abs(r - mean) <= JUMP and last > i:
                    r0 = min(mean, _nearer(laser[tail], medians[tail]))
                    n = _put(work, n, r0 * cosine[last], r0 * sine[last])
                before, count, total = mean, 0, _F(0.0)
        if r <= far:
            if count == 0:
                begin, edge = b, bool(abs(r - before) > JUMP)
                # One point represents an arc, the longer the farther it is.
                arc = _FINE if r < _NEARBY else 2.0 * _FINE if r < 2.0 * _NEARBY else 4.0 * _FINE
                limit = int(arc * one.per_angle / r)
            count += 1
            total += r
            tail = b
        elif count == 0:
            before = _INF
    return n


@borrowing_kernel
def _find_nearest(one: LaserArrays, work: Any, medians: Floats, n: int) -> int:
    """Store the nearest hit of each group of beams from the n-th point on; returns where they end.

    For scans with more edges than fit: groups share the room that is left, 0.5 degrees of a fan of
    270 each, or less. A farther hit of a group is behind the nearest one, 1 cm per metre beside it.
    """
    beams, room = one.cosine.shape[0], SCANNED - n
    for k in range(room):
        b = k * beams // room
        for i in range(b, (k + 1) * beams // room):
            b = i if medians[i] < medians[b] or medians[b] != medians[b] else b
        if medians[b] <= _F(FAR):
            n = _put(work, n, medians[b] * one.cosine[b], medians[b] * one.sine[b])
    return n


@borrowing_kernel
def update_points(g: Any, s: Any, one: LaserArrays, scan: Scan, laser: Floats, dt: float) -> None:
    """Add a scan of a laser, dt [s] after the last one, and forget what it shows to be gone."""
    work, marks = _update_at(on_stack(_SIZE), 1)[0], s.n_marks
    beams = laser.shape[0]
    medians = floats_at(on_stack(4 * beams + 4), beams + 1)
    for k in range(marks):
        work.old_marks[k] = s.marks[k]
    _keep_points(g, s, scan, work, dt)
    _keep_marks(g, s, scan)
    first = s.n_marks
    _find_medians(s, one, scan, laser, medians)
    end = _find_points(one, work, laser, medians, s.n_points)
    if end > SCANNED:
        end = _find_nearest(one, work, medians, s.n_points)
    _add_points(g, s, work, scan, marks, end)
    _keep_hits(g, s, scan, laser)
    _drop_passed(s, scan, work.in_view[:], first)


@borrowing_kernel
def _is_explained(x: Array, y: Array, n: int, at: Frame, slope: float, r: float) -> bool:
    """Whether one of n points inside a ranger's cone explains its echo."""
    square, found = (r + _AGREE) * (r + _AGREE), 0
    for k in range(np.uint64(n + -n % _BLOCK)):
        dx, dy = x[k] - at.x, y[k] - at.y
        ahead, left = world_to_body(at.c, at.s, dx, dy)
        inside = (ahead > 0.0) & (abs(left) <= slope * ahead + _SLACK)
        found |= inside & (dx * dx + dy * dy <= square) & (k < np.uint64(n))
    return found > 0


@borrowing_kernel
def _listen(g: Any, s: Any, k: int, at: Frame, r: float) -> None:
    """Count the places at which ranger k does not hear a surface that the laser shows."""
    if r == r and s.travel - s.deaf_at[k] > _ELSEWHERE:
        surface = expected_echo(s.keys[0], at, g.ranger_half[k], g.ranger_reach[k])
        if surface < math.inf:
            s.deaf[k] = s.deaf[k] + 1 if r > surface + _MISSED else 0
            s.deaf_at[k] = s.travel


@borrowing_kernel
def _watch_steady(g: Any, s: Any, k: int, at: Frame, yaw: float, r: float, explained: bool) -> None:
    """Find an echo whose range stays the same while the chair's motion must change it.

    A point within the cone comes nearer by the part of a motion along the cone's edge, a plane by
    that along its normal, and they leave the cone if the chair turns. A plane is heard at some
    incidence: one along the motion, such as glass beside the chair, stays as far away as it is. A
    laser point that explains the echo moves so.
    """
    steady, half = s.steady[k], g.ranger_half[k]
    if not abs(steady.range - r) < _STEADY:
        steady.range, steady.stuck = math.nan, False
    if explained:
        return
    if steady.range != steady.range:
        steady.range, steady.x, steady.y, steady.yaw = r, at.x, at.y, yaw
    dx, dy, turned = at.x - steady.x, at.y - steady.y, abs(yaw - steady.yaw)
    way, along = math.sqrt(dx * dx + dy * dy), abs(at.c * dx + at.s * dy)
    off = math.acos(min(1.0, along / max(way, _NEARLY))) + g.ranger_oblique[k] + turned
    nearer = way * math.cos(off) if off < 0.5 * math.pi else 0.0
    steady.stuck = steady.stuck or nearer > _NEARER or turned > 2.0 * half + _TURNED


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
        # Where the chair was when the ranger fired: it has moved since as its wheels report.
        v, w = s.read_twist[0], s.read_twist[1]
        way, turn = v * old, w * old
        if not math.isfinite(way + turn):
            way, turn = 0.0, 0.0
        bx, by, yaw = arc_step(s.pose[0], s.pose[1], s.pose[2], -way, -turn, 1.0)
        mount = g.ranger_mount[k]
        x, y = point_to_world(math.cos(yaw), math.sin(yaw), bx, by, mount[0], mount[1])
        yaw += mount[2]
        at, slope = Frame(x, y, math.cos(yaw), math.sin(yaw)), g.ranger_slope[k]
        r = float(ultrasonic[k])
        _listen(g, s, k, at, r)
        points, others = s.points, s.others
        explained = (
            not 0.0 <= r <= min(g.ranger_reach[k], _ECHO)
            or _is_explained(points.x[:], points.y[:], s.n_points, at, slope, r)
            or _is_explained(others.x[:], others.y[:], s.n_others, at, slope, r)
        )
        _watch_steady(g, s, k, at, yaw, r, explained)
        if explained:
            s.n_arc[k], s.doubtful[k] = 0, math.nan
            continue
        moved = abs(v) * since if math.isfinite(v) else 0.0
        again = abs(s.doubtful[k] - r) <= _AGREE + moved
        s.doubtful[k] = r
        s.n_arc[k] = 0
        if again:
            half, arc = g.ranger_half[k], s.arc[k]
            n = min(ARC, 2 + int(2.0 * half * r / _SPACING))
            for i in range(n):
                angle = yaw - half + 2.0 * half * i / (n - 1)
                arc.x[i], arc.y[i] = x + r * math.cos(angle), y + r * math.sin(angle)
            s.n_arc[k] = n


@borrowing_kernel
def reset(s: Any) -> None:
    """Reset the state: nothing has been seen, the chair stands."""
    decision = s.decision
    s.begun, s.rearmed, decision.protective = False, False, False
    s.stamp, s.latched, decision.reason = 0.0, 0, NOTHING
    s.scan_hash[:] = s.sonar_hash = np.uint64(0)
    s.scan_silent[:] = s.scan_frozen[:] = s.sonar_frozen = 0.0
    s.laser_blind, s.laser_denied, s.n_lost = 0.0, 0.0, 0
    for k in range(s.keys.shape[0]):
        key = s.keys[k]
        key.begun, key.astray, key.lag, key.square, key.product = False, 0.0, 0.0, 0.0, 0.0
        key.followed, key.strange, key.marked = 0.0, 0.0, False
        key.x[:] = math.nan  # no point
        key.dark[:] = _F(0.0)
    s.odometry_silent, s.odometry_frozen, s.astray, s.ahead = 0.0, 0.0, 0.0, 0
    s.pose[:] = s.read_pose[:] = 0.0
    s.read_twist[:] = decision.asked[:] = decision.given[:] = 0.0
    set_motion(s, 0.0, 0.0, 0.0, 0.0)
    s.sonar_silent[:], s.fired[:] = 0.0, -math.inf
    s.doubtful[:], s.n_arc[:] = math.nan, 0
    s.corner[:] = 1 << 40  # far away: all cells of the grid come in as never seen
    s.travel, s.deaf[:], s.deaf_at[:] = 0.0, 0, -1.0
    s.n_dark = 0
    for k in range(s.steady.shape[0]):
        s.steady[k].range, s.steady[k].stuck = math.nan, False
    s.n_points, s.n_old, s.n_marks, s.n_hits, s.n_others, s.columns = 0, 0, 0, 0, 0, 0
    s.gap = FAR
    s.marked, s.tracker.begun = -math.inf, False


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
        s.travel += (abs(v) + abs(w)) * dt
    s.stamp = stamp
    fresh = check_sensors(g, s, pose, twist, ranges, ultrasonic, age, bumped, halted, dt)
    s.reaction_time = g.reaction_time + max(0.0, _LOW * s.keys[0].lag - _KNOWN_LAG)
    laser, way = ranges[: g.beams], (abs(v) + abs(w)) * dt
    slow = abs(s.setpoint.v) + abs(s.setpoint.w) <= g.creep_speed
    if halted:
        set_motion(s, v, 0.0, w, 0.0)
    recenter_grid(s)
    if fresh:
        first, s.n_lost, s.n_dark = scanner_at(g.scanners, g.n_scanners, 0), 0, 0
        minimum = floats_at(on_stack(4 * g.beams), g.beams)
        find_minimum(laser, first.reach, minimum)
        find_lost(s, s.keys[0], first, laser, minimum, slow, way, dt)
        scan = scan_of(first, s.pose, minimum)
        update_points(g, s, first, scan, laser, dt)
        add_lost(s, s.keys[0])
        track(g, s, laser)
        if not is_doubted(s.keys[0]):
            update_grid(g, s, scan, True)
        if not s.begun:  # the other half of the columns, too
            update_grid(g, s, scan, True)
    if g.n_scanners > 1:
        update_others(g, s, ranges, fresh, slow, way, dt)
    update_echoes(g, s, ultrasonic, age)
    s.begun = True
