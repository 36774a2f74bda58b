"""The boundary of free space: segments, their order, walks along it, and where lines meet it."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from planners.collision.polygon_tests import (
    Index,
    SpaceArrays,
    blocks,
    enters_solid,
    fill_buckets,
    mark_free_corners,
    orient2d,
)
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.compiled.kernel import borrowing_kernel, kernel

NONE = -1
MAX_BUCKETS = 200_000


class Boundary(NamedTuple):
    """Closed loops of segments with the solid on their left; loops meet in single points only."""

    points: Array  # (m, 2) m, by y, then x
    begins: Index  # (n,) point at which each segment begins
    ends: Index  # (n,)
    before: Index  # (n,) point before its begin, along the boundary of the solid

    @property
    def segments(self) -> Array:
        """The segments (n, 4) [m], from begin to end."""
        return np.hstack([self.points[self.begins], self.points[self.ends]])


class Corners(NamedTuple):
    """The convex corners of obstacles; several may lie at one point."""

    place: Index  # (n,) points
    before: Index  # (n,) points: the corner before
    after: Index  # (n,) points
    first: Index  # (m + 1,) where each point's corners begin
    members: Index  # (n,) corners, point by point


@borrowing_kernel
def orientation(points: Array, a: int, b: int, c: int) -> float:
    """Return `orient2d` of three points by index: positive if c is left of the line from a to b."""
    return orient2d(
        points[a, 0], points[a, 1], points[b, 0], points[b, 1], points[c, 0], points[c, 1]
    )


@kernel
def group_by_point(which: Index, points: int) -> tuple[Index, Index]:
    """Return the bounds (points + 1,) of the group of each point, and indices (n,) by their point.

    It is a counting sort.
    """
    first, members = np.zeros(points + 1, np.int64), np.empty(len(which), np.int64)
    for p in which:
        first[p + 1] += 1
    first = np.cumsum(first)
    place = first.copy()
    for k in range(len(which)):
        members[place[which[k]]] = k
        place[which[k]] += 1
    return first, members


@kernel
def _before(points: Array, begins: Index, ends: Index) -> Index:
    """Return the point before the begin of each segment; NONE where no segment ends.

    Where loops meet in a point, an outgoing segment follows the next incoming one,
    counter-clockwise.
    """
    first, arriving = group_by_point(ends, len(points))
    before = np.full(len(begins), NONE, np.int64)
    for k in range(len(begins)):
        p, minimum = begins[k], math.inf
        for i in range(first[p], first[p + 1]):
            q = begins[arriving[i]]
            if first[p + 1] - first[p] > 1:
                ahead, behind = points[ends[k]] - points[p], points[q] - points[p]
                turn = math.atan2(
                    ahead[0] * behind[1] - ahead[1] * behind[0],
                    ahead[0] * behind[0] + ahead[1] * behind[1],
                )
                turn = turn if turn > 0.0 else turn + 2 * math.pi
                if turn >= minimum:
                    continue
                minimum = turn
            before[k] = q
    return before


def boundary(segments: ArrayLike) -> Boundary:
    """Return the boundary of segments (n, 4) [m]: closed loops with the solid on their left."""
    lines = np.asarray(segments, dtype=np.float64).reshape(-1, 4)
    ends = np.concatenate([lines[:, :2], lines[:, 2:]])
    order = np.lexsort((ends[:, 0], ends[:, 1]))
    ordered = ends[order]
    fresh = np.ones(len(ends), dtype=np.bool_)
    fresh[1:] = np.any(ordered[1:] != ordered[:-1], axis=1)
    place = np.empty(len(ends), dtype=np.int64)
    place[order] = np.cumsum(fresh) - 1
    points, n = ordered[fresh], len(lines)
    return Boundary(points, place[:n], place[n:], _before(points, place[:n], place[n:]))


def edges_within_frame(walls: ArrayLike, bounds: tuple[float, float, float, float]) -> Array | None:
    """Return segments (n, 4) [m] around free space inside a frame, from walls around obstacles.

    The result is None if a wall is not axis-aligned, or leaves the frame.
    """
    lines = np.asarray(walls, dtype=np.float64).reshape(-1, 4)
    xmin, ymin, xmax, ymax = bounds
    level = lines[:, 1] == lines[:, 3]
    inside = (lines >= (xmin, ymin, xmin, ymin)) & (lines <= (xmax, ymax, xmax, ymax))
    if not ((level ^ (lines[:, 0] == lines[:, 2])).all() and inside.all()):
        return None
    pieces, keep = [], np.ones(len(lines), dtype=np.bool_)
    # Each side of the frame: its axis and position, and its ends with the outside on the left.
    for axis, at, begin, end in (
        (1, ymin, xmax, xmin),
        (0, xmax, ymax, ymin),
        (1, ymax, xmin, xmax),
        (0, xmin, ymin, ymax),
    ):
        on = (lines[:, axis] == at) & (lines[:, axis + 2] == at)
        keep &= ~on
        covered = np.sort(lines[on][:, [1 - axis, 3 - axis]], axis=1)
        covered = covered[np.argsort(covered[:, 0])]
        low, high = min(begin, end), max(begin, end)
        free = np.stack([np.append(low, covered[:, 1]), np.append(covered[:, 0], high)], axis=1)
        free = free[free[:, 0] < free[:, 1]]
        if begin > end:
            free = free[:, ::-1]
        piece = np.full((len(free), 4), at)
        piece[:, [1 - axis, 3 - axis]] = free
        pieces.append(piece)
    return np.concatenate([lines[keep], *pieces])


@kernel
def convex_corners(around: Boundary) -> Corners:
    """Return the convex corners of a boundary: a shortest path bends at these corners only."""
    points, begins, ends, before = around
    kept, count = np.empty(len(begins), np.int64), 0
    for k in range(len(begins)):
        if before[k] != NONE and orientation(points, before[k], begins[k], ends[k]) > 0.0:
            kept[count] = k
            count += 1
    kept = kept[:count]
    place = begins[kept]
    first, members = group_by_point(place, len(points))
    return Corners(place, before[kept], ends[kept], first, members)


def build_space_arrays(segments: Array, before: Array, bounds: Array) -> SpaceArrays:
    """Return a space's arrays from segments (n, 4), corners before them (n, 2), bounds (4,) [m]."""
    xmin, ymin, xmax, ymax = bounds
    width, height = max(xmax - xmin, 0.0), max(ymax - ymin, 0.0)
    # About two buckets for each segment: an edge passes few buckets, and each holds few segments.
    size = math.sqrt((width * height or 1.0) / min(2 * len(segments) + 16, MAX_BUCKETS))
    size = max(size, width / 2000, height / 2000)
    grid = np.array([xmin - 0.5 * size, ymin - 0.5 * size, size])
    columns, rows = int(width / size) + 2, int(height / size) + 2
    counts = np.zeros(rows * columns, dtype=np.int64)
    fill_buckets(segments, grid, rows, columns, counts, np.empty(0, dtype=np.int32))
    first = np.concatenate([[0], np.cumsum(counts)])
    members = np.empty(first[-1], dtype=np.int32)
    fill_buckets(segments, grid, rows, columns, first[:-1].copy(), members)
    free = np.zeros((rows, columns), dtype=np.bool_)
    arrays = SpaceArrays(bounds, segments, before, grid, first, members, free)
    mark_free_corners(arrays)
    return arrays


