"""Hits of all scanners except the first: each point is an obstacle, whatever the others see.

Points whose echo is lost stay obstacles as those of the first scanner do.

A scanner that shows what is free (`LaserSettings.shows_free`) is also taken in as the first one is:
space that its beams cross has been seen, and what enters such space moves.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from wheelchair_gym.base.arrays import Floats
from wheelchair_gym.compiled.address import floats_at, on_stack
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.geometry.planar import body_to_world, point_to_world, world_to_body
from wheelchair_gym.safety.agreement import add_lost, find_lost
from wheelchair_gym.safety.faults import count_echoes
from wheelchair_gym.safety.grid import (
    Scan,
    find_minimum,
    is_in_view,
    mark_motion,
    scanner_frame,
    sees_beyond,
    update_grid,
    was_empty,
)
from wheelchair_gym.safety.state import (
    BODY,
    CLOSE_BY,
    EDGE,
    FAR,
    JUMP,
    OTHERS,
    OTHERS_KEPT,
    SAME,
    SECTORS,
    Frame,
)
from wheelchair_gym.sensors.laser import LaserArrays, median3, scanner_at
from wheelchair_gym.sensors.settings import SCANNERS

_F = np.float32
_PASSED = 2  # readings in which a scanner sees beyond a point before it is dropped
_NEARLY = 1e-9
_ECHOES = 0.05  # share of beams: a scanner without echoes may be blind


@borrowing_kernel
def _shows_free(s: Any, one: LaserArrays, scan: Floats) -> bool:
    """Whether a scan shows what is free: it is new, and enough of its beams have an echo."""
    works = s.other_silent[one.number] == 0.0 and s.other_frozen[one.number] == 0.0
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
    g: Any, s: Any, one: LaserArrays, frame: Frame, r: np.float32, b: int, n_marks: int
) -> None:
    """Add the hit of beam b of a further scanner at a range [m].

    The first `n_marks` marks are not of this scan.
    """
    x, y = r * one.cosine[b], r * one.sine[b]
    others, n = s.others, s.n_others
    px, py = point_to_world(frame.c, frame.s, frame.x, frame.y, x, y)
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
        beams, frame = one.cosine.shape[0], scanner_frame(one.mount, s.pose)
        size = (beams + SECTORS - 1) // SECTORS
        best, at, n_marks = far, -1, s.n_marks
        for b in range(beams):
            if b % size == 0 and at >= 0:
                _add_other(g, s, one, frame, best, at, n_marks)
                at = -1
            r = _without_noise(ranges, one.start, beams, b)
            r = _F(_range_of_edge(g, one, b)) if r == -_F(np.inf) else r
            if not r <= far:  # NaN, too
                continue
            if at >= 0 and abs(r - best) > JUMP and spare > 0:
                _add_other(g, s, one, frame, best, at, n_marks)
                spare -= 1
                at = -1
            if at < 0 or r < best:
                best, at = r, b
        if at >= 0:
            _add_other(g, s, one, frame, best, at, n_marks)
        if _shows_free(s, one, ranges[one.start : one.start + beams]):
            minimum = minima[one.start : one.start + beams]
            scan = Scan(frame.x, frame.y, frame.c, frame.s, one.first, one.per_angle, minimum)
            _drop_marks(s, scan, n_marks)
            update_grid(g, s, scan, False)
    for k in range(kept):
        _move_other(s.others, OTHERS - kept + k, s.n_others)
        s.n_others += 1
