"""Inflation of obstacles: the region in which the centre of a disc may be.

Its boundary consists of segments offset by the radius and of arcs around convex corners. A piece of
these is exposed where every other segment is at least that segment's radius away. A
circumscribed polygon replaces each arc, so the region is never too large; where two pieces would
cross, their arcs get shorter sides.

Pieces may not fit together where segments lie nearer to each other than rounding can tell. Only
there `solids.inflate` makes the region as a union of polygons, which takes 14 times as long.
Shapely's own buffer is no substitute: it comes up to 2e-7 m nearer to obstacles than the radius.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from planners.collision.boundary import build_space_arrays
from planners.collision.polygon_tests import Index, SpaceArrays, orient2d
from wheelchair_gym.base.arrays import Array, Mask
from wheelchair_gym.compiled.kernel import absorbed_kernel, borrowing_kernel, kernel

ARC = math.pi / 8  # rad: at most this much of an arc per side of its polygon
# Radii grow by this share: far below the precision of maps, far above rounding. On a raster many
# circles of one radius meet in one point or just touch; of a radius like this, no three ever do.
SHIFT = 7.310585e-7
JOIN = 1e-9  # m: ends of pieces nearer than this are one point
FINEST = 10  # largest number of times that the sides of a crossing arc are halved
MAX_GAPS = 64  # exposed intervals of one segment or arc


class Pieces(NamedTuple):
    """Pieces of the inflated boundary, with the solid on their left."""

    source: Index  # (k,) segment moved out, or -1 - segment: the arc around its first corner
    low: Array  # (k,) m along the segment, or rad: where it begins
    high: Array  # (k,) where it ends
    complete: Mask  # (k, 2) whether the segment or arc itself begins and ends there
    ends: Array  # (k, 4) m: where it begins and ends


@borrowing_kernel
def _subtract_interval(exposed: Array, count: int, low: float, high: float) -> int:
    """Subtract a covered interval from the exposed ones (count, 2); return the number left."""
    k = 0
    while k < count:
        a, b = exposed[k, 0], exposed[k, 1]
        if low <= a and high >= b:
            count -= 1
            exposed[k, 0], exposed[k, 1] = exposed[count, 0], exposed[count, 1]
            continue
        if a < low < high < b:
            if count == exposed.shape[0]:
                return -1
            exposed[count, 0], exposed[count, 1] = high, b
            count += 1
        if a < low < b:
            exposed[k, 1] = low
        elif a < high < b:
            exposed[k, 0] = high
        k += 1
    return count


@borrowing_kernel
def _covered_on_segment(
    segments: Array, k: int, j: int, radius: float, other: float
) -> tuple[float, float]:
    """Return the interval [m] of segment k, offset by a radius, nearer to segment j than `other`.

    The region that j covers is convex, so this is one interval; it is empty where low > high.
    """
    ax, ay, bx, by = segments[k, 0], segments[k, 1], segments[k, 2], segments[k, 3]
    cx, cy, dx, dy = segments[j, 0], segments[j, 1], segments[j, 2], segments[j, 3]
    length, extent = math.hypot(bx - ax, by - ay), math.hypot(dx - cx, dy - cy)
    ux, uy, vx, vy = (bx - ax) / length, (by - ay) / length, (dx - cx) / extent, (dy - cy) / extent
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
        s, t = -far / step, (extent - far) / step
        first, last = max(first, min(s, t)), min(last, max(s, t))
    elif far <= 0.0 or far >= extent:
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
    """Return the arc [rad] of a circle around a point that is nearer to segment j than `other`.

    The discs around the points of j cover adjoining arcs, so this is one interval.
    """
    cx, cy, dx, dy = segments[j, 0], segments[j, 1], segments[j, 2], segments[j, 3]
    extent = math.hypot(dx - cx, dy - cy)
    vx, vy = (dx - cx) / extent, (dy - cy) / extent
    foot = min(max((x - cx) * vx + (y - cy) * vy, 0.0), extent)
    sx, sy = cx + foot * vx - x, cy + foot * vy - y
    gap = math.hypot(sx, sy)
    if gap >= radius + other:
        return math.inf, -math.inf
    half, middle = 0.5 * math.pi, math.atan2(vy, vx)
    if x == dx and y == dy:
        middle = math.atan2(-vy, -vx)
    elif x != cx or y != cy:
        half, middle = _half_angle(gap, radius, other), math.atan2(sy, sx)
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
                if 0.0 < qx * vx + qy * vy < extent:
                    at = _wrapped(angle - middle)
                    low, high = min(low, at), max(high, at)
    return middle + low, middle + high


@borrowing_kernel
def _half_angle(far: float, radius: float, other: float) -> float:
    """Return half the angle [rad] of a circle that a disc of another radius covers."""
    turn = (radius * radius + far * far - other * other) / (2.0 * radius * far)
    return math.acos(min(max(turn, -1.0), 1.0))


class _Item(NamedTuple):
    """A segment moved out by its radius, or the arc around its first corner, if that is convex."""

    segment: int
    arc: bool
    exists: bool
    begin: float  # m along the segment, or rad
    end: float
    normals: tuple[float, float, float, float]  # outward, at the begin and at the end
    box: tuple[float, float, float, float]  # m: xmin, ymin, xmax, ymax around it


@absorbed_kernel
def _segment_item(segments: Array, k: int, radius: float) -> _Item:
    """Return a segment moved out."""
    ax, ay, bx, by = segments[k, 0], segments[k, 1], segments[k, 2], segments[k, 3]
    length = math.hypot(bx - ax, by - ay)
    ux, uy = (by - ay) / length, -((bx - ax) / length)
    x0, x1 = min(ax, bx) + radius * ux, max(ax, bx) + radius * ux
    y0, y1 = min(ay, by) + radius * uy, max(ay, by) + radius * uy
    return _Item(k, False, True, 0.0, length, (ux, uy, ux, uy), (x0, y0, x1, y1))


@absorbed_kernel
def _arc_item(arrays: SpaceArrays, k: int, radius: float) -> _Item:
    """Return the arc around a segment's first corner.

    Its box holds both ends, and where the sides that touch the circle there meet.
    """
    segments, before = arrays.segments, arrays.before
    ax, ay, bx, by = segments[k, 0], segments[k, 1], segments[k, 2], segments[k, 3]
    length = math.hypot(bx - ax, by - ay)
    ux, uy = (bx - ax) / length, (by - ay) / length
    wx, wy = ax - before[k, 0], ay - before[k, 1]
    turn = math.atan2(wx * uy - wy * ux, wx * ux + wy * uy)
    begin = math.atan2(-wx, wy)
    ux, uy, wx, wy = uy, -ux, wy / math.hypot(wx, wy), -wx / math.hypot(wx, wy)
    far = radius / max(1.0 + ux * wx + uy * wy, 1e-3)
    x0, x1 = min(ux, wx) * radius, max(ux, wx) * radius
    y0, y1 = min(uy, wy) * radius, max(uy, wy) * radius
    x0, x1 = ax + min(x0, (ux + wx) * far), ax + max(x1, (ux + wx) * far)
    y0, y1 = ay + min(y0, (uy + wy) * far), ay + max(y1, (uy + wy) * far)
    x0, x1 = max(x0, ax - radius), min(x1, ax + radius)
    y0, y1 = max(y0, ay - radius), min(y1, ay + radius)
    return _Item(k, True, turn > 0.0, begin, begin + turn, (ux, uy, wx, wy), (x0, y0, x1, y1))


@absorbed_kernel
def _cover(
    arrays: SpaceArrays, radii: Array, item: _Item, j: int, exposed: Array, left: int
) -> int:
    """Subtract what segment j covers from the `left` exposed intervals; return the number left."""
    segments, before, k = arrays.segments, arrays.before, item.segment
    ax, ay, (ux, uy, wx, wy) = segments[k, 0], segments[k, 1], item.normals
    cx, cy = segments[j, 0] - ax, segments[j, 1] - ay
    dx, dy = segments[j, 2] - ax, segments[j, 3] - ay
    if (
        cx * ux + cy * uy <= 0.0
        and cx * wx + cy * wy <= 0.0
        and dx * ux + dy * uy <= 0.0
        and dx * wx + dy * wy <= 0.0
    ):  # behind: its points are no nearer than the corner or segment itself
        return left
    if not item.arc:
        a, b = _covered_on_segment(segments, k, j, radii[k], radii[j])
        return _subtract_interval(exposed, left, a, b) if a < b else left
    meets = segments[j, 2] == ax and segments[j, 3] == ay
    if meets and segments[j, 0] == before[k, 0] and segments[j, 1] == before[k, 1]:
        return left
    a, b = _covered_on_circle(segments, ax, ay, j, radii[k], radii[j])
    if a < b:
        for r in range(-1, 2):
            shift = r * 2.0 * math.pi
            if left > 0:
                left = _subtract_interval(exposed, left, a + shift, b + shift)
    return left


@absorbed_kernel
def _expose(
    arrays: SpaceArrays, radii: Array, item: _Item, widest: float, seen: Index, exposed: Array
) -> int:
    """Write the exposed intervals of an item; return their number, -1 if there is no space."""
    grid, (rows, columns), (x0, y0, x1, y1) = arrays.grid, arrays.corner_free.shape, item.box
    number = 2 * item.segment + (not item.arc)
    exposed[0, 0], exposed[0, 1] = item.begin, item.end
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
            if j != item.segment and seen[j] != number:
                seen[j] = number
                left = _cover(arrays, radii, item, j, exposed, left)
                if left <= 0:
                    return left
    return left


@kernel
def exposed_pieces(arrays: SpaceArrays, radii: Array) -> tuple[Pieces, bool]:
    """Return the exposed pieces of segments moved out by radii (n,) [m]; false: arrays are full."""
    segments, n = arrays.segments, arrays.segments.shape[0]
    widest = radii.max() if n > 0 else 0.0
    capacity = 4 * n + 64
    source, low, high = np.empty(capacity, np.int64), np.empty(capacity), np.empty(capacity)
    complete, ends = np.empty((capacity, 2), np.bool_), np.empty((capacity, 4))
    exposed, seen, count, good = np.empty((MAX_GAPS, 2)), np.full(n, -1, np.int64), 0, True
    for number in range(2 * n):
        k, arc = number // 2, number % 2 == 0
        item = _arc_item(arrays, k, radii[k]) if arc else _segment_item(segments, k, radii[k])
        if not item.exists:
            continue
        left = _expose(arrays, radii, item, widest, seen, exposed)
        good = left >= 0 and count + left <= capacity
        if not good:
            break
        ax, ay, radius = segments[k, 0], segments[k, 1], radii[k]
        ux, uy = item.normals[0], item.normals[1]
        for g in range(left):
            a, b = exposed[g, 0], exposed[g, 1]
            source[count], low[count], high[count] = (-1 - k if arc else k), a, b
            complete[count, 0], complete[count, 1] = a == item.begin, b == item.end
            for m, t in enumerate((a, b)):
                if arc:
                    ends[count, 2 * m] = ax + radius * math.cos(t)
                    ends[count, 2 * m + 1] = ay + radius * math.sin(t)
                else:
                    ends[count, 2 * m] = ax + radius * ux - t * uy
                    ends[count, 2 * m + 1] = ay + radius * uy + t * ux
            count += 1
    pieces = Pieces(source[:count], low[:count], high[:count], complete[:count], ends[:count])
    return pieces, good


@kernel
def _offset_polygons(
    pieces: Pieces, follows: Index, segments: Array, radii: Array, halvings: Index
) -> tuple[Array, Index, Index]:
    """Return corners (v, 2) of the polygons of the pieces, each one's successor and its piece.

    Where a segment passes into the arc around its end there is no corner.
    """
    count, last = 0, np.empty(len(follows), np.int64)
    sides = np.zeros(len(follows), np.int64)
    for k in range(len(follows)):
        last[follows[k]] = k
        if pieces.source[k] < 0:
            extent = pieces.high[k] - pieces.low[k]
            sides[k] = math.ceil(extent / ARC) << halvings[k]
        count += sides[k] + 1
    corners, owner = np.empty((count, 2)), np.empty(count, np.int64)
    next_one, done = np.empty(count, np.int64), np.zeros(len(follows), np.bool_)
    count = 0
    for begin in range(len(follows)):
        k, first = begin, count
        while not done[k]:
            done[k] = True
            if not (pieces.complete[k, 0] and pieces.complete[last[k], 1]):
                corners[count] = pieces.ends[k, :2]
                owner[count] = k
                count += 1
            if sides[k] > 0:
                source = -1 - pieces.source[k]
                step = (pieces.high[k] - pieces.low[k]) / sides[k]
                reach = radii[source] / math.cos(0.5 * step)
                for i in range(sides[k]):
                    angle = pieces.low[k] + (i + 0.5) * step
                    corners[count, 0] = segments[source, 0] + reach * math.cos(angle)
                    corners[count, 1] = segments[source, 1] + reach * math.sin(angle)
                    owner[count] = k
                    count += 1
            k = follows[k]
        for i in range(first, count):
            next_one[i] = i + 1 if i + 1 < count else first
    return corners[:count], next_one[:count], owner[:count]


@kernel
def _self_intersections(arrays: SpaceArrays, follows: Index) -> Mask:
    """Return which segments meet another one, neighbours apart; segment k begins at corner k."""
    segments, meets = arrays.segments, np.zeros(len(follows), np.bool_)
    for bucket in range(len(arrays.first) - 1):
        near = arrays.members[arrays.first[bucket] : arrays.first[bucket + 1]]
        for m in range(len(near)):
            ax, ay, bx, by = segments[near[m]]
            for o in range(m):
                i, j = near[m], near[o]
                if follows[i] == j or follows[j] == i:
                    continue
                cx, cy, dx, dy = segments[j]
                if max(cx, dx) < min(ax, bx) or min(cx, dx) > max(ax, bx):
                    continue
                if max(cy, dy) < min(ay, by) or min(cy, dy) > max(ay, by):
                    continue
                a, b = orient2d(cx, cy, dx, dy, ax, ay), orient2d(cx, cy, dx, dy, bx, by)
                c, d = orient2d(ax, ay, bx, by, cx, cy), orient2d(ax, ay, bx, by, dx, dy)
                apart = (a > 0.0 and b > 0.0) or (a < 0.0 and b < 0.0)
                apart = apart or (c > 0.0 and d > 0.0) or (c < 0.0 and d < 0.0)
                if not apart:
                    meets[i] = meets[j] = True
    return meets


def _offset_boundary(arrays: SpaceArrays, radii: Array, bounds: Array) -> Array | None:
    """Return segments around the rest after each segment moved out by its radius, or None."""
    pieces, good = exposed_pieces(arrays, radii)
    if not good or not len(pieces.source):
        return np.empty((0, 4)) if good else None
    if (pieces.high - pieces.low < JOIN).any():  # pieces that only touch, up to rounding
        return None
    far, follows = cKDTree(pieces.ends[:, :2]).query(pieces.ends[:, 2:])
    if (far > JOIN).any() or len(np.unique(follows)) < len(follows):
        return None
    halvings = np.zeros(len(follows), dtype=np.int64)
    for _ in range(FINEST):
        corners, after, owner = _offset_polygons(pieces, follows, arrays.segments, radii, halvings)
        edges = np.hstack([corners, corners[after]])
        meets = _self_intersections(build_space_arrays(edges, edges[:, :2], bounds), after)
        if not meets.any():
            return edges
        finer = np.unique(owner[np.concatenate([np.flatnonzero(meets), after[meets]])])
        finer = finer[pieces.source[finer] < 0]
        if not len(finer):
            return None
        halvings[finer] += 1
    return None


def inflated_boundary(arrays: SpaceArrays, radius: float) -> Array:
    """Return segments (n, 4) [m] around the places of a disc's centre; the rest is on their left.

    No point inside is nearer than the radius [m] to anything, and no point that keeps
    radius / cos(ARC / 2) is lost. The map's borders move in by exactly the radius, if possible.

    Raises:
        ValueError: pieces do not fit together, as where segments lie nearer to each other than
            rounding can tell.
    """
    segments, bounds = arrays.segments, arrays.bounds
    x, y = segments[:, ::2], segments[:, 1::2]
    border = np.zeros(len(segments), dtype=np.bool_)
    for line, at in ((x, bounds[0]), (y, bounds[1]), (x, bounds[2]), (y, bounds[3])):
        border |= (line == at).all(axis=1)
    for shift in (0.0, SHIFT):
        radii = radius * np.where(border, 1.0 + shift, 1.0 + SHIFT)
        edges = _offset_boundary(arrays, radii, bounds + radius * np.array([1.0, 1.0, -1.0, -1.0]))
        if edges is not None:
            return edges
    raise ValueError(f"pieces of edge at {radius} m do not fit together")