@borrowing_kernel
def fraction_along(ax: float, ay: float, bx: float, by: float, x: float, y: float) -> float:
    """Return the fraction of the segment from a to b [m] at the projection of a point."""
    ux, uy = bx - ax, by - ay
    return ((x - ax) * ux + (y - ay) * uy) / (ux * ux + uy * uy)


@borrowing_kernel
def line_intersection(
    segments: Array, k: int, ax: float, ay: float, bx: float, by: float
) -> tuple[float, float]:
    """Return the point of a segment on the line from a to b [m]; exact at the segment's ends."""
    cx, cy, dx, dy = segments[k, 0], segments[k, 1], segments[k, 2], segments[k, 3]
    c, d = orient2d(ax, ay, bx, by, cx, cy), orient2d(ax, ay, bx, by, dx, dy)
    if c == 0.0:
        return cx, cy
    if d == 0.0:
        return dx, dy
    return cx + c / (c - d) * (dx - cx), cy + c / (c - d) * (dy - cy)


@kernel
def blocking_segments(
    arrays: SpaceArrays, ax: float, ay: float, bx: float, by: float
) -> tuple[Index, Array]:
    """Return the segments (n,) that block the edge from a to b [m], and its fractions there."""
    found = np.empty(arrays.segments.shape[0], dtype=np.int64)
    parts = np.empty(arrays.segments.shape[0])
    count = 0
    for k in range(arrays.segments.shape[0]):
        if blocks(arrays.segments, arrays.before, k, ax, ay, bx, by):
            x, y = line_intersection(arrays.segments, k, ax, ay, bx, by)
            found[count], parts[count] = k, fraction_along(ax, ay, bx, by, x, y)
            count += 1
    return found[:count].copy(), parts[:count].copy()


@borrowing_kernel
def last_corner_on_line(
    arrays: SpaceArrays, ax: float, ay: float, bx: float, by: float, part: float
) -> int:
    """Return the segment from the last corner exactly on the first part of an edge, or -1."""
    last, found = 0.0, -1
    for k in range(arrays.segments.shape[0]):
        x, y = arrays.segments[k, 0], arrays.segments[k, 1]
        if (
            orient2d(ax, ay, bx, by, x, y) == 0.0
            and last < fraction_along(ax, ay, bx, by, x, y) <= part
        ):
            last, found = fraction_along(ax, ay, bx, by, x, y), k
    return found


@kernel
def leads_into_solid(arrays: SpaceArrays, k: int, corner: bool, x: float, y: float) -> bool:
    """Return whether the line from a segment, or its first corner, to a point enters the solid."""
    ax, ay, bx, by = arrays.segments[k]
    if corner:
        return enters_solid(arrays.before[k, 0], arrays.before[k, 1], ax, ay, bx, by, x, y)
    return orient2d(ax, ay, bx, by, x, y) > 0.0


def segment_links(arrays: SpaceArrays) -> tuple[Index, Index]:
    """Return the next segment (n,) of each along its obstacle, and the previous one.

    Where two obstacles meet in a point, a path may pass between them.
    """
    segments = arrays.segments
    here = np.lexsort(segments.T)
    there = np.lexsort(np.hstack([arrays.before, segments[:, :2]]).T)
    preceding, following = np.empty_like(here), np.empty_like(here)
    preceding[there] = here
    following[preceding] = np.arange(len(segments))
    return following, preceding


def boundary_loop(k: int, step: Index) -> Index:
    """Return the segments of a loop (m,), beginning with one of them."""
    found = [k]
    while step[found[-1]] != k:
        found.append(int(step[found[-1]]))
    return np.array(found, dtype=np.int64)
