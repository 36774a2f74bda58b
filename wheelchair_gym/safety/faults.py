"""Checks of the scanners and other sensors, and the hits of all scanners except the first.

A sensor is at fault that is silent, repeats its data, or is blind. A scan without echoes is
accepted only without evidence against it: the previous scan predicts what is still in view, and
ultrasonics may measure what the laser misses.

Of a scanner after the first, each point is an obstacle, whatever the others see. Points whose echo
is lost stay obstacles as those of the first scanner do. A scanner that shows what is free
(`LaserSettings.shows_free`) is also taken in as the first one is: space that its beams cross has
been seen, and what enters such space moves.
"""

import math
from typing import Any

import numpy as np

from wheelchair_gym.base.arrays import Array, Floats
from wheelchair_gym.compiled.address import floats_at, on_stack
from wheelchair_gym.compiled.kernel import borrowing_kernel, inlined
from wheelchair_gym.compiled.simd import bits_of_float
from wheelchair_gym.geometry.planar import body_to_world, point_to_world, world_to_body
from wheelchair_gym.safety.agreement import (
    DARK_BEAMS,
    add_lost,
    count_expected,
    disagrees,
    find_lost,
)
from wheelchair_gym.safety.grid import (
    Scan,
    find_minimum,
    is_in_view,
    mark_motion,
    scan_of,
    scanner_frame,
    sees_beyond,
    update_grid,
    was_empty,
)
from wheelchair_gym.safety.state import (
    BODY,
    BUMPED,
    CLOSE_BY,
    EDGE,
    FAR,
    JUMP,
    KEY_POINTS,
    LASER_BLIND,
    LASER_DISAGREES,
    LASER_FROZEN,
    LASER_SILENT,
    ODOMETRY_FROZEN,
    ODOMETRY_SILENT,
    OTHERS,
    OTHERS_KEPT,
    SAME,
    SECTORS,
    SONAR_DEAF,
    SONAR_FROZEN,
    SONAR_SILENT,
    outrun,
)
from wheelchair_gym.sensors.laser import LaserArrays, median3, scanner_at
from wheelchair_gym.sensors.settings import SCANNERS

_FACTOR, _KEY = np.uint64(0x9E3779B97F4A7C15), np.uint32(0x9E3779B1)
_INF = np.float32(np.inf)
_MOVED = 1e-3  # m or rad in a period: sensors of a chair that moves more report something new
_ASKED_V, _ASKED_W = 0.1, 0.25  # m/s, rad/s: at such set points, wheels must report a motion
_OFF_V, _OFF_W = 0.25, 0.5  # m/s, rad/s: wheels so far from the set point are astray
_RUNAWAY_V, _RUNAWAY_W = 0.2, 0.4  # m/s2, rad/s2: least change of speed that counts
_ASTRAY = 0.5  # s
_VALID = 0.5  # least share of valid beams
_ROUND = 1e-6  # s
_NOISE, _ALIKE = np.float32(0.1), 0.98  # m, and the share of beams within that of one range
_FEW = 0.02  # share of the predicted echoes: with fewer, the laser counts as blind
_DEAF = 5  # places in a row at which a ranger did not hear a surface
_MINIMUM = 6  # key points that must predict an echo before the laser can count as blind


@inlined
def _lasting(condition: bool, seconds: float, dt: float) -> float:
    """Advance a timer: return the new duration [s] of a condition after a time dt [s]."""
    return seconds + dt if condition else 0.0


@borrowing_kernel
def hash_floats(values: Floats, begin: np.uint64) -> np.uint64:
    """A hash of the bits of float32 numbers (n,), continued from another hash."""
    h = begin * _FACTOR
    for k in range(np.uint64(values.shape[0])):
        key = np.uint32(np.uint32(k) * _KEY) | np.uint32(1)
        h += np.uint64(bits_of_float(values[k])) * np.uint64(key)
    return h


@borrowing_kernel
def valid_share(laser: Floats) -> float:
    """Share of beams that are not invalid (NaN)."""
    valid = 0
    for k in range(np.uint64(laser.shape[0])):
        valid += laser[k] == laser[k]
    return float(valid / laser.shape[0])


@borrowing_kernel
def count_echoes(laser: Floats) -> int:
    """Number of beams with an echo, those that are too near to be measured included."""
    echoes = 0
    for k in range(np.uint64(laser.shape[0])):
        echoes += laser[k] < _INF
    return echoes


