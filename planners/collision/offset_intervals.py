"""The exposed pieces of offset segments, and of the arcs around convex corners.

A piece is exposed where every other segment is at least that segment's own radius away.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from planners.collision.polygon_tests import SpaceArrays
from wheelchair_gym.compiled.kernel import borrowing_kernel, kernel

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

MOST_GAPS = 64  # exposed intervals of one segment or arc


class Pieces(NamedTuple):
    """Pieces of the inflated boundary, with the solid on their left."""

    source: Index  # (k,) segment moved out, or -1 - segment: the arc round its first corner
    low: Array  # (k,) m along the segment, or rad: where it begins
    high: Array  # (k,) where it ends
    whole: Mask  # (k, 2) whether the segment or arc itself begins and ends there
    ends: Array  # (k, 4) m: where it begins and ends


@borrowing_kernel
def _subtract_interval(gaps: Array, count: int, low: float, high: float) -> int:
    """Subtract a covered interval from the exposed ones (count, 2); returns how many remain."""
    k = 0
    while k < count:
        a, b = gaps[k, 0], gaps[k, 1]
        if high <= a or low >= b:
            k += 1
        elif low > a and high < b:
            if count == gaps.shape[0]:
                return -1
            gaps[count, 0], gaps[count, 1] = high, b
            gaps[k, 1] = low
            count += 1
            k += 1
        elif low > a:
            gaps[k, 1] = low
            k += 1
        elif high < b:
            gaps[k, 0] = high
            k += 1
        else:
            count -= 1
            gaps[k, 0], gaps[k, 1] = gaps[count, 0], gaps[count, 1]
    return count


@borrowing_kernel
def _covered_on_segment(
    segments: Array, k: int, j: int, radius: float, other: float
) -> tuple[float, float]:
    """Where segment k, offset by a radius, is nearer to segment j than `other`, along k [m].

    The region that j covers is convex, so this is one interval; it is empty where low > high.
    """
    ax, ay, bx, by = segments[k, 0], segments[k, 1], segments[k, 2], segments[k, 3]
    cx, cy, dx, dy = segments[j, 0], segments[j, 1], segments[j, 2], segments[j, 3]
    length, span = math.hypot(bx - ax, by - ay), math.hypot(dx - cx, dy - cy)
    ux, uy, vx, vy = (bx - ax) / length, (by - ay) / length, (dx - cx) / span, (dy - cy) / span
    px, py = ax + radius * uy, ay - radius * ux
    low, high = math.inf, -math.inf
    shared = 0.0  # how steeply j turns away from k's outside at a common corner
    for m in range(2):
        ex, ey = (cx, cy) if m == 0 else (dx, dy)
        if (ex == ax and ey == ay) or (ex == bx and ey == by):
            shared = (uy * vx - ux * vy) * (1.0 if m == 0 else -1.0)
            if shared <= 1e-12:
                return math.inf, -math.inf
            continue
        along, aside = (ex - px) * ux + (ey - py) * uy, (ex - px) * uy - (ey - py) * ux
        if abs(aside) < other:
            half = math.sqrt(other * other - aside * aside)
            low, high = min(low, along - half), max(high, along + half)
    # Beside j: nearer than the radius to its line, between its ends.
    wide, grow = vx * (py - cy) - vy * (px - cx), vx * uy - vy * ux
    far, step = (px - cx) * vx + (py - cy) * vy, ux * vx + uy * vy
    first, last = -math.inf, math.inf
    if abs(grow) > 1e-14:
        s, t = (-other - wide) / grow, (other - wide) / grow
        first, last = min(s, t), max(s, t)
    elif abs(wide) >= other:
        return low, high
    if abs(step) > 1e-14:
        s, t = -far / step, (span - far) / step
        first, last = max(first, min(s, t)), min(last, max(s, t))
    elif far <= 0.0 or far >= span:
        return low, high
    if first < last:
        low, high = min(low, first), max(high, last)
    return low, high


@borrowing_kernel
def _wrapped(angle: float) -> float:
    return angle - 2.0 * math.pi * math.floor(angle / (2.0 * math.pi) + 0.5)


@borrowing_kernel
def _covered_on_circle(
    segments: Array, x: float, y: float, j: int, radius: float, other: float
) -> tuple[float, float]:
    """Where a circle of a radius around a point is nearer to segment j than `other` [rad].

    The discs around the points of j cover adjoining arcs, so this is one interval.
    """
    cx, cy, dx, dy = segments[j, 0], segments[j, 1], segments[j, 2], segments[j, 3]
    span = math.hypot(dx - cx, dy - cy)
    vx, vy = (dx - cx) / span, (dy - cy) / span
    foot = min(max((x - cx) * vx + (y - cy) * vy, 0.0), span)
    sx, sy = cx + foot * vx - x, cy + foot * vy - y
    gap = math.hypot(sx, sy)
    if gap >= radius + other:
        return math.inf, -math.inf
    low, high = math.inf, -math.inf
    middle = math.atan2(sy, sx)
    if (x == cx and y == cy) or (x == dx and y == dy):
        middle = math.atan2(vy, vx) if x == cx and y == cy else math.atan2(-vy, -vx)
        low, high = -0.5 * math.pi, 0.5 * math.pi
    else:
        half = _half_angle(gap, radius, other)
        low, high = -half, half
    for m in range(2):
        ex, ey = (cx - x, cy - y) if m == 0 else (dx - x, dy - y)
        far = math.hypot(ex, ey)
        if 0.0 < far < radius + other:
            at, half = _wrapped(math.atan2(ey, ex) - middle), _half_angle(far, radius, other)
            low, high = min(low, at - half), max(high, at + half)
    # Beside j: where the circle meets the lines beside it, between its ends.
    wide = vx * (y - cy) - vy * (x - cx)
    for m in range(2):
        turn = ((other if m == 0 else -other) - wide) / radius
        if abs(turn) < 1.0:
            up = math.atan2(vx, -vy)
            for k in range(2):
                angle = up + (math.acos(turn) if k == 0 else -math.acos(turn))
                qx, qy = x + radius * math.cos(angle) - cx, y + radius * math.sin(angle) - cy
                if 0.0 < qx * vx + qy * vy < span:
                    at = _wrapped(angle - middle)
                    low, high = min(low, at), max(high, at)
    return middle + low, middle + high


@borrowing_kernel
def _half_angle(far: float, radius: float, other: float) -> float:
    """Half the angle of a circle that a disc of another radius covers [rad]."""
    turn = (radius * radius + far * far - other * other) / (2.0 * radius * far)
    return math.acos(min(max(turn, -1.0), 1.0))


@kernel
def exposed_pieces(arrays: SpaceArrays, radii: Array) -> tuple[Pieces, bool]:
    """All exposed pieces, and whether the arrays held them; segments move out by radii (n,) [m]."""
    segments, before, grid = arrays.segments, arrays.before, arrays.grid
    rows, columns = arrays.corner_free.shape
    n, widest = segments.shape[0], 0.0
    for k in range(n):
        widest = max(widest, radii[k])
    room = 4 * n + 64
    source, low, high = np.empty(room, np.int64), np.empty(room), np.empty(room)
    whole, ends = np.empty((room, 2), np.bool_), np.empty((room, 4))
    gaps, seen, count, good = np.empty((MOST_GAPS, 2)), np.full(n, -1, np.int64), 0, True
    for item in range(2 * n):
        k, arc = item // 2, item % 2 == 0
        ax, ay, bx, by = segments[k, 0], segments[k, 1], segments[k, 2], segments[k, 3]
        radius, length = radii[k], math.hypot(bx - ax, by - ay)
        ux, uy = (bx - ax) / length, (by - ay) / length
        # Outward at both ends: u at the segment's begin, w at the arc's.
        if arc:
            wx, wy = ax - before[k, 0], ay - before[k, 1]
            turn = math.atan2(wx * uy - wy * ux, wx * ux + wy * uy)
            if turn <= 0.0:
                continue
            begin = math.atan2(-wx, wy)
            end = begin + turn
            # The box of both ends and of where the sides that touch the circle there meet.
            ux, uy, wx, wy = uy, -ux, wy / math.hypot(wx, wy), -wx / math.hypot(wx, wy)
            far = radius / max(1.0 + ux * wx + uy * wy, 1e-3)
            x0, x1 = min(ux, wx) * radius, max(ux, wx) * radius
            y0, y1 = min(uy, wy) * radius, max(uy, wy) * radius
            x0, x1 = ax + min(x0, (ux + wx) * far), ax + max(x1, (ux + wx) * far)
            y0, y1 = ay + min(y0, (uy + wy) * far), ay + max(y1, (uy + wy) * far)
            x0, x1 = max(x0, ax - radius), min(x1, ax + radius)
            y0, y1 = max(y0, ay - radius), min(y1, ay + radius)
        else:
            begin, end = 0.0, length
            ux, uy = uy, -ux
            wx, wy = ux, uy
            x0, x1 = min(ax, bx) + radius * ux, max(ax, bx) + radius * ux
            y0, y1 = min(ay, by) + radius * uy, max(ay, by) + radius * uy
        gaps[0, 0], gaps[0, 1] = begin, end
        left = 1
        i0 = max(0, int((y0 - widest - grid[1]) / grid[2]))
        i1 = min(rows - 1, int((y1 + widest - grid[1]) / grid[2]))
        j0 = max(0, int((x0 - widest - grid[0]) / grid[2]))
        j1 = min(columns - 1, int((x1 + widest - grid[0]) / grid[2]))
        middle = (i0 + i1) // 2
        for step in range(i1 - i0 + 1):  # from the middle out: what lies near covers most
            i = middle + (step + 1) // 2 * (1 if step % 2 == 1 else -1)
            for m in range(arrays.first[i * columns + j0], arrays.first[i * columns + j1 + 1]):
                j = arrays.members[m]
                if j == k or seen[j] == item:
                    continue
                seen[j] = item
                cx, cy = segments[j, 0] - ax, segments[j, 1] - ay
                dx, dy = segments[j, 2] - ax, segments[j, 3] - ay
                if (
                    cx * ux + cy * uy <= 0.0
                    and cx * wx + cy * wy <= 0.0
                    and dx * ux + dy * uy <= 0.0
                    and dx * wx + dy * wy <= 0.0
                ):  # behind: its points are no nearer than the corner or segment itself
                    continue
                if arc:
                    own = segments[j, 2] == ax and segments[j, 3] == ay
                    if own and segments[j, 0] == before[k, 0] and segments[j, 1] == before[k, 1]:
                        continue
                    a, b = _covered_on_circle(segments, ax, ay, j, radius, radii[j])
                    if a < b:
                        for r in range(-1, 2):
                            shift = r * 2.0 * math.pi
                            if left > 0:
                                left = _subtract_interval(gaps, left, a + shift, b + shift)
                else:
                    a, b = _covered_on_segment(segments, k, j, radius, radii[j])
                    if a < b:
                        left = _subtract_interval(gaps, left, a, b)
                if left <= 0:
                    break
            if left <= 0:
                break
        good = left >= 0 and count + left <= room
        if not good:
            break
        for g in range(left):
            a, b = gaps[g, 0], gaps[g, 1]
            source[count], low[count], high[count] = (-1 - k if arc else k), a, b
            whole[count, 0], whole[count, 1] = a == begin, b == end
            for m in range(2):
                t = a if m == 0 else b
                if arc:
                    ends[count, 2 * m] = ax + radius * math.cos(t)
                    ends[count, 2 * m + 1] = ay + radius * math.sin(t)
                else:
                    ends[count, 2 * m] = ax + radius * ux - t * uy
                    ends[count, 2 * m + 1] = ay + radius * uy + t * ux
            count += 1
    pieces = Pieces(source[:count], low[:count], high[:count], whole[:count], ends[:count])
    return pieces, good