@borrowing_kernel
def _is_of_one_range(laser: Floats) -> bool:
    """Whether a mirror stands: all beams measure one range, up to noise."""
    alike, middle = 0, laser[laser.shape[0] // 2]
    for k in range(np.uint64(laser.shape[0])):
        alike += abs(laser[k] - middle) < _NOISE
    return bool(alike >= _ALIKE * laser.shape[0])


@borrowing_kernel
def _laser_is_blind(g: Any, s: Any, one: LaserArrays, echoes: int, dt: float) -> bool:
    """Whether scans have lacked echoes, against the evidence, for too long."""
    beams, expected, heard = one.cosine.shape[0], 0, 0
    if echoes < _FEW * beams:
        expected = count_expected(s.keys[0], one, s.pose)
        for k in range(s.n_arc.shape[0]):
            heard += s.n_arc[k] > 0
    lacking = expected >= _MINIMUM and echoes * KEY_POINTS < _FEW * expected * beams
    s.laser_blind = _lasting(lacking, s.laser_blind, dt)
    s.laser_denied = _lasting(heard > 0 and echoes == 0, s.laser_denied, dt)
    blind = s.laser_blind > g.stale_laser + g.period + _ROUND
    denied = s.laser_denied > g.stale_ultrasonic + g.period + _ROUND
    return bool(blind or denied or s.n_dark >= DARK_BEAMS)


@borrowing_kernel
def _check_scanner(
    g: Any, s: Any, k: int, ranges: Floats, moves: bool, dt: float
) -> tuple[bool, int]:
    """Update the timers of scanner k; returns whether its scan is new, and the reason of a fault.

    A scanner after the first that sees nothing is no fault: it shows no free space.
    """
    one = scanner_at(g.scanners, g.n_scanners, k)
    scan = ranges[one.start : one.start + one.cosine.shape[0]]
    valid = valid_share(scan) >= _VALID
    s.scan_silent[k] = _lasting(not valid, s.scan_silent[k], dt)
    now, echoes = hash_floats(scan, np.uint64(0)), count_echoes(scan)
    # Scans without echoes have no noise, and so are equal.
    fresh = not s.begun or now != s.scan_hash[k] or echoes == 0
    fresh &= k > 0 or not _is_of_one_range(scan)
    blind = k == 0 and valid and _laser_is_blind(g, s, one, echoes, dt)
    if fresh or moves:
        s.scan_frozen[k] = _lasting(not fresh, s.scan_frozen[k], dt)
    s.scan_hash[k] = now
    if s.scan_silent[k] > g.stale_laser + _ROUND:
        return fresh, LASER_SILENT
    if s.scan_frozen[k] > g.stale_laser + _ROUND:
        return fresh, LASER_FROZEN
    return fresh, LASER_BLIND if blind else 0


@borrowing_kernel
def _check_motion(g: Any, s: Any, ranges: Floats, twist: Array, dt: float) -> int:
    """Compare the scans with the wheels' motion; returns the reason of a fault, 0: none."""
    reason = 0
    for k in range(g.n_scanners if math.isfinite(twist[0] + twist[1]) else 0):
        one = scanner_at(g.scanners, g.n_scanners, k)
        scan = ranges[one.start : one.start + one.cosine.shape[0]]
        usable = valid_share(scan) >= _VALID and count_echoes(scan) >= _FEW * scan.shape[0]
        if usable and disagrees(s.keys[k], one, s.pose, scan, twist[0], twist[1], dt):
            reason = LASER_DISAGREES
    return reason


@borrowing_kernel
def _check_ultrasonics(
    g: Any, s: Any, ultrasonic: Floats, age: Floats, moves: bool, dt: float
) -> int:
    """Update the timers of the ultrasonics; returns the reason of a fault, 0: none."""
    mounted, reason, stuck = False, 0, False
    for k in range(age.shape[0]):
        if age[k] == math.inf:  # never heard
            continue
        mounted = True
        heard = ultrasonic[k] == ultrasonic[k] and age[k] <= g.stale_ultrasonic
        s.sonar_silent[k] = _lasting(not heard, s.sonar_silent[k], dt)
        old = float(age[k]) if age[k] == age[k] else s.sonar_silent[k]
        if max(old, s.sonar_silent[k]) > g.stale_ultrasonic + _ROUND:
            reason = SONAR_SILENT
        if s.deaf[k] >= _DEAF:
            reason, s.deaf[k] = SONAR_DEAF, 0  # a fault from now on, which a person clears
        if s.steady[k].stuck:
            stuck, s.steady[k].stuck, s.steady[k].range = True, False, math.nan
    now = hash_floats(age, hash_floats(ultrasonic, np.uint64(0)))
    repeats = mounted and moves and s.begun and now == s.sonar_hash
    s.sonar_frozen = _lasting(repeats, s.sonar_frozen, dt)
    s.sonar_hash = now
    return SONAR_FROZEN if stuck or s.sonar_frozen > g.stale_ultrasonic + _ROUND else reason


@borrowing_kernel
def _runs_away(now: float, before: float, given: float, far: float, change: float) -> bool:
    """Return whether wheels depart from their command, or do not come nearer though they are far.

    All are speeds or turn rates; `change` is the least change in a period that counts.
    """
    return abs(now - given) > abs(before - given) + (-change if abs(now - given) > far else change)


@borrowing_kernel
def _check_odometry(g: Any, s: Any, pose: Array, twist: Array, halted: bool, dt: float) -> int:
    """Update the odometry's timers; returns the reason of a fault, 0: none."""
    v, w, setpoint = twist[0], twist[1], s.setpoint
    finite = math.isfinite(v + w)
    same = s.begun and finite and v == s.read_twist[0] and w == s.read_twist[1]
    for k in range(3):
        same = same and pose[k] == s.read_pose[k]
        s.read_pose[k] = pose[k]
    still = v == 0.0 and w == 0.0
    asked = abs(setpoint.v) > _ASKED_V or abs(setpoint.w) > _ASKED_W
    off = abs(v - setpoint.v) > _OFF_V or abs(w - setpoint.w) > _OFF_W
    fast, turns = outrun(s, v, w)  # the set point follows them, so that they are not off
    given, before = s.decision.given, s.read_twist
    off |= fast and _runs_away(v, before[0], given[0], _OFF_V, _RUNAWAY_V * dt)
    off |= turns and _runs_away(w, before[1], given[1], _OFF_W, _RUNAWAY_W * dt)
    s.odometry_silent = _lasting(not finite, s.odometry_silent, dt)
    frozen = (same and not still) or (finite and still and asked)
    s.odometry_frozen = _lasting(not halted and frozen, s.odometry_frozen, dt)
    s.astray = _lasting(not halted and finite and off, s.astray, dt)
    s.read_twist[0], s.read_twist[1] = v, w
    if s.odometry_silent > g.stale_odometry + _ROUND:
        return ODOMETRY_SILENT
    frozen = s.odometry_frozen > g.stale_odometry + _ROUND or s.astray > _ASTRAY
    return ODOMETRY_FROZEN if frozen else 0


@borrowing_kernel
def check_sensors(
    g: Any, s: Any, pose: Array, twist: Array, ranges: Floats, ultrasonic: Floats, age: Floats,
    bumped: bool, halted: bool, dt: float,
) -> bool:  # fmt: skip
    """Detect faults and latch them; returns whether the first scanner's scan is new and trusted."""
    v, w = twist[0], twist[1]
    moves = not math.isfinite(v + w) or abs(v) * dt > _MOVED or abs(w) * dt > _MOVED
    fresh, laser_fault = _check_scanner(g, s, 0, ranges, moves, dt)
    other_fault = 0
    for k in range(1, g.n_scanners):
        _, fault = _check_scanner(g, s, k, ranges, moves, dt)
        other_fault = fault if fault > 0 else other_fault
    laser_fault = laser_fault if laser_fault > 0 else other_fault
    motion_fault = _check_motion(g, s, ranges, twist, dt)
    laser_fault = laser_fault if laser_fault > 0 else motion_fault
    sonar_fault = _check_ultrasonics(g, s, ultrasonic, age, moves, dt)
    odometry_fault = _check_odometry(g, s, pose, twist, halted, dt)
    if bumped:
        reason = BUMPED
    elif odometry_fault > 0:
        reason = odometry_fault
    elif laser_fault == LASER_BLIND and sonar_fault > 0:
        reason = sonar_fault
    else:
        reason = laser_fault if laser_fault > 0 else sonar_fault
    if reason > 0:
        s.latched, s.rearmed = reason, False  # a fault whose cause lasts cannot be cleared
    return fresh and s.laser_blind == 0.0  # a doubtful scan clears no cell


_F = np.float32
_PASSED = 2  # readings in which a scanner sees beyond a point before it is dropped
_NEARLY = 1e-9
_ECHOES = 0.05  # share of beams: a scanner without echoes may be blind


@borrowing_kernel
def _shows_free(s: Any, one: LaserArrays, scan: Floats) -> bool:
    """Whether a scan shows what is free: it is new, and enough of its beams have an echo."""
    works = s.scan_silent[one.number] == 0.0 and s.scan_frozen[one.number] == 0.0
    return bool(one.shows_free and works and count_echoes(scan) >= _ECHOES * scan.shape[0])


@borrowing_kernel
def _is_kept(g: Any, s: Any, ranges: Floats, minimum: Floats, k: int) -> bool:
    """Whether point k of a further scanner is remembered after a reading.

    It goes where its scanner hits its place again, which gives a new point, or sees beyond it in
    two readings: a beam may miss a thin thing. `minimum` is -inf where a point is lost.
    """
    others = s.others
    dx, dy = others.x[k] - s.pose[0], others.y[k] - s.pose[1]
    if s.stamp > others.stamp[k] or dx * dx + dy * dy > FAR * FAR:
        return False
    one = scanner_at(g.scanners, g.n_scanners, others.scanner[k])
    frame = scanner_frame(one.mount, s.pose)
    dx, dy = others.x[k] - frame.x, others.y[k] - frame.y
    ahead, left = world_to_body(frame.c, frame.s, dx, dy)
    b = math.floor((math.atan2(left, ahead) - one.first) * one.per_angle)
    if b < 0 or b + 1 >= one.cosine.shape[0]:
        return True
    far, b = math.sqrt(dx * dx + dy * dy), one.start + b
    nearest, lost = min(ranges[b], ranges[b + 1]), min(minimum[b], minimum[b + 1]) == -_F(np.inf)
    if far > one.reach or lost or not nearest >= far - SAME:
        return True
    others.passed[k] += 1
    return bool(nearest > far + SAME and others.passed[k] < _PASSED)


@borrowing_kernel
def _drop_marks(s: Any, scan: Scan, begin: int) -> None:
    """Drop earlier marks where a further scanner sees beyond them, or has marked their body anew.

    Its new marks are those from `begin` on, earlier ones those of earlier readings. A mark at the
    edge of the view is no evidence: its body may reach beyond.
    """
    edge, kept = int(EDGE * scan.per_angle), 0
    for k in range(s.n_marks):
        mark = s.marks[k]
        dx, dy = mark.x - scan.x, mark.y - scan.y
        old = mark.seen < s.stamp
        gone = old and sees_beyond(scan, dx, dy, math.sqrt(dx * dx + dy * dy) - SAME, edge)
        for i in range(begin if old else s.n_marks, s.n_marks):
            ax, ay = s.marks[i].x - scan.x, s.marks[i].y - scan.y
            near = (ax - dx) ** 2 + (ay - dy) ** 2 < BODY * BODY
            gone = gone or (near and is_in_view(scan, ax, ay, edge))
        if not gone:
            s.marks[kept] = s.marks[k]
            kept += 1
    s.n_marks = kept


@borrowing_kernel
def _add_other(
    g: Any, s: Any, one: LaserArrays, scan: Scan, r: np.float32, b: int, n_marks: int
) -> None:
    """Add the hit of beam b of a further scanner at a range [m].

    The first `n_marks` marks are not of this scan.
    """
    x, y = r * one.cosine[b], r * one.sine[b]
    others, n = s.others, s.n_others
    px, py = point_to_world(scan.c, scan.s, scan.x, scan.y, x, y)
    if one.shows_free:
        moves = mark_motion(g, s, px, py, s.marks[:], n_marks)
    else:
        moves = was_empty(s, px, py)
    static = x * x + y * y < CLOSE_BY * CLOSE_BY and not moves
    others.x[n], others.y[n], others.scanner[n], others.passed[n] = px, py, one.number, 0
    others.stamp[n] = s.stamp + (g.static_memory_time if static else g.memory_time)
    s.n_others += 1


@borrowing_kernel
def _move_other(others: Any, k: int, to: int) -> None:
    """Copy point k of further scanners to another place."""
    others.x[to], others.y[to], others.stamp[to] = others.x[k], others.y[k], others.stamp[k]
    others.scanner[to], others.passed[to] = others.scanner[k], others.passed[k]


@borrowing_kernel
def _range_of_edge(g: Any, one: LaserArrays, b: int) -> float:
    """Length [m] of beam b of a scanner within the outline, at most its minimum range."""
    c, sn = math.cos(one.mount[2]), math.sin(one.mount[2])
    dx, dy = body_to_world(c, sn, one.cosine[b], one.sine[b])
    ahead = g.outline[0] - one.mount[0] if dx > 0.0 else g.outline[1] + one.mount[0]
    aside = g.outline[2] - one.mount[1] if dy > 0.0 else g.outline[2] + one.mount[1]
    r = min(ahead / max(abs(dx), _NEARLY), aside / max(abs(dy), _NEARLY))
    return float(min(max(r, 0.0), one.nearest))


@borrowing_kernel
def _without_noise(ranges: Floats, start: int, beams: int, b: int) -> np.float32:
    """Range of beam b of a scanner; where it is slightly nearer, the median of it and neighbours.

    The nearest of many noisy ranges would be too near by two standard deviations.
    """
    r = ranges[start + b]
    if 0 < b < beams - 1:
        middle = median3(ranges[start + b - 1], r, ranges[start + b + 1])
        if middle - JUMP < r < middle:
            return _F(middle)
    return _F(r)


@borrowing_kernel
def update_others(
    g: Any, s: Any, ranges: Floats, fresh: bool, slow: bool, way: float, dt: float
) -> None:
    """Add the hits of all scanners but the first: each is an obstacle, whatever the others see.

    Neighbouring beams whose ranges differ little become one point, their nearest median: each of at
    most `SECTORS` groups of beams has one at least, and more where ranges jump within the group.
    What is too near to be measured (-inf) counts as at the outline: it may be anywhere up to there.
    The last four are those of `find_lost`; `fresh`: the first scanner's lost points are of now.
    """
    kept, minima = 0, floats_at(on_stack(4 * ranges.shape[0]), ranges.shape[0])
    for k in range(1, g.n_scanners):
        one = scanner_at(g.scanners, g.n_scanners, k)
        end = one.start + one.cosine.shape[0]
        of_one, minimum = ranges[one.start : end], minima[one.start : end]
        find_minimum(of_one, one.reach, minimum)
        if fresh:
            find_lost(s, s.keys[k], one, of_one, minimum, slow, way, dt)
            add_lost(s, s.keys[k])
    for k in range(s.n_others):
        if kept < OTHERS_KEPT and _is_kept(g, s, ranges, minima, k):
            _move_other(s.others, k, kept)
            kept += 1
    for k in range(kept):  # new points come first, so that the oldest are lost
        _move_other(s.others, k, OTHERS - kept + k)
    s.n_others, far = 0, _F(FAR)
    spare = (SCANNERS - g.n_scanners) * SECTORS
    for k in range(1, g.n_scanners):
        one = scanner_at(g.scanners, g.n_scanners, k)
        beams = one.cosine.shape[0]
        scan = scan_of(one, s.pose, minima[one.start : one.start + beams])
        size = (beams + SECTORS - 1) // SECTORS
        best, at, n_marks = far, -1, s.n_marks
        for b in range(beams):
            if b % size == 0 and at >= 0:
                _add_other(g, s, one, scan, best, at, n_marks)
                at = -1
            r = _without_noise(ranges, one.start, beams, b)
            r = _F(_range_of_edge(g, one, b)) if r == -_F(np.inf) else r
            if not r <= far:  # NaN, too
                continue
            if at >= 0 and abs(r - best) > JUMP and spare > 0:
                _add_other(g, s, one, scan, best, at, n_marks)
                spare -= 1
                at = -1
            if at < 0 or r < best:
                best, at = r, b
        if at >= 0:
            _add_other(g, s, one, scan, best, at, n_marks)
        if _shows_free(s, one, ranges[one.start : one.start + beams]):
            _drop_marks(s, scan, n_marks)
            update_grid(g, s, scan, False)
    for k in range(kept):
        _move_other(s.others, OTHERS - kept + k, s.n_others)
        s.n_others += 1
